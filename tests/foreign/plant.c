/* A plant of a few equations as another tool's unit: rates.h, which the test writes, defines STATES, START_VALUES and
   rates(x, u, dx). An input times a gain drives it, within limits; Runge-Kutta steps of at most .5 ms. */
#include <math.h>
#include "rates.h"

#define VARIABLES (2 + STATES)
enum { INPUT, GAIN, STATE };

static const double start[] = {0, 1, START_VALUES};
#define START(v) for (int i = 0; i < VARIABLES; i++) (v)[i] = start[i]

static void outputs(double *v, double time) {}

static void moved(const double *x, const double *k, double h, double *at) {
    for (int i = 0; i < STATES; i++) at[i] = x[i] + h * k[i];
}

static void step(double *v, double time, double h) {
    double u = v[GAIN] * fmin(fmax(v[INPUT], -LIMIT), LIMIT), *x = &v[STATE];
    int steps = (int)ceil(h / 5e-4 - 1e-6);
    double part = h / steps;
    for (int k = 0; k < steps; k++) {
        double at[STATES], k1[STATES], k2[STATES], k3[STATES], k4[STATES];
        rates(x, u, k1);
        moved(x, k1, part / 2, at);
        rates(at, u, k2);
        moved(x, k2, part / 2, at);
        rates(at, u, k3);
        moved(x, k3, part, at);
        rates(at, u, k4);
        for (int i = 0; i < STATES; i++) x[i] += part / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]);
    }
}

#include "unit.h"
