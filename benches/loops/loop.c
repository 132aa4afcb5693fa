#include "loop.h"

#include <stdio.h>
#include <string.h>

static const Loop *const LOOPS[] = {
    &ROBOT_FAST, &ROBOT_SLOW, &QUADROTOR, &OBSERVED_QUADROTOR, &VEHICLE, &TWIN_ROTOR, &ACTUATED,
};

const Loop *find_loop(const char *name) {
    for (size_t i = 0; i < sizeof LOOPS / sizeof *LOOPS; i++)
        if (!strcmp(name, LOOPS[i]->name)) return LOOPS[i];
    return NULL;
}

void record(const Loop *loop, const double *z, double *row) {
    if (loop->measure)
        loop->measure(z, row);
    else
        memcpy(row, z, loop->measured * sizeof *z);
}

void tell(const Loop *loop, double seconds, int samples, const double *rows) {
    printf("%.9g\n", seconds);
    for (int k = 0; k < samples * loop->measured; k++)
        printf("%.17g%c", rows[k], (k + 1) % loop->measured ? ',' : '\n');
}
