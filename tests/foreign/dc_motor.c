/* The DC motor of docs/own_controller.md as another tool's unit, whose voltage its source limits:
   speed' = -.5 speed + 250 current, current' = -25 speed - 500 current + 500 voltage; Runge-Kutta steps of .1 ms. */
#include <math.h>

#define VARIABLES 3
enum { VOLTAGE, SPEED, CURRENT };

static void outputs(double *v, double time) {}

static void rates(const double *x, double u, double *dx) {
    dx[0] = -0.5 * x[0] + 250 * x[1];
    dx[1] = -25 * x[0] - 500 * x[1] + 500 * u;
}

static void step(double *v, double time, double h) {
    double u = fmin(fmax(v[VOLTAGE], -12), 12);
    int steps = (int)ceil(h / 1e-4 - 1e-6);
    double part = h / steps;
    for (int k = 0; k < steps; k++) {
        double *x = &v[SPEED], at[2], k1[2], k2[2], k3[2], k4[2];
        rates(x, u, k1);
        for (int i = 0; i < 2; i++) at[i] = x[i] + part / 2 * k1[i];
        rates(at, u, k2);
        for (int i = 0; i < 2; i++) at[i] = x[i] + part / 2 * k2[i];
        rates(at, u, k3);
        for (int i = 0; i < 2; i++) at[i] = x[i] + part * k3[i];
        rates(at, u, k4);
        for (int i = 0; i < 2; i++) x[i] += part / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]);
    }
}

#include "unit.h"
