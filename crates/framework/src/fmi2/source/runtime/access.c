/* Values by value reference: the place in the instance's block, integers behind the reals. So each is unique over all
 * types, and a wrong type is noticed. */

/* What may be done with one value. */
typedef struct {
    const char *name; /* NULL where no variable is shown */
    int type;
    int access;
    int place;
} Value;

static Value value_of(fmi2ValueReference reference) {
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
static int find(Call *call, fmi2ValueReference reference, int type, Value *value) {
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
static int check_settable(Call *call, fmi2ValueReference reference, const Value *value) {
    Phase phase = call->instance->phase;
    const char *what = "calculated by the unit and can't be set";
    if (value->access == ACCESS_TUNABLE && phase == PHASE_CONTINUOUS_TIME) {
        what = "a tunable parameter, which in model exchange can only be set in Event Mode";
    } else if (value->access == ACCESS_INPUT || value->access == ACCESS_TUNABLE) {
        return 1;
    } else if (value->access == ACCESS_DESIGNED) {
        what = "a constant of these sources, designed at export: export the unit anew to change it";
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

/* Brings what is calculated up to date: in Initialization Mode to what is set at present, in model exchange to the present
 * time, states and inputs. In co-simulation it changes with steps only. */
static int bring_up_to_date(Call *call) {
    StepError error;
    if (call->instance->phase == PHASE_INITIALIZATION) {
        if (!initialise(call->instance, &error)) {
            text_add(why(call), ": ");
            tell_failure(call, &error);
            return 0;
        }
    } else if (call->instance->interface == fmi2ModelExchange) {
        evaluate(call->instance);
    } else {
        /* What the last step left holds. */
    }
    return 1;
}

/* Finds all that is read, and brings it up to date where any of it is calculated. */
static int find_all(Call *call, const fmi2ValueReference references[], size_t count, int type) {
    int any_calculated = 0;
    for (size_t k = 0; k < count; k++) {
        Value value;
        if (!find(call, references[k], type, &value)) {
            return 0;
        }
        any_calculated |= is_calculated(&value);
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

/* Answers a question for a value that is no number at the present point. fmi2Discard, since a solver that only probed may
 * come back with a smaller step; with fmi2Error it would have to give up. */
static fmi2Status no_number(Call *call, real value) {
    real time = call->instance->block.v[AT_TIME], numbers[2] = {value, time};
    text_marked(&call->why, " is \1n at t = \1n s, which is no finite number", numbers, 2);
    if (!is_sound(call->instance)) {
        text_add(&call->why, ": ");
        log_take_refusals(&call->instance->log, &call->why, &time);
    }
    return fmi2Discard;
}

/* Hands out numbers from the places of the block, all of them or, where one isn't finite, none. */
static fmi2Status hand_out(Call *call, const real *numbers, const char *what, const fmi2ValueReference references[],
                           size_t count, double values[]) {
    for (size_t k = 0; k < count; k++) {
        if (!isfinite(numbers[references[k]])) {
            what_is_no_number(call, what, value_of(references[k]).name);
            return no_number(call, numbers[references[k]]);
        }
    }
    for (size_t k = 0; k < count; k++) {
        values[k] = (double)numbers[references[k]];
    }
    return fmi2OK;
}

static fmi2Status get_real(Call *call, const fmi2ValueReference references[], size_t count, double values[]) {
    if (!find_all(call, references, count, TYPE_REAL)) {
        return fmi2Error;
    }
    return hand_out(call, call->instance->block.v, "", references, count, values);
}

static fmi2Status set_real_values(Call *call, const fmi2ValueReference references[], size_t count,
                                  const double values[]) {
    for (size_t k = 0; k < count; k++) {
        Value value;
        if (!find(call, references[k], TYPE_REAL, &value) || !check_settable(call, references[k], &value)) {
            return fmi2Error;
        }
        if (!isfinite(real_of(values[k]))) {
            refused_number(call, value.name, values[k]);
            return fmi2Error;
        }
    }
    for (size_t k = 0; k < count; k++) {
        set_real(call->instance, (int)references[k], (real)values[k]);
    }
    return fmi2OK;
}

static fmi2Status get_integer(Call *call, int type, const fmi2ValueReference references[], size_t count, int values[]) {
    if (!find_all(call, references, count, type)) {
        return fmi2Error;
    }
    for (size_t k = 0; k < count; k++) {
        values[k] = call->instance->block.n[references[k] - UNIT_REALS];
    }
    return fmi2OK;
}

/* A choice has only the numbers of its items; limits of an integer are checked with all parameters. */
static int check_item(Call *call, const Value *value, int number) {
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

static fmi2Status set_integer_values(Call *call, int type, const fmi2ValueReference references[], size_t count,
                                     const int values[]) {
    for (size_t k = 0; k < count; k++) {
        Value value;
        if (!find(call, references[k], type, &value) || !check_settable(call, references[k], &value) ||
            !check_item(call, &value, values[k])) {
            return fmi2Error;
        }
    }
    for (size_t k = 0; k < count; k++) {
        int place = (int)(references[k] - UNIT_REALS), value = type == TYPE_BOOLEAN ? values[k] != 0 : values[k];
        if (call->instance->phase == PHASE_CONTINUOUS_TIME) {
            /* Parameters were refused, so this is an input. */
            set_integer_input_between_events(call->instance, place, value);
        } else {
            set_integer(call->instance, place, value);
        }
    }
    return fmi2OK;
}
