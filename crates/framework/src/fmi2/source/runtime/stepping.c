/* What the functions of co-simulation do, and those that begin and end a simulation. */

static int is_category(const char *name) {
    for (int k = 0; k < UNIT_CATEGORIES; k++) {
        if (strcmp(name, unit_categories[k]) == 0) {
            return 1;
        }
    }
    return strcmp(name, "logAll") == 0;
}

/* Why an instance can't be made; NULL where it can. */
static const char *check_instantiation(Text *why, const char *name, const char *token) {
    if (name == NULL || name[0] == '\0') {
        text_add(why, "instanceName is NULL or empty");
    } else if (token == NULL) {
        text_add(why, TOKEN_ARGUMENT " is NULL");
    } else if (strcmp(token, UNIT_GUID) != 0) {
        text_add(why, TOKEN " `");
        text_add(why, token);
        text_add(why, "` is not that of this FMU, " UNIT_GUID ": modelDescription.xml and the sources don't belong "
                      "together");
    } else {
        return NULL;
    }
    return why->at;
}

/* Tells the master why there is no instance. */
static void tell_no_instance(const Master *master, const char *function, const char *name, const char *reason) {
    char room[TEXT_ROOM];
    Text text = text_in(room, sizeof room);
    text_add(&text, function);
    text_add(&text, ": ");
    text_bytes(&text, reason, strlen(reason));
    if (master->logger != NULL) {
        log_to(master, name != NULL ? name : "", STATUS_ERROR, CATEGORY_ERROR, room);
    }
}

/* Makes an instance; NULL where that fails, with a message. */
static Instance *instantiate(const Master *master, const char *function, Interface interface, const char *name,
                             const char *token, int logging) {
    char room[TEXT_ROOM];
    Text text = text_in(room, sizeof room);
    const char *reason = check_instantiation(&text, name, token);
    Instance *instance = reason == NULL ? make_instance(master, name) : NULL;
    if (instance == NULL) {
        tell_no_instance(master, function, name, reason != NULL ? reason : "there is no memory for another instance");
        return NULL;
    }
    instance->interface = interface;
    instance->phase = PHASE_INSTANTIATED;
    instance->has_stop_time = 0;
    memset(instance->logged, logging, sizeof instance->logged);
    instance->points_differ = 0;
    instance->salt = salt_of(instance);
    unsigned host = host_modes_aside();
    put_at_start(instance);
    host_modes_back(host);
    return instance;
}

/* Frees an instance, or has the call do so that sends it messages: from the master's logger. */
static void free_instance(Instance *instance) {
    if (instance == NULL) {
        return;
    }
    instance->is_freed = 1;
    if (instance->sending == 0) {
        release(instance);
    }
}

static int asks_for(const char *const categories[], size_t count, const char *name) {
    int asks = count == 0;
    for (size_t k = 0; k < count; k++) {
        asks = asks || strcmp(categories[k], name) == 0 || strcmp(categories[k], "logAll") == 0;
    }
    return asks;
}

/* In FMI 2.0 those that aren't named are turned off; in FMI 3.0 they stay as they are. */
static void choose_categories(Instance *instance, int on, size_t count, const char *const categories[]) {
    for (int k = 0; k < UNIT_CATEGORIES; k++) {
        int asked = asks_for(categories, count, unit_categories[k]);
        if (asked || UNIT_FMI == 2) {
            instance->logged[k] = on && asked;
        }
    }
}

static Status set_debug_logging(Call *call, int on, size_t count, const char *const categories[]) {
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
            return STATUS_ERROR;
        }
    }
    choose_categories(call->instance, on, count, categories);
    return STATUS_OK;
}

/* Adds a refusal of up to three times. */
static Status refused_times(Call *call, const char *reason, double first, double second, double third) {
    real times[3] = {real_of(first), real_of(second), real_of(third)};
    text_marked(why(call), reason, times, 3);
    return STATUS_ERROR;
}

static Status setup_experiment(Call *call, int tolerance_defined, double tolerance, double start, int stop_defined,
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
    return STATUS_OK;
}

static Status go_to(Call *call, Phase phase) {
    call->instance->phase = phase;
    return STATUS_OK;
}

static Status enter_event_mode(Call *call) {
    begin_event(call->instance);
    return go_to(call, PHASE_EVENT);
}

static Status exit_initialization_mode(Call *call) {
    Instance *instance = call->instance;
    int is_exchange = instance->interface == MODEL_EXCHANGE;
    int has_events = is_exchange || leaves_events(instance);
    StepError error;
    if (!initialise(instance, &error) || (has_events && !check_equations(instance, STEP_INVALID, &error))) {
        text_add(why(call), ": ");
        tell_failure(call, &error);
        return STATUS_ERROR;
    }
    if (is_exchange) {
        begin_model_exchange(instance);
    }
#if UNIT_FMI == 3 && UNIT_INDICATORS > 0
    find_indicators(instance, instance->indicators);
#endif
    return has_events ? enter_event_mode(call) : go_to(call, PHASE_STEP_COMPLETE);
}

static Status terminate(Call *call) {
    if (call->instance->phase == PHASE_EVENT) {
        evaluate(call->instance);
    }
    return go_to(call, PHASE_TERMINATED);
}

static Status reset(Call *call) {
    put_at_start(call->instance);
    call->instance->phase = PHASE_INSTANTIATED;
    call->instance->has_stop_time = 0;
    return STATUS_OK;
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
    log_text(&instance->log, CATEGORY_WARNING,
         FMI "DoStep: currentCommunicationPoint = \1n s, but the instance is at t = \1n s. A given point that differs by "
         "at most 0.001 of the step is used, here and in later steps",
         times, 2);
}

static Status check_step(Call *call, double point, double step) {
    const Instance *instance = call->instance;
    double time = (double)instance->block.v[AT_TIME];
    double last = time - (double)instance->block.v[AT_LAST_STEP];
    double slack = point_slack(COMMUNICATION_POINT_SLACK, step, time);
    if (!(isfinite(real_of(step)) && step > 0)) {
        return refused_times(call, ": communicationStepSize = \1n must be finite and above 0", step, 0, 0);
    }
    if (!(isfinite(point) && fabs(point - time) <= slack)) {
        const char *reason = ": currentCommunicationPoint = \1n s, but the instance is at t = \1n s: give that point, "
                             "to within 0.001 of communicationStepSize = \1n s";
        return refused_times(call, reason, point, time, step);
    }
    if (last < time && point < last - point_slack(0, step, time)) {
        const char *reason = ": currentCommunicationPoint = \1n s is before that of the last step, \1n s; the instance "
                             "is at t = \1n s: give that point";
        return refused_times(call, reason, point, last, time);
    }
    if ((real)point + (real)step <= (real)point) {
        return refused_times(call, ": communicationStepSize = \1n is too small to change t = \1n s", step, point, 0);
    }
    if (instance->has_stop_time && point + step > instance->stop_time + slack) {
        const char *reason = ": \1n s + \1n s goes beyond stopTime = \1n s, which " SETUP_EXPERIMENT " was given";
        return refused_times(call, reason, point, step, instance->stop_time);
    }
    return STATUS_OK;
}

static Status failed_step(Call *call, const StepError *error, double point, double step) {
    Instance *instance = call->instance;
    Status status = STATUS_ERROR;
    if (error->kind == STEP_INVALID) {
        /* A smaller step would not start either, so this is never discarded. */
        instance->phase = PHASE_ERROR;
    } else if (error->kind != STEP_PARAMETERS) {
        int discards = instance->block.n[AT_ON_STEP_FAILURE] == ON_FAILURE_DISCARD;
        /* In FMI 3.0 a discarded step can be tried again, as if it had not been asked for. */
        instance->phase = !discards ? PHASE_ERROR : UNIT_FMI == 3 ? PHASE_STEP_COMPLETE : PHASE_STEP_FAILED;
        status = discards ? STATUS_DISCARD : STATUS_ERROR;
    } else {
        /* Refused parameters are as any refused argument: the instance can go on. */
    }
    refused_times(call, " from t = \1n s by \1n s: ", point, step, 0);
    tell_failure(call, error);
    return status;
}

/* A step that was checked, or a part of one. */
static Status take_step(Call *call, double point, double step) {
    StepError error;
    log_adopted(call->instance, point, step);
    if (!advance(call->instance, (real)point, (real)step, &error)) {
        return failed_step(call, &error, point, step);
    }
    return STATUS_OK;
}
