/* Steps of fixed length: the classical Runge-Kutta method of order 4, for targets that must know beforehand what a
 * communication step takes. There is no error control.
 *
 * Events are handled where a substep ends in which they fall due or in which an indicator has changed sides, one after the
 * other. A time event is due at an end that lies at most a little before it. An indicator that changes sides twice within
 * a substep has no event. */

#if UNIT_STATES > 0

/* Goes on along the rates that the problem holds, h from the start; these are kept as a stage. */
static void fixed_stage(Driver *driver, Problem *problem, int stage, real h) {
    for (int i = 0; i < UNIT_STATES; i++) {
        driver->stages[stage][i] = problem->v[FIRST_RATE + i];
        problem->v[FIRST_STATE + i] = driver->start.states[i] + h * driver->stages[stage][i];
    }
    problem_evaluate(problem, driver->start.time + h);
}

/* One step of length h from t, where the problem stands evaluated; it is then evaluated at `end`. */
static void fixed_step(Driver *driver, Problem *problem, real t, real h, real end) {
    const real *first = driver->stages[0], *second = driver->stages[1], *third = driver->stages[2];
    start_at(&driver->start, problem, t);
    fixed_stage(driver, problem, 0, R(0.5) * h);
    fixed_stage(driver, problem, 1, R(0.5) * h);
    fixed_stage(driver, problem, 2, h);
    for (int i = 0; i < UNIT_STATES; i++) {
        real sum = first[i] + R(2.0) * second[i] + R(2.0) * third[i] + problem->v[FIRST_RATE + i];
        problem->v[FIRST_STATE + i] = driver->start.states[i] + h / R(6.0) * sum;
    }
    problem_evaluate(problem, end);
}

/* Handles what a substep has brought about, at its end. */
static int end_substep(Driver *driver, Problem *problem, real end, real t1, real slack, const Settings *settings,
                       StepError *error) {
    EventCount events = count_from(end, slack);
    int crossed = crossed_at(driver, problem, end);
    int is_left = settings->leaves_end && end >= t1 && !crossed;
    if (is_left || (!crossed && !time_event_due(&events, problem, end, end))) {
        return 1;
    }
    if (!handle_events(driver, problem, end, end, &events, crossed, error)) {
        return 0;
    }
    if (end < t1) {
        driver_sides_of_zeros(driver, problem, end, t1, settings->relative_tolerance);
    }
    return 1;
}

/* Advances a problem from t0 to t1 by so many substeps of the same length. */
static int fixed_advance(Driver *driver, Problem *problem, real t0, real t1, const Settings *settings, StepError *error) {
    int steps = settings->fixed_steps;
    real t = t0, h = (t1 - t0) / (real)steps;
    EventCount begun = count_from(t0, R(0.0));
    note_method(driver, settings->method, t0, NULL);
#if UNIT_INDICATORS > 0
    driver->indicators.substep = R(0.0);
    driver->indicators.span = h;
#endif
    if ((jumped_at(driver, problem, t0) || time_event_due(&begun, problem, t0, t0)) &&
        !handle_events(driver, problem, t0, t0, &begun, 0, error)) {
        return 0;
    }
    driver_sides_of_zeros(driver, problem, t0, t1, settings->relative_tolerance);
    for (int step = 1; step <= steps; step++) {
        real end = step == steps ? t1 : t0 + (t1 - t0) * (real)step / (real)steps;
        fixed_step(driver, problem, t, h, end);
        if (!check_divergence(problem, end, error) ||
            !end_substep(driver, problem, end, t1, EVENT_SLACK * h, settings, error)) {
            return 0;
        }
        t = end;
    }
    return 1;
}

#endif
