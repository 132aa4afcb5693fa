/* The functions that both standards have with the same arguments. Each call passes the table of allowed calls, and ends with its
 * messages.
 *
 * A call that computes does so in the default floating-point modes. Where the host's can't be set aside, division by zero, invalid
 * operations and overflow may be trapped: values that nobody asks for aren't computed. */

FMI_FUNCTION(SetDebugLogging, SetDebugLogging)(void *c, MasterBoolean on, size_t count, const char *const categories[]) {
    ANSWER(c, SetDebugLogging, has_elements(categories, count), set_debug_logging(&call, on, count, categories));
}

FMI_FUNCTION(ExitInitializationMode, ExitInitializationMode)(void *c) {
    ANSWER(c, ExitInitializationMode, 1, exit_initialization_mode(&call));
}

FMI_FUNCTION(Terminate, Terminate)(void *c) {
    ANSWER(c, Terminate, 1, terminate(&call));
}

FMI_FUNCTION(Reset, Reset)(void *c) {
    ANSWER(c, Reset, 1, reset(&call));
}

FMI_FUNCTION(GetFMUstate, GetFMUState)(void *c, void **state) {
    ANSWER(c, GetFMUstate, state != NULL, get_state(&call, state));
}

FMI_FUNCTION(SetFMUstate, SetFMUState)(void *c, void *state) {
    ANSWER(c, SetFMUstate, 1, set_state(&call, state));
}

FMI_FUNCTION(FreeFMUstate, FreeFMUState)(void *c, void **state) {
    ANSWER(c, FreeFMUstate, 1, free_state(&call, state));
}

FMI_FUNCTION(SerializedFMUstateSize, SerializedFMUStateSize)(void *c, void *state, size_t *size) {
    ANSWER(c, SerializedFMUstateSize, size != NULL, serialised_size(&call, state, size));
}

FMI_FUNCTION(SerializeFMUstate, SerializeFMUState)(void *c, void *state, MasterByte bytes[], size_t size) {
    ANSWER(c, SerializeFMUstate, has_elements(bytes, size), serialise(&call, state, (unsigned char *)bytes, size));
}

FMI_FUNCTION(DeSerializeFMUstate, DeserializeFMUState)(void *c, const MasterByte bytes[], size_t size, void **state) {
    ANSWER(c, DeSerializeFMUstate, has_elements(bytes, size) && state != NULL,
           deserialise(&call, (const unsigned char *)bytes, size, state));
}

FMI_FUNCTION(EnterContinuousTimeMode, EnterContinuousTimeMode)(void *c) {
    ANSWER(c, EnterContinuousTimeMode, 1, leave_event_mode(&call, PHASE_CONTINUOUS_TIME));
}

static Status end_integrator_step(Call *call, MasterBoolean *event_mode, MasterBoolean *terminate_now) {
    int enter = 0;
    Status status = completed_integrator_step(call, &enter);
    if (status == STATUS_OK) {
        *event_mode = enter != 0;
        *terminate_now = 0;
    }
    return status;
}

FMI_FUNCTION(CompletedIntegratorStep, CompletedIntegratorStep)(void *c, MasterBoolean no_set_prior,
                                                               MasterBoolean *event_mode, MasterBoolean *terminate_now) {
    (void)no_set_prior;
    ANSWER(c, CompletedIntegratorStep, event_mode != NULL && terminate_now != NULL,
           end_integrator_step(&call, event_mode, terminate_now));
}

FMI_FUNCTION(SetTime, SetTime)(void *c, double time) {
    ANSWER(c, SetTime, 1, set_time(&call, time));
}

FMI_FUNCTION(SetContinuousStates, SetContinuousStates)(void *c, const double states[], size_t count) {
    ANSWER(c, SetContinuousStates, has_elements(states, count), set_continuous_states(&call, states, count));
}

FMI_FUNCTION(GetDerivatives, GetContinuousStateDerivatives)(void *c, double derivatives[], size_t count) {
    ANSWER(c, GetDerivatives, has_elements(derivatives, count), get_derivatives(&call, derivatives, count));
}

FMI_FUNCTION(GetEventIndicators, GetEventIndicators)(void *c, double indicators[], size_t count) {
    ANSWER(c, GetEventIndicators, has_elements(indicators, count), get_event_indicators(&call, indicators, count));
}

FMI_FUNCTION(GetContinuousStates, GetContinuousStates)(void *c, double states[], size_t count) {
    ANSWER(c, GetContinuousStates, has_elements(states, count), get_continuous_states(&call, states, count));
}

FMI_FUNCTION(GetNominalsOfContinuousStates, GetNominalsOfContinuousStates)(void *c, double nominals[], size_t count) {
    ANSWER(c, GetNominalsOfContinuousStates, has_elements(nominals, count), get_nominals(&call, nominals, count));
}
