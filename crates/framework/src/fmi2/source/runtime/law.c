/* The law of a unit without FMI; see law.h. What a law doesn't call is left out by the compiler. */

#define UNIT_LAW

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wunused-variable"
#endif

#include "runtime.h"
#include "problem.h"

/* Nobody reads messages; of refusals it counts that there are any. */
struct Log {
    int refused;
};

static void tell(Log *log, int category, const char *text, const real *values, int count) {
    (void)log, (void)category, (void)text, (void)values, (void)count;
}

static void refuse(Log *log, const char *reason, const real *values, int count) {
    (void)reason, (void)values, (void)count;
    log->refused++;
}

static int log_refused(const Log *log) {
    return log->refused;
}

#include "unit.c"

#include "problem.c"
#include "explicit.c"
#include "elimination.c"
#include "spectrum.c"
#include "stiff.c"
#include "stability.c"
#include "choice.c"
#include "indicators.c"
#include "events.c"
#include "fixed.c"
#include "driver.c"

/* Behind the unit, whose variables may have any name. */
#include "law.h"

/* Integration steps in a period. */
#ifndef UNIT_LAW_STEPS
#if defined(AT_FIXED_STEPS) && AT_FIXED_STEPS >= 0
#define UNIT_LAW_STEPS unit_start_integers[AT_FIXED_STEPS]
#else
#define UNIT_LAW_STEPS 1
#endif
#endif

/* What a law doesn't go on with: of all laws of this unit. */
static Driver workspace;
static UNIT_LAW_PREFIX as_before;

void LAW_NAME(_init)(UNIT_LAW_PREFIX *self) {
    memcpy(self->v, unit_start_reals, sizeof self->v);
    memcpy(self->n, unit_start_integers, sizeof self->n);
#if AT_STEPPED >= 0
    self->n[AT_STEPPED] = 1;
#endif
}

static int is_number(real value) {
    return isfinite(value) && F(fabs)(value) <= DIVERGENCE_LIMIT;
}

/* Begins with the inputs of the first step: what is taken from them at the start is taken there. */
static int start(Problem *problem, StepError *error) {
    unit_initialise(problem->v[AT_TIME], problem->v, problem->n, problem->log);
    problem->n[AT_STARTED] = 1;
    return problem->log->refused == 0 && driver_settle(&workspace, problem, problem->v[AT_TIME], error);
}

/* Where a step begins for the equations. Those that don't read time begin at 0 in each step: in float, time comes to stand
 * still when a period is lost in its rounding. */
static real beginning(const Problem *problem) {
#if UNIT_READS_TIME || UNIT_HAS_TIME_EVENTS || UNIT_INDICATORS > 0
    return problem->v[AT_TIME];
#else
    (void)problem;
    return 0;
#endif
}

static int take_step(Problem *problem) {
    const Settings settings = {METHOD_FIXED, UNIT_LAW_STEPS, DEFAULT_TOLERANCE, problem->v[AT_WORK_LIMIT]};
    const real step = UNIT_LAW_PERIOD;
    StepError error;
    Pace pace;
    if (!problem->n[AT_STARTED] && !start(problem, &error)) {
        return 0;
    }
    memset(&pace, 0, sizeof pace);
    real t0 = beginning(problem), t1 = t0 + step;
    if (!driver_advance(&workspace, problem, t0, t1, &settings, &pace, &error)) {
        return 0;
    }
    problem->v[AT_TIME] += step;
    unit_check(problem->v[AT_TIME], problem->v, problem->n, problem->log);
    if (problem->log->refused > 0) {
        return 0;
    }
    unit_step_completed(problem->v[AT_TIME], step, problem->v, problem->n, problem->log);
    return 1;
}

int LAW_NAME(_step)(UNIT_LAW_PREFIX *self, const real *inputs, real *outputs) {
    Log log = {0};
    Problem problem = {self->v, self->n, 1, NULL, NULL, 0, &log, 0};
    as_before = *self;
    (void)inputs, (void)outputs;
#if UNIT_INPUTS > 0
    memcpy(self->v + FIRST_INPUT, inputs, UNIT_INPUTS * sizeof *inputs);
#endif
    int taken = take_step(&problem);
#if UNIT_REAL_OUTPUTS > 0
    for (int k = 0; k < UNIT_REAL_OUTPUTS; k++) {
        taken = taken && is_number(self->v[unit_real_outputs[k]]);
    }
#endif
    if (!taken) {
        *self = as_before;
        return 0;
    }
#if UNIT_REAL_OUTPUTS > 0
    for (int k = 0; k < UNIT_REAL_OUTPUTS; k++) {
        outputs[k] = self->v[unit_real_outputs[k]];
    }
#endif
    return 1;
}
