/* The stiff method: Rosenbrock's, of order 5 with an embedded one of order 4, L-stable and stiffly accurate.
 *
 * Steinebach, Construction of Rosenbrock-Wanner method Rodas5P and numerical benchmarks within the Julia Differential
 * Equations package, BIT Numer. Math. 63 (2023) 27. In the form without products by the Jacobian J (Hairer and Wanner,
 * Solving Ordinary Differential Equations II, IV.7) its stages solve
 *
 *     (I/(gamma h) - J) u_i = f(t + alpha_i h, x + sum a_ij u_j) + sum c_ij u_j / h + gamma_i h df/dt.
 *
 * The states of the last stages add up: the result is that of stage 8 plus u_8, and u_8 itself is the error. */

#if UNIT_HAS_STIFF

enum { STIFF_STAGES = 8 };

#define GAMMA R(0.21193756319429014)
/* The nodes alpha_i. */
static const real STIFF_NODES[STIFF_STAGES] = {
    R(0.0), R(0.6358126895828704), R(0.4095798393397535), R(0.9769306725060716), R(0.4288403609558664), R(1.0), R(1.0), R(1.0),
};
/* The weights gamma_i of df/dt. */
static const real TIME_WEIGHTS[STIFF_STAGES] = {
    GAMMA, R(-0.42387512638858027), R(-0.3384627126235924), R(1.8046452872882734), R(2.325825639765069), R(0.0), R(0.0), R(0.0),
};
/* The weights a_ij of stages 1 to 6. Stage 7 adds u_6 to the state of stage 6, stage 8 then u_7. */
static const real STATE_WEIGHTS[6][5] = {
    {R(0.0)},
    {R(3.0)},
    {R(2.849394379747939), R(0.45842242204463923)},
    {R(-6.954028509809101), R(2.489845061869568), R(-10.358996098473584)},
    {R(2.8029986275628964), R(0.5072464736228206), R(-0.3988312541770524), R(-0.04721187230404641)},
    {R(-7.502846399306121), R(2.561846144803919), R(-11.627539656261098), R(-0.18268767659942256), R(0.030198172008377946)},
};
/* The weights c_ij of stages 1 to 8. */
static const real STAGE_WEIGHTS[STIFF_STAGES][7] = {
    {R(0.0)},
    {R(-14.155112264123755)},
    {R(-17.97296035885952), R(-2.859693295451294)},
    {R(147.12150275711716), R(-1.41221402718213), R(71.68940251302358)},
    {R(165.43517024871676), R(-0.4592823456491126), R(42.90938336958603), R(-5.961986721573306)},
    {R(24.854864614690072), R(-3.0009227002832186), R(47.4931110020768), R(5.5814197821558125), R(-0.6610691825249471)},
    {R(30.91273214028599), R(-3.1208243349937974), R(77.79954646070892), R(34.28646028294783), R(-19.097331116725623),
     R(-28.087943162872662)},
    {R(37.80277123390563), R(-3.2571969029072276), R(112.26918849496327), R(66.9347231244047), R(-40.06618937091002),
     R(-54.66780262877968), R(-9.48861652309627)},
};

/* The exact derivatives of the rates where a substep begins; whether they are numbers. *state: the one whose rate has a
 * derivative that isn't. */
static int evaluate_jacobian(Driver *driver, const Problem *problem, int *state) {
    const real *slopes = problem->held ? NULL : problem->ramp_slopes;
    unit_jacobian(driver->start.time, problem->v, problem->n, slopes, driver->jacobian, driver->by_time);
    for (int entry = 0; entry < UNIT_NONZEROS; entry++) {
        if (!is_finite(driver->jacobian[entry])) {
            *state = unit_rows[entry];
            return 0;
        }
    }
    for (int i = 0; i < UNIT_STATES; i++) {
        if (!is_finite(driver->by_time[i])) {
            *state = i;
            return 0;
        }
    }
    return 1;
}

/* Weighted sum of the first stages, of state i. */
static real weighted(const Driver *driver, const real *weights, int stages, int i) {
    real sum = R(0.0);
    for (int j = 0; j < stages; j++) {
        sum += weights[j] * driver->stages[j][i];
    }
    return sum;
}

/* Puts the states of a stage: of the first ones from the start, of the last ones from the stage before. */
static void place_stage(const Driver *driver, Problem *problem, int stage) {
    real *x = problem->v + FIRST_STATE;
    for (int i = 0; i < UNIT_STATES; i++) {
        x[i] = stage < STIFF_STAGES - 2 ? driver->start.states[i] + weighted(driver, STATE_WEIGHTS[stage], stage, i)
                                        : x[i] + driver->stages[stage - 1][i];
    }
}

/* Solves the equations of a stage with these rates. */
static void solve_stage(Driver *driver, const real *rates, int stage, real h) {
    real *u = driver->stages[stage];
    for (int i = 0; i < UNIT_STATES; i++) {
        u[i] = rates[i] + weighted(driver, STAGE_WEIGHTS[stage], stage, i) / h + TIME_WEIGHTS[stage] * h * driver->by_time[i];
    }
    solve(driver, u);
}

/* A correction after the last one may be so large a part of it; else the Jacobian isn't what it was at the start. */
#define LEFT_OVER R(0.5)
/* Below this part of a state's magnitude, corrections can't be told from rounding. */
#ifdef UNIT_FLOAT
#define CORRECTION_ROUNDING R(1e-5)
#else
#define CORRECTION_ROUNDING R(1e-13)
#endif

/* The error right after an attempt, for one that is tolerated: where the Jacobian damps what would be more, it must be what it
 * was at the start, which one more stage tells. Else the error is what that would be if nothing were damped. */
static Estimate undamped_error(Driver *driver, const Problem *problem, real h, real relative_tolerance, Estimate damped) {
    const real *x = problem->v + FIRST_STATE, *last = driver->stages[STIFF_STAGES - 1];
    real diagonal = R(1.0) / (GAMMA * h), *left = driver->stages[STIFF_STAGES], *undamped = driver->stages[0];
    for (int i = 0; i < UNIT_STATES; i++) {
        left[i] = problem->v[FIRST_RATE + i] + weighted(driver, STAGE_WEIGHTS[STIFF_STAGES - 1], STIFF_STAGES - 1, i) / h -
                  diagonal * last[i];
        undamped[i] = left[i] / diagonal;
    }
    Estimate most = scaled_error(undamped, driver->start.states, x, relative_tolerance);
    if (!(most.scaled > R(1.0))) {
        return damped;
    }
    solve(driver, left);
    for (int i = 0; i < UNIT_STATES; i++) {
        real size = larger(larger(unit_nominals[i], magnitude(driver->start.states[i])), magnitude(x[i]));
        int lasts = magnitude(left[i]) <= larger(LEFT_OVER * magnitude(last[i]), CORRECTION_ROUNDING * size);
        if (!lasts && magnitude(undamped[i]) > relative_tolerance * size) {
            return most;
        }
    }
    return damped;
}

/* Advances the states from the start by h and evaluates the problem there, with the Jacobian of the start. */
static Estimate stiff_attempt(Driver *driver, Problem *problem, real h, real relative_tolerance) {
    if (!decompose(driver, R(1.0) / (GAMMA * h))) {
        Estimate none = {(real)INFINITY, 0};
        return none;
    }
    solve_stage(driver, driver->start.rates, 0, h);
    for (int stage = 1; stage < STIFF_STAGES; stage++) {
        place_stage(driver, problem, stage);
        problem_evaluate(problem, driver->start.time + STIFF_NODES[stage] * h);
        solve_stage(driver, problem->v + FIRST_RATE, stage, h);
    }
    real *x = problem->v + FIRST_STATE;
    for (int i = 0; i < UNIT_STATES; i++) {
        x[i] += driver->stages[STIFF_STAGES - 1][i];
    }
    problem_evaluate(problem, driver->start.time + h);
    for (int i = 0; i < UNIT_STATES; i++) {
        /* Where the equations give no number, no other step could start. */
        int is_number = is_finite(problem->v[FIRST_RATE + i]);
        driver->errors[i] = is_number ? driver->stages[STIFF_STAGES - 1][i] : (real)NAN;
    }
    Estimate damped = scaled_error(driver->errors, driver->start.states, x, relative_tolerance);
    return damped.scaled <= R(1.0) ? undamped_error(driver, problem, h, relative_tolerance, damped) : damped;
}

#endif
