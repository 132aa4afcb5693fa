/* Evaluating what is integrated. */

/* The smaller and the larger of two numbers; the other where one isn't a number. */
static inline real smaller(real a, real b) { return a < b || b != b ? a : b; }
static inline real larger(real a, real b) { return a > b || b != b ? a : b; }

static inline real clamped(real x, real low, real high) { return x < low ? low : x > high ? high : x; }

static inline real magnitude(real x) { return F(fabs)(x); }

static inline int is_finite(real x) { return isfinite(x) != 0; }

/* Brings inputs to time t. */
static void follow_ramp(Problem *problem, real t) {
#if UNIT_INPUTS > 0
    if (!problem->held) {
        for (int i = 0; i < UNIT_INPUTS; i++) {
            problem->v[FIRST_INPUT + i] = problem->ramp_values[i] + problem->ramp_slopes[i] * (t - problem->ramp_time);
        }
    }
#else
    (void)problem;
    (void)t;
#endif
}

static void problem_evaluate(Problem *problem, real t) {
    follow_ramp(problem, t);
    unit_evaluate(t, problem->v, problem->n);
}

static void problem_evaluate_signals(Problem *problem, real t) {
    follow_ramp(problem, t);
    unit_outputs(t, problem->v, problem->n);
}

static void copy(real *to, const real *from, int count) {
    for (int i = 0; i < count; i++) {
        to[i] = from[i];
    }
}

/* Notes where a substep begins: where a problem stands, at time t. */
static void start_at(Start *start, const Problem *problem, real t) {
    start->time = t;
    copy(start->states, problem->v + FIRST_STATE, UNIT_STATES);
    copy(start->rates, problem->v + FIRST_RATE, UNIT_STATES);
}

/* Fills an error in, and says that there is one. */
static int step_fails(StepError *error, int kind, int variable, real time) {
    memset(error, 0, sizeof *error);
    error->kind = kind;
    error->variable = variable;
    error->time = time;
    return 0;
}

/* Whether the equations hold at t, where the problem stands evaluated. The reasons of a refusal are left in the log. */
static int problem_check(Problem *problem, real t, StepError *error) {
    unit_check(t, problem->v, problem->n, problem->log);
    return log_refused(problem->log) ? step_fails(error, STEP_UNSOUND, 0, t) : 1;
}

static int check_divergence(const Problem *problem, real time, StepError *error) {
    for (int i = 0; i < UNIT_STATES; i++) {
        real x = problem->v[FIRST_STATE + i];
        if (!(magnitude(x) <= DIVERGENCE_LIMIT)) {
            step_fails(error, STEP_DIVERGED, FIRST_STATE + i, time);
            error->value = x;
            return 0;
        }
    }
    return 1;
}
