/* The methods of a unit, and the choice between them.
 *
 * The eigenvalues of the exact Jacobian choose, and work. A substep of the explicit method speaks for the stiff one where
 * its stability limits it, for one mode or another that is damped, and the stiff method need not follow a mode that isn't.
 * One that goes the whole way can't be beaten. A substep of the stiff method speaks for the explicit one where that would
 * take less work within its own limits. The stiff method is tried when the explicit one has worked as long as a trial
 * takes, so that a trial never costs more than what it may save.
 *
 * There are two explicit methods, of order 5 and 8, and any substep may go by either: the one that is expected to come to
 * where it has to end with less work, by the substeps that error control and the eigenvalues allow each.
 *
 * Eigenvalues are looked at now and then. How often depends on work alone, so that a restored instance looks at the same
 * substeps. The stiff method has the Jacobian anyway, takes long substeps, and is the one that could pass over growth or a
 * pole, so it looks more often. */

/* Work in elementary operations of about 1 ns: of an evaluation, by what it may read, and in the choice between methods,
 * that by the number of states alone. */
#define CALL_WORK R(30.0)
#define EVALUATION_WORK (CALL_WORK + (real)(FIRST_RATE + UNIT_STATES))
#define TYPICAL_EVALUATION (CALL_WORK + R(20.0) * STATES)
#define STATES ((real)UNIT_STATES)
/* Of a substep that is tried by either method, of a Jacobian, and of its eigenvalues. */
#define EXPLICIT_WORK(evaluation) (R(7.0) * (evaluation) + R(50.0) * STATES)
#define ORDER_8_WORK(evaluation) (R(12.0) * (evaluation) + R(90.0) * STATES)
#define STIFF_WORK(evaluation)                                                                                              \
    (R(9.0) * (evaluation) + R(2.0) / R(3.0) * (STATES * STATES * STATES) + R(16.0) * (STATES * STATES) + R(80.0) * STATES)
#define JACOBIAN_WORK(evaluation) ((STATES + R(1.0)) * R(2.5) * (evaluation))
#define EIGENVALUES_WORK (R(20.0) * (STATES * STATES * STATES) + R(100.0) * STATES)

/* The explicit method of order 8 is taken where it gets along with this part of the work of that of order 5. */
#define PAYS R(0.8)
/* Before it was tried, its substeps are taken to be so many times as long. */
#define TIMES_AS_LONG R(2.0)
/* What error control suggests to one explicit method is expected of the other as well, and so much more each time; the two are
 * at most so many times apart. */
#define EXPECTED R(1.02)
#define APART R(8.0)

#if UNIT_MOVES

/* What eigenvalues limit an explicit method to, as the reciprocal of its substep, 1/s. */
static real explicit_limit(const ExplicitLimits *limits) {
    return larger(limits->stable, limits->growing);
}

#endif

#if UNIT_HAS_STIFF

/* Work of a stiff substep in explicit ones. */
#define RELATIVE_WORK                                                                                                       \
    ((STIFF_WORK(TYPICAL_EVALUATION) + JACOBIAN_WORK(TYPICAL_EVALUATION)) / EXPLICIT_WORK(TYPICAL_EVALUATION))
/* How many more substeps must speak for the explicit method than against it before it is taken. */
#define EVIDENCE 15
/* The same for the stiff one: they take as long as a trial that ends with the evidence for the explicit method. */
#define EVIDENCE_TO_TRY ((int)(RELATIVE_WORK * (real)EVIDENCE))
/* Evidence isn't counted beyond this, where the method is one that was asked for. */
#define MOST_EVIDENCE 1000000000
/* After a change back to the explicit method, the next trial takes so many times the evidence more. */
#define TRIAL_PATIENCE 4

#endif

#if UNIT_HAS_SPECTRUM

/* A substep above this part of what stability allows counts as limited by it. */
#define LIMITED R(0.5)
/* Work of the explicit method between looks, in what a look takes. Far from any limit it may wait longer. */
#define LOOK_WORK (JACOBIAN_WORK(TYPICAL_EVALUATION))
#define EXPLICIT_INTERVAL (R(20.0) * (EIGENVALUES_WORK + LOOK_WORK))
#define FAR_FROM_LIMIT R(10.0)
#define PATIENCE R(4.0)
/* The same of the stiff method, whose substeps are long, and its shortest wait as a part of that. */
#define STIFF_INTERVAL (R(3.0) * EIGENVALUES_WORK)
#define LEAST_INTERVAL R(1e-3)
/* A Jacobian that became so many times larger or smaller is looked at, whatever it takes. */
#define CHANGE R(1.25)

/* Looks at the eigenvalues of the Jacobian. */
static void look(Driver *driver, Pace *pace) {
    real carried = pace->limits.carried;
    memset(driver->matrix, 0, sizeof driver->matrix);
    for (int column = 0; column < UNIT_STATES; column++) {
        for (int entry = unit_columns[column]; entry < unit_columns[column + 1]; entry++) {
            /* Zeros have no sign here: reflections would go by it. */
            driver->matrix[column * UNIT_STATES + unit_rows[entry]] = driver->jacobian[entry] + R(0.0);
        }
    }
    if (find_spectrum(driver)) {
        find_limits(driver, &pace->limits);
    } else {
        memset(&pace->limits, 0, sizeof pace->limits);
        driver->damped = (Mode){R(0.0), R(0.0)};
    }
    keep_carrying(&pace->limits, carried);
}

/* How large the Jacobian is, with states in units of their nominal values: its largest sum of a row, 1/s. */
static real jacobian_size(Driver *driver) {
    real *sums = driver->solution, size = R(0.0);
    memset(sums, 0, sizeof driver->solution);
    for (int column = 0; column < UNIT_STATES; column++) {
        for (int entry = unit_columns[column]; entry < unit_columns[column + 1]; entry++) {
            sums[unit_rows[entry]] += magnitude(driver->jacobian[entry]) * unit_nominals[column];
        }
    }
    for (int i = 0; i < UNIT_STATES; i++) {
        size = larger(size, sums[i] / unit_nominals[i]);
    }
    return size;
}

/* The stiff method looks at the Jacobian of its substep, if that is due or it has changed; whether it did. */
static int look_for_stiff(Driver *driver, real way, Pace *pace) {
    real size = jacobian_size(driver);
    int changed = size > CHANGE * pace->jacobian_size || pace->jacobian_size > CHANGE * size;
    if (pace->until_look > R(0.0) && !changed) {
        return 0;
    }
    Limits before = pace->limits;
    look(driver, pace);
    remember_limits(&pace->limits, &before);
    pace->jacobian_size = size;
    /* Growth that has to be followed may come and go: it is looked for in each substep, then ever more rarely. */
    int follows = pace->limits.stiff * way > R(1.0);
    real longer = clamped(R(2.0) * pace->interval, LEAST_INTERVAL * STIFF_INTERVAL, STIFF_INTERVAL);
    pace->interval = follows ? R(0.0) : longer;
    pace->until_look = pace->interval;
    return 1;
}

/* The explicit method looks where that is due, at a Jacobian that is made for that; the work that it was. */
static real look_for_explicit(Driver *driver, const Problem *problem, real way, Pace *pace) {
    int state;
    if (pace->until_look > R(0.0)) {
        return R(0.0);
    }
    if (!evaluate_jacobian(driver, problem, &state)) {
        memset(&pace->limits, 0, sizeof pace->limits);
        pace->until_look = EXPLICIT_INTERVAL;
        return JACOBIAN_WORK(EVALUATION_WORK);
    }
    look(driver, pace);
    int far = way * explicit_limit(&pace->limits.order_5) * FAR_FROM_LIMIT < R(1.0);
    pace->until_look = EXPLICIT_INTERVAL * (far ? PATIENCE : R(1.0));
    return JACOBIAN_WORK(EVALUATION_WORK) + EIGENVALUES_WORK;
}

/* Counts the accepted substep h for or against the method in force. `whole`: it went all the way to where it had to end. */
static void judge(const Driver *driver, real h, int whole, Pace *pace) {
    const Limits *limits = &pace->limits;
    real stable = driver->by_order_8 ? limits->order_8.stable : limits->order_5.stable;
    /* In substeps of order 5 that take as much work as those of order 8, where these pay. */
    real times = ORDER_8_WORK(TYPICAL_EVALUATION) / (PAYS * EXPLICIT_WORK(TYPICAL_EVALUATION));
    real of_8 = explicit_limit(&limits->order_8) * times;
    real least = smaller(explicit_limit(&limits->order_5), of_8);
    int against;
    if (pace->stiff) {
        /* Half the work: a system at the border stays with what it has. */
        against = h * least < R(0.5) * RELATIVE_WORK;
    } else {
        against = !whole && h * stable > LIMITED && limits->stiff * RELATIVE_WORK < least;
    }
    if (against) {
        pace->evidence += pace->evidence < MOST_EVIDENCE;
    } else if (pace->evidence > 0) {
        pace->evidence -= 1;
    } else {
        /* There was none to take back. */
    }
}

#endif

#if UNIT_MOVES

/* The order of the method in force. */
static int order_in_force(const Driver *driver, const Pace *pace) {
    return driver->by_order_8 && !pace->stiff ? 8 : 5;
}

/* The substep that is suggested to the method in force; 0 where none is known yet. */
static real suggested_substep(const Driver *driver, const Pace *pace) {
    return order_in_force(driver, pace) == 8 ? pace->substep_8 : pace->substep;
}

/* Suggests a substep to the method in force. What the solution asks of one explicit method, it asks of the other. */
static void suggest_substep(const Driver *driver, real h, Pace *pace) {
    int by_8 = order_in_force(driver, pace) == 8;
    real *suggested = by_8 ? &pace->substep_8 : &pace->substep, *other = by_8 ? &pace->substep : &pace->substep_8;
    if (*suggested > R(0.0) && *other > R(0.0)) {
        *other = clamped(EXPECTED * *other * (h / *suggested), h / APART, h * APART);
    }
    *suggested = h;
}

/* Substeps that a method is expected to take so far, by what eigenvalues and error control allow it. */
static real substeps_to(real way, const ExplicitLimits *limits, real suggested) {
    real most = explicit_limit(limits);
    if (suggested > R(0.0)) {
        most = larger(most, R(1.0) / suggested);
    }
    return larger(F(ceil)(way * most), R(1.0));
}

/* Whether the explicit method of order 8 is expected to go so far with less work than that of order 5. */
static int order_8_pays(real way, const Pace *pace) {
    real suggested = pace->substep_8 > R(0.0) ? pace->substep_8 : TIMES_AS_LONG * pace->substep;
    real work = ORDER_8_WORK(TYPICAL_EVALUATION) * substeps_to(way, &pace->limits.order_8, suggested);
    return work < PAYS * EXPLICIT_WORK(TYPICAL_EVALUATION) * substeps_to(way, &pace->limits.order_5, pace->substep);
}

/* The longest substep that the eigenvalues allow the method in force, s. */
static real longest_substep(const Driver *driver, const Pace *pace) {
#if UNIT_HAS_SPECTRUM
    const Limits *limits = &pace->limits;
    real limit = pace->stiff ? limits->stiff : explicit_limit(driver->by_order_8 ? &limits->order_8 : &limits->order_5);
    return limit > R(0.0) ? R(1.0) / limit : (real)INFINITY;
#else
    (void)driver;
    (void)pace;
    return (real)INFINITY;
#endif
}

#endif

#if UNIT_HAS_STIFF

static void change_method(Pace *pace) {
    pace->evidence = pace->stiff ? -TRIAL_PATIENCE * EVIDENCE_TO_TRY : 0;
    pace->stiff = !pace->stiff;
    /* The other method's limits are looked at before it goes anywhere. */
    pace->until_look = R(0.0);
}

/* Prepares a substep of the stiff method; whether it can go. */
static int begin_stiff(Driver *driver, const Problem *problem, real way, Pace *pace, int *state) {
    if (!evaluate_jacobian(driver, problem, state)) {
        return 0;
    }
#if UNIT_HAS_SPECTRUM
    int looked = look_for_stiff(driver, way, pace);
#else
    int looked = 0;
    (void)way;
    (void)pace;
#endif
    driver->work += JACOBIAN_WORK(EVALUATION_WORK) + (looked ? EIGENVALUES_WORK : R(0.0));
    return 1;
}

#endif

#if UNIT_MOVES

/* Prepares a substep of an explicit method. */
static void begin_explicit(Driver *driver, const Problem *problem, int method, real way, Pace *pace) {
#if UNIT_HAS_SPECTRUM
    driver->work += look_for_explicit(driver, problem, way, pace);
#else
    (void)problem;
#endif
#if UNIT_HAS_ORDER_8
    driver->by_order_8 = method == METHOD_AUTOMATIC && order_8_pays(way, pace);
    if (driver->by_order_8 && pace->substep_8 == R(0.0)) {
        pace->substep_8 = TIMES_AS_LONG * pace->substep;
    }
#else
    (void)driver;
    (void)method;
    (void)way;
    (void)pace;
#endif
}

/* Decides by which method the substep goes that begins where the problem stands, with so long a way to go, and prepares
 * it. */
static int begin_substep(Driver *driver, const Problem *problem, int method, real way, Pace *pace, StepError *error) {
#if UNIT_HAS_STIFF
    int state = 0;
    if (method != METHOD_AUTOMATIC) {
        pace->stiff = method == METHOD_STIFF;
    } else if (pace->evidence >= (pace->stiff ? EVIDENCE : EVIDENCE_TO_TRY)) {
        change_method(pace);
    } else {
        /* The method in force goes on. */
    }
    if (pace->stiff) {
        if (begin_stiff(driver, problem, way, pace, &state)) {
            return 1;
        }
        if (method != METHOD_AUTOMATIC) {
            return step_fails(error, STEP_NO_JACOBIAN, FIRST_STATE + state, driver->start.time);
        }
        change_method(pace);
    }
#else
    (void)error;
#endif
    begin_explicit(driver, problem, method, way, pace);
    return 1;
}

/* What is tolerated isn't tightened beyond this: rounding errors are as large. */
#ifdef UNIT_FLOAT
#define LEAST_TOLERATED R(1e-3)
#else
#define LEAST_TOLERATED R(1e-12)
#endif

/* The relative error that a substep may have, so that what an oscillation carries on stays within a tolerance. Where inputs
 * move, what a master holds or extrapolates errs by more than that. */
static real tolerated(const Problem *problem, const Limits *limits, real relative_tolerance) {
    real tightened = larger(relative_tolerance / larger(limits->carried, R(1.0)), smaller(relative_tolerance, LEAST_TOLERATED));
    return problem->moved ? relative_tolerance : tightened;
}

/* Tries a substep of length h by the method in force, from where the last one ended. */
static Estimate attempt(Driver *driver, Problem *problem, real h, real relative_tolerance, Pace *pace) {
    real tolerance = tolerated(problem, &pace->limits, relative_tolerance);
#if UNIT_HAS_STIFF
    if (pace->stiff) {
        driver->work += STIFF_WORK(EVALUATION_WORK);
        pace->until_look -= STIFF_WORK(TYPICAL_EVALUATION) + JACOBIAN_WORK(TYPICAL_EVALUATION);
        return stiff_attempt(driver, problem, h, tolerance);
    }
#endif
#if UNIT_HAS_ORDER_8
    if (driver->by_order_8) {
        driver->work += ORDER_8_WORK(EVALUATION_WORK);
        pace->until_look -= ORDER_8_WORK(TYPICAL_EVALUATION);
        return order_8_attempt(driver, problem, h, tolerance);
    }
#endif
    driver->work += EXPLICIT_WORK(EVALUATION_WORK);
    pace->until_look -= EXPLICIT_WORK(TYPICAL_EVALUATION);
    return explicit_attempt(driver, problem, h, tolerance);
}

#endif
