/* Chapter 4, case 1: a nonlinear system behind an actuator with an L1 law. The plant's unmodeled dynamics are left out:
   in this case nothing depends on them. */
#include "l1.h"
#include "loop.h"

static const Law LAW = {1, 0, 0, {-21}, {.743}, 1e6, 20, 10, 100, 0, 10, 0};
static const double ACTUATOR_RATE = 75;

static void rate(double t, const double *z, double *dz) {
    double r = cos(.5 * t), x1 = z[0], x2 = z[1], u;
    l1(&LAW, &r, z, z + 3, &u, dz + 3);
    dz[0] = x2;
    dz[1] = z[2] + 2 * x1 * x1 + 2 * x2 * x2 + x1 * sin(x1 * x1) + x2 * cos(x2 * x2);
    dz[2] = ACTUATOR_RATE * (u - z[2]);
}

static void slopes(double t, const double *z, double *const *columns) {
    double x1 = z[0], x2 = z[1], a = x1 * x1, b = x2 * x2;
    Place at = {&LAW, columns, columns + 3, 3};
    (void)t;
    columns[1][0] = columns[2][1] = 1;
    columns[0][1] = 4 * x1 + sin(a) + 2 * a * cos(a);
    columns[1][1] = 4 * x2 + cos(b) - 2 * b * sin(b);
    columns[2][2] = -ACTUATOR_RATE;
    l1_control_slope(at, 0, 2, ACTUATOR_RATE);
    l1_slopes(at, z, z + 3);
}

static void start(double *z) { l1_start(&LAW, z, z + 3); }

const Loop ACTUATED = {"4-case1", 9, 2, rate, slopes, start, 0};
