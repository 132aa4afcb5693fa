/* Exact derivatives of the unit's equations, in a direction: of inputs and states, along the solution, of the start. */

/* A copy of the block with the valid parameters and the integer inputs in force, and no changes. Those that wait to be
 * taken over aren't in force. */
static Block *begin_directions(Instance *instance) {
    Block *point = &instance->saved;
    *point = instance->block;
    restore_valid_parameters(point);
#if UNIT_INTEGER_INPUTS > 0
    if (point->n[AT_INTEGER_INPUTS_WAIT]) {
        copy_integers(point->n + FIRST_INTEGER_INPUT, point->n + AT_LAST_INTEGER_INPUTS, UNIT_INTEGER_INPUTS);
    }
#endif
    memset(instance->changes, 0, sizeof instance->changes);
    return point;
}

/* Time derivatives of signals and states at the last communication point, along the solution. */
static void time_derivatives(Instance *instance) {
    Block *point = begin_directions(instance);
    real *changes = instance->changes;
    copy_reals(changes + FIRST_STATE, point->v + FIRST_RATE, UNIT_STATES);
    /* As the last step left them: what was set since then isn't in force yet. */
#if UNIT_INPUTS > 0
    copy_reals(point->v + FIRST_INPUT, point->v + AT_LAST_INPUTS, UNIT_INPUTS);
    copy_reals(changes + FIRST_INPUT, point->v + AT_SLOPES, UNIT_INPUTS);
#endif
#if UNIT_INTEGER_INPUTS > 0
    copy_integers(point->n + FIRST_INTEGER_INPUT, point->n + AT_LAST_INTEGER_INPUTS, UNIT_INTEGER_INPUTS);
#endif
    unit_directional(point->v[AT_TIME], 1, point->v, point->n, changes);
}

/* Derivatives in the direction that gives each of the knowns the change in `seed`; in Initialization Mode those of the
 * start values. */
static void directional_derivative(Instance *instance, const fmi2ValueReference knowns[], const double seed[],
                                   size_t count) {
    Block *point = begin_directions(instance);
    real *changes = instance->changes;
    for (size_t k = 0; k < count; k++) {
        changes[knowns[k]] += (real)seed[k];
    }
    if (instance->phase != PHASE_INITIALIZATION) {
        unit_directional(point->v[AT_TIME], 0, point->v, point->n, changes);
        return;
    }
    copy_reals(point->v + FIRST_STATE, unit_start_reals + FIRST_STATE, UNIT_STATES);
    copy_reals(point->v + FIRST_DISCRETE, unit_start_reals + FIRST_DISCRETE, UNIT_DISCRETES);
    copy_integers(point->n + FIRST_INTEGER_DISCRETE, unit_start_integers + FIRST_INTEGER_DISCRETE,
                  UNIT_INTEGER_DISCRETES);
    unit_start_directional(point->v[AT_TIME], point->v, point->n, changes);
}

static int lies_in(fmi2ValueReference place, int first, int count) {
    return (long long)place >= first && (long long)place < (long long)first + count;
}

static int check_known(Call *call, fmi2ValueReference known, double change) {
    Value value;
    int is_input = lies_in(known, FIRST_INPUT, UNIT_INPUTS);
    if (!find(call, known, TYPE_REAL, &value)) {
        return 0;
    }
    if (call->instance->phase == PHASE_INITIALIZATION && !is_input) {
        const char *reason = " is not an input: in Initialization Mode the start has derivatives by inputs alone";
        return refused_value(call, value.name, reason);
    }
    if (!is_input && !lies_in(known, FIRST_STATE, UNIT_STATES)) {
        return refused_value(call, value.name, " is neither an input nor a state");
    }
    if (!isfinite(real_of(change))) {
        refused_value(call, value.name, " has the seed ");
        text_number(&call->why, real_of(change));
        text_add(&call->why, ", which must be finite");
        return 0;
    }
    return 1;
}

static fmi2Status get_directional_derivative(Call *call, const fmi2ValueReference unknowns[], size_t unknown_count,
                                             const fmi2ValueReference knowns[], size_t known_count,
                                             const double seed[], double result[]) {
    Value value;
    for (size_t k = 0; k < unknown_count; k++) {
        if (!find(call, unknowns[k], TYPE_REAL, &value)) {
            return fmi2Error;
        }
        if (!is_calculated(&value)) {
            refused_value(call, value.name, " is not calculated, so it has no derivative");
            return fmi2Error;
        }
    }
    for (size_t k = 0; k < known_count; k++) {
        if (!check_known(call, knowns[k], seed[k])) {
            return fmi2Error;
        }
    }
    if (call->instance->phase == PHASE_INITIALIZATION && !bring_up_to_date(call)) {
        return fmi2Error;
    }
    directional_derivative(call->instance, knowns, seed, known_count);
    return hand_out(call, call->instance->changes, "the derivative of ", unknowns, unknown_count, result);
}

/* Only first derivatives are supported. */
static int check_order(Call *call, const char *name, int order) {
    if (order == 1) {
        return 1;
    }
    refused_value(call, name, ": order ");
    text_integer(&call->why, order);
    text_add(&call->why, "; only order 1 is supported");
    return 0;
}

static fmi2Status set_input_derivatives(Call *call, const fmi2ValueReference references[], size_t count,
                                        const int orders[], const double values[]) {
    for (size_t k = 0; k < count; k++) {
        Value value;
        if (!find(call, references[k], TYPE_REAL, &value)) {
            return fmi2Error;
        }
        if (value.access != ACCESS_INPUT) {
            refused_value(call, value.name, " is not an input");
            return fmi2Error;
        }
        if (!check_order(call, value.name, orders[k])) {
            return fmi2Error;
        }
        if (!isfinite(real_of(values[k]))) {
            refused_value(call, value.name, ": ");
            text_number(&call->why, real_of(values[k]));
            text_add(&call->why, " must be a finite number");
            return fmi2Error;
        }
    }
#if UNIT_INPUTS > 0
    for (size_t k = 0; k < count; k++) {
        set_input_slope(call->instance, (int)references[k] - FIRST_INPUT, (real)values[k]);
    }
#endif
    return fmi2OK;
}

static fmi2Status get_output_derivatives(Call *call, const fmi2ValueReference references[], size_t count,
                                         const int orders[], double values[]) {
    for (size_t k = 0; k < count; k++) {
        Value value;
        if (!find(call, references[k], TYPE_REAL, &value)) {
            return fmi2Error;
        }
        if (value.access != ACCESS_OUTPUT) {
            refused_value(call, value.name, " is not an output");
            return fmi2Error;
        }
        if (!check_order(call, value.name, orders[k])) {
            return fmi2Error;
        }
    }
    time_derivatives(call->instance);
    return hand_out(call, call->instance->changes, "the derivative of ", references, count, values);
}
