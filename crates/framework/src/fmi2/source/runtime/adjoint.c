/* Adjoint derivatives: a seed of unknowns times their derivatives by each known. A unit has a function for them where that isn't too
 * long; else, and at the start, they come from the derivatives in the direction of each known. */

/* Where results lie: those by inputs, by states, and by time. */
enum { ADJOINT_STATES = UNIT_INPUTS, ADJOINT_TIME = ADJOINT_STATES + UNIT_STATES, ADJOINTS = ADJOINT_TIME + 1 };

static int place_of_adjoint(Reference known) {
    if (lies_in(known, FIRST_INPUT, UNIT_INPUTS)) {
        return (int)known - FIRST_INPUT;
    }
    return lies_in(known, FIRST_STATE, UNIT_STATES) ? ADJOINT_STATES + (int)known - FIRST_STATE : ADJOINT_TIME;
}

/* The result by one known. */
static real adjoint_by(Instance *instance, Reference known, Walk unknowns, const double seed[]) {
    real sum = R(0.0);
    Block *point = begin_directions(instance);
    instance->changes[known] = R(1.0);
    along_changes(instance, point);
    for (Reference unknown; next_value(&unknowns, &unknown); seed++) {
        sum += (real)*seed * instance->changes[unknown];
    }
    return sum;
}

#ifdef UNIT_HAS_ADJOINT

/* The results by all knowns. */
static void adjoints_by_all(Instance *instance, Walk unknowns, const double seed[], real results[]) {
    const Block *point = begin_directions(instance);
    real *changes = instance->changes;
    for (Reference unknown; next_value(&unknowns, &unknown); seed++) {
        changes[unknown] += (real)*seed;
    }
    unit_adjoint(point->v[AT_TIME], point->v, point->n, changes, results);
    /* A state that is asked for changes as it changes itself, and so does time. */
    for (int k = 0; k < UNIT_STATES; k++) {
        results[ADJOINT_STATES + k] += changes[FIRST_STATE + k];
    }
    results[ADJOINT_TIME] += changes[AT_TIME];
}

#endif

static Status get_adjoint_derivative(Call *call, Walk unknowns, Walk knowns, const double seed[], double result[]) {
    Instance *instance = call->instance;
    real results[ADJOINTS];
    if (!begin_derivatives(call, unknowns, knowns, unknowns, seed)) {
        return STATUS_ERROR;
    }
    int is_known = 0;
#ifdef UNIT_HAS_ADJOINT
    if (instance->phase != PHASE_INITIALIZATION) {
        adjoints_by_all(instance, unknowns, seed, results);
        is_known = 1;
    }
#endif
    Walk again = knowns;
    for (Reference known; next_value(&knowns, &known);) {
        real *found = &results[place_of_adjoint(known)];
        if (!is_known) {
            *found = adjoint_by(instance, known, unknowns, seed);
        }
        if (!isfinite(*found)) {
            what_is_no_number(call, "the derivative of ", value_of(known).name);
            return no_number(call, *found);
        }
    }
    for (Reference known; next_value(&again, &known); result++) {
        *result = (double)results[place_of_adjoint(known)];
    }
    return STATUS_OK;
}
