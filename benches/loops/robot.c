/* Example 3.3.1: a robot of two links with an L1 law, whose poles are fast or slow. */
#include "l1.h"
#include "loop.h"

static const Law FAST = {2, 1, 1, {-300, -400}, {5, 5}, 1e5, 30, 100, 10, .5, 10, 2};
static const Law SLOW = {2, 1, 1, {-30, -40}, {.5, .5}, 1e5, 30, 100, 10, .5, 10, 2};

static const double m1 = 3.2, len1 = .5, i1 = .96, m2 = 2, len2 = .4, i2 = .841, k1 = 1, k2 = 1, g = 9.81;

/* What the equations of motion M a = f are made of. */
typedef struct {
    double m11, m12, m22, det, a[2], half, c;
} Motion;

static inline Motion motion(const double *x, const double *u) {
    Motion o;
    double c1 = cos(x[0]), c2 = cos(x[1]), c12 = cos(x[0] + x[1]), w1 = x[2], w2 = x[3];
    o.half = m2 * len1 * len2 / 2;
    o.m11 = i1 + i2 + m1 * len1 * len1 / 4 + m2 * (len1 * len1 + len2 * len2 / 4) + 2 * o.half * c2;
    o.m12 = i2 + m2 * len2 * len2 / 4 + o.half * c2, o.m22 = i2 + m2 * len2 * len2 / 4;
    o.c = o.half * sin(x[1]);
    double g2 = m2 * g * len2 * c12 / 2, g1 = m1 * g * len1 * c1 / 2 + m2 * g * len1 * c1 + g2;
    double f1 = u[0] - (-o.c * w2 + k1) * w1 + o.c * (w1 + w2) * w2 - g1;
    double f2 = u[1] - o.c * w1 * w1 - k2 * w2 - g2;
    o.det = o.m11 * o.m22 - o.m12 * o.m12;
    o.a[0] = (o.m22 * f1 - o.m12 * f2) / o.det, o.a[1] = (o.m11 * f2 - o.m12 * f1) / o.det;
    return o;
}

static inline void robot_loop(const Law *law, double t, const double *z, double *dz) {
    double r[2] = {.5 * cos(.7 * t), -.6 * cos(.65 * t)}, u[2];
    l1(law, r, z, z + 4, u, dz + 4);
    Motion o = motion(z, u);
    dz[0] = z[2], dz[1] = z[3], dz[2] = o.a[0], dz[3] = o.a[1];
}

/* Adds M^-1 (f1, f2) to the accelerations' rows of a column. */
static inline void accelerations(const Motion *o, double f1, double f2, double *column) {
    column[2] += (o->m22 * f1 - o->m12 * f2) / o->det, column[3] += (o->m11 * f2 - o->m12 * f1) / o->det;
}

static inline void robot_slopes(const Law *law, const double *x, double *const *columns) {
    const double *z = x + 4;
    Place at = {law, columns, columns + 4, 4};
    double u[2], w1 = x[2], w2 = x[3];
    for (int i = 0; i < 2; i++) u[i] = z[12 + i] - stiffness(law, i) * x[i] - damping(law, i) * x[2 + i];
    Motion o = motion(x, u);
    double s1 = sin(x[0]), c2 = cos(x[1]), s12 = sin(x[0] + x[1]), dc = o.half * c2, dm = -2 * o.c;
    double g12 = m2 * g * len2 * s12 / 2, g11 = m1 * g * len1 * s1 / 2 + m2 * g * len1 * s1 + g12;
    columns[2][0] = columns[3][1] = 1;
    accelerations(&o, g11, g12, columns[0]);
    /* d(M a) = df: what the inertia changes by goes to the right. */
    double turned = dc * (2 * w1 * w2 + w2 * w2) + g12 - dm * o.a[0] - dm / 2 * o.a[1];
    accelerations(&o, turned, -dc * w1 * w1 + g12 - dm / 2 * o.a[0], columns[1]);
    accelerations(&o, 2 * o.c * w2 - k1, -2 * o.c * w1, columns[2]);
    accelerations(&o, 2 * o.c * (w1 + w2), -k2, columns[3]);
    l1_control_slope(at, 0, 2, o.m22 / o.det), l1_control_slope(at, 0, 3, -o.m12 / o.det);
    l1_control_slope(at, 1, 2, -o.m12 / o.det), l1_control_slope(at, 1, 3, o.m11 / o.det);
    l1_slopes(at, x, z);
}

static void fast(double t, const double *z, double *dz) { robot_loop(&FAST, t, z, dz); }
static void slow(double t, const double *z, double *dz) { robot_loop(&SLOW, t, z, dz); }
static void fast_slopes(double t, const double *z, double *const *columns) { (void)t, robot_slopes(&FAST, z, columns); }
static void slow_slopes(double t, const double *z, double *const *columns) { (void)t, robot_slopes(&SLOW, z, columns); }
static void start(double *z) { l1_start(&FAST, z, z + 4); }

const Loop ROBOT_FAST = {"3.3.1-case1", 18, 4, fast, fast_slopes, start, 0};
const Loop ROBOT_SLOW = {"3.3.1-case2", 18, 4, slow, slow_slopes, start, 0};
