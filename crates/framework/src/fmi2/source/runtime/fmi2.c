/* The functions of the standard. Each call passes the table of allowed calls, and ends with its messages.
 *
 * A call that computes does so in the default floating-point modes. Where the host's can't be set aside, division by zero, invalid
 * operations and overflow may be trapped: values that nobody asks for aren't computed. */

/* Answers a call: nothing is done where it isn't allowed, or where a pointer that is needed is NULL. */
#define ANSWER(c, function, pointers_given, answer)                           \
    do {                                                                      \
        Call call;                                                            \
        fmi2Status status = fmi2Error;                                        \
        if (call_begins(&call, (c), CALL_##function, (pointers_given) != 0)) { \
            status = (answer);                                                \
        }                                                                     \
        return call_ends(&call, status);                                      \
    } while (0)

FMI2_FUNCTION(const char *, fmi2GetTypesPlatform)(void) {
    return "default";
}

FMI2_FUNCTION(const char *, fmi2GetVersion)(void) {
    return "2.0";
}

/* Why an instance can't be made; NULL where it can. */
static const char *check_instantiation(Text *why, fmi2String name, int type, fmi2String guid) {
    if (name == NULL || name[0] == '\0') {
        text_add(why, "fmi2Instantiate: instanceName is NULL or empty");
    } else if (type != fmi2ModelExchange && type != fmi2CoSimulation) {
        text_add(why, "fmi2Instantiate: fmuType = ");
        text_integer(why, type);
        text_add(why, " must be 0 (fmi2ModelExchange) or 1 (fmi2CoSimulation)");
    } else if (guid == NULL) {
        text_add(why, "fmi2Instantiate: fmuGUID is NULL");
    } else if (strcmp(guid, UNIT_GUID) != 0) {
        text_add(why, "fmi2Instantiate: the GUID `");
        text_add(why, guid);
        text_add(why, "` is not that of this unit, " UNIT_GUID ": modelDescription.xml and the sources don't belong "
                      "together");
    } else {
        return NULL;
    }
    return why->at;
}

/* Tells the master why there is no instance. */
static void tell_no_instance(const fmi2CallbackFunctions *functions, const char *name, const char *reason) {
    if (functions->logger != NULL) {
        functions->logger(functions->componentEnvironment, name != NULL ? name : "", fmi2Error,
                          unit_categories[CATEGORY_ERROR], reason);
    }
}

FMI2_FUNCTION(fmi2Component, fmi2Instantiate)(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                              const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                                              fmi2Boolean logging) {
    (void)resources, (void)visible;
    if (functions == NULL) {
        return NULL;
    }
    char room[TEXT_ROOM];
    Text text = text_in(room, sizeof room);
    const char *reason = check_instantiation(&text, name, (int)type, guid);
    Instance *instance = reason == NULL ? make_instance(functions, name) : NULL;
    if (instance == NULL) {
        tell_no_instance(functions, name, reason != NULL ? reason : "fmi2Instantiate: there is no memory for another instance");
        return NULL;
    }
    instance->interface = type;
    instance->phase = PHASE_INSTANTIATED;
    instance->has_stop_time = 0;
    instance->logs_events = logging != 0;
    instance->points_differ = 0;
    instance->salt = salt_of(instance);
    unsigned host = host_modes_aside();
    put_at_start(instance);
    host_modes_back(host);
    return instance;
}

FMI2_FUNCTION(void, fmi2FreeInstance)(fmi2Component c) {
    Instance *instance = c;
    if (instance == NULL) {
        return;
    }
    /* From the master's logger: the call that sends messages frees it when it ends. */
    instance->is_freed = 1;
    if (instance->sending == 0) {
        release(instance);
    }
}

FMI2_FUNCTION(fmi2Status, fmi2SetDebugLogging)(fmi2Component c, fmi2Boolean on, size_t count,
                                               const fmi2String categories[]) {
    ANSWER(c, SetDebugLogging, has_elements(categories, count), set_debug_logging(&call, on, count, categories));
}

FMI2_FUNCTION(fmi2Status, fmi2SetupExperiment)(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance,
                                               fmi2Real start, fmi2Boolean stop_defined, fmi2Real stop) {
    ANSWER(c, SetupExperiment, 1, setup_experiment(&call, tolerance_defined, tolerance, start, stop_defined, stop));
}

static fmi2Status go_to(Call *call, Phase phase) {
    call->instance->phase = phase;
    return fmi2OK;
}

FMI2_FUNCTION(fmi2Status, fmi2EnterInitializationMode)(fmi2Component c) {
    ANSWER(c, EnterInitializationMode, 1, go_to(&call, PHASE_INITIALIZATION));
}

FMI2_FUNCTION(fmi2Status, fmi2ExitInitializationMode)(fmi2Component c) {
    ANSWER(c, ExitInitializationMode, 1, exit_initialization_mode(&call));
}

FMI2_FUNCTION(fmi2Status, fmi2Terminate)(fmi2Component c) {
    ANSWER(c, Terminate, 1, go_to(&call, PHASE_TERMINATED));
}

FMI2_FUNCTION(fmi2Status, fmi2Reset)(fmi2Component c) {
    ANSWER(c, Reset, 1, reset(&call));
}

FMI2_FUNCTION(fmi2Status, fmi2GetReal)(fmi2Component c, const fmi2ValueReference references[], size_t count,
                                       fmi2Real values[]) {
    ANSWER(c, GetReal, has_elements(references, count) && has_elements(values, count),
           get_real(&call, references, count, values));
}

FMI2_FUNCTION(fmi2Status, fmi2GetInteger)(fmi2Component c, const fmi2ValueReference references[], size_t count,
                                          fmi2Integer values[]) {
    ANSWER(c, GetInteger, has_elements(references, count) && has_elements(values, count),
           get_integer(&call, TYPE_INTEGER, references, count, values));
}

FMI2_FUNCTION(fmi2Status, fmi2GetBoolean)(fmi2Component c, const fmi2ValueReference references[], size_t count,
                                          fmi2Boolean values[]) {
    ANSWER(c, GetBoolean, has_elements(references, count) && has_elements(values, count),
           get_integer(&call, TYPE_BOOLEAN, references, count, values));
}

FMI2_FUNCTION(fmi2Status, fmi2SetReal)(fmi2Component c, const fmi2ValueReference references[], size_t count,
                                       const fmi2Real values[]) {
    ANSWER(c, SetReal, has_elements(references, count) && has_elements(values, count),
           set_real_values(&call, references, count, values));
}

FMI2_FUNCTION(fmi2Status, fmi2SetInteger)(fmi2Component c, const fmi2ValueReference references[], size_t count,
                                          const fmi2Integer values[]) {
    ANSWER(c, SetInteger, has_elements(references, count) && has_elements(values, count),
           set_integer_values(&call, TYPE_INTEGER, references, count, values));
}

FMI2_FUNCTION(fmi2Status, fmi2SetBoolean)(fmi2Component c, const fmi2ValueReference references[], size_t count,
                                          const fmi2Boolean values[]) {
    ANSWER(c, SetBoolean, has_elements(references, count) && has_elements(values, count),
           set_integer_values(&call, TYPE_BOOLEAN, references, count, values));
}

/* No unit has a String. */
static fmi2Status answer_strings(Call *call, size_t count) {
    return count == 0 ? fmi2OK : refused(call, ": this unit has no variable of type String");
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

FMI2_FUNCTION(fmi2Status, fmi2GetFMUstate)(fmi2Component c, fmi2FMUstate *state) {
    ANSWER(c, GetFMUstate, state != NULL, get_state(&call, state));
}

FMI2_FUNCTION(fmi2Status, fmi2SetFMUstate)(fmi2Component c, fmi2FMUstate state) {
    ANSWER(c, SetFMUstate, 1, set_state(&call, state));
}

FMI2_FUNCTION(fmi2Status, fmi2FreeFMUstate)(fmi2Component c, fmi2FMUstate *state) {
    ANSWER(c, FreeFMUstate, 1, free_state(&call, state));
}

FMI2_FUNCTION(fmi2Status, fmi2SerializedFMUstateSize)(fmi2Component c, fmi2FMUstate state, size_t *size) {
    ANSWER(c, SerializedFMUstateSize, size != NULL, serialised_size(&call, state, size));
}

FMI2_FUNCTION(fmi2Status, fmi2SerializeFMUstate)(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    ANSWER(c, SerializeFMUstate, has_elements(bytes, size),
           serialise(&call, state, (unsigned char *)bytes, size));
}

FMI2_FUNCTION(fmi2Status, fmi2DeSerializeFMUstate)(fmi2Component c, const fmi2Byte bytes[], size_t size,
                                                   fmi2FMUstate *state) {
    ANSWER(c, DeSerializeFMUstate, has_elements(bytes, size) && state != NULL,
           deserialise(&call, (const unsigned char *)bytes, size, state));
}

FMI2_FUNCTION(fmi2Status, fmi2GetDirectionalDerivative)(fmi2Component c, const fmi2ValueReference unknowns[],
                                                        size_t unknown_count, const fmi2ValueReference knowns[],
                                                        size_t known_count, const fmi2Real seed[], fmi2Real result[]) {
    ANSWER(c, GetDirectionalDerivative,
           has_elements(unknowns, unknown_count) && has_elements(result, unknown_count) &&
               has_elements(knowns, known_count) && has_elements(seed, known_count),
           get_directional_derivative(&call, unknowns, unknown_count, knowns, known_count, seed, result));
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
           get_output_derivatives(&call, references, count, orders, values));
}

FMI2_FUNCTION(fmi2Status, fmi2DoStep)(fmi2Component c, fmi2Real point, fmi2Real step, fmi2Boolean no_set_prior) {
    (void)no_set_prior;
    ANSWER(c, DoStep, 1, do_step(&call, point, step));
}

/* Never allowed. */
FMI2_FUNCTION(fmi2Status, fmi2CancelStep)(fmi2Component c) {
    ANSWER(c, CancelStep, 1, fmi2Error);
}

/* Nothing is ever pending: steps are never asynchronous. */
FMI2_FUNCTION(fmi2Status, fmi2GetStatus)(fmi2Component c, fmi2StatusKind kind, fmi2Status *value) {
    (void)kind, (void)value;
    ANSWER(c, GetStatus, 1, fmi2Discard);
}

FMI2_FUNCTION(fmi2Status, fmi2GetRealStatus)(fmi2Component c, fmi2StatusKind kind, fmi2Real *value) {
    ANSWER(c, GetRealStatus, value != NULL,
           kind == fmi2LastSuccessfulTime ? get_last_successful_time(&call, value) : fmi2Discard);
}

FMI2_FUNCTION(fmi2Status, fmi2GetIntegerStatus)(fmi2Component c, fmi2StatusKind kind, fmi2Integer *value) {
    (void)kind, (void)value;
    ANSWER(c, GetIntegerStatus, 1, fmi2Discard);
}

/* A unit never asks to end the simulation. */
FMI2_FUNCTION(fmi2Status, fmi2GetBooleanStatus)(fmi2Component c, fmi2StatusKind kind, fmi2Boolean *value) {
    ANSWER(c, GetBooleanStatus, value != NULL, kind == fmi2Terminated ? (*value = fmi2False, fmi2OK) : fmi2Discard);
}

FMI2_FUNCTION(fmi2Status, fmi2GetStringStatus)(fmi2Component c, fmi2StatusKind kind, fmi2String *value) {
    (void)kind, (void)value;
    ANSWER(c, GetStringStatus, 1, fmi2Discard);
}

static fmi2Status enter_event_mode(Call *call) {
    begin_event(call->instance);
    return go_to(call, PHASE_EVENT);
}

FMI2_FUNCTION(fmi2Status, fmi2EnterEventMode)(fmi2Component c) {
    ANSWER(c, EnterEventMode, 1, enter_event_mode(&call));
}

FMI2_FUNCTION(fmi2Status, fmi2NewDiscreteStates)(fmi2Component c, fmi2EventInfo *info) {
    ANSWER(c, NewDiscreteStates, info != NULL, new_discrete_states(&call, info));
}

FMI2_FUNCTION(fmi2Status, fmi2EnterContinuousTimeMode)(fmi2Component c) {
    ANSWER(c, EnterContinuousTimeMode, 1, enter_continuous_time_mode(&call));
}

FMI2_FUNCTION(fmi2Status, fmi2CompletedIntegratorStep)(fmi2Component c, fmi2Boolean no_set_prior,
                                                       fmi2Boolean *enter_event_mode_now, fmi2Boolean *terminate) {
    (void)no_set_prior;
    ANSWER(c, CompletedIntegratorStep, enter_event_mode_now != NULL && terminate != NULL,
           completed_integrator_step(&call, enter_event_mode_now, terminate));
}

FMI2_FUNCTION(fmi2Status, fmi2SetTime)(fmi2Component c, fmi2Real time) {
    ANSWER(c, SetTime, 1, set_time(&call, time));
}

FMI2_FUNCTION(fmi2Status, fmi2SetContinuousStates)(fmi2Component c, const fmi2Real states[], size_t count) {
    ANSWER(c, SetContinuousStates, has_elements(states, count), set_continuous_states(&call, states, count));
}

FMI2_FUNCTION(fmi2Status, fmi2GetDerivatives)(fmi2Component c, fmi2Real derivatives[], size_t count) {
    ANSWER(c, GetDerivatives, has_elements(derivatives, count), get_derivatives(&call, derivatives, count));
}

FMI2_FUNCTION(fmi2Status, fmi2GetEventIndicators)(fmi2Component c, fmi2Real indicators[], size_t count) {
    ANSWER(c, GetEventIndicators, has_elements(indicators, count), get_event_indicators(&call, indicators, count));
}

FMI2_FUNCTION(fmi2Status, fmi2GetContinuousStates)(fmi2Component c, fmi2Real states[], size_t count) {
    ANSWER(c, GetContinuousStates, has_elements(states, count), get_continuous_states(&call, states, count));
}

FMI2_FUNCTION(fmi2Status, fmi2GetNominalsOfContinuousStates)(fmi2Component c, fmi2Real nominals[], size_t count) {
    ANSWER(c, GetNominalsOfContinuousStates, has_elements(nominals, count), get_nominals(&call, nominals, count));
}
