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

/* Derivatives in the direction that `changes` has of inputs, states and time; in Initialization Mode those of the start values. */
static void along_changes(Instance *instance, Block *point) {
    if (instance->phase != PHASE_INITIALIZATION) {
        unit_directional(point->v[AT_TIME], instance->changes[AT_TIME], point->v, point->n, instance->changes);
        return;
    }
    copy_reals(point->v + FIRST_STATE, unit_start_reals + FIRST_STATE, UNIT_STATES);
    copy_reals(point->v + FIRST_DISCRETE, unit_start_reals + FIRST_DISCRETE, UNIT_DISCRETES);
    copy_integers(point->n + FIRST_INTEGER_DISCRETE, unit_start_integers + FIRST_INTEGER_DISCRETE,
                  UNIT_INTEGER_DISCRETES);
    unit_start_directional(point->v[AT_TIME], point->v, point->n, instance->changes);
}

/* Derivatives in the direction that gives each of the knowns the change in `seed`. */
static void directional_derivative(Instance *instance, Walk knowns, const double seed[]) {
    Block *point = begin_directions(instance);
    for (Reference known; next_value(&knowns, &known); seed++) {
        instance->changes[known] += (real)*seed;
    }
    along_changes(instance, point);
}

static int lies_in(Reference place, int first, int count) {
    return (long long)place >= first && (long long)place < (long long)first + count;
}

static int check_known(Call *call, Reference known) {
    Value value;
    int is_input = lies_in(known, FIRST_INPUT, UNIT_INPUTS);
    if (!find(call, known, TYPE_REAL, &value)) {
        return 0;
    }
    if (call->instance->phase == PHASE_INITIALIZATION && !is_input) {
        const char *reason = " is not an input: in Initialization Mode the start has derivatives by inputs only";
        return refused_value(call, value.name, reason);
    }
    /* Time is a variable in FMI 3.0 only. */
    if (!is_input && !lies_in(known, FIRST_STATE, UNIT_STATES) && known != AT_TIME) {
        return refused_value(call, value.name, " is neither an input nor a state");
    }
    return 1;
}

static int check_unknown(Call *call, Reference unknown) {
    Value value;
    if (!find(call, unknown, TYPE_REAL, &value)) {
        return 0;
    }
    if (!is_calculated(&value)) {
        return refused_value(call, value.name, " is not calculated, so it has no derivative");
    }
    if (unknown >= UNIT_REALS) {
        return refused_value(call, value.name, " is an event indicator, whose derivatives aren't known");
    }
    return 1;
}

/* Refuses what has no derivative, and a seed that isn't finite; else brings the start up to date, where derivatives are those of
 * the start. */
static int begin_derivatives(Call *call, Walk unknowns, Walk knowns, Walk seeded, const double seed[]) {
    for (Reference unknown; next_value(&unknowns, &unknown);) {
        if (!check_unknown(call, unknown)) {
            return 0;
        }
    }
    for (Reference known; next_value(&knowns, &known);) {
        if (!check_known(call, known)) {
            return 0;
        }
    }
    for (Reference reference; next_value(&seeded, &reference); seed++) {
        if (!isfinite(real_of(*seed))) {
            refused_value(call, value_of(reference).name, " has the seed ");
            text_number(&call->why, real_of(*seed));
            text_add(&call->why, ", which must be finite");
            return 0;
        }
    }
    return call->instance->phase != PHASE_INITIALIZATION || bring_up_to_date(call);
}

static Status get_directional_derivative(Call *call, Walk unknowns, Walk knowns, const double seed[], double result[]) {
    if (!begin_derivatives(call, unknowns, knowns, knowns, seed)) {
        return STATUS_ERROR;
    }
    directional_derivative(call->instance, knowns, seed);
    return hand_out(call, call->instance->changes, "the derivative of ", unknowns, result);
}

/* Only first derivatives are supported. */
static int check_order(Call *call, const char *name, Order order) {
    if (order == 1) {
        return 1;
    }
    refused_value(call, name, ": order ");
    text_integer(&call->why, order);
    text_add(&call->why, "; only order 1 is supported");
    return 0;
}

static Status get_output_derivatives(Call *call, Walk wanted, const Order orders[], double values[]) {
    Walk outputs = wanted;
    size_t at = 0;
    for (Reference reference; next_value(&outputs, &reference); at = outputs.at) {
        Value value;
        if (!find(call, reference, TYPE_REAL, &value)) {
            return STATUS_ERROR;
        }
        if (value.access != ACCESS_OUTPUT) {
            refused_value(call, value.name, " is not an output");
            return STATUS_ERROR;
        }
        if (!check_order(call, value.name, orders[at])) {
            return STATUS_ERROR;
        }
    }
    time_derivatives(call->instance);
    return hand_out(call, call->instance->changes, "the derivative of ", wanted, values);
}
