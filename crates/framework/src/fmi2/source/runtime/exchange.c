/* An instance in model exchange: the master integrates, and asks for values at its own times, states and inputs. Its events are
 * those of Event Mode in co-simulation, too. */

static void swap_reals(real *a, real *b, int count) {
    for (int k = 0; k < count; k++) {
        real kept = a[k];
        a[k] = b[k];
        b[k] = kept;
    }
}

static void swap_integers(int *a, int *b, int count) {
    for (int k = 0; k < count; k++) {
        int kept = a[k];
        a[k] = b[k];
        b[k] = kept;
    }
}

static void swap_parameters(Block *block) {
    swap_reals(block->v + FIRST_PARAMETER, block->v + AT_VALID_PARAMETERS, UNIT_PARAMETERS);
    swap_integers(block->n + FIRST_INTEGER_PARAMETER, block->n + AT_VALID_INTEGERS, UNIT_INTEGER_PARAMETERS);
}

static void swap_integer_inputs(Block *block) {
#if UNIT_INTEGER_INPUTS > 0
    swap_integers(block->n + FIRST_INTEGER_INPUT, block->n + AT_LAST_INTEGER_INPUTS, UNIT_INTEGER_INPUTS);
#else
    (void)block;
#endif
}

/* Integer inputs that wait for an event aren't in force: puts those in their place that are; whether any wait. */
static int begin_with_integer_inputs_in_force(Block *block) {
    int wait = block->n[AT_INTEGER_INPUTS_WAIT];
    if (wait) {
        swap_integer_inputs(block);
        block->n[AT_INTEGER_INPUTS_WAIT] = 0;
    }
    return wait;
}

static void end_with_integer_inputs_in_force(Block *block, int wait) {
    if (wait) {
        swap_integer_inputs(block);
        block->n[AT_INTEGER_INPUTS_WAIT] = 1;
    }
}

/* What is set and not in force. */
typedef struct {
    int parameters;
    int integer_inputs;
} Waiting;

/* Puts the last valid parameters in the place of those that wait to be taken over: they may contradict each other, and
 * what is prepared from them isn't. Likewise integer inputs. */
static Waiting begin_with_valid(Block *block) {
    Waiting waiting;
    waiting.parameters = block->n[AT_PARAMETERS_SET];
    if (waiting.parameters) {
        swap_parameters(block);
    }
    waiting.integer_inputs = begin_with_integer_inputs_in_force(block);
    return waiting;
}

static void end_with_valid(Block *block, Waiting waiting) {
    end_with_integer_inputs_in_force(block, waiting.integer_inputs);
    if (waiting.parameters) {
        swap_parameters(block);
    }
}

/* Brings signals and derivatives to the present time, states and inputs, where these have changed. */
static void evaluate(Instance *instance) {
    if (!instance->fresh) {
        Waiting waiting = begin_with_valid(&instance->block);
        Problem problem = problem_of(instance, 0);
        problem_evaluate(&problem, instance->block.v[AT_TIME]);
        end_with_valid(&instance->block, waiting);
        instance->fresh = 1;
    }
}

/* Whether the equations hold at the present time, states and inputs; else the reasons lie in the log. */
static int is_sound(Instance *instance) {
    StepError error;
    Waiting waiting = begin_with_valid(&instance->block);
    int sound = check_equations(instance, STEP_UNSOUND, &error);
    end_with_valid(&instance->block, waiting);
    return sound;
}

#if UNIT_INDICATORS > 0
/* The event indicators of the values as they are. */
static void find_indicators(Instance *instance, real *z) {
    Waiting waiting = begin_with_valid(&instance->block);
    unit_event_indicators(instance->block.v[AT_TIME], instance->block.v, instance->block.n, z);
    end_with_valid(&instance->block, waiting);
}
#endif

/* Begins an event: from here on it is noted whether states jump. Integer and Boolean inputs that waited for it are in
 * force. */
static void begin_event(Instance *instance) {
    Block *block = &instance->block;
    block->n[AT_STATES_JUMPED] = 0;
    if (block->n[AT_INTEGER_INPUTS_WAIT]) {
        block->n[AT_INTEGER_INPUTS_WAIT] = 0;
        instance->fresh = 0;
    }
}

/* Goes on in model exchange from the values that were just initialised. What is taken from inputs at the start was taken
 * there. */
static void begin_model_exchange(Instance *instance) {
    Block *block = &instance->block;
    block->n[AT_STARTED] = 1;
    block->v[AT_COMPLETED] = block->v[AT_TIME];
}

/* Sets an Integer or Boolean input between events: it waits for the next one, since within a step of the master's
 * integrator nothing may jump. */
static void set_integer_input_between_events(Instance *instance, int place, int value) {
    Block *block = &instance->block;
    if (!block->n[AT_INTEGER_INPUTS_WAIT]) {
        keep_integer_inputs(block);
    }
    block->n[place] = value;
#if UNIT_INTEGER_INPUTS > 0
    block->n[AT_INTEGER_INPUTS_WAIT] = memcmp(block->n + FIRST_INTEGER_INPUT, block->n + AT_LAST_INTEGER_INPUTS,
                                              UNIT_INTEGER_INPUTS * sizeof value) != 0;
#endif
}

static int section_differs(const real *a, const real *b, int first, int count) {
    for (int place = first; place < first + count; place++) {
        if (a[place] != b[place]) {
            return 1;
        }
    }
    return 0;
}

/* Refuses a point at which the master's integrator has arrived with values beyond any use. */
static int check_point(Instance *instance, StepError *error) {
    real t = instance->block.v[AT_TIME];
    Problem problem = problem_of(instance, 0);
    return check_divergence(&problem, t, error) && check_values(instance, t, error);
}

/* A time event belongs to the present point if it lies at most this far behind it, s: masters add up their steps. */
static real event_slack_of(const Instance *instance) {
    return instance->interface == CO_SIMULATION ? EVENT_SLACK * instance->block.v[AT_LAST_STEP] : R(0.0);
}

static int bring_events(Instance *instance, int *any, StepError *error) {
    Problem problem = problem_of(instance, 0);
    if (!driver_events_at(&instance->driver, &problem, instance->block.v[AT_TIME], event_slack_of(instance), any, error)) {
        return 0;
    }
    instance->fresh = 1;
    return check_point(instance, error);
}

/* What an update of the discrete variables has brought. */
typedef struct {
    int changed;       /* an event was handled or parameters were taken over, so that outputs may have jumped */
    int states_jumped; /* since the event began */
    real next_event;   /* that is known in advance, s */
} Update;

/* Takes over the parameters that were set, all or none, and handles the events that the present time, states and inputs
 * have brought. Where parameters are refused the last valid ones are in force again; after another failure everything is
 * as before, parameters that wait to be taken over included. */
static int update_discrete(Instance *instance, Update *update, StepError *error) {
    Block *block = &instance->block;
    LogPlace place = log_place(&instance->log);
    int taken_over;
    instance->saved = *block;
    instance->fresh = 0;
    if (!commit_parameters(instance, block->v[AT_TIME], &taken_over, error)) {
        return 0;
    }
    /* Not every master sets inputs in Initialization Mode: what is taken from them at the start is taken in the first Event Mode,
     * too. */
    int starts = instance->interface == CO_SIMULATION && !block->n[AT_STARTED];
    if ((starts && !initialise_states(instance, error)) || !bring_events(instance, &update->changed, error)) {
        *block = instance->saved;
        log_take_back(&instance->log, place);
        instance->fresh = 0;
        return 0;
    }
    if (section_differs(block->v, instance->saved.v, FIRST_STATE, UNIT_STATES)) {
        block->n[AT_STATES_JUMPED] = 1;
    }
    update->changed |= taken_over;
    update->states_jumped = block->n[AT_STATES_JUMPED];
    update->next_event = unit_next_time_event(block->v, block->n);
    return 1;
}

/* Ends an event: an indicator that it left at exactly zero is from now on on the side to which it leaves. */
static void end_event(Instance *instance) {
    evaluate(instance);
    real t = instance->block.v[AT_TIME];
    Problem problem = problem_of(instance, 0);
    driver_sides_of_zeros(&instance->driver, &problem, t, t + 1, settings_of(instance).relative_tolerance);
}

/* Whether two blocks differ in what the equations give. */
static int equations_differ(const Block *a, const Block *b) {
    return section_differs(a->v, b->v, FIRST_STATE, UNIT_STATES) || section_differs(a->v, b->v, FIRST_SIGNAL, UNIT_SIGNALS) ||
           section_differs(a->v, b->v, FIRST_RATE, UNIT_STATES) ||
           unit_next_time_event(a->v, a->n) != unit_next_time_event(b->v, b->n);
}

/* Tells the system that a step is completed; whether that is an event.
 *
 * By the standard, discrete variables change in Event Mode only. What a system changes here counts steps and remembers
 * warnings, which equations don't read, and to restart the master's integrator after each step for that would be absurd.
 * So it is an event only where the equations see a difference. */
static int tell_step(Instance *instance) {
    Block *block = &instance->block, *before = &instance->saved;
    real t = block->v[AT_TIME], step = t - block->v[AT_COMPLETED];
    block->v[AT_COMPLETED] = t;
    if (step <= 0) {
        return 0;
    }
    *before = *block;
    unit_step_completed(t, step, block->v, block->n, &instance->log);
    if (!section_differs(block->v, before->v, 0, UNIT_REALS) && memcmp(block->n, before->n, sizeof block->n) == 0) {
        return 0;
    }
    instance->fresh = 0;
    evaluate(instance);
    return equations_differ(block, before);
}

static int note_step(Instance *instance, int *ends_at_event, StepError *error) {
    evaluate(instance);
    if (!check_equations(instance, STEP_UNSOUND, error) || !check_point(instance, error)) {
        return 0;
    }
    int noticed = tell_step(instance);
    Problem problem = problem_of(instance, 0);
    int pending = driver_event_pending(&instance->driver, &problem, instance->block.v[AT_TIME]);
    *ends_at_event = noticed || pending;
    return 1;
}

/* Takes note of a completed step of the master's integrator; whether it ends at an event, be it that inputs wait for one. */
static int complete_step(Instance *instance, int *ends_at_event, StepError *error) {
    int wait = begin_with_integer_inputs_in_force(&instance->block);
    int noted = note_step(instance, ends_at_event, error);
    end_with_integer_inputs_in_force(&instance->block, wait);
    *ends_at_event = noted && (*ends_at_event || wait);
    return noted;
}
