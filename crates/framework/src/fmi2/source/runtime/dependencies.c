/* Which elements of variables others depend on: per element, as tables of the unit have them. */

/* Dependences that are counted, and handed out where there are places for them. Elements are counted from 1; 0 is a scalar, or all
 * of an array. */
typedef struct {
    size_t *dependent_elements;
    Reference *independents; /* NULL: they are only counted */
    size_t *independent_elements;
    fmi3DependencyKind *kinds;
    size_t count;
} Dependences;

static void add_dependence(Dependences *found, size_t dependent_element, Reference independent, size_t independent_element) {
    if (found->independents != NULL) {
        found->dependent_elements[found->count] = dependent_element;
        found->independents[found->count] = independent;
        found->independent_elements[found->count] = independent_element;
        found->kinds[found->count] = fmi3Dependent;
    }
    found->count++;
}

/* The number of the element that lies at a place, with its variable's reference. */
static size_t element_at(Reference place, Reference *reference) {
    const Array *array = array_of(place);
    *reference = place;
    if (array == NULL) {
        return 0;
    }
    int offset = (int)place - array->first;
    *reference = (Reference)array->first;
    return (size_t)(offset % array->rows * array->columns + offset / array->rows) + 1;
}

/* What an output, a state or a derivative depends on; NULL where a place is none of them. */
static const Dependent *dependent_at(Reference place) {
    for (int k = 0; k < UNIT_DEPENDENTS; k++) {
        if ((Reference)unit_dependents[k].place == place) {
            return &unit_dependents[k];
        }
    }
    return NULL;
}

/* Each event indicator on everything that it may depend on: more isn't known of it. */
static void find_dependences_of_indicators(Dependences *found) {
    for (size_t indicator = 1; indicator <= UNIT_INDICATORS; indicator++) {
        for (int k = 0; k < UNIT_INDEPENDENTS; k++) {
            add_dependence(found, indicator, (Reference)unit_independents[k], 0);
        }
    }
}

/* Finds what a variable depends on while a simulation runs or, before it does, at the start. */
static int find_dependences(Call *call, Reference dependent, Dependences *found) {
    int is_start = call->instance->phase == PHASE_INSTANTIATED || call->instance->phase == PHASE_INITIALIZATION;
    if (UNIT_INDICATORS > 0 && dependent == FIRST_INDICATOR) {
        find_dependences_of_indicators(found);
        return 1;
    }
    if (length_of(dependent) == 0 || dependent_at(dependent) == NULL) {
        text_add(why(call), ": value reference ");
        text_integer(&call->why, dependent);
        text_add(&call->why, " is no output, state or derivative of a state");
        return 0;
    }
    Walk elements = walk_over(&dependent, 1);
    for (Reference place; next_value(&elements, &place);) {
        Reference own, independent;
        size_t element = element_at(place, &own);
        const Dependent *on = dependent_at(place);
        for (int k = 0; on != NULL && k < (is_start ? on->starts : on->running); k++) {
            Reference other = (Reference)unit_dependences[(is_start ? on->first_start : on->first_running) + k];
            size_t element_of_other = element_at(other, &independent);
            add_dependence(found, element, independent, element_of_other);
        }
    }
    return 1;
}

static Status count_dependences(Call *call, Reference dependent, size_t *count) {
    Dependences found = {NULL, NULL, NULL, NULL, 0};
    if (!find_dependences(call, dependent, &found)) {
        return STATUS_ERROR;
    }
    *count = found.count;
    return STATUS_OK;
}

static Status give_dependences(Call *call, Reference dependent, Dependences *found, size_t asked) {
    size_t count;
    if (count_dependences(call, dependent, &count) != STATUS_OK) {
        return STATUS_ERROR;
    }
    if (count != asked) {
        text_add(why(call), ": nDependencies = ");
        text_integer(&call->why, (long long)asked);
        text_add(&call->why, ", but there are ");
        text_integer(&call->why, (long long)count);
        return STATUS_ERROR;
    }
    return find_dependences(call, dependent, found) ? STATUS_OK : STATUS_ERROR;
}
