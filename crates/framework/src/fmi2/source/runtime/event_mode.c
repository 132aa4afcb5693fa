/* Functions of FMI 3.0 that FMI 2.0 doesn't have: Event Mode and Step Mode of co-simulation, and arrays. */

/* How many values a reference names; 0 where it is no variable's, or that of an element of an array. */
static size_t length_of(Reference reference) {
    const Array *array = array_of(reference);
    if (array != NULL) {
        return reference == (Reference)array->first ? (size_t)array->rows * (size_t)array->columns : 0;
    }
    return reference < FIRST_INDICATOR ? 1 : 0;
}

/* Refuses value references that are none, or name another number of values than are given. */
static int check_values_of(Call *call, const Reference references[], size_t count, size_t given) {
    size_t expected = 0;
    for (size_t k = 0; k < count; k++) {
        size_t length = length_of(references[k]);
        if (length == 0) {
            const char *name = value_of(references[k]).name;
            text_add(why(call), ": there is no variable with value reference ");
            text_integer(&call->why, references[k]);
            if (name != NULL && references[k] < FIRST_INDICATOR) {
                text_add(&call->why, ": `");
                text_add(&call->why, name);
                text_add(&call->why, "` is an element of an array");
            }
            return 0;
        }
        expected += length;
    }
    if (expected == given) {
        return 1;
    }
    text_add(why(call), ": nValues = ");
    text_integer(&call->why, (long long)given);
    text_add(&call->why, ", but these variables have ");
    text_integer(&call->why, (long long)expected);
    text_add(&call->why, " values");
    return 0;
}

/* Refuses enumerations as Int32, and integers as Int64. */
static int check_whole(Call *call, const Reference references[], size_t count, size_t given) {
    int wants_items = call->function == CALL_GetEnumeration || call->function == CALL_SetEnumeration;
    int wants_numbers = call->function == CALL_GetInteger || call->function == CALL_SetInteger;
    if (!check_values_of(call, references, count, given)) {
        return 0;
    }
    for (size_t k = 0; (wants_items || wants_numbers) && k < count; k++) {
        Value value;
        if (!find(call, references[k], TYPE_INTEGER, &value)) {
            return 0;
        }
        if ((unit_integer_variables[value.place].items != NULL) != wants_items) {
            refused_value(call, value.name, " (value reference ");
            text_integer(&call->why, references[k]);
            text_add(&call->why, ") is of type ");
            text_add(&call->why, wants_items ? "Int32" : "Enumeration, which Int64 is for");
            return 0;
        }
    }
    return 1;
}

static Status enter_event_mode_of_step(Call *call) {
    if (call->instance->interface == CO_SIMULATION && !call->instance->event_mode) {
        return refused(call, ": the instance was made with eventModeUsed = false");
    }
    return enter_event_mode(call);
}

/* Goes on with a step behind an event: the inputs in force are those that were set. */
static Status enter_step_mode(Call *call) {
    Instance *instance = call->instance;
    Block *block = &instance->block;
    if (leave_event_mode(call, PHASE_STEP_COMPLETE) != STATUS_OK) {
        return STATUS_ERROR;
    }
#if UNIT_INPUTS > 0
    if (!block->n[AT_STARTED]) {
        /* Those before the start are none that inputs could come from. */
        copy_reals(block->v + AT_PREVIOUS_INPUTS, block->v + FIRST_INPUT, UNIT_INPUTS);
    }
    copy_reals(block->v + AT_LAST_INPUTS, block->v + FIRST_INPUT, UNIT_INPUTS);
    memset(block->v + AT_SLOPES, 0, UNIT_INPUTS * sizeof(real));
#endif
    block->n[AT_STARTED] = 1;
    keep_integer_inputs(block);
#if UNIT_INDICATORS > 0
    find_indicators(instance, instance->indicators);
#endif
    return STATUS_OK;
}

/* Whether a time event is due at the communication point where the instance is. */
static int event_due(const Instance *instance) {
    const Block *block = &instance->block;
    return unit_next_time_event(block->v, block->n) <= block->v[AT_TIME] + event_slack_of(instance);
}

/* The length up to the time event that ends a step early: one that lies within it. */
static double length_to_event(const Instance *instance, double point, double step) {
    double event = (double)unit_next_time_event(instance->block.v, instance->block.n);
    double slack = (double)EVENT_SLACK * step;
    int ends_early = instance->event_mode && instance->early_return;
    return ends_early && event > point + slack && event < point + step - slack ? event - point : step;
}

/* Whether a discrete variable that is computed has changed in the last step. */
static int discrete_differ(const Instance *instance) {
    const Block *now = &instance->block, *before = &instance->saved;
    for (int k = 0; k < UNIT_COMPUTED_DISCRETES; k++) {
        int place = unit_computed_discretes[k];
        int differs = place < UNIT_REALS ? memcmp(&now->v[place], &before->v[place], sizeof(real)) != 0
                                         : now->n[place - UNIT_REALS] != before->n[place - UNIT_REALS];
        if (differs) {
            return 1;
        }
    }
    return 0;
}

/* Outcome of a step. */
typedef struct {
    int event_needed;
    int early_return;
    double last_time;
} Stepped;

/* A step without Event Mode, or whose master takes no early return, handles events within it. */
static Status step_with_events(Call *call, double point, double step, Stepped *stepped) {
    Instance *instance = call->instance;
    stepped->last_time = (double)instance->block.v[AT_TIME];
    if (check_step(call, point, step) != STATUS_OK) {
        return STATUS_ERROR;
    }
    double length = length_to_event(instance, point, step);
    Status status = take_step(call, point, length);
    stepped->last_time = (double)instance->block.v[AT_TIME];
    if (status == STATUS_OK) {
#if UNIT_INDICATORS > 0
        find_indicators(instance, instance->indicators);
#endif
        /* A master reads discrete variables at events: flags, for example, which equations set at the end of a step. */
        stepped->event_needed = instance->event_mode && (event_due(instance) || discrete_differ(instance));
        stepped->early_return = length < step;
    }
    return status;
}
