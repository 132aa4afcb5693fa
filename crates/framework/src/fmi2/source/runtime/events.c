/* Events: where they lie, where they leave an indicator, and when they never end.
 *
 * An event of an indicator is located just behind its zero. Where it turns the motion back by a jump of states (a bounce),
 * the indicator is from then on on the side where it was: coming back over its zero is no second event, however the event
 * was written, and no contact is lost to rounding, however low the bounces are. An event that lets the motion through is
 * as good as any other, unless it has stopped it: then something was to hold that isn't in the equations. */

/* Events that may follow each other without time between them, as far as numbers can tell times apart. */
#define MOST_EVENTS 10000
/* A time event is taken at the end of a communication step if it lies at most this much of the step behind it: masters add
 * up their communication points, and rounding must not move an event by a whole step. */
#define EVENT_SLACK R(1e-6)
/* A rate is found along a tangent on which states change by about this part of their magnitudes, and no longer than this
 * part of the last substep. */
#ifdef UNIT_FLOAT
#define TANGENT R(1e-3)
#else
#define TANGENT R(1e-4)
#endif
#define TANGENT_TIME R(1e-3)
/* An event is located to the rounding of its time, but no finer than this part of its substep. */
#define FINEST R(1e-18)
/* Shorter substeps can't be halved: their lengths are subnormal numbers. */
#define SHORTEST REAL_MIN

/* Counts the events of a communication step: those that have no time between them, and all time events. */
typedef struct {
    real slack; /* how far behind the step's end a time event is taken there, if no other came before */
    long count;
    real last;
    real clock; /* how many time events the step has had */
    long total; /* how many events */
} EventCount;

static EventCount count_from(real t, real slack) {
    EventCount events = {slack, 0, t, R(0.0), 0};
    return events;
}

static int count_another(EventCount *events, real t, int is_time_event, StepError *error) {
    events->count = t - events->last > R(4.0) * REAL_EPSILON * magnitude(t) ? 1 : events->count + 1;
    events->last = t;
    events->total += 1;
    events->clock += is_time_event ? R(1.0) : R(0.0);
    if (events->count > MOST_EVENTS) {
        step_fails(error, STEP_TOO_MANY_EVENTS, 0, t);
        error->events = MOST_EVENTS;
        return 0;
    }
    return 1;
}

/* How far behind the end of the step a time event is taken there: a part of the time between two of them. */
static real event_slack(const EventCount *events) { return events->slack / (events->clock + R(1.0)); }

static real next_time_event(const Problem *problem) { return unit_next_time_event(problem->v, problem->n); }

static int time_event_due(const EventCount *events, const Problem *problem, real t, real t1) {
    real event = next_time_event(problem);
    return event <= t || (t == t1 && event <= t1 + event_slack(events));
}

#if UNIT_INDICATORS > 0

/* The indicators a little ahead on the tangent of a problem that stands evaluated at t. */
static void ahead(Problem *problem, real t, real length, real *z) {
    for (int i = 0; i < UNIT_STATES; i++) {
        problem->v[FIRST_STATE + i] += length * problem->v[FIRST_RATE + i];
    }
    problem_evaluate_signals(problem, t + length);
    event_indicators(problem, t + length, z);
}

/* Puts the problem back to these states at t. */
static void stand_at(Problem *problem, real t, const real *states) {
    copy(problem->v + FIRST_STATE, states, UNIT_STATES);
    problem_evaluate(problem, t);
}

static int differ(const real *a, const real *b, int count) {
    for (int i = 0; i < count; i++) {
        if (a[i] != b[i]) {
            return 1;
        }
    }
    return 0;
}

/* The length of a tangent along which states change by a small part of their magnitudes, before an event and behind it,
 * where the problem stands. */
static real tangent(const Driver *driver, const Problem *problem) {
    real span = driver->indicators.span, length = span > R(0.0) ? TANGENT_TIME * span : (real)INFINITY;
    for (int i = 0; i < 2 * UNIT_STATES; i++) {
        int before = i < UNIT_STATES, k = before ? i : i - UNIT_STATES;
        real x = before ? driver->start.states[k] : problem->v[FIRST_STATE + k];
        real rate = before ? driver->start.rates[k] : problem->v[FIRST_RATE + k];
        if (rate != R(0.0)) {
            length = smaller(length, TANGENT * larger(unit_nominals[k], magnitude(x)) / magnitude(rate));
        }
    }
    return length;
}

/* Leaves in `between` the indicators after a step h of the explicit method: it is so short that it is no harder for one
 * method than for another. The problem is evaluated at the start, before and after. */
static void try_explicitly(Driver *driver, Problem *problem, real h, real relative_tolerance) {
    real t = driver->start.time;
    explicit_attempt(driver, problem, h, relative_tolerance);
    event_indicators(problem, t + h, driver->indicators.between);
    stand_at(problem, t, driver->start.states);
}

/* What holds indicators that an event has stopped: an error where they go on through for a while h all the same. Where
 * nothing moves them now, but no equation reads what the event has set either, they count as on the side from which they
 * came: pushed through later, they have another event. */
static int stay_stopped(Driver *driver, Problem *problem, real t, real h, StepError *error) {
    Indicators *known = &driver->indicators;
    start_at(&driver->start, problem, t);
    try_explicitly(driver, problem, h, DEFAULT_TOLERANCE);
    for (int i = 0; i < UNIT_INDICATORS; i++) {
        real way = (known->between[i] - known->after[i]) * known->came_from[i];
        if (outcome(known, i) == HAS_STOPPED && way < R(0.0)) {
            step_fails(error, STEP_GOES_THROUGH, i, t);
            error->events = (long)kept(problem, ALL_EVENTS)[i];
            return 0;
        }
    }
    exchange_discrete(known, problem);
    problem_evaluate(problem, t);
    int held = differ(problem->v + FIRST_RATE, driver->start.rates, UNIT_STATES);
    exchange_discrete(known, problem);
    problem_evaluate(problem, t);
    for (int i = 0; i < UNIT_INDICATORS; i++) {
        if (!held && outcome(known, i) == HAS_STOPPED) {
            stay(known, problem, i);
        }
    }
    return 1;
}

/* Which indicators that crossed were turned back by the states that have jumped: the motion would have gone on with the
 * states that the event met, and goes back with those that it left. */
static int turned_back(Driver *driver, Problem *problem, real t, StepError *error) {
    Indicators *known = &driver->indicators;
    real length = tangent(driver, problem);
    if (length == R(0.0) || !is_finite(length)) {
        return 1;
    }
    copy(known->states, problem->v + FIRST_STATE, UNIT_STATES);
    ahead(problem, t, length, known->between);
    for (int i = 0; i < UNIT_INDICATORS; i++) {
        known->leaving[i] = known->between[i] - known->after[i];
    }
    stand_at(problem, t, driver->start.states);
    event_indicators(problem, t, known->approach);
    ahead(problem, t, length, known->between);
    for (int i = 0; i < UNIT_INDICATORS; i++) {
        known->approach[i] = known->between[i] - known->approach[i];
    }
    stand_at(problem, t, known->states);
    int any_stopped = 0;
    for (int i = 0; i < UNIT_INDICATORS; i++) {
        int what = outcome(known, i);
        any_stopped |= what == HAS_STOPPED;
        if (what == TURNED_BACK) {
            stay(known, problem, i);
        }
    }
    return any_stopped ? stay_stopped(driver, problem, t, length, error) : 1;
}

/* Takes over where the indicators are behind an event at t, where the problem stands evaluated; `start` has the states
 * that the event met, and `after` the indicators. `moved`: the motion has brought it. */
static int sides_behind(Driver *driver, Problem *problem, real t, int moved, StepError *error) {
    Indicators *known = &driver->indicators;
    int any_crossed = 0;
    copy(known->between, known->after, UNIT_INDICATORS);
    event_indicators(problem, t, known->after);
    for (int i = 0; i < UNIT_INDICATORS; i++) {
        real value = known->after[i];
        known->untouched[i] = value == known->between[i] || value == R(0.0);
        any_crossed |= known->crossed[i];
        if (known->crossed[i] || has_left(problem, i, value)) {
            put_side(problem, i, value, R(0.0));
        }
    }
    take_over(problem, known->after);
    int jumped = any_crossed && differ(problem->v + FIRST_STATE, driver->start.states, UNIT_STATES);
    return moved && jumped ? turned_back(driver, problem, t, error) : 1;
}

/* Counts the state event that was noted. */
static int count_state_event(Driver *driver, Problem *problem, real t, StepError *error) {
    int endless = count_events(&driver->indicators, problem, t);
    if (endless >= 0) {
        step_fails(error, STEP_ACCUMULATION, endless, t);
        error->events = (long)kept(problem, ALL_EVENTS)[endless];
        error->close = MOST_CLOSE;
        return 0;
    }
    return 1;
}

#endif

/* Notes which indicators changed sides since they were last known, where the problem stands evaluated at t; whether any
 * did. */
static int crossed_at(Driver *driver, const Problem *problem, real t) {
#if UNIT_INDICATORS > 0
    Indicators *known = &driver->indicators;
    event_indicators(problem, t, known->after);
    int crossed = note_crossed(known, problem);
    take_over(problem, known->after);
    return crossed;
#else
    (void)driver;
    (void)problem;
    (void)t;
    return 0;
#endif
}

/* The same after an evaluation. Inputs, parameters and states that were set may have taken an indicator across. */
static int jumped_at(Driver *driver, Problem *problem, real t) {
    problem_evaluate(problem, t);
    return crossed_at(driver, problem, t);
}

/* Handles an event at t: of indicators that were noted, or a time event that is due. */
static int handle_event(Driver *driver, Problem *problem, real t, int due, int moved, StepError *error) {
    /* Where rounding has the step end a little before a time event, the unit is told the event's own time. */
    real time = due ? larger(t, next_time_event(problem)) : t;
    driver->work += EVALUATION_WORK;
    start_at(&driver->start, problem, t);
#if UNIT_INDICATORS > 0
    Indicators *known = &driver->indicators;
    keep_discrete(known, problem);
    unit_event(time, known->crossed, problem->v, problem->n, problem->log);
    problem_evaluate(problem, t);
    if (!sides_behind(driver, problem, t, moved, error)) {
        return 0;
    }
    memset(known->crossed, 0, sizeof known->crossed);
#else
    (void)moved;
    (void)error;
    unit_event(time, NULL, problem->v, problem->n, problem->log);
    problem_evaluate(problem, t);
#endif
    return 1;
}

/* Handles the state event that was noted, and time events until none is due. `moved`: the motion has brought it, and no
 * value that was set. */
static int handle_events(Driver *driver, Problem *problem, real t, real t1, EventCount *events, int moved,
                         StepError *error) {
#if UNIT_INDICATORS > 0
    /* How fast indicators went is forgotten: what comes may be another motion. */
    driver->indicators.substep = R(0.0);
    if (moved && !count_state_event(driver, problem, t, error)) {
        return 0;
    }
#endif
    int due = time_event_due(events, problem, t, t1);
    do {
        if (!count_another(events, t, due, error) || !handle_event(driver, problem, t, due, moved, error)) {
            return 0;
        }
        due = time_event_due(events, problem, t, t1);
    } while (due);
    return 1;
}

static int driver_events_at(Driver *driver, Problem *problem, real t, real slack, int *any, StepError *error) {
    EventCount events = count_from(t, larger(slack, rounding(t)));
    *any = jumped_at(driver, problem, t) || time_event_due(&events, problem, t, t);
    return *any ? handle_events(driver, problem, t, t, &events, 1, error) : 1;
}

static int driver_settle(Driver *driver, Problem *problem, real t, StepError *error) {
    int any;
#if UNIT_INDICATORS > 0
    /* Nothing was known before, so nothing has crossed. */
    memset(kept(problem, 0), 0, KEPT_OF_INDICATORS * UNIT_INDICATORS * sizeof(real));
#endif
    return driver_events_at(driver, problem, t, R(0.0), &any, error);
}

static int driver_event_pending(Driver *driver, Problem *problem, real t) {
    int pending = next_time_event(problem) <= t + rounding(t);
#if UNIT_INDICATORS > 0
    Indicators *known = &driver->indicators;
    event_indicators(problem, t, known->after);
    take_over(problem, known->after);
    pending = pending || any_left(problem, known->after);
#else
    (void)driver;
#endif
    return pending;
}

/* The side is found by a step of rounding's length towards t1, or, where that is lost in the indicator's own rounding,
 * along the tangent. */
static void driver_sides_of_zeros(Driver *driver, Problem *problem, real t, real t1, real relative_tolerance) {
#if UNIT_INDICATORS > 0
    Indicators *known = &driver->indicators;
    if (!any_zero(problem)) {
        return;
    }
    real h = smaller(R(64.0) * REAL_EPSILON * larger(magnitude(t), magnitude(t1)), t1 - t);
    start_at(&driver->start, problem, t);
    try_explicitly(driver, problem, h, relative_tolerance);
    leave_zero(known, problem);
    real length = smaller(tangent(driver, problem), t1 - t);
    if (is_finite(length) && any_zero(problem)) {
        ahead(problem, t, length, known->between);
        stand_at(problem, t, driver->start.states);
        leave_zero(known, problem);
    }
#else
    (void)driver;
    (void)problem;
    (void)t;
    (void)t1;
    (void)relative_tolerance;
#endif
}

#if UNIT_INDICATORS > 0

/* Looks for an indicator that has left its side within the substep that was just accepted, and is back on it at the end; a
 * length within which it leaves, or 0. Where there is none, the problem stands at the end, as it did. */
static real within(Driver *driver, Problem *problem, real end, real relative_tolerance, Pace *pace) {
    Indicators *known = &driver->indicators;
    real t = driver->start.time, h = end - t;
    if (!may_leave(known, problem, h)) {
        return R(0.0);
    }
    copy(driver->end, problem->v + FIRST_INPUT, EVALUATED);
    real part = leaves_within(driver, problem, h);
    copy(problem->v + FIRST_INPUT, driver->end, EVALUATED);
    if (part == R(0.0)) {
        return R(0.0);
    }
    /* What an interpolation shows, the solution must show as well. */
    real shorter = part * h;
    attempt(driver, problem, shorter, relative_tolerance, pace);
    event_indicators(problem, t + shorter, known->between);
    if (any_left(problem, known->between)) {
        copy(known->after, known->between, UNIT_INDICATORS);
        return shorter;
    }
    attempt(driver, problem, h, relative_tolerance, pace);
    event_indicators(problem, end, known->after);
    return R(0.0);
}

/* The shortest length at which a time can be told from that of the start and a way `high`. */
static real shortest_at(const Driver *driver, real high, real shortest) {
    return larger(shortest, R(4.0) * REAL_EPSILON * magnitude(driver->start.time + high));
}

/* The end of a substep that ends just behind the first crossing before `high`, where indicators have left; the problem
 * stands there. A bracketing search repeats the substep: regula falsi, and a bisection whenever that fails to halve the
 * bracket. So an event is as accurate as the method itself, whichever it is. */
static real search_crossing(Driver *driver, Problem *problem, real high, real relative_tolerance, Pace *pace) {
    Indicators *known = &driver->indicators;
    real low = R(0.0), shortest = larger(FINEST * high, SHORTEST);
    int bisect = 0;
    while (high - low > shortest_at(driver, high, shortest)) {
        real width = shortest_at(driver, high, shortest), gap = high - low;
        real part = bisect ? R(0.5) : first_crossing(known, problem);
        real h = clamped(low + gap * part, low + R(0.25) * width, high - R(0.25) * width);
        attempt(driver, problem, h, relative_tolerance, pace);
        event_indicators(problem, driver->start.time + h, known->between);
        if (any_left(problem, known->between)) {
            high = h;
            copy(known->after, known->between, UNIT_INDICATORS);
        } else {
            low = h;
            take_over(problem, known->between);
        }
        bisect = high - low > R(0.5) * gap;
    }
    attempt(driver, problem, high, relative_tolerance, pace);
    return driver->start.time + high;
}

#endif

#if UNIT_MOVES

/* Moves *t to the end of an accepted substep, or to the first event indicator that changes its sign before; whether there
 * is one. */
static int locate_event(Driver *driver, Problem *problem, real *t, real end, real relative_tolerance, Pace *pace) {
#if UNIT_INDICATORS > 0
    Indicators *known = &driver->indicators;
    real high = end - *t;
    event_indicators(problem, end, known->after);
    if (!any_left(problem, known->after)) {
        real shorter = within(driver, problem, end, relative_tolerance, pace);
        if (shorter == R(0.0)) {
            note_slopes(known, problem, high);
            take_over(problem, known->after);
            *t = end;
            return 0;
        }
        high = shorter;
    }
    known->span = end - *t;
    *t = search_crossing(driver, problem, high, relative_tolerance, pace);
    /* The indicators at the bracket's end are those that stand in `after`. */
    note_crossed(known, problem);
    return 1;
#else
    (void)driver;
    (void)problem;
    (void)relative_tolerance;
    (void)pace;
    *t = end;
    return 0;
#endif
}

#endif
