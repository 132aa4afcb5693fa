/* The explicit Runge-Kutta method of order 5 with an embedded one of order 4: Dormand and Prince, A family of embedded
 * Runge-Kutta formulae, J. Comput. Appl. Math. 6 (1980) 19-26, table 2.
 *
 * Where a rate has a kink both solutions are wrong in almost the same way, and their difference is much less than the
 * error. So a step whose difference is not far below what is tolerated must agree with Simpson's rule as well, which takes
 * one more evaluation in the middle, where the state is known from the stages (Shampine, Some practical Runge-Kutta
 * formulas, Math. Comp. 46 (1986) 135-150). */

#if UNIT_MOVES

enum { EXPLICIT_STAGES = 7 };

/* Where stages 2 to 7 stand, in parts of the step. */
static const real EXPLICIT_NODES[6] = {
    R(1.0) / R(5.0), R(3.0) / R(10.0), R(4.0) / R(5.0), R(8.0) / R(9.0), R(1.0), R(1.0),
};
/* Weights of the earlier stages in stages 2 to 7. The last are those of the solution of order 5. */
static const real EXPLICIT_WEIGHTS[6][6] = {
    {R(1.0) / R(5.0)},
    {R(3.0) / R(40.0), R(9.0) / R(40.0)},
    {R(44.0) / R(45.0), R(-56.0) / R(15.0), R(32.0) / R(9.0)},
    {R(19372.0) / R(6561.0), R(-25360.0) / R(2187.0), R(64448.0) / R(6561.0), R(-212.0) / R(729.0)},
    {R(9017.0) / R(3168.0), R(-355.0) / R(33.0), R(46732.0) / R(5247.0), R(49.0) / R(176.0), R(-5103.0) / R(18656.0)},
    {R(35.0) / R(384.0), R(0.0), R(500.0) / R(1113.0), R(125.0) / R(192.0), R(-2187.0) / R(6784.0), R(11.0) / R(84.0)},
};
/* Difference of the solutions of order 5 and 4. */
static const real EXPLICIT_ERROR[EXPLICIT_STAGES] = {
    R(71.0) / R(57600.0),      R(0.0),           R(-71.0) / R(16695.0), R(71.0) / R(1920.0),
    R(-17253.0) / R(339200.0), R(22.0) / R(525.0), R(-1.0) / R(40.0),
};
/* Weights of the stages in the solution of order 4 in the middle of a step. */
static const real EXPLICIT_MIDDLE[EXPLICIT_STAGES] = {
    R(6025192743.0) / R(60171106304.0),    R(0.0),
    R(51252292925.0) / R(130801643196.0),  R(-2691868925.0) / R(90256659456.0),
    R(187940372067.0) / R(3189068634112.0), R(-1776094331.0) / R(39487288512.0),
    R(11237099.0) / R(470086768.0),
};
/* What errors are added to. */
static const real NO_STATES[AT_LEAST_ONE(UNIT_STATES)] = {R(0.0)};
/* Below this scaled error there is nothing to look for: what a kink hides is tolerated too. */
#define CLOSE R(1e-3)
/* The disagreement with Simpson's rule is about so many times the error of a step with a kink. */
#define DISAGREEMENT R(2.0)

/* The largest of the errors of states in units of what is tolerated. Not a number where any of them isn't. */
static Estimate scaled_error(const real *errors, const real *before, const real *after, real relative_tolerance) {
    Estimate worst = {R(0.0), 0};
    for (int i = 0; i < UNIT_STATES; i++) {
        real size = larger(larger(unit_nominals[i], magnitude(before[i])), magnitude(after[i]));
        real scaled = magnitude(errors[i]) / (relative_tolerance * size);
        if (scaled != scaled || scaled > worst.scaled) {
            worst.scaled = scaled;
            worst.state = i;
        }
        if (scaled != scaled) {
            break;
        }
    }
    return worst;
}

/* The stages' weighted sums, of each state: the sum is one expression, so that compilers form it for several states at once. */
#define STAGE(j) (weights[j] * stages[j][i])
#define SUM_1 (R(0.0) + STAGE(0))
#define SUM_2 (SUM_1 + STAGE(1))
#define SUM_3 (SUM_2 + STAGE(2))
#define SUM_4 (SUM_3 + STAGE(3))
#define SUM_5 (SUM_4 + STAGE(4))
#define SUM_6 (SUM_5 + STAGE(5))
#define SUM_7 (SUM_6 + STAGE(6))
#define SUM_8 (SUM_7 + STAGE(7))
#define SUM_9 (SUM_8 + STAGE(8))
#define SUM_10 (SUM_9 + STAGE(9))
#define OF_EACH_STATE(sum)                  \
    for (int i = 0; i < UNIT_STATES; i++) { \
        to[i] = from[i] + h * (sum);        \
    }

/* to = from + h times the weighted sum of the first stages. */
static void add_stages(real *restrict to, const real *restrict from, real h, const real *restrict weights,
                       real (*restrict stages)[AT_LEAST_ONE(UNIT_STATES)], int count) {
    switch (count) {
    case 1:
        OF_EACH_STATE(SUM_1)
        break;
    case 2:
        OF_EACH_STATE(SUM_2)
        break;
    case 3:
        OF_EACH_STATE(SUM_3)
        break;
    case 4:
        OF_EACH_STATE(SUM_4)
        break;
    case 5:
        OF_EACH_STATE(SUM_5)
        break;
    case 6:
        OF_EACH_STATE(SUM_6)
        break;
    case 7:
        OF_EACH_STATE(SUM_7)
        break;
    case 8:
        OF_EACH_STATE(SUM_8)
        break;
    case 9:
        OF_EACH_STATE(SUM_9)
        break;
    default:
        OF_EACH_STATE(SUM_10)
    }
}

/* Takes over the derivatives of the newest stage, which the problem holds, and evaluates it at a part c of the step. */
static void explicit_stage(Driver *driver, Problem *problem, int newest, real h, real c, const real *weights) {
    copy(driver->stages[newest], problem->v + FIRST_RATE, UNIT_STATES);
    add_stages(problem->v + FIRST_STATE, driver->start.states, h, weights, driver->stages, newest + 1);
    problem_evaluate(problem, driver->start.time + c * h);
}

/* The error as Simpson's rule tells it, right after the last stage. */
static Estimate against_simpson(Driver *driver, Problem *problem, real h, real relative_tolerance) {
    copy(driver->end, problem->v + FIRST_INPUT, EVALUATED);
    explicit_stage(driver, problem, EXPLICIT_STAGES - 1, h, R(0.5), EXPLICIT_MIDDLE);
    const Start *start = &driver->start;
    const real *end = driver->end + (FIRST_STATE - FIRST_INPUT);
    const real *first = driver->stages[0], *last = driver->stages[EXPLICIT_STAGES - 1];
    real *errors = driver->stages[1];
    for (int i = 0; i < UNIT_STATES; i++) {
        real simpson = h / R(6.0) * (first[i] + R(4.0) * problem->v[FIRST_RATE + i] + last[i]);
        errors[i] = (end[i] - start->states[i] - simpson) / DISAGREEMENT;
    }
    Estimate seen = scaled_error(errors, start->states, end, relative_tolerance);
    copy(problem->v + FIRST_INPUT, driver->end, EVALUATED);
    return seen;
}

/* Advances the states from the start by h and evaluates the problem there. The problem stands anywhere; what it holds is
 * overwritten. */
static Estimate explicit_attempt(Driver *driver, Problem *problem, real h, real relative_tolerance) {
    copy(problem->v + FIRST_RATE, driver->start.rates, UNIT_STATES);
    for (int stage = 0; stage < EXPLICIT_STAGES - 1; stage++) {
        explicit_stage(driver, problem, stage, h, EXPLICIT_NODES[stage], EXPLICIT_WEIGHTS[stage]);
    }
    copy(driver->stages[EXPLICIT_STAGES - 1], problem->v + FIRST_RATE, UNIT_STATES);
    add_stages(driver->errors, NO_STATES, h, EXPLICIT_ERROR, driver->stages, EXPLICIT_STAGES);
    const real *before = driver->start.states, *after = problem->v + FIRST_STATE;
    Estimate estimate = scaled_error(driver->errors, before, after, relative_tolerance);
    if (estimate.scaled >= CLOSE && estimate.scaled <= R(1.0)) {
        Estimate seen = against_simpson(driver, problem, h, relative_tolerance);
        if (seen.scaled > estimate.scaled || seen.scaled != seen.scaled) {
            estimate = seen;
        }
    }
    return estimate;
}

#endif
