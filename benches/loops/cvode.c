/* A whole loop by CVODE of SUNDIALS: multistep methods of variable order and step, with error control.

   cvode LOOP SAMPLES PERIOD ORDER TOLERANCE: ORDER is the highest of backward differentiation (with Newton's method, a
   dense direct solver, and the exact Jacobian matrix), 2 to 5, or 0 for Adams' methods with fixed-point iteration. The
   tolerance is relative to each state's value, and to its largest magnitude, which a run before finds out. Prints the
   seconds that SAMPLES periods take, then the plant's state at the end of each, a line each.

   The highest order matters: from order 3 on the methods aren't stable near the imaginary axis, where the adaptation's
   eigenvalues are. */
#include <cvode/cvode.h>
#include <math.h>
#include <nvector/nvector_serial.h>
#include <stdio.h>
#include <stdlib.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>

#include "loop.h"

/* What is always smaller than this is as accurate as if it were so large: else it would be rounding that counts. */
static const double SMALL = 1e-3;

static int rates(double t, N_Vector z, N_Vector dz, void *loop) {
    ((const Loop *)loop)->rate(t, N_VGetArrayPointer(z), N_VGetArrayPointer(dz));
    return 0;
}

/* CVODE has set the matrix to zero. */
static int jacobian(double t, N_Vector z, N_Vector dz, SUNMatrix matrix, void *loop, N_Vector a, N_Vector b,
                    N_Vector c) {
    (void)dz, (void)a, (void)b, (void)c;
    ((const Loop *)loop)->slopes(t, N_VGetArrayPointer(z), SM_COLS_D(matrix));
    return 0;
}

typedef struct {
    SUNContext context;
    N_Vector z, tolerances;
    SUNMatrix matrix;
    SUNLinearSolver linear;
    SUNNonlinearSolver fixed_point;
    void *solver;
} Integrator;

static void check(int flag, const char *what) {
    if (flag >= 0) return;
    fprintf(stderr, "%s: %d\n", what, flag);
    exit(1);
}

/* Absolute tolerances are relative to the magnitudes. */
static Integrator make(const Loop *loop, int order, double tolerance, const double *magnitudes) {
    Integrator o = {0};
    int n = loop->states;
    check(SUNContext_Create(NULL, &o.context), "SUNContext_Create");
    o.z = N_VNew_Serial(n, o.context), o.tolerances = N_VNew_Serial(n, o.context);
    N_VConst(0, o.z);
    loop->start(N_VGetArrayPointer(o.z));
    for (int i = 0; i < n; i++) NV_Ith_S(o.tolerances, i) = tolerance * magnitudes[i];
    o.solver = CVodeCreate(order ? CV_BDF : CV_ADAMS, o.context);
    check(CVodeInit(o.solver, rates, 0, o.z), "CVodeInit");
    check(CVodeSVtolerances(o.solver, tolerance, o.tolerances), "CVodeSVtolerances");
    check(CVodeSetUserData(o.solver, (void *)loop), "CVodeSetUserData");
    check(CVodeSetMaxNumSteps(o.solver, 100000000), "CVodeSetMaxNumSteps");
    if (order) {
        check(CVodeSetMaxOrd(o.solver, order), "CVodeSetMaxOrd");
        o.matrix = SUNDenseMatrix(n, n, o.context), o.linear = SUNLinSol_Dense(o.z, o.matrix, o.context);
        check(CVodeSetLinearSolver(o.solver, o.linear, o.matrix), "CVodeSetLinearSolver");
        check(CVodeSetJacFn(o.solver, jacobian), "CVodeSetJacFn");
    } else {
        o.fixed_point = SUNNonlinSol_FixedPoint(o.z, 0, o.context);
        check(CVodeSetNonlinearSolver(o.solver, o.fixed_point), "CVodeSetNonlinearSolver");
    }
    return o;
}

static void discard(Integrator *o) {
    CVodeFree(&o->solver);
    if (o->linear) SUNLinSolFree(o->linear), SUNMatDestroy(o->matrix);
    if (o->fixed_point) SUNNonlinSolFree(o->fixed_point);
    N_VDestroy(o->z), N_VDestroy(o->tolerances);
    SUNContext_Free(&o->context);
}

/* Takes the periods, and returns the seconds; magnitudes grow to the largest of each state. */
static double run(const Loop *loop, Integrator *o, int samples, double period, double *rows, double *magnitudes) {
    double begun = seconds_now(), t;
    for (int k = 0; k < samples; k++) {
        const double *z = N_VGetArrayPointer(o->z);
        check(CVode(o->solver, (k + 1) * period, o->z, &t, CV_NORMAL), "CVode");
        record(loop, z, rows + k * loop->measured);
        for (int i = 0; i < loop->states; i++) magnitudes[i] = fmax(magnitudes[i], fabs(z[i]));
    }
    return seconds_now() - begun;
}

int main(int count, char **arguments) {
    const Loop *loop = count == 6 ? find_loop(arguments[1]) : NULL;
    if (!loop) {
        fprintf(stderr, "usage: cvode LOOP SAMPLES PERIOD ORDER TOLERANCE\n");
        return 2;
    }
    int samples = atoi(arguments[2]);
    double period = atof(arguments[3]), magnitudes[MOST_STATES], largest[MOST_STATES] = {0}, took;
    double *rows = malloc(samples * loop->measured * sizeof *rows);
    for (int i = 0; i < MOST_STATES; i++) magnitudes[i] = SMALL;
    Integrator first = make(loop, 2, 1e-5, magnitudes);
    run(loop, &first, samples, period, rows, largest);
    discard(&first);
    for (int i = 0; i < MOST_STATES; i++) magnitudes[i] = fmax(largest[i], SMALL);
    Integrator second = make(loop, atoi(arguments[4]), atof(arguments[5]), magnitudes);
    took = run(loop, &second, samples, period, rows, largest);
    tell(loop, took, samples, rows);
    discard(&second);
    free(rows);
    return 0;
}
