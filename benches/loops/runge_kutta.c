/* A whole loop by the classical Runge-Kutta method with a fixed step.

   runge_kutta LOOP SAMPLES PERIOD SUBSTEPS: takes SAMPLES periods of so many equal steps, and prints the seconds that
   it took, then the plant's state at the end of each period, a line each. */
#include <stdio.h>
#include <stdlib.h>

#include "loop.h"

static inline void advance(Rate *rate, int n, double t, double h, double *z) {
    double k1[MOST_STATES], k2[MOST_STATES], k3[MOST_STATES], k4[MOST_STATES], y[MOST_STATES];
    rate(t, z, k1);
    for (int i = 0; i < n; i++) y[i] = z[i] + .5 * h * k1[i];
    rate(t + .5 * h, y, k2);
    for (int i = 0; i < n; i++) y[i] = z[i] + .5 * h * k2[i];
    rate(t + .5 * h, y, k3);
    for (int i = 0; i < n; i++) y[i] = z[i] + h * k3[i];
    rate(t + h, y, k4);
    for (int i = 0; i < n; i++) z[i] += h / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]);
}

static void run(const Loop *loop, int samples, double period, int substeps) {
    double z[MOST_STATES] = {0}, *rows = malloc(samples * loop->measured * sizeof *rows), h = period / substeps;
    loop->start(z);
    double begun = seconds_now();
    for (int k = 0; k < samples; k++) {
        for (int j = 0; j < substeps; j++) advance(loop->rate, loop->states, k * period + j * h, h, z);
        record(loop, z, rows + k * loop->measured);
    }
    tell(loop, seconds_now() - begun, samples, rows);
    free(rows);
}

int main(int count, char **arguments) {
    const Loop *loop = count == 5 ? find_loop(arguments[1]) : NULL;
    if (!loop) {
        fprintf(stderr, "usage: runge_kutta LOOP SAMPLES PERIOD SUBSTEPS\n");
        return 2;
    }
    run(loop, atoi(arguments[2]), atof(arguments[3]), atoi(arguments[4]));
    return 0;
}
