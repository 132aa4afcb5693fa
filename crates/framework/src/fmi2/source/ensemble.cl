/* Many runs of one system at a time, each a work item: communication steps of a fixed number of Runge-Kutta steps of order 4,
 * with events at their ends, as the method `fixed` of an FMU takes them. But contacts aren't judged, and an indicator that begins at
 * zero has no side until it leaves it. */

/* Events that may follow each other at one time. */
#define MOST_EVENTS 1000
/* A time event belongs to the end of a step if it lies at most this part of the step behind it. */
#define EVENT_SLACK 1e-6
/* States beyond it have diverged. */
#define MOST_STATE 1e12

/* Why a run isn't complete. */
#define REFUSED 1
#define DIVERGED 2
#define TOO_MANY_EVENTS 3

/* Signs of the event indicators at an evaluated point; one at zero stays on its side. True if any has changed sides. */
static int note_sides(real t, const real *v, const int *n, int *sides, unsigned char *crossed)
{
    int any = 0;
#if UNIT_INDICATORS > 0
    real z[UNIT_INDICATORS];
    unit_event_indicators(t, v, n, z);
    for (int i = 0; i < UNIT_INDICATORS; i++) {
        const int side = z[i] > 0.0 ? 1 : z[i] < 0.0 ? -1 : sides[i];
        crossed[i] = (unsigned char)(sides[i] != 0 && side != sides[i]);
        any |= crossed[i];
        sides[i] = side;
    }
#endif
    return any;
}

/* Handles events at an evaluated point: of indicators, and time events until none is due. */
static int handle_events(real t, real slack, int any_crossed, real *v, int *n, int *sides, unsigned char *crossed, Log *log)
{
    int due = unit_next_time_event(v, n) <= t + slack;
    for (int events = 1; any_crossed || due; events++) {
        if (events > MOST_EVENTS) {
            return TOO_MANY_EVENTS;
        }
        const real time = due ? fmax(t, unit_next_time_event(v, n)) : t;
        unit_event(time, crossed, v, n, log);
        unit_evaluate(t, v, n);
        (void)note_sides(t, v, n, sides, crossed);
        for (int i = 0; i < UNIT_INDICATORS; i++) {
            crossed[i] = 0;
        }
        any_crossed = 0;
        due = unit_next_time_event(v, n) <= t + slack / (events + 1);
    }
    return 0;
}

/* A Runge-Kutta step of length h. */
static void step_states(real t, real h, real *v, const int *n)
{
#if UNIT_STATES > 0
    real from[UNIT_STATES];
    real sum[UNIT_STATES];
    unit_rates(t, v, n);
    for (int i = 0; i < UNIT_STATES; i++) {
        from[i] = v[FIRST_STATE + i];
        sum[i] = v[FIRST_RATE + i];
        v[FIRST_STATE + i] = from[i] + 0.5 * h * v[FIRST_RATE + i];
    }
    unit_rates(t + 0.5 * h, v, n);
    for (int i = 0; i < UNIT_STATES; i++) {
        sum[i] += 2.0 * v[FIRST_RATE + i];
        v[FIRST_STATE + i] = from[i] + 0.5 * h * v[FIRST_RATE + i];
    }
    unit_rates(t + 0.5 * h, v, n);
    for (int i = 0; i < UNIT_STATES; i++) {
        sum[i] += 2.0 * v[FIRST_RATE + i];
        v[FIRST_STATE + i] = from[i] + h * v[FIRST_RATE + i];
    }
    unit_rates(t + h, v, n);
    for (int i = 0; i < UNIT_STATES; i++) {
        sum[i] += v[FIRST_RATE + i];
        v[FIRST_STATE + i] = from[i] + h / 6.0 * sum[i];
    }
#endif
}

/* One communication step. */
static int communication_step(real t0, real t1, int substeps, real *v, int *n, int *sides, Log *log)
{
    unsigned char crossed[AT_LEAST_ONE(UNIT_INDICATORS)];
    const real h = (t1 - t0) / substeps;
    unit_evaluate(t0, v, n);
    int jumped = note_sides(t0, v, n, sides, crossed);
    int status = handle_events(t0, 0.0, jumped, v, n, sides, crossed, log);
    real t = t0;
    for (int k = 1; status == 0 && k <= substeps; k++) {
        const real end = k == substeps ? t1 : t0 + (t1 - t0) * k / substeps;
        step_states(t, h, v, n);
        for (int i = 0; i < UNIT_STATES; i++) {
            if (!(fabs(v[FIRST_STATE + i]) <= MOST_STATE)) {
                return DIVERGED;
            }
        }
        if (UNIT_INDICATORS > 0 || k == substeps) {
            unit_evaluate(end, v, n);
        }
        jumped = note_sides(end, v, n, sides, crossed);
        status = handle_events(end, EVENT_SLACK * h, jumped, v, n, sides, crossed, log);
        t = end;
    }
    if (status != 0) {
        return status;
    }
    unit_check(t1, v, n, log);
    unit_step_completed(t1, t1 - t0, v, n, log);
    return log->refused ? REFUSED : 0;
}

/* Takes `steps` communication steps of each run from number `first` on. Values that a run continues with are columns of `reals` and
 * `integers`; `recorded` gets what is recorded behind each step, or once before the first where `steps` is 0. Change c of a run is
 * due at step `change_at`; the values that are in force then are column c of `changed_reals` and `changed_integers`. */
__kernel void advance(
    const uint runs, const uint first, const uint steps, const uint all_steps, const double start_time, const double step,
    const double stop_time, const uint substeps, __global double *reals, __global int *integers, __global int *status,
    __global const uint *change_at, __global const double *changed_reals, __global const int *changed_integers,
    __global double *recorded)
{
    const uint run = get_global_id(0);
    if (run >= runs || status[run] != 0) {
        return;
    }
    real v[UNIT_REALS];
    int n[AT_LEAST_ONE(UNIT_INTEGERS)];
    int sides[AT_LEAST_ONE(UNIT_INDICATORS)];
    Log log = { 0 };
    load(v, n, sides, reals, integers, run, runs);
    if (steps == 0) {
        unit_evaluate(start_time, v, n);
        record(v, n, recorded, 0, run, runs);
        return;
    }
    int failure = 0;
    for (uint k = 0; failure == 0 && k < steps; k++) {
        const uint number = first + k;
        const real t0 = start_time + number * step;
        const real t1 = number + 1 == all_steps ? stop_time : start_time + (number + 1) * step;
        for (uint c = 0; c < CHANGES; c++) {
            if (change_at[c * runs + run] == number) {
                change(v, n, changed_reals, changed_integers, c, run, runs);
                unit_parameters_changed(t0, v, n, &log);
            }
        }
        failure = communication_step(t0, t1, (int)substeps, v, n, sides, &log);
        if (failure == 0) {
            record(v, n, recorded, k, run, runs);
        }
    }
    status[run] = failure;
    store(v, n, sides, reals, integers, run, runs);
}
