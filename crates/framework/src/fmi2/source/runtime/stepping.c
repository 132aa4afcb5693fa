/* What the functions of co-simulation do, and those that begin and end a simulation. */

static int is_category(const char *name) {
    for (int k = 0; k < UNIT_CATEGORIES; k++) {
        if (strcmp(name, unit_categories[k]) == 0) {
            return 1;
        }
    }
    return strcmp(name, "logAll") == 0;
}

/* Errors and warnings are always told; only debug messages can be chosen. */
static fmi2Status set_debug_logging(Call *call, int on, size_t count, const fmi2String categories[]) {
    int events = count == 0;
    for (size_t k = 0; k < count; k++) {
        if (categories[k] == NULL) {
            return refused(call, ": a pointer is NULL");
        }
    }
    for (size_t k = 0; k < count; k++) {
        if (!is_category(categories[k])) {
            text_add(why(call), ": there is no category `");
            text_add(&call->why, categories[k]);
            text_add(&call->why, "`; there are ");
            for (int known = 0; known < UNIT_CATEGORIES; known++) {
                text_add(&call->why, known > 0 ? ", " : "");
                text_add(&call->why, unit_categories[known]);
            }
            return fmi2Error;
        }
        events |= strcmp(categories[k], unit_categories[CATEGORY_EVENTS]) == 0 || strcmp(categories[k], "logAll") == 0;
    }
    call->instance->logs_events = on && events;
    return fmi2OK;
}

/* Adds a refusal of up to three times. */
static fmi2Status refused_times(Call *call, const char *reason, double first, double second, double third) {
    real times[3] = {real_of(first), real_of(second), real_of(third)};
    text_marked(why(call), reason, times, 3);
    return fmi2Error;
}

static fmi2Status setup_experiment(Call *call, int tolerance_defined, double tolerance, double start, int stop_defined,
                                   double stop) {
    Instance *instance = call->instance;
    if (tolerance_defined && !(isfinite(real_of(tolerance)) && tolerance > 0)) {
        return refused_times(call, ": tolerance = \1n must be finite and above 0", tolerance, 0, 0);
    }
    if (!isfinite(real_of(start))) {
        return refused_times(call, ": startTime = \1n must be finite", start, 0, 0);
    }
    if (stop_defined && !(isfinite(real_of(stop)) && stop >= start)) {
        const char *reason = ": stopTime = \1n must be finite, and at least startTime = \1n";
        return refused_times(call, reason, stop, start, 0);
    }
    instance->block.v[AT_TOLERANCE] = tolerance_defined ? (real)tolerance : 0;
    put_at_time(instance, (real)start);
    instance->has_stop_time = stop_defined;
    instance->stop_time = stop_defined ? stop : 0;
    return fmi2OK;
}

static fmi2Status exit_initialization_mode(Call *call) {
    Instance *instance = call->instance;
    int is_exchange = instance->interface == fmi2ModelExchange;
    StepError error;
    if (!initialise(instance, &error) || (is_exchange && !begin_model_exchange(instance, &error))) {
        text_add(why(call), ": ");
        tell_failure(call, &error);
        return fmi2Error;
    }
    instance->phase = is_exchange ? PHASE_EVENT : PHASE_STEP_COMPLETE;
    return fmi2OK;
}

static fmi2Status reset(Call *call) {
    put_at_start(call->instance);
    call->instance->phase = PHASE_INSTANTIATED;
    call->instance->has_stop_time = 0;
    return fmi2OK;
}

/* How far a communication point may lie from a time: a part of the step, and the rounding of the time. */
static double point_slack(double part, double step, double time) {
    return part * step + 4.0 * (double)REAL_EPSILON * fabs(time);
}

/* Logs, once, that a communication point is adopted which isn't where the last step ended. */
static void log_adopted(Instance *instance, double point, double step) {
    double time = (double)instance->block.v[AT_TIME];
    if (instance->points_differ || fabs(point - time) <= point_slack(COMMUNICATION_POINT_ROUNDING, step, time)) {
        return;
    }
    instance->points_differ = 1;
    const real times[2] = {(real)point, (real)time};
    tell(&instance->log, CATEGORY_WARNING,
         "fmi2DoStep: currentCommunicationPoint = \1n s, but the instance stands at t = \1n s. Up to 0.001 of the step "
         "the given point is taken, here and in later steps",
         times, 2);
}

static fmi2Status check_step(Call *call, double point, double step) {
    const Instance *instance = call->instance;
    double time = (double)instance->block.v[AT_TIME];
    double last = time - (double)instance->block.v[AT_LAST_STEP];
    double slack = point_slack(COMMUNICATION_POINT_SLACK, step, time);
    if (!(isfinite(real_of(step)) && step > 0)) {
        return refused_times(call, ": communicationStepSize = \1n must be finite and above 0", step, 0, 0);
    }
    if (!(isfinite(point) && fabs(point - time) <= slack)) {
        const char *reason = ": currentCommunicationPoint = \1n s, but the instance stands at t = \1n s: give that point, "
                             "to within 0.001 of communicationStepSize = \1n s";
        return refused_times(call, reason, point, time, step);
    }
    if (last < time && point < last - point_slack(0, step, time)) {
        const char *reason = ": currentCommunicationPoint = \1n s is before that of the last step, \1n s; the instance "
                             "stands at t = \1n s: give that point";
        return refused_times(call, reason, point, last, time);
    }
    if ((real)point + (real)step <= (real)point) {
        return refused_times(call, ": communicationStepSize = \1n is too small to change t = \1n s", step, point, 0);
    }
    if (instance->has_stop_time && point + step > instance->stop_time + slack) {
        const char *reason = ": \1n s + \1n s goes beyond stopTime = \1n s, which fmi2SetupExperiment was given";
        return refused_times(call, reason, point, step, instance->stop_time);
    }
    return fmi2OK;
}

static fmi2Status failed_step(Call *call, const StepError *error, double point, double step) {
    Instance *instance = call->instance;
    fmi2Status status = fmi2Error;
    if (error->kind == STEP_INVALID) {
        /* A smaller step would not start either, so this is never discarded. */
        instance->phase = PHASE_ERROR;
    } else if (error->kind != STEP_PARAMETERS) {
        int discards = instance->block.n[AT_ON_STEP_FAILURE] == ON_FAILURE_DISCARD;
        instance->phase = discards ? PHASE_STEP_FAILED : PHASE_ERROR;
        status = discards ? fmi2Discard : fmi2Error;
    } else {
        /* Refused parameters are as any refused argument: the instance can go on. */
    }
    refused_times(call, " from t = \1n s by \1n s: ", point, step, 0);
    tell_failure(call, error);
    return status;
}

static fmi2Status do_step(Call *call, double point, double step) {
    StepError error;
    if (check_step(call, point, step) != fmi2OK) {
        return fmi2Error;
    }
    log_adopted(call->instance, point, step);
    if (!advance(call->instance, (real)point, (real)step, &error)) {
        return failed_step(call, &error, point, step);
    }
    return fmi2OK;
}

/* Time up to which values are valid; fmi2Discard where it is no number. */
static fmi2Status get_last_successful_time(Call *call, double *value) {
    real time = call->instance->block.v[AT_TIME];
    if (!isfinite(time)) {
        what_is_no_number(call, "the last successful time", NULL);
        return no_number(call, time);
    }
    *value = (double)time;
    return fmi2OK;
}
