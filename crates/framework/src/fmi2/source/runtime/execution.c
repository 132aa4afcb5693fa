/* An instance in time: its values, its parameters as a transaction, its inputs within a step. */

/* Copies a part of one array of values to another: sections of any size, none included. */
static void copy_reals(real *to, const real *from, int count) {
    memmove(to, from, (size_t)count * sizeof *to);
}

static void copy_integers(int *to, const int *from, int count) {
    memmove(to, from, (size_t)count * sizeof *to);
}

/* Tells the system who integrates. */
static void mark_stepped(Instance *instance) {
#if AT_STEPPED >= 0
    instance->block.n[AT_STEPPED] = instance->interface == CO_SIMULATION;
#endif
    instance->fresh = 0;
}

/* Back to the start values. */
static void put_at_start(Instance *instance) {
    copy_reals(instance->block.v, unit_start_reals, UNIT_REALS);
    copy_integers(instance->block.n, unit_start_integers, UNIT_INTEGERS);
    mark_stepped(instance);
    (void)memset(&instance->driver.choices, 0, sizeof instance->driver.choices);
}

/* Puts the instance at a time: the start, or a communication point as the master counts it. */
static void put_at_time(Instance *instance, real t) {
    instance->block.v[AT_TIME] = t;
    instance->fresh = 0;
}

/* Whether a place is one of so many from the first on. */
static int is_among(int place, int first, int count) {
    return place >= first && place < first + count;
}

/* Sets a value by its place in the block. Parameters that are set in a running simulation are prepared together before
 * the next step. */
static void set_real(Instance *instance, int place, real value) {
    instance->block.v[place] = value;
    instance->fresh = 0;
    if (is_among(place, FIRST_PARAMETER, UNIT_PARAMETERS)) {
        instance->block.n[AT_PARAMETERS_SET] = 1;
    }
}

static void set_integer(Instance *instance, int place, int value) {
    instance->block.n[place] = value;
    instance->fresh = 0;
    if (is_among(place, FIRST_INTEGER_PARAMETER, UNIT_INTEGER_PARAMETERS)) {
        instance->block.n[AT_PARAMETERS_SET] = 1;
    }
}

/* Whether events at the end of a communication step are the master's to handle. */
static int leaves_events(const Instance *instance) {
#if UNIT_FMI == 3
    return instance->event_mode;
#else
    (void)instance;
    return 0;
#endif
}

static Settings settings_of(const Instance *instance) {
    const real *v = instance->block.v;
    Settings settings = {METHOD_AUTOMATIC, 1, DEFAULT_TOLERANCE, v[AT_WORK_LIMIT], leaves_events(instance)};
    /* The master's tolerance may tighten the unit's own, never loosen it. */
    real asked = v[AT_TOLERANCE];
#if AT_RELATIVE_TOLERANCE >= 0
    settings.relative_tolerance = v[AT_RELATIVE_TOLERANCE];
#endif
    if (asked > 0) {
        asked = F(fmax)(asked, TIGHTEST_TOLERANCE);
        settings.relative_tolerance = F(fmin)(settings.relative_tolerance, asked);
    }
#if AT_INTEGRATION_METHOD >= 0
    settings.method = instance->block.n[AT_INTEGRATION_METHOD];
#endif
#if defined(AT_FIXED_STEPS) && AT_FIXED_STEPS >= 0
    settings.fixed_steps = instance->block.n[AT_FIXED_STEPS];
#endif
    return settings;
}

static Problem problem_of(Instance *instance, int ramped) {
    Problem problem = {instance->block.v, instance->block.n, !ramped, NULL, NULL, instance->block.v[AT_TIME],
                       &instance->log, 0};
#if UNIT_INPUTS > 0
    problem.ramp_values = instance->ramp_values;
    problem.ramp_slopes = instance->ramp_slopes;
#endif
    return problem;
}

/* Leaves in the error that reasons lie in the log; with the time at which they were found, unless that is no number. */
static int failed(StepError *error, int kind, real time) {
    memset(error, 0, sizeof *error);
    error->kind = kind;
    error->time = time;
    return 0;
}

static void check_real_limits(const RealVariable *variable, real value, Log *log) {
    int has_min = (variable->limits & (LIMIT_MIN | LIMIT_ABOVE_MIN)) != 0, has_max = (variable->limits & LIMIT_MAX) != 0;
    int is_open = (variable->limits & LIMIT_ABOVE_MIN) != 0;
    int too_small = has_min && (value < variable->min || (is_open && value <= variable->min));
    if (!too_small && !(has_max && value > variable->max) && isfinite(value)) {
        return;
    }
    const char *allowed = has_max && is_open   ? "\1n: must be above \1n and at most \1n"
                          : has_max && has_min ? "\1n: must be within \1n … \1n"
                          : has_max            ? "\1n: must be at most \1n"
                          : is_open            ? "\1n: must be above \1n"
                          : has_min            ? "\1n: must be at least \1n"
                                               : "\1n: must be finite";
    real values[3] = {value, has_min ? variable->min : variable->max, variable->max};
    refuse_value(log, variable->name, allowed, values, 3);
}

static void check_limits(const Instance *instance, Log *log) {
    for (int place = FIRST_PARAMETER; place < FIRST_PARAMETER + UNIT_PARAMETERS; place++) {
        check_real_limits(&unit_real_variables[place], instance->block.v[place], log);
    }
    for (int place = FIRST_INTEGER_PARAMETER; place < FIRST_INTEGER_PARAMETER + UNIT_INTEGER_PARAMETERS; place++) {
        const IntegerVariable *variable = &unit_integer_variables[place];
        int value = instance->block.n[place];
        if (variable->has_limits && (value < variable->min || value > variable->max)) {
            real values[3] = {(real)value, (real)variable->min, (real)variable->max};
            refuse_value(log, variable->name, "\1n: must be within \1n … \1n", values, 3);
        }
    }
}

/* Checks every parameter against its limits, then prepares what depends on them; 0 where any is refused. */
static int prepare(Instance *instance) {
    Log *log = &instance->log;
    int before = log_refused(log);
    check_limits(instance, log);
    if (log_refused(log) > before) {
        return 0;
    }
    unit_prepare(instance->block.v, instance->block.n, log);
    for (int place = FIRST_PREPARED; place < FIRST_PREPARED + UNIT_PREPARED && log_refused(log) == before; place++) {
        if (!isfinite(instance->block.v[place])) {
            const char *allowed = "\1n: follows from the parameters and must be finite: they are too large or too small";
            refuse_value(log, unit_real_variables[place].name, allowed, &instance->block.v[place], 1);
        }
    }
    return log_refused(log) == before;
}

static void keep_valid_parameters(Block *block) {
    copy_reals(block->v + AT_VALID_PARAMETERS, block->v + FIRST_PARAMETER, UNIT_PARAMETERS);
    copy_integers(block->n + AT_VALID_INTEGERS, block->n + FIRST_INTEGER_PARAMETER, UNIT_INTEGER_PARAMETERS);
}

static void restore_valid_parameters(Block *block) {
    copy_reals(block->v + FIRST_PARAMETER, block->v + AT_VALID_PARAMETERS, UNIT_PARAMETERS);
    copy_integers(block->n + FIRST_INTEGER_PARAMETER, block->n + AT_VALID_INTEGERS, UNIT_INTEGER_PARAMETERS);
}

/* Whether any parameter is another than in the last valid set. */
static int differs_from_valid(const Block *block) {
    for (int k = 0; k < UNIT_PARAMETERS; k++) {
        if (block->v[FIRST_PARAMETER + k] != block->v[AT_VALID_PARAMETERS + k]) {
            return 1;
        }
    }
    return memcmp(block->n + FIRST_INTEGER_PARAMETER, block->n + AT_VALID_INTEGERS,
                  UNIT_INTEGER_PARAMETERS * sizeof block->n[0]) != 0;
}

/* Takes over the parameters that were set since the last step, all or none; *any: whether there were any. Where they are
 * refused, the last valid ones are in force again. `t` is the time as the master counts it. */
static int commit_parameters(Instance *instance, real t, int *any, StepError *error) {
    Block *block = &instance->block;
    LogPlace place = log_place(&instance->log);
    *any = block->n[AT_PARAMETERS_SET];
    if (!*any) {
        return 1;
    }
    if (instance->logged[CATEGORY_EVENTS]) {
        log_text(&instance->log, CATEGORY_EVENTS, "tunable parameters taken over at t = \1n s", &t, 1);
    }
    block->n[AT_PARAMETERS_SET] = 0;
    if (!prepare(instance)) {
        log_take_back(&instance->log, place);
        restore_valid_parameters(block);
        /* These were prepared before, so they are accepted again. */
        prepare(instance);
        return failed(error, STEP_PARAMETERS, (real)NAN);
    }
    if (differs_from_valid(block)) {
        /* The equations are others: eigenvalues are looked at before the next substep. */
        block->v[AT_UNTIL_LOOK] = 0;
    }
    keep_valid_parameters(block);
    unit_parameters_changed(block->v[AT_TIME], block->v, block->n, &instance->log);
    return 1;
}

/* Whether the equations hold where the instance stands evaluated. */
static int check_equations(Instance *instance, int kind, StepError *error) {
    real t = instance->block.v[AT_TIME];
    unit_check(t, instance->block.v, instance->block.n, &instance->log);
    return log_refused(&instance->log) == 0 || failed(error, kind, t);
}

/* Every state and signal must be a number, and so the time of the next event; every output within the limit. */
static int check_values(const Instance *instance, real time, StepError *error) {
    static const int sections[2][2] = {{FIRST_STATE, UNIT_STATES}, {FIRST_SIGNAL, UNIT_SIGNALS}};
    const Block *block = &instance->block;
    real next = unit_next_time_event(block->v, block->n);
    if (isnan(next)) {
        failed(error, STEP_DIVERGED, time);
        error->variable = TIME_OF_NEXT_EVENT;
        error->value = next;
        return 0;
    }
    for (int k = 0; k < 2; k++) {
        for (int place = sections[k][0]; place < sections[k][0] + sections[k][1]; place++) {
            real value = block->v[place];
            int is_output = unit_real_variables[place].access == ACCESS_OUTPUT;
            if (!isfinite(value) || (is_output && F(fabs)(value) > DIVERGENCE_LIMIT)) {
                failed(error, STEP_DIVERGED, time);
                error->variable = place;
                error->value = value;
                return 0;
            }
        }
    }
    return 1;
}

static void keep_integer_inputs(Block *block) {
#if UNIT_INTEGER_INPUTS > 0
    copy_integers(block->n + AT_LAST_INTEGER_INPUTS, block->n + FIRST_INTEGER_INPUT, UNIT_INTEGER_INPUTS);
#else
    (void)block;
#endif
}

/* Puts states and discrete variables at their start, and nothing else. */
static int initialise_states(Instance *instance, StepError *error) {
    real *v = instance->block.v, t = v[AT_TIME];
    int *n = instance->block.n;
    copy_reals(v + FIRST_STATE, unit_start_reals + FIRST_STATE, UNIT_STATES);
    copy_reals(v + FIRST_DISCRETE, unit_start_reals + FIRST_DISCRETE, UNIT_DISCRETES);
    copy_integers(n + FIRST_INTEGER_DISCRETE, unit_start_integers + FIRST_INTEGER_DISCRETE, UNIT_INTEGER_DISCRETES);
    unit_initialise(t, v, n, &instance->log);
    if (log_refused(&instance->log) > 0) {
        return failed(error, STEP_INVALID, (real)NAN);
    }
    Problem problem = problem_of(instance, 0);
    return driver_settle(&instance->driver, &problem, t, error);
}

/* Computes everything at the start time from the present parameters and inputs, where any was changed. */
static int initialise(Instance *instance, StepError *error) {
    Block *block = &instance->block;
    if (instance->fresh) {
        return 1;
    }
    if (!prepare(instance)) {
        return failed(error, STEP_INVALID, (real)NAN);
    }
    block->n[AT_PARAMETERS_SET] = 0;
    keep_valid_parameters(block);
#if UNIT_INPUTS > 0
    copy_reals(block->v + AT_LAST_INPUTS, block->v + FIRST_INPUT, UNIT_INPUTS);
#endif
    keep_integer_inputs(block);
    if (!initialise_states(instance, error) || !check_values(instance, block->v[AT_TIME], error)) {
        return 0;
    }
    instance->fresh = 1;
    return 1;
}

/* True if an input has another value than in the communication step before. */
static int inputs_moved(const Block *block) {
    int moved = 0;
#if UNIT_INPUTS > 0
    for (int k = 0; k < UNIT_INPUTS; k++) {
        moved = moved || block->v[FIRST_INPUT + k] != block->v[AT_PREVIOUS_INPUTS + k];
    }
#else
    (void)block;
#endif
    return moved;
}

/* Decides how inputs go during this step; whether they change at all. */
static int prepare_inputs(Instance *instance, real step, int first) {
    int ramped = 0;
#if UNIT_INPUTS > 0
    const Block *before = &instance->saved;
    Block *block = &instance->block;
    const real *present = before->v + FIRST_INPUT, *previous = before->v + AT_PREVIOUS_INPUTS;
    int handling = first ? INPUTS_HOLD : before->n[AT_INPUT_HANDLING];
    int given = before->n[AT_SLOPES_GIVEN];
    real duration = handling == INPUTS_EXTRAPOLATE ? before->v[AT_LAST_STEP] : step;
    for (int k = 0; k < UNIT_INPUTS; k++) {
        real value = present[k], slope = 0;
        if (given) {
            slope = before->v[AT_GIVEN_SLOPES + k];
        } else if (handling != INPUTS_HOLD) {
            slope = (present[k] - previous[k]) / duration;
            value = handling == INPUTS_INTERPOLATE ? previous[k] : value;
        } else {
            /* Held: no slope. */
        }
        instance->ramp_values[k] = value;
        instance->ramp_slopes[k] = slope;
        block->v[AT_SLOPES + k] = slope;
        block->v[AT_PREVIOUS_INPUTS + k] = present[k];
        block->v[AT_LAST_INPUTS + k] = value + slope * step;
        ramped |= slope != 0;
    }
    block->n[AT_SLOPES_GIVEN] = 0;
#else
    (void)instance, (void)step, (void)first;
#endif
    return ramped;
}

static Pace read_pace(const Block *block) {
    const real *v = block->v;
    const real *limits = v + AT_LIMITS;
    Pace pace = {v[AT_SUBSTEP],
                 v[AT_SUBSTEP_8],
                 block->n[AT_STIFF],
                 block->n[AT_EVIDENCE],
                 {{limits[0], limits[1]}, {limits[2], limits[3]}, limits[4], {limits[5], limits[6]}, limits[7]},
                 v[AT_JACOBIAN_SIZE],
                 v[AT_UNTIL_LOOK],
                 v[AT_INTERVAL]};
    return pace;
}

static void write_pace(Block *block, const Pace *pace) {
    const Limits *limits = &pace->limits;
    real numbers[8] = {limits->order_5.stable,  limits->order_5.growing, limits->order_8.stable,
                       limits->order_8.growing, limits->stiff,           limits->mode.growth,
                       limits->mode.frequency,  limits->carried};
    block->v[AT_SUBSTEP] = pace->substep;
    block->v[AT_SUBSTEP_8] = pace->substep_8;
    block->n[AT_STIFF] = pace->stiff;
    block->n[AT_EVIDENCE] = pace->evidence;
    copy_reals(block->v + AT_LIMITS, numbers, 8);
    block->v[AT_JACOBIAN_SIZE] = pace->jacobian_size;
    block->v[AT_UNTIL_LOOK] = pace->until_look;
    block->v[AT_INTERVAL] = pace->interval;
}

static int try_step(Instance *instance, real step, StepError *error) {
    Block *block = &instance->block;
    int first = !block->n[AT_STARTED];
    if (first) {
        /* Not every master sets inputs in Initialization Mode: what is taken from them is taken here. */
        if (!initialise_states(instance, error) || !check_equations(instance, STEP_INVALID, error)) {
            return 0;
        }
        block->n[AT_STARTED] = 1;
    }
    real t0 = block->v[AT_TIME], t1 = t0 + step;
    Settings settings = settings_of(instance);
    int moved = !first && inputs_moved(block);
    int ramped = prepare_inputs(instance, step, first);
    Pace pace = read_pace(block);
    Problem problem = problem_of(instance, ramped);
    problem.moved = ramped || moved;
    if (!driver_advance(&instance->driver, &problem, t0, t1, &settings, &pace, error)) {
        return 0;
    }
    keep_integer_inputs(block);
    put_at_time(instance, t1);
    if (!check_equations(instance, STEP_UNSOUND, error) || !check_values(instance, t1, error)) {
        return 0;
    }
    if (ramped) {
        /* Inputs read back what was set. */
        copy_reals(block->v + FIRST_INPUT, instance->saved.v + FIRST_INPUT, UNIT_INPUTS);
    }
    write_pace(block, &pace);
    block->v[AT_LAST_STEP] = step;
    unit_step_completed(t1, step, block->v, block->n, &instance->log);
    return 1;
}

/* Takes over the parameters that were set since the last step, then advances from t by one communication step. Where they
 * are refused the last valid ones are in force again; after another failure everything is as before, parameters that wait
 * to be taken over included. */
static int advance(Instance *instance, real t, real step, StepError *error) {
    LogPlace place = log_place(&instance->log);
    int taken_over;
    instance->saved = instance->block;
    if (!commit_parameters(instance, t, &taken_over, error)) {
        return 0;
    }
    put_at_time(instance, t);
    if (!try_step(instance, step, error)) {
        instance->block = instance->saved;
        log_take_back(&instance->log, place);
        return 0;
    }
    Chosen news;
    if (take_news(&instance->driver.choices, &news) && instance->logged[CATEGORY_EVENTS]) {
        tell_method(&instance->log, place.count + (taken_over ? 1 : 0), &news);
    }
    return 1;
}
