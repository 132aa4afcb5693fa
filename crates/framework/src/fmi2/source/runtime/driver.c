/* Step-size control and events: from one communication point to the next. */

/* Without states, outputs have no error. */
#define OUTPUTS_HAVE_ERRORS (UNIT_OUTPUTS > 0 && UNIT_STATES > 0)

#if OUTPUTS_HAVE_ERRORS

/* Beyond this, an output multiplies what can't be told from rounding: the error of states is controlled there, that of the
 * output isn't worth what it would take. */
#define MOST_AMPLIFIED R(1e4)
/* An output's error in a substep may be this part of what is tolerated: an error of the control stays until the loop has
 * answered it, and those of many substeps add up. */
#define OUTPUT_PART R(0.1)
/* A control before its limits counts in the magnitude that it has within them, up to so many times that. */
#define FAR_BEYOND R(10.0)
/* Factor on the error estimate of a substep in which a control reaches or leaves a limit: rates have a kink there, and the
 * difference of the two solutions doesn't show it. */
#define KINK R(6.0)
/* Relative accuracy of states below which nothing is asked for the sake of outputs. */
#ifdef UNIT_FLOAT
#define STATE_ROUNDING R(1e-6)
#else
#define STATE_ROUNDING R(1e-13)
#endif

/* True if a limit cuts an output. */
static int is_cut(const real *v, int i) {
    return v[unit_watched[i].place] != v[unit_watched[i].output];
}

/* True if a control reached or left a limit since the substep began. */
static int has_kink(const Driver *driver, const real *v) {
    int changed = 0;
    for (int i = 0; i < UNIT_OUTPUTS; i++) {
        changed = changed || (int)driver->cut[i] != is_cut(v, i);
    }
    return changed;
}

/* The largest error of a continuous output in units of what is tolerated, right after an attempt to t whose largest error
 * of a state is `scaled`: outputs multiply the errors of states, by gains of thousands in a controller. The problem stands
 * as before. */
static real outputs_error(Driver *driver, Problem *problem, real t, real scaled, real relative_tolerance) {
    real amplified = clamped(relative_tolerance / STATE_ROUNDING, R(1.0), MOST_AMPLIFIED), worst = R(0.0);
    real *v = problem->v, *end = driver->end;
    scaled *= has_kink(driver, v) ? KINK : R(1.0);
    if (scaled * amplified <= R(1.0)) {
        return scaled;
    }
    copy(end, v + FIRST_INPUT, EVALUATED);
    for (int i = 0; i < UNIT_STATES; i++) {
        v[FIRST_STATE + i] -= driver->errors[i];
    }
    problem_evaluate_signals(problem, t);
    for (int i = 0; i < UNIT_OUTPUTS; i++) {
        int place = unit_watched[i].place;
        real value = end[place - FIRST_INPUT];
        real size = larger(larger(unit_watched[i].nominal, magnitude(driver->outputs[i])),
                           larger(magnitude(end[unit_watched[i].output - FIRST_INPUT]), magnitude(value) / FAR_BEYOND));
        /* Where the other solution gives no number, its distance tells nothing. */
        worst = larger(worst, magnitude(v[place] - value) / (OUTPUT_PART * relative_tolerance * size));
    }
    copy(v + FIRST_INPUT, end, EVALUATED);
    return larger(scaled, smaller(worst, scaled * amplified));
}

#endif

#if UNIT_MOVES

/* A new substep is this much smaller than the one that would just meet the tolerance. */
#define SAFETY R(0.9)
/* The largest change of the substep, down and up. */
#define SHRINK R(0.2)
#define GROW R(5.0)
/* A substep that would leave less than this part of the way is stretched to the end. */
#define STRETCH R(1.001)

/* Factor to the next substep from a scaled error of this order. */
static real growth(real scaled, int order) {
    /* Below this error the factor is at its limit: no power to take. */
    return scaled < R(1e-6) ? GROW : clamped(SAFETY * F(pow)(scaled, R(-1.0) / (real)order), SHRINK, GROW);
}

/* An attempt, with the error of what a user reads in it. */
static Estimate controlled(Driver *driver, Problem *problem, real h, real relative_tolerance, Pace *pace) {
    Estimate estimate = attempt(driver, problem, h, relative_tolerance, pace);
#if OUTPUTS_HAVE_ERRORS
    if (estimate.scaled <= R(1.0)) {
        real tolerance = tolerated(problem, &pace->limits, relative_tolerance), end = driver->start.time + h;
        estimate.scaled = outputs_error(driver, problem, end, estimate.scaled, tolerance);
    }
#endif
    return estimate;
}

/* The substep to try first: the one that is suggested, where there is so long a way to go, and what eigenvalues allow. */
static real first_substep(const Driver *driver, const Pace *pace, real way, real smallest) {
    real longest = larger(longest_substep(driver, pace), smallest);
    real suggested = suggested_substep(driver, pace);
    real h = suggested > R(0.0) ? smaller(suggested, longest) : longest;
    return h * STRETCH < way ? h : way;
}

/* Takes note of an accepted substep h. */
static void accept_substep(const Driver *driver, real h, real way, real scaled, int method, Pace *pace) {
    /* A substep that was cut short says nothing about how long the next may be, unless it was the limit. */
    real suggested = suggested_substep(driver, pace);
    if (suggested == R(0.0) || h >= suggested) {
        suggest_substep(driver, h * growth(scaled, order_in_force(driver, pace)), pace);
    }
#if UNIT_HAS_SPECTRUM
    if (method == METHOD_AUTOMATIC) {
        judge(driver, h, h == way, pace);
    }
#else
    (void)way;
    (void)method;
#endif
}

/* One accepted substep from *t towards `target`. *state_event: whether it ended at one. */
static int substep(Driver *driver, Problem *problem, real *t, real target, const Settings *settings, Pace *pace,
                   int *state_event, StepError *error) {
    real way = target - *t, tolerance = settings->relative_tolerance;
    real smallest = larger(R(16.0) * REAL_EPSILON * larger(magnitude(*t), magnitude(target)), SHORTEST);
    start_at(&driver->start, problem, *t);
#if OUTPUTS_HAVE_ERRORS
    for (int i = 0; i < UNIT_OUTPUTS; i++) {
        driver->outputs[i] = problem->v[unit_watched[i].output];
        driver->cut[i] = (unsigned char)is_cut(problem->v, i);
    }
#endif
    if (!begin_substep(driver, problem, settings->method, way, pace, error)) {
        return 0;
    }
    note_method(driver, settings->method, *t, pace);
    real h = first_substep(driver, pace, way, smallest);
    for (;;) {
        Estimate estimate = controlled(driver, problem, h, tolerance, pace);
        if (estimate.scaled <= R(1.0)) {
            accept_substep(driver, h, way, estimate.scaled, settings->method, pace);
            *state_event = locate_event(driver, problem, t, h == way ? target : *t + h, tolerance, pace);
            return 1;
        }
        real factor = growth(estimate.scaled, order_in_force(driver, pace));
        h *= is_finite(estimate.scaled) ? smaller(factor, SAFETY) : SHRINK;
        suggest_substep(driver, h, pace);
        if (h <= smallest) {
            step_fails(error, STEP_TOO_SMALL, FIRST_STATE + estimate.state, *t);
            error->value = driver->start.states[estimate.state];
            error->step = h;
            error->tolerance = tolerance;
            return 0;
        }
    }
}

#endif

/* Goes on from *t to `target`, or to a state event before. */
static int go_on(Driver *driver, Problem *problem, real *t, real target, const Settings *settings, Pace *pace,
                 int *state_event, StepError *error) {
    *state_event = 0;
    if (!(target > *t)) {
        return 1;
    }
#if UNIT_MOVES
    return substep(driver, problem, t, target, settings, pace, state_event, error);
#else
    /* Nothing moves between time events. */
    (void)settings;
    (void)pace;
    (void)error;
    problem_evaluate(problem, target);
    driver->work += EVALUATION_WORK;
    *t = target;
    return 1;
#endif
}

/* What grows by e to this within a communication step, and keeps it from being finished, escapes. */
#define ESCAPES R(1e6)

/* Why a step of this length comes no further than t with so many events and substeps: a mode that had to be followed escapes,
 * or it is too much. */
static int overworked(const Driver *driver, const Problem *problem, real t, real step, long events, long substeps, const Pace *pace,
                      StepError *error) {
    const Limits *limits = &pace->limits;
    ExplicitLimits of_explicit = driver->by_order_8 ? limits->order_8 : limits->order_5;
    int follows = pace->stiff ? limits->stiff > R(0.0) : of_explicit.growing > of_explicit.stable, largest = 0;
    if (!follows || limits->mode.growth * step < ESCAPES) {
        step_fails(error, STEP_TOO_MUCH_WORK, 0, t);
        error->events = events;
        error->substeps = substeps;
        error->step = step;
        error->follows = follows;
        error->mode = limits->mode;
        return 0;
    }
    const real *x = problem->v + FIRST_STATE;
    for (int i = 1; i < UNIT_STATES; i++) {
        largest = magnitude(x[i]) / unit_nominals[i] >= magnitude(x[largest]) / unit_nominals[largest] ? i : largest;
    }
    step_fails(error, STEP_DIVERGED, FIRST_STATE + largest, t);
    error->value = x[largest];
    return 0;
}

/* Advances a problem from t0 to t1 by substeps under error control. */
static int integrate(Driver *driver, Problem *problem, real t0, real t1, const Settings *settings, Pace *pace,
                     StepError *error) {
    EventCount events = count_from(t0, EVENT_SLACK * (t1 - t0));
    real t = t0;
    long substeps = 0;
    driver->work = R(0.0);
#if UNIT_INDICATORS > 0
    driver->indicators.substep = R(0.0);
#endif
    if (jumped_at(driver, problem, t) && !handle_events(driver, problem, t, t1, &events, 0, error)) {
        return 0;
    }
    driver_sides_of_zeros(driver, problem, t, t1, settings->relative_tolerance);
    while (t < t1) {
        real event = next_time_event(problem), target = event < t1 - event_slack(&events) ? larger(event, t) : t1;
        int state_event;
        if (!go_on(driver, problem, &t, target, settings, pace, &state_event, error)) {
            return 0;
        }
        substeps++;
        if (driver->work > settings->most_work) {
            return overworked(driver, problem, t, t1 - t0, events.total, substeps, pace, error);
        }
        if (!check_divergence(problem, t, error)) {
            return 0;
        }
        int is_left = settings->leaves_end && t >= t1 && !state_event;
        if (!is_left && (state_event || time_event_due(&events, problem, t, t1))) {
            if (!handle_events(driver, problem, t, t1, &events, state_event, error)) {
                return 0;
            }
            if (t < t1) {
                driver_sides_of_zeros(driver, problem, t, t1, settings->relative_tolerance);
            }
        }
    }
    return 1;
}

/* How often the shortest step is doubled in the search for where the equations cease to hold. */
#define LOOK_AHEAD 12

/* Whether the equations hold where a substep begins that can't be finished, and a little ahead along its tangent: towards a
 * pole, steps shrink as the way to it does, so that none of them reaches it. */
static int check_ahead(const Start *start, Problem *problem, real shortest, StepError *error) {
    int finite = 1;
    real h = shortest;
    copy(problem->v + FIRST_STATE, start->states, UNIT_STATES);
    problem_evaluate_signals(problem, start->time);
    if (!problem_check(problem, start->time, error)) {
        return 0;
    }
    for (int i = 0; i < UNIT_STATES; i++) {
        finite = finite && is_finite(start->rates[i]);
    }
    for (int doublings = 0; finite && doublings <= LOOK_AHEAD; doublings++, h *= R(2.0)) {
        for (int i = 0; i < UNIT_STATES; i++) {
            problem->v[FIRST_STATE + i] = start->states[i] + h * start->rates[i];
        }
        problem_evaluate_signals(problem, start->time + h);
        if (!problem_check(problem, start->time + h, error)) {
            return 0;
        }
    }
    return 1;
}

static int driver_advance(Driver *driver, Problem *problem, real t0, real t1, const Settings *settings, Pace *pace,
                          StepError *error) {
#if UNIT_STATES > 0
    int arrived = settings->method == METHOD_FIXED ? fixed_advance(driver, problem, t0, t1, settings, error)
                                                   : integrate(driver, problem, t0, t1, settings, pace, error);
#else
    int arrived = integrate(driver, problem, t0, t1, settings, pace, error);
#endif
    if (arrived) {
        return 1;
    }
    /* Where the unit itself says that its equations don't hold, that is the reason. */
    if (error->kind == STEP_TOO_SMALL) {
        check_ahead(&driver->start, problem, error->step, error);
    } else if (error->kind == STEP_DIVERGED || error->kind == STEP_NO_JACOBIAN || error->kind == STEP_TOO_MUCH_WORK) {
        problem_check(problem, error->time, error);
    } else {
        /* Events and parameters have reasons of their own. */
    }
    return 0;
}
