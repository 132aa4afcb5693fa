/* Values by value reference: the place in the instance's block, integers behind the reals. So each is unique over all
 * types, and a wrong type is noticed. In FMI 3.0 that of an array is its first element's, and event indicators have
 * references behind all others. */

enum { FIRST_INDICATOR = UNIT_REALS + UNIT_INTEGERS };

/* Goes through the values that references name: in FMI 3.0 those of an array row by row. */
typedef struct {
    const Reference *references;
    size_t count;
    size_t at;      /* which of these has the next value */
    size_t element; /* which one of an array that is */
} Walk;

static Walk walk_over(const Reference references[], size_t count) {
    Walk walk = {references, count, 0, 0};
    return walk;
}

#if UNIT_FMI == 3

/* The array that a reference belongs to, as its own or as that of another element; NULL of a scalar. */
static const Array *array_of(Reference reference) {
    int low = 0, high = UNIT_ARRAYS;
    while (low < high) {
        int middle = (low + high) / 2;
        if (unit_arrays[middle].first <= (long long)reference) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    const Array *before = low > 0 ? &unit_arrays[low - 1] : NULL;
    return before != NULL && (long long)reference < (long long)before->first + before->rows * before->columns ? before : NULL;
}

/* The place of an element of an array, counted row by row: as they are stored, columns come first. */
static int place_of_element(const Array *array, size_t k) {
    return array->first + (int)k % array->columns * array->rows + (int)k / array->columns;
}

#endif

/* The reference of the next value; 0 behind the last. */
static int next_value(Walk *walk, Reference *reference) {
    if (walk->at == walk->count) {
        return 0;
    }
    *reference = walk->references[walk->at];
#if UNIT_FMI == 3
    const Array *array = array_of(*reference);
    if (array != NULL) {
        *reference = (Reference)place_of_element(array, walk->element);
        walk->element++;
        if (walk->element < (size_t)(array->rows * array->columns)) {
            return 1;
        }
    }
    walk->element = 0;
#endif
    walk->at++;
    return 1;
}

/* What may be done with one value. */
typedef struct {
    const char *name; /* NULL where no variable is shown */
    int type;
    int access;
    int place;
} Value;

static Value value_of(Reference reference) {
    Value value = {NULL, TYPE_REAL, ACCESS_HIDDEN, (int)reference};
    if (reference < UNIT_REALS) {
        const RealVariable *variable = &unit_real_variables[reference];
        value.name = variable->name;
        value.access = variable->access;
    } else if (reference - UNIT_REALS < UNIT_INTEGERS) {
        const IntegerVariable *variable = &unit_integer_variables[reference - UNIT_REALS];
        value.name = variable->name;
        value.type = variable->type;
        value.access = variable->access;
        value.place = (int)(reference - UNIT_REALS);
#if UNIT_FMI == 3 && UNIT_INDICATORS > 0
    } else if (reference - FIRST_INDICATOR < UNIT_INDICATORS) {
        value.name = unit_indicator_variables[reference - FIRST_INDICATOR];
        value.access = ACCESS_LOCAL;
#endif
    } else {
        /* There is no such place: it stays hidden. */
    }
    if (value.access == ACCESS_HIDDEN) {
        value.name = NULL;
    }
    return value;
}

/* A number of the master's as one of the model's: an infinity where it is too large for that. */
static real real_of(double number) {
    if (isnan(number) || fabs(number) <= (double)REAL_MAX) {
        return (real)number;
    }
    return number > 0 ? (real)INFINITY : -(real)INFINITY;
}

/* Adds ": `name`", and what is wrong with it. */
static int refused_value(Call *call, const char *name, const char *reason) {
    Text *text = why(call);
    text_add(text, ": `");
    text_add(text, name);
    text_add(text, "`");
    text_add(text, reason);
    return 0;
}

static int refused_number(Call *call, const char *name, double number) {
    refused_value(call, name, " = ");
    text_number(&call->why, real_of(number));
    text_add(&call->why, " must be a finite number");
    return 0;
}

/* Finds the value of a type; 0, refused, where there is none. */
static int find(Call *call, Reference reference, int type, Value *value) {
    static const char *const types[] = {"Real", "Integer", "Boolean"};
    *value = value_of(reference);
    if (value->name == NULL) {
        text_add(why(call), ": there is no variable with value reference ");
        text_integer(&call->why, reference);
        return 0;
    }
    if (value->type != type) {
        refused_value(call, value->name, " (value reference ");
        text_integer(&call->why, reference);
        text_add(&call->why, ") is of type ");
        text_add(&call->why, types[value->type]);
        return 0;
    }
    return 1;
}

static int is_calculated(const Value *value) {
    return value->access == ACCESS_LOCAL || value->access == ACCESS_OUTPUT;
}

/* Refuses to set what can't be set now. */
static int check_settable(Call *call, Reference reference, const Value *value) {
    Phase phase = call->instance->phase;
    const char *what = "calculated by the FMU and can't be set";
    if (value->access == ACCESS_TUNABLE && phase == PHASE_CONTINUOUS_TIME) {
        what = "a tunable parameter, which in model exchange can only be set in Event Mode";
    } else if (value->access == ACCESS_INPUT || value->access == ACCESS_TUNABLE) {
        return 1;
    } else if (value->access == ACCESS_DESIGNED) {
        what = "a constant of these sources, designed at export: export the FMU again to change it";
    } else if (value->access == ACCESS_FIXED) {
        if (phase == PHASE_INSTANTIATED || phase == PHASE_INITIALIZATION) {
            return 1;
        }
        what = "a fixed parameter, which can only be set before the simulation starts";
    } else {
        /* A local value or an output. */
    }
    refused_value(call, value->name, " (value reference ");
    text_integer(&call->why, reference);
    text_add(&call->why, ") is ");
    text_add(&call->why, what);
    return 0;
}

/* Tells why a step, an event or a start failed. */
static void tell_failure(Call *call, const StepError *error) {
    step_error_text(error, &call->instance->log, &call->why);
}

/* Brings what is calculated up to date: in Initialization Mode to what is set at present, in model exchange and in Event Mode to
 * the present time, states and inputs. In co-simulation it changes with steps only. */
static int bring_up_to_date(Call *call) {
    StepError error;
    if (call->instance->phase == PHASE_INITIALIZATION) {
        if (!initialise(call->instance, &error)) {
            text_add(why(call), ": ");
            tell_failure(call, &error);
            return 0;
        }
    } else if (call->instance->phase == PHASE_EVENT || call->instance->interface == MODEL_EXCHANGE) {
        evaluate(call->instance);
    } else {
        /* What the last step left holds. */
    }
    return 1;
}

/* Finds all that is read, and brings it up to date where any of it is calculated. */
static int find_all(Call *call, Walk values, int type) {
    int any_calculated = 0;
    for (Reference reference; next_value(&values, &reference);) {
        Value value;
        if (!find(call, reference, type, &value)) {
            return 0;
        }
        any_calculated |= is_calculated(&value);
    }
    if (any_calculated && call->instance->phase == PHASE_INSTANTIATED) {
        refused(call, ": calculated values are available from Initialization Mode on");
        return 0;
    }
    return !any_calculated || bring_up_to_date(call);
}

/* Begins the reason for which something, whose name is told next, has no number. */
static Text *what_is_no_number(Call *call, const char *what, const char *name) {
    Text *text = why(call);
    text_add(text, ": ");
    text_add(text, what);
    if (name != NULL) {
        text_add(text, "`");
        text_add(text, name);
        text_add(text, "`");
    }
    return text;
}

/* Answers a question for a value that is no number at the present point. STATUS_DISCARD, since a solver that only probed may
 * come back with a smaller step; with STATUS_ERROR it would have to give up. */
static Status no_number(Call *call, real value) {
    real time = call->instance->block.v[AT_TIME], numbers[2] = {value, time};
    text_marked(&call->why, " is \1n at t = \1n s, which is no finite number", numbers, 2);
    if (!is_sound(call->instance)) {
        text_add(&call->why, ": ");
        log_take_refusals(&call->instance->log, &call->why, &time);
    }
    return STATUS_DISCARD;
}

/* The number at the place of a reference. */
static real number_at(const Instance *instance, const real *numbers, Reference reference) {
#if UNIT_FMI == 3 && UNIT_INDICATORS > 0
    if (reference >= FIRST_INDICATOR) {
        return instance->indicators[reference - FIRST_INDICATOR];
    }
#else
    (void)instance;
#endif
    return numbers[reference];
}

/* Hands out numbers from the places of the block, all of them or, where one isn't finite, none. */
static Status hand_out(Call *call, const real *numbers, const char *what, Walk wanted, double values[]) {
    Walk again = wanted;
    for (Reference reference; next_value(&wanted, &reference);) {
        real number = number_at(call->instance, numbers, reference);
        if (!isfinite(number)) {
            what_is_no_number(call, what, value_of(reference).name);
            return no_number(call, number);
        }
    }
    for (Reference reference; next_value(&again, &reference); values++) {
        *values = (double)number_at(call->instance, numbers, reference);
    }
    return STATUS_OK;
}

/* Finds the event indicators where any is read. In Step Mode they are those of the end of the last step, whatever inputs were set
 * since then. */
static void find_indicators_for(Instance *instance, Walk wanted) {
#if UNIT_FMI == 3 && UNIT_INDICATORS > 0
    for (Reference reference; instance->phase != PHASE_STEP_COMPLETE && next_value(&wanted, &reference);) {
        if (reference >= FIRST_INDICATOR) {
            find_indicators(instance, instance->indicators);
            return;
        }
    }
#else
    (void)instance, (void)wanted;
#endif
}

static Status get_real(Call *call, Walk wanted, double values[]) {
    if (!find_all(call, wanted, TYPE_REAL)) {
        return STATUS_ERROR;
    }
    find_indicators_for(call->instance, wanted);
    return hand_out(call, call->instance->block.v, "", wanted, values);
}

static Status set_real_values(Call *call, Walk given, const double values[]) {
    Walk again = given;
    const double *next = values;
    for (Reference reference; next_value(&given, &reference); next++) {
        Value value;
        if (!find(call, reference, TYPE_REAL, &value) || !check_settable(call, reference, &value)) {
            return STATUS_ERROR;
        }
        if (!isfinite(real_of(*next))) {
            refused_number(call, value.name, *next);
            return STATUS_ERROR;
        }
    }
    next = values;
    for (Reference reference; next_value(&again, &reference); next++) {
        set_real(call->instance, (int)reference, (real)*next);
    }
    return STATUS_OK;
}

/* Whole numbers of the master's, in the type of the function that was called. */
static void put_whole(Function function, void *values, size_t k, int value);
static int64_t whole_at(Function function, const void *values, size_t k);

static Status get_integer(Call *call, int type, Walk wanted, void *values) {
    size_t k = 0;
    if (!find_all(call, wanted, type)) {
        return STATUS_ERROR;
    }
    for (Reference reference; next_value(&wanted, &reference); k++) {
        put_whole(call->function, values, k, call->instance->block.n[reference - UNIT_REALS]);
    }
    return STATUS_OK;
}

/* A choice has only the numbers of its items; limits of an integer are checked with all parameters. */
static int check_item(Call *call, const Value *value, int64_t number) {
    const IntegerVariable *variable = &unit_integer_variables[value->place];
    if (variable->items == NULL || (number >= variable->min && number <= variable->max)) {
        return 1;
    }
    refused_value(call, value->name, " = ");
    text_integer(&call->why, number);
    text_add(&call->why, " is no item; there are ");
    text_add(&call->why, variable->items);
    return 0;
}

static Status set_integer_values(Call *call, int type, Walk given, const void *values) {
    Walk again = given;
    size_t k = 0;
    for (Reference reference; next_value(&given, &reference); k++) {
        Value value;
        if (!find(call, reference, type, &value) || !check_settable(call, reference, &value) ||
            !check_item(call, &value, whole_at(call->function, values, k))) {
            return STATUS_ERROR;
        }
    }
    k = 0;
    for (Reference reference; next_value(&again, &reference); k++) {
        int place = (int)(reference - UNIT_REALS), value = (int)whole_at(call->function, values, k);
        value = type == TYPE_BOOLEAN ? value != 0 : value;
        if (call->instance->phase == PHASE_CONTINUOUS_TIME) {
            /* Parameters were refused, so this is an input. */
            set_integer_input_between_events(call->instance, place, value);
        } else {
            set_integer(call->instance, place, value);
        }
    }
    return STATUS_OK;
}
