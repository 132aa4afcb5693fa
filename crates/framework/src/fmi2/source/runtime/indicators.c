/* Event indicators: on which sides they are, when they leave them, and how often.
 *
 * An event lies just behind a zero of its indicator. How far beyond is kept as the indicator's overshoot, where the event
 * turned the motion back: until it has come back to its side, only what is deeper counts as another crossing. */

/* How exactly a master's times and the solution tell when an event is, relative to the time. */
#ifdef UNIT_FLOAT
#define EVENT_PRECISION R(1e-6)
#else
#define EVENT_PRECISION R(1e-11)
#endif

/* How far t may lie before a time event that it is meant to be: a master rounds. */
static real rounding(real t) { return EVENT_PRECISION * magnitude(t); }

#if UNIT_INDICATORS > 0

/* So many events of one indicator may follow each other within the rounding of time. */
#define MOST_CLOSE 100
/* An event that leaves less than this part of an indicator's rate has stopped it. */
#define STOPPED R(1e-6)
/* An indicator is looked at within a substep where its bow could be this many times as large as estimated and reach
 * zero. */
#define CAUTION R(4.0)

/* What is kept of each indicator in the block: the value where it was last known (its sign is the side), its overshoot,
 * the time of its last event, how many of its events were close together, and how many there were. */
enum { SIDES, OVERSHOOTS, LAST_EVENTS, CLOSE_EVENTS, ALL_EVENTS, KEPT_OF_INDICATORS };

static real *kept(const Problem *problem, int which) { return problem->v + AT_INDICATORS + which * UNIT_INDICATORS; }

static void event_indicators(const Problem *problem, real t, real *z) { unit_event_indicators(t, problem->v, problem->n, z); }

/* Whether two numbers have other signs; what is no number has none. */
static int other_sign(real a, real b) {
    return a != a || b != b || F(copysign)(R(1.0), a) != F(copysign)(R(1.0), b);
}

/* Whether indicator i left the side on which it was; one that was exactly zero had none. One that is on its way back from
 * an overshoot has not left. */
static int has_left(const Problem *problem, int i, real value) {
    real side = kept(problem, SIDES)[i], overshoot = kept(problem, OVERSHOOTS)[i];
    int elsewhere = side != R(0.0) && (value == R(0.0) || other_sign(side, value));
    return elsewhere && (overshoot == R(0.0) || magnitude(value) > overshoot);
}

static int any_left(const Problem *problem, const real *values) {
    for (int i = 0; i < UNIT_INDICATORS; i++) {
        if (has_left(problem, i, values[i])) {
            return 1;
        }
    }
    return 0;
}

static void put_side(const Problem *problem, int i, real side, real overshoot) {
    kept(problem, SIDES)[i] = side;
    kept(problem, OVERSHOOTS)[i] = overshoot;
}

/* Takes over the values of those that are on their sides. */
static void take_over(const Problem *problem, const real *values) {
    for (int i = 0; i < UNIT_INDICATORS; i++) {
        real value = values[i], side = kept(problem, SIDES)[i];
        int arrived = value != R(0.0) && (side == R(0.0) || !other_sign(value, side));
        if (!has_left(problem, i, value) && (arrived || kept(problem, OVERSHOOTS)[i] == R(0.0))) {
            put_side(problem, i, value, R(0.0));
        }
    }
}

/* Has an indicator behind its event on the side from which it came. */
static void stay(const Indicators *known, const Problem *problem, int i) {
    put_side(problem, i, known->came_from[i] * REAL_MIN, larger(magnitude(known->after[i]), REAL_MIN));
}

static int any_zero(const Problem *problem) {
    for (int i = 0; i < UNIT_INDICATORS; i++) {
        if (kept(problem, SIDES)[i] == R(0.0)) {
            return 1;
        }
    }
    return 0;
}

/* Has those that stand at zero on the sides where they are in `between`. As long as rounding keeps one at zero, it has not
 * come back there. */
static void leave_zero(const Indicators *known, const Problem *problem) {
    for (int i = 0; i < UNIT_INDICATORS; i++) {
        if (kept(problem, SIDES)[i] == R(0.0) && known->between[i] != R(0.0)) {
            put_side(problem, i, known->between[i], REAL_MIN);
        }
    }
}

/* Notes which have changed sides on the way to `after`; whether any has. */
static int note_crossed(Indicators *known, const Problem *problem) {
    int any = 0;
    for (int i = 0; i < UNIT_INDICATORS; i++) {
        real side = kept(problem, SIDES)[i];
        known->crossed[i] = (unsigned char)has_left(problem, i, known->after[i]);
        known->came_from[i] = side != side ? side : F(copysign)(R(1.0), side);
        known->never_back[i] = kept(problem, OVERSHOOTS)[i] > R(0.0);
        any |= known->crossed[i];
    }
    return any;
}

/* Counts the events that were noted, at t; the indicator whose events accumulate, or -1: there is no time between them, or
 * what is between is lost in the rounding of the indicator. */
static int count_events(Indicators *known, const Problem *problem, real t) {
    int endless = -1;
    for (int i = UNIT_INDICATORS - 1; i >= 0; i--) {
        if (known->crossed[i]) {
            real gap = t - kept(problem, LAST_EVENTS)[i], *close = kept(problem, CLOSE_EVENTS) + i;
            int is_short = kept(problem, ALL_EVENTS)[i] > R(0.0) && gap > R(0.0) && gap <= rounding(t);
            *close = is_short || known->never_back[i] ? *close + R(1.0) : R(0.0);
            kept(problem, LAST_EVENTS)[i] = t;
            kept(problem, ALL_EVENTS)[i] += R(1.0);
            endless = *close > (real)MOST_CLOSE ? i : endless;
        }
    }
    return endless;
}

static void exchange_real(real *a, real *b) {
    real kept_number = *a;
    *a = *b;
    *b = kept_number;
}

/* Exchanges the problem's discrete values with those that were kept. */
static void exchange_discrete(Indicators *known, Problem *problem) {
    for (int i = 0; i < UNIT_DISCRETES; i++) {
        exchange_real(&known->discrete[i], &problem->v[FIRST_DISCRETE + i]);
    }
    for (int i = 0; i < UNIT_INTEGER_DISCRETES; i++) {
        int value = known->discrete_integers[i];
        known->discrete_integers[i] = problem->n[FIRST_INTEGER_DISCRETE + i];
        problem->n[FIRST_INTEGER_DISCRETE + i] = value;
    }
}

/* Keeps the problem's discrete values as an event meets them. */
static void keep_discrete(Indicators *known, const Problem *problem) {
    copy(known->discrete, problem->v + FIRST_DISCRETE, UNIT_DISCRETES);
    for (int i = 0; i < UNIT_INTEGER_DISCRETES; i++) {
        known->discrete_integers[i] = problem->n[FIRST_INTEGER_DISCRETE + i];
    }
}

/* What became of an indicator's motion at an event that has changed states. Otherwise: it went on, or the event brought
 * the indicator elsewhere, or didn't act on it. */
enum { OTHERWISE, TURNED_BACK, HAS_STOPPED };

static int outcome(const Indicators *known, int i) {
    real side = known->came_from[i];
    real z = known->after[i] * side, approach = known->approach[i] * side, leaving = known->leaving[i] * side;
    int went_on = known->crossed[i] && approach < R(0.0) && z <= R(0.0);
    if (!went_on || leaving < STOPPED * approach) {
        return OTHERWISE;
    }
    if (leaving <= -STOPPED * approach) {
        return HAS_STOPPED;
    }
    return known->untouched[i] ? TURNED_BACK : OTHERWISE;
}

/* Where, as a part of the way, the first of the indicators that changed sign would be zero if it were linear; the middle
 * where one is still on its way back to its side. */
static real first_crossing(const Indicators *known, const Problem *problem) {
    real first = R(1.0);
    for (int i = 0; i < UNIT_INDICATORS; i++) {
        if (has_left(problem, i, known->after[i])) {
            real before = kept(problem, SIDES)[i];
            real zero = kept(problem, OVERSHOOTS)[i] > R(0.0) ? R(0.5) : before / (before - known->after[i]);
            first = smaller(first, zero);
        }
    }
    return first;
}

/* Whether an indicator that is on its side at both ends of an accepted substep h may have left it between: where nothing
 * is known of its bow, or where that is large for how far it is from zero. */
static int may_leave(const Indicators *known, const Problem *problem, real h) {
    if (known->substep == R(0.0)) {
        return 1;
    }
    for (int i = 0; i < UNIT_INDICATORS; i++) {
        real before = kept(problem, SIDES)[i], after = known->after[i];
        real bend = magnitude((after - before) / h - known->slopes[i]);
        real bow = bend * h * h / (R(4.0) * (h + known->substep));
        if (CAUTION * bow > smaller(magnitude(before), magnitude(after))) {
            return 1;
        }
    }
    return 0;
}

static void note_slopes(Indicators *known, const Problem *problem, real h) {
    for (int i = 0; i < UNIT_INDICATORS; i++) {
        known->slopes[i] = (known->after[i] - kept(problem, SIDES)[i]) / h;
    }
    known->substep = h;
}

/* Leaves in `between` the indicators at a part of the substep h, by Hermite's interpolation of the states between its
 * start and the driver's `end`. */
static void interpolate(Driver *driver, Problem *problem, real h, real part) {
    const Start *start = &driver->start;
    const real *ends = driver->end + (FIRST_STATE - FIRST_INPUT), *end_rates = driver->end + (FIRST_RATE - FIRST_INPUT);
    real rest = R(1.0) - part, t = start->time + part * h;
    for (int i = 0; i < UNIT_STATES; i++) {
        real x0 = start->states[i], x1 = ends[i];
        real chord = x0 + part * (x1 - x0);
        real early = h * start->rates[i] - (x1 - x0), late = h * end_rates[i] - (x1 - x0);
        problem->v[FIRST_STATE + i] = chord + part * rest * (rest * early - part * late);
    }
    problem_evaluate_signals(problem, t);
    event_indicators(problem, t, driver->indicators.between);
}

/* Where a parabola through both ends of the way and the middle comes closest to zero, if that is near zero: then it is
 * looked at, for a parabola is not quite the curve. 0 where it isn't. */
static real nearest_part(real side, real middle, real end) {
    real slope = R(4.0) * middle - R(3.0) * side - end, curvature = R(2.0) * (side - R(2.0) * middle + end);
    if (curvature == R(0.0)) {
        return R(0.0);
    }
    real part = -slope / (R(2.0) * curvature);
    real value = side + part * (slope + part * curvature);
    int near = value * middle <= R(0.25) * magnitude(value - middle) * magnitude(middle);
    return part > R(0.0) && part < R(1.0) && near ? part : R(0.0);
}

/* A part of the accepted substep h at which an indicator has left its side, as the states' cubic interpolation has it; 0
 * where there is none. */
static real leaves_within(Driver *driver, Problem *problem, real h) {
    Indicators *known = &driver->indicators;
    interpolate(driver, problem, h, R(0.5));
    if (any_left(problem, known->between)) {
        return R(0.5);
    }
    for (int i = 0; i < UNIT_INDICATORS; i++) {
        real side = kept(problem, OVERSHOOTS)[i] > R(0.0) ? R(0.0) : kept(problem, SIDES)[i];
        real part = nearest_part(side, known->between[i], known->after[i]);
        if (part > R(0.0)) {
            interpolate(driver, problem, h, part);
            if (any_left(problem, known->between)) {
                return part;
            }
            interpolate(driver, problem, h, R(0.5));
        }
    }
    return R(0.0);
}

#endif
