/* What the functions of model exchange do (FMI 2.0.4, section 3.2). */

static fmi2Status new_discrete_states(Call *call, fmi2EventInfo *info) {
    Instance *instance = call->instance;
    real time = instance->block.v[AT_TIME];
    Update update;
    StepError error;
    if (!update_discrete(instance, &update, &error)) {
        /* Parameters are refused as any argument is: the instance can go on. */
        if (error.kind != STEP_PARAMETERS) {
            instance->phase = PHASE_ERROR;
        }
        text_marked(why(call), " at t = \1n s: ", &time, 1);
        tell_failure(call, &error);
        return fmi2Error;
    }
    /* Other units may answer to outputs that have jumped; their answer is another update's. */
    info->newDiscreteStatesNeeded = update.changed;
    info->terminateSimulation = fmi2False;
    info->nominalsOfContinuousStatesChanged = fmi2False;
    info->valuesOfContinuousStatesChanged = update.states_jumped;
    info->nextEventTimeDefined = isfinite(update.next_event) != 0;
    info->nextEventTime = isfinite(update.next_event) ? (double)update.next_event : 0.0;
    return fmi2OK;
}

static fmi2Status enter_continuous_time_mode(Call *call) {
    if (call->instance->block.n[AT_PARAMETERS_SET]) {
        return refused(call, ": parameters were set; fmi2NewDiscreteStates takes them over first");
    }
    end_event(call->instance);
    call->instance->phase = PHASE_CONTINUOUS_TIME;
    return fmi2OK;
}

static fmi2Status completed_integrator_step(Call *call, fmi2Boolean *enter_event_mode, fmi2Boolean *terminate) {
    Instance *instance = call->instance;
    double time = (double)instance->block.v[AT_TIME];
    double slack = COMMUNICATION_POINT_SLACK * fabs(time - (double)instance->block.v[AT_COMPLETED]);
    if (instance->has_stop_time && time > instance->stop_time + slack) {
        real times[2] = {(real)time, (real)instance->stop_time};
        const char *reason = ": t = \1n s is beyond stopTime = \1n s, which fmi2SetupExperiment was given";
        text_marked(why(call), reason, times, 2);
        return fmi2Error;
    }
    StepError error;
    int ends_at_event = 0;
    if (!complete_step(instance, &ends_at_event, &error)) {
        instance->phase = PHASE_ERROR;
        text_add(why(call), ": ");
        tell_failure(call, &error);
        return fmi2Error;
    }
    *enter_event_mode = ends_at_event;
    *terminate = fmi2False;
    return fmi2OK;
}

static fmi2Status set_time(Call *call, double time) {
    if (!isfinite(real_of(time))) {
        text_add(why(call), ": time = ");
        text_number(&call->why, real_of(time));
        text_add(&call->why, " must be a finite number");
        return fmi2Error;
    }
    put_at_time(call->instance, (real)time);
    return fmi2OK;
}

/* Whether the master counts what the unit has. */
static int check_count(Call *call, size_t given, size_t expected, const char *what) {
    if (given == expected) {
        return 1;
    }
    text_add(why(call), ": ");
    text_integer(&call->why, (long long)given);
    text_add(&call->why, what);
    text_add(&call->why, "; this unit has ");
    text_integer(&call->why, (long long)expected);
    return 0;
}

static fmi2Status set_continuous_states(Call *call, const double states[], size_t count) {
    Instance *instance = call->instance;
    if (!check_count(call, count, UNIT_STATES, " continuous states")) {
        return fmi2Error;
    }
    for (size_t k = 0; k < count; k++) {
        if (!isfinite(real_of(states[k]))) {
            refused_number(call, unit_real_variables[FIRST_STATE + k].name, states[k]);
            return fmi2Error;
        }
    }
    for (size_t k = 0; k < count; k++) {
        instance->block.v[FIRST_STATE + k] = (real)states[k];
    }
    instance->fresh = 0;
    return fmi2OK;
}

/* Hands out a section of the block. */
static fmi2Status hand_out_section(Call *call, int first, size_t count, double values[]) {
    const real *numbers = call->instance->block.v + first;
    for (size_t k = 0; k < count; k++) {
        if (!isfinite(numbers[k])) {
            what_is_no_number(call, "", unit_real_variables[(size_t)first + k].name);
            return no_number(call, numbers[k]);
        }
    }
    for (size_t k = 0; k < count; k++) {
        values[k] = (double)numbers[k];
    }
    return fmi2OK;
}

static fmi2Status get_continuous_states(Call *call, double states[], size_t count) {
    if (!check_count(call, count, UNIT_STATES, " continuous states") || !bring_up_to_date(call)) {
        return fmi2Error;
    }
    return hand_out_section(call, FIRST_STATE, count, states);
}

static fmi2Status get_derivatives(Call *call, double derivatives[], size_t count) {
    if (!check_count(call, count, UNIT_STATES, " continuous states")) {
        return fmi2Error;
    }
    evaluate(call->instance);
    return hand_out_section(call, FIRST_RATE, count, derivatives);
}

static fmi2Status get_nominals(Call *call, double nominals[], size_t count) {
    if (!check_count(call, count, UNIT_STATES, " continuous states")) {
        return fmi2Error;
    }
    for (size_t k = 0; k < count; k++) {
        nominals[k] = (double)unit_nominals[k];
    }
    return fmi2OK;
}

static fmi2Status get_event_indicators(Call *call, double indicators[], size_t count) {
    if (!check_count(call, count, UNIT_INDICATORS, " event indicators") || !bring_up_to_date(call)) {
        return fmi2Error;
    }
#if UNIT_INDICATORS > 0
    real z[UNIT_INDICATORS];
    evaluate_indicators(call->instance, z);
    for (size_t k = 0; k < count; k++) {
        if (!isfinite(z[k])) {
            text_integer(what_is_no_number(call, "event indicator ", NULL), (long long)k + 1);
            return no_number(call, z[k]);
        }
    }
    for (size_t k = 0; k < count; k++) {
        indicators[k] = (double)z[k];
    }
#else
    (void)indicators;
#endif
    return fmi2OK;
}
