/* The functions of FMI 2.0, but for those that FMI 3.0 has, too (both.c). */

FMI2_FUNCTION(const char *, fmi2GetTypesPlatform)(void) {
    return "default";
}

FMI2_FUNCTION(const char *, fmi2GetVersion)(void) {
    return "2.0";
}

static void log_to(const Master *master, const char *instance, Status status, int category, const char *text) {
    master->logger(master->environment, instance, (fmi2Status)status, unit_categories[category], text);
}

FMI2_FUNCTION(fmi2Component, fmi2Instantiate)(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                              const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                                              fmi2Boolean logging) {
    (void)resources, (void)visible;
    if (functions == NULL) {
        return NULL;
    }
    const Master master = {functions->componentEnvironment, functions->logger, functions->allocateMemory,
                           functions->freeMemory};
    if (type != fmi2ModelExchange && type != fmi2CoSimulation) {
        char room[TEXT_ROOM];
        Text text = text_in(room, sizeof room);
        text_add(&text, "fmuType = ");
        text_integer(&text, (int)type);
        text_add(&text, " must be 0 (fmi2ModelExchange) or 1 (fmi2CoSimulation)");
        tell_no_instance(&master, "fmi2Instantiate", name, room);
        return NULL;
    }
    Interface interface = type == fmi2CoSimulation ? CO_SIMULATION : MODEL_EXCHANGE;
    return instantiate(&master, "fmi2Instantiate", interface, name, guid, logging != 0);
}

FMI2_FUNCTION(void, fmi2FreeInstance)(fmi2Component c) {
    free_instance(c);
}

FMI2_FUNCTION(fmi2Status, fmi2SetupExperiment)(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance,
                                               fmi2Real start, fmi2Boolean stop_defined, fmi2Real stop) {
    ANSWER(c, SetupExperiment, 1, setup_experiment(&call, tolerance_defined, tolerance, start, stop_defined, stop));
}

FMI2_FUNCTION(fmi2Status, fmi2EnterInitializationMode)(fmi2Component c) {
    ANSWER(c, EnterInitializationMode, 1, go_to(&call, PHASE_INITIALIZATION));
}

FMI2_FUNCTION(fmi2Status, fmi2GetReal)(fmi2Component c, const fmi2ValueReference references[], size_t count,
                                       fmi2Real values[]) {
    ANSWER(c, GetReal, has_elements(references, count) && has_elements(values, count),
           get_real(&call, walk_over(references, count), values));
}

static void put_whole(Function function, void *values, size_t k, int value) {
    (void)function;
    ((fmi2Integer *)values)[k] = value;
}

static int64_t whole_at(Function function, const void *values, size_t k) {
    (void)function;
    return ((const fmi2Integer *)values)[k];
}

FMI2_FUNCTION(fmi2Status, fmi2GetInteger)(fmi2Component c, const fmi2ValueReference references[], size_t count,
                                          fmi2Integer values[]) {
    ANSWER(c, GetInteger, has_elements(references, count) && has_elements(values, count),
           get_integer(&call, TYPE_INTEGER, walk_over(references, count), values));
}

FMI2_FUNCTION(fmi2Status, fmi2GetBoolean)(fmi2Component c, const fmi2ValueReference references[], size_t count,
                                          fmi2Boolean values[]) {
    ANSWER(c, GetBoolean, has_elements(references, count) && has_elements(values, count),
           get_integer(&call, TYPE_BOOLEAN, walk_over(references, count), values));
}

FMI2_FUNCTION(fmi2Status, fmi2SetReal)(fmi2Component c, const fmi2ValueReference references[], size_t count,
                                       const fmi2Real values[]) {
    ANSWER(c, SetReal, has_elements(references, count) && has_elements(values, count),
           set_real_values(&call, walk_over(references, count), values));
}

FMI2_FUNCTION(fmi2Status, fmi2SetInteger)(fmi2Component c, const fmi2ValueReference references[], size_t count,
                                          const fmi2Integer values[]) {
    ANSWER(c, SetInteger, has_elements(references, count) && has_elements(values, count),
           set_integer_values(&call, TYPE_INTEGER, walk_over(references, count), values));
}

FMI2_FUNCTION(fmi2Status, fmi2SetBoolean)(fmi2Component c, const fmi2ValueReference references[], size_t count,
                                          const fmi2Boolean values[]) {
    ANSWER(c, SetBoolean, has_elements(references, count) && has_elements(values, count),
           set_integer_values(&call, TYPE_BOOLEAN, walk_over(references, count), values));
}

/* No unit has a String. */
static Status answer_strings(Call *call, size_t count) {
    return count == 0 ? STATUS_OK : refused(call, ": this FMU has no variable of type String");
}

FMI2_FUNCTION(fmi2Status, fmi2GetString)(fmi2Component c, const fmi2ValueReference references[], size_t count,
                                         fmi2String values[]) {
    (void)references, (void)values;
    ANSWER(c, GetString, 1, answer_strings(&call, count));
}

FMI2_FUNCTION(fmi2Status, fmi2SetString)(fmi2Component c, const fmi2ValueReference references[], size_t count,
                                         const fmi2String values[]) {
    (void)references, (void)values;
    ANSWER(c, SetString, 1, answer_strings(&call, count));
}

FMI2_FUNCTION(fmi2Status, fmi2GetDirectionalDerivative)(fmi2Component c, const fmi2ValueReference unknowns[],
                                                        size_t unknown_count, const fmi2ValueReference knowns[],
                                                        size_t known_count, const fmi2Real seed[], fmi2Real result[]) {
    ANSWER(c, GetDirectionalDerivative,
           has_elements(unknowns, unknown_count) && has_elements(result, unknown_count) &&
               has_elements(knowns, known_count) && has_elements(seed, known_count),
           get_directional_derivative(&call, walk_over(unknowns, unknown_count), walk_over(knowns, known_count), seed, result));
}

/* Gives rates of inputs for the next step. */
static void set_input_slopes(Instance *instance, const Reference inputs[], size_t count, const double slopes[]) {
#if UNIT_INPUTS > 0
    Block *block = &instance->block;
    if (count > 0 && !block->n[AT_SLOPES_GIVEN]) {
        memset(block->v + AT_GIVEN_SLOPES, 0, UNIT_INPUTS * sizeof(real));
        block->n[AT_SLOPES_GIVEN] = 1;
    }
    for (size_t k = 0; k < count; k++) {
        block->v[AT_GIVEN_SLOPES + (int)inputs[k] - FIRST_INPUT] = (real)slopes[k];
    }
#else
    (void)instance, (void)inputs, (void)count, (void)slopes;
#endif
}

static Status set_input_derivatives(Call *call, const Reference references[], size_t count, const Order orders[],
                                    const double values[]) {
    for (size_t k = 0; k < count; k++) {
        Value value;
        if (!find(call, references[k], TYPE_REAL, &value)) {
            return STATUS_ERROR;
        }
        if (value.access != ACCESS_INPUT) {
            refused_value(call, value.name, " is not an input");
            return STATUS_ERROR;
        }
        if (!check_order(call, value.name, orders[k])) {
            return STATUS_ERROR;
        }
        if (!isfinite(real_of(values[k]))) {
            refused_value(call, value.name, ": ");
            text_number(&call->why, real_of(values[k]));
            text_add(&call->why, " must be a finite number");
            return STATUS_ERROR;
        }
    }
    set_input_slopes(call->instance, references, count, values);
    return STATUS_OK;
}

FMI2_FUNCTION(fmi2Status, fmi2SetRealInputDerivatives)(fmi2Component c, const fmi2ValueReference references[],
                                                       size_t count, const fmi2Integer orders[],
                                                       const fmi2Real values[]) {
    ANSWER(c, SetRealInputDerivatives,
           has_elements(references, count) && has_elements(orders, count) && has_elements(values, count),
           set_input_derivatives(&call, references, count, orders, values));
}

FMI2_FUNCTION(fmi2Status, fmi2GetRealOutputDerivatives)(fmi2Component c, const fmi2ValueReference references[],
                                                        size_t count, const fmi2Integer orders[], fmi2Real values[]) {
    ANSWER(c, GetRealOutputDerivatives,
           has_elements(references, count) && has_elements(orders, count) && has_elements(values, count),
           get_output_derivatives(&call, walk_over(references, count), orders, values));
}

static Status do_step(Call *call, double point, double step) {
    Status status = check_step(call, point, step);
    return status == STATUS_OK ? take_step(call, point, step) : status;
}

FMI2_FUNCTION(fmi2Status, fmi2DoStep)(fmi2Component c, fmi2Real point, fmi2Real step, fmi2Boolean no_set_prior) {
    (void)no_set_prior;
    ANSWER(c, DoStep, 1, do_step(&call, point, step));
}

/* Never allowed. */
FMI2_FUNCTION(fmi2Status, fmi2CancelStep)(fmi2Component c) {
    ANSWER(c, CancelStep, 1, STATUS_ERROR);
}

/* Nothing is ever pending: steps are never asynchronous. */
FMI2_FUNCTION(fmi2Status, fmi2GetStatus)(fmi2Component c, fmi2StatusKind kind, fmi2Status *value) {
    (void)kind, (void)value;
    ANSWER(c, GetStatus, 1, STATUS_DISCARD);
}

/* Time up to which values are valid; fmi2Discard where it is no number. */
static Status get_last_successful_time(Call *call, double *value) {
    real time = call->instance->block.v[AT_TIME];
    if (!isfinite(time)) {
        what_is_no_number(call, "the last successful time", NULL);
        return no_number(call, time);
    }
    *value = (double)time;
    return STATUS_OK;
}

FMI2_FUNCTION(fmi2Status, fmi2GetRealStatus)(fmi2Component c, fmi2StatusKind kind, fmi2Real *value) {
    ANSWER(c, GetRealStatus, value != NULL,
           kind == fmi2LastSuccessfulTime ? get_last_successful_time(&call, value) : STATUS_DISCARD);
}

FMI2_FUNCTION(fmi2Status, fmi2GetIntegerStatus)(fmi2Component c, fmi2StatusKind kind, fmi2Integer *value) {
    (void)kind, (void)value;
    ANSWER(c, GetIntegerStatus, 1, STATUS_DISCARD);
}

/* A unit never asks to end the simulation. */
FMI2_FUNCTION(fmi2Status, fmi2GetBooleanStatus)(fmi2Component c, fmi2StatusKind kind, fmi2Boolean *value) {
    ANSWER(c, GetBooleanStatus, value != NULL, kind == fmi2Terminated ? (*value = fmi2False, STATUS_OK) : STATUS_DISCARD);
}

FMI2_FUNCTION(fmi2Status, fmi2GetStringStatus)(fmi2Component c, fmi2StatusKind kind, fmi2String *value) {
    (void)kind, (void)value;
    ANSWER(c, GetStringStatus, 1, STATUS_DISCARD);
}

FMI2_FUNCTION(fmi2Status, fmi2EnterEventMode)(fmi2Component c) {
    ANSWER(c, EnterEventMode, 1, enter_event_mode(&call));
}

static Status give_event_info(Call *call, fmi2EventInfo *info) {
    Update update;
    if (new_discrete_states(call, &update) != STATUS_OK) {
        return STATUS_ERROR;
    }
    /* Other units may answer to outputs that have jumped; their answer is another update's. */
    info->newDiscreteStatesNeeded = update.changed;
    info->terminateSimulation = fmi2False;
    info->nominalsOfContinuousStatesChanged = fmi2False;
    info->valuesOfContinuousStatesChanged = update.states_jumped;
    info->nextEventTimeDefined = isfinite(update.next_event) != 0;
    info->nextEventTime = isfinite(update.next_event) ? (double)update.next_event : 0.0;
    return STATUS_OK;
}

FMI2_FUNCTION(fmi2Status, fmi2NewDiscreteStates)(fmi2Component c, fmi2EventInfo *info) {
    ANSWER(c, NewDiscreteStates, info != NULL, give_event_info(&call, info));
}
