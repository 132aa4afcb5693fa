/* What the functions of model exchange do (FMI 2.0.4, section 3.2). */

static Status new_discrete_states(Call *call, Update *update) {
    Instance *instance = call->instance;
    real time = instance->block.v[AT_TIME];
    StepError error;
    if (!update_discrete(instance, update, &error)) {
        /* Parameters are refused as any argument is: the instance can go on. */
        if (error.kind != STEP_PARAMETERS) {
            instance->phase = PHASE_ERROR;
        }
        text_marked(why(call), " at t = \1n s: ", &time, 1);
        tell_failure(call, &error);
        return STATUS_ERROR;
    }
    return STATUS_OK;
}

static Status leave_event_mode(Call *call, Phase next) {
    if (call->instance->block.n[AT_PARAMETERS_SET]) {
        return refused(call, ": parameters were set; " NEW_DISCRETE_STATES " takes them over first");
    }
    end_event(call->instance);
    call->instance->phase = next;
    return STATUS_OK;
}

static Status completed_integrator_step(Call *call, int *enter_event_mode) {
    Instance *instance = call->instance;
    double time = (double)instance->block.v[AT_TIME];
    double slack = COMMUNICATION_POINT_SLACK * fabs(time - (double)instance->block.v[AT_COMPLETED]);
    if (instance->has_stop_time && time > instance->stop_time + slack) {
        real times[2] = {(real)time, (real)instance->stop_time};
        const char *reason = ": t = \1n s is beyond stopTime = \1n s, which " SETUP_EXPERIMENT " was given";
        text_marked(why(call), reason, times, 2);
        return STATUS_ERROR;
    }
    StepError error;
    if (!complete_step(instance, enter_event_mode, &error)) {
        instance->phase = PHASE_ERROR;
        text_add(why(call), ": ");
        tell_failure(call, &error);
        return STATUS_ERROR;
    }
    return STATUS_OK;
}

static Status set_time(Call *call, double time) {
    if (!isfinite(real_of(time))) {
        text_add(why(call), ": time = ");
        text_number(&call->why, real_of(time));
        text_add(&call->why, " must be a finite number");
        return STATUS_ERROR;
    }
    put_at_time(call->instance, (real)time);
    return STATUS_OK;
}

/* Whether the master counts what the unit has. */
static int check_count(Call *call, size_t given, size_t expected, const char *what) {
    if (given == expected) {
        return 1;
    }
    text_add(why(call), ": ");
    text_integer(&call->why, (long long)given);
    text_add(&call->why, what);
    text_add(&call->why, "; this FMU has ");
    text_integer(&call->why, (long long)expected);
    return 0;
}

static Status set_continuous_states(Call *call, const double states[], size_t count) {
    Instance *instance = call->instance;
    if (!check_count(call, count, UNIT_STATES, " continuous states")) {
        return STATUS_ERROR;
    }
    for (size_t k = 0; k < count; k++) {
        if (!isfinite(real_of(states[k]))) {
            refused_number(call, unit_real_variables[FIRST_STATE + k].name, states[k]);
            return STATUS_ERROR;
        }
    }
    for (size_t k = 0; k < count; k++) {
        instance->block.v[FIRST_STATE + k] = (real)states[k];
    }
    instance->fresh = 0;
    return STATUS_OK;
}

/* Hands out a section of the block. */
static Status hand_out_section(Call *call, int first, size_t count, double values[]) {
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
    return STATUS_OK;
}

static Status get_continuous_states(Call *call, double states[], size_t count) {
    if (!check_count(call, count, UNIT_STATES, " continuous states") || !bring_up_to_date(call)) {
        return STATUS_ERROR;
    }
    return hand_out_section(call, FIRST_STATE, count, states);
}

static Status get_derivatives(Call *call, double derivatives[], size_t count) {
    if (!check_count(call, count, UNIT_STATES, " continuous states") || !bring_up_to_date(call)) {
        return STATUS_ERROR;
    }
    return hand_out_section(call, FIRST_RATE, count, derivatives);
}

static Status get_nominals(Call *call, double nominals[], size_t count) {
    if (!check_count(call, count, UNIT_STATES, " continuous states")) {
        return STATUS_ERROR;
    }
    for (size_t k = 0; k < count; k++) {
        nominals[k] = (double)unit_nominals[k];
    }
    return STATUS_OK;
}

static Status get_event_indicators(Call *call, double indicators[], size_t count) {
    if (!check_count(call, count, UNIT_INDICATORS, " event indicators") || !bring_up_to_date(call)) {
        return STATUS_ERROR;
    }
#if UNIT_INDICATORS > 0
    real z[UNIT_INDICATORS];
    find_indicators(call->instance, z);
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
    return STATUS_OK;
}
