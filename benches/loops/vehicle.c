/* Example 3.3.3: an underwater vehicle with an L1 law. States: eta (position, angles), nu (velocities in body axes),
   the law's; the law measures (eta, eta'). */
#include "l1.h"
#include "loop.h"

static const Law LAW = {
    6, 0, 0, {-9, -10.5, -12, -13.5, -15, -16.5}, {.1, .1, .1, .1, .1, .1}, 1e5, 30, 100, 100, .5, 20, 0,
};
/* By which accelerations that the law commands become forces. */
static const double NOMINAL[6] = {33.039603, 62.248227, 62.248227, .1344, 6.702954, 6.702954};
static const double MASS = 32, COUPLING = 32 * .0044, RIGHTING = 32 * 9.81 * .0044;
static const double LINEAR[6] = {1, 5, 5, .2, 1, 1};

/* The diagonal of M, and quadratic damping. Beside the diagonal M has COUPLING, of surge and pitch, and its negative,
   of sway and roll. */
static double INERTIA[6], QUADRATIC[6];

static void hull(void) {
    const double pi = 3.14159265358979323846, rho = 1025, length = 1.5, diameter = .2, a = length / 2, b = diameter / 2;
    double e2 = 1 - b * b / (a * a), e = sqrt(e2), water = 4 * pi / 3 * rho * a * b * b;
    double alpha = 2 * (1 - e2) / (e2 * e) * (atanh(e) - e), beta = 1 / e2 - (1 - e2) / (e2 * e) * atanh(e);
    double less = a * a - b * b, more = a * a + b * b, bent = less * (beta - alpha);
    double turn = water / 5 * less * bent / (2 * less - more * (beta - alpha));
    INERTIA[0] = MASS + alpha / (2 - alpha) * water;
    INERTIA[1] = INERTIA[2] = MASS + beta / (2 - beta) * water;
    INERTIA[3] = 1.05 * .4 * MASS * b * b;
    INERTIA[4] = INERTIA[5] = MASS / 5 * more + turn;
    QUADRATIC[0] = .5 * rho * .2 * pi * b * b;
    QUADRATIC[1] = QUADRATIC[2] = .5 * rho * 1.1 * length * diameter;
    QUADRATIC[3] = .1;
    QUADRATIC[4] = QUADRATIC[5] = .5 * rho * 1.1 * diameter * pow(length, 4) / 32;
}

/* h = M nu. */
static inline void momentum(const double *nu, double *h) {
    for (int i = 0; i < 6; i++) h[i] = INERTIA[i] * nu[i];
    h[0] += COUPLING * nu[4], h[4] += COUPLING * nu[0];
    h[1] -= COUPLING * nu[3], h[3] -= COUPLING * nu[1];
}

/* M^-1 f, in place. */
static inline void accelerate(double *f) {
    double c = COUPLING, det04 = INERTIA[0] * INERTIA[4] - c * c, det13 = INERTIA[1] * INERTIA[3] - c * c;
    double f0 = f[0], f1 = f[1];
    f[0] = (INERTIA[4] * f0 - c * f[4]) / det04, f[4] = (INERTIA[0] * f[4] - c * f0) / det04;
    f[1] = (INERTIA[3] * f1 + c * f[3]) / det13, f[3] = (INERTIA[1] * f[3] + c * f1) / det13;
    f[2] /= INERTIA[2], f[5] /= INERTIA[5];
}

/* Adds a x b. */
static inline void add_cross(const double *a, const double *b, double *sum) {
    sum[0] += a[1] * b[2] - a[2] * b[1], sum[1] += a[2] * b[0] - a[0] * b[2], sum[2] += a[0] * b[1] - a[1] * b[0];
}

/* J: the rotation R, and V = W^-1, by rows. */
typedef struct {
    double sf, cf, st, ct, sp, cp, R[3][3], V[3][3];
} Frame;

static inline Frame frame(const double *eta) {
    Frame o = {.sf = sin(eta[3]), .cf = cos(eta[3]), .st = sin(eta[4]), .ct = cos(eta[4])};
    o.sp = sin(eta[5]), o.cp = cos(eta[5]);
    double sf = o.sf, cf = o.cf, st = o.st, ct = o.ct, sp = o.sp, cp = o.cp, turns = 1 / ct;
    double R[3][3] = {
        {cp * ct, -sp * cf + cp * st * sf, sp * sf + cp * cf * st},
        {sp * ct, cp * cf + sf * st * sp, -cp * sf + st * sp * cf},
        {-st, ct * sf, ct * cf},
    };
    double V[3][3] = {{1, sf * st * turns, cf * st * turns}, {0, cf, -sf}, {0, sf * turns, cf * turns}};
    memcpy(o.R, R, sizeof R);
    memcpy(o.V, V, sizeof V);
    return o;
}

/* J nu. */
static inline void turned(const double R[3][3], const double V[3][3], const double *nu, double *out) {
    for (int i = 0; i < 3; i++) {
        out[i] = R[i][0] * nu[0] + R[i][1] * nu[1] + R[i][2] * nu[2];
        out[3 + i] = V[i][0] * nu[3] + V[i][1] * nu[4] + V[i][2] * nu[5];
    }
}

/* J' u. */
static inline void turned_back(const double R[3][3], const double V[3][3], const double *u, double *out) {
    for (int i = 0; i < 3; i++) {
        out[i] = R[0][i] * u[0] + R[1][i] * u[1] + R[2][i] * u[2];
        out[3 + i] = V[0][i] * u[3] + V[1][i] * u[4] + V[2][i] * u[5];
    }
}

/* (eta, eta'). */
static inline Frame measured(const double *z, double *x) {
    Frame o = frame(z);
    memcpy(x, z, 6 * sizeof *z);
    turned(o.R, o.V, z + 6, x + 6);
    return o;
}

static void measure(const double *z, double *x) { measured(z, x); }

static void rate(double t, const double *z, double *dz) {
    double e = .4 * t, s = 1 - exp(-e) * (1 + e + .5 * e * e), x[12], u[6], h[6];
    double r[6] = {.25 * t, 2 * sin(.1 * t), 3, .1 * sin(.2 * t), -.15 * sin(.15 * t), .5 * sin(.1 * t)};
    const double *nu = z + 6;
    double *f = dz + 6;
    for (int i = 0; i < 6; i++) r[i] *= s;
    Frame o = measured(z, x);
    l1(&LAW, r, x, z + 12, u, dz + 12);
    for (int i = 0; i < 6; i++) dz[i] = x[6 + i], u[i] *= NOMINAL[i];
    turned_back(o.R, o.V, u, f);
    momentum(nu, h);
    add_cross(h, nu + 3, f), add_cross(h, nu, f + 3), add_cross(h + 3, nu + 3, f + 3);
    for (int i = 0; i < 6; i++) f[i] -= (LINEAR[i] + QUADRATIC[i] * fabs(nu[i])) * nu[i];
    f[3] -= RIGHTING * o.ct * o.sf, f[4] -= RIGHTING * o.st;
    accelerate(f);
}

/* How J changes with angle k. */
static void frame_slope(const Frame *o, int k, double R[3][3], double V[3][3]) {
    const double sf = o->sf, cf = o->cf, st = o->st, ct = o->ct, heading[2] = {o->cp, o->sp}, c2 = ct * ct;
    memset(R, 0, 9 * sizeof(double)), memset(V, 0, 9 * sizeof(double));
    for (int i = 0; i < 3 && k == 0; i++) {
        R[i][1] = o->R[i][2], R[i][2] = -o->R[i][1];
        V[i][1] = o->V[i][2], V[i][2] = -o->V[i][1];
    }
    if (k == 1) {
        R[2][0] = -ct, R[2][1] = -st * sf, R[2][2] = -st * cf;
        for (int j = 0; j < 6; j++) R[j / 3][j % 3] = heading[j / 3] * o->R[2][j % 3];
        V[0][1] = sf / c2, V[0][2] = cf / c2, V[2][1] = sf * st / c2, V[2][2] = cf * st / c2;
    }
    for (int j = 0; j < 3 && k == 2; j++) R[0][j] = -o->R[1][j], R[1][j] = o->R[0][j];
}

/* Column k of what is measured beside eta, and of the plant's forces but for the control's own slopes. */
typedef struct {
    double x[6], f[6];
} Column;

static Column angle_column(const Frame *o, int k, const double *z, const double *u) {
    double R[3][3], V[3][3];
    Column c;
    frame_slope(o, k, R, V);
    turned(R, V, z + 6, c.x);
    turned_back(R, V, u, c.f);
    if (k == 0) c.f[3] -= RIGHTING * o->ct * o->cf;
    if (k == 1) c.f[3] += RIGHTING * o->st * o->sf, c.f[4] -= RIGHTING * o->ct;
    return c;
}

static Column velocity_column(const Frame *o, int k, const double *z) {
    const double *nu = z + 6;
    double unit[6] = {0}, h[6], dh[6];
    Column c = {.f = {0}};
    unit[k] = 1;
    turned(o->R, o->V, unit, c.x);
    momentum(nu, h), momentum(unit, dh);
    add_cross(h, unit + 3, c.f), add_cross(dh, nu + 3, c.f);
    add_cross(h, unit, c.f + 3), add_cross(dh, nu, c.f + 3);
    add_cross(h + 3, unit + 3, c.f + 3), add_cross(dh + 3, nu + 3, c.f + 3);
    c.f[k] -= LINEAR[k] + 2 * QUADRATIC[k] * fabs(nu[k]);
    return c;
}

static void slopes(double t, const double *z, double *const *columns) {
    double x[12], u[6], rates[6][MOST_STATES] = {{0}}, *measured_columns[12];
    const double *u_ad = z + 42;
    Place at = {&LAW, measured_columns, columns + 12, 12};
    Frame o = measured(z, x);
    (void)t;
    for (int i = 0; i < 6; i++) {
        measured_columns[i] = columns[i], measured_columns[6 + i] = rates[i];
        u[i] = NOMINAL[i] * (u_ad[i] - stiffness(&LAW, i) * x[i] - damping(&LAW, i) * x[6 + i]);
    }
    l1_slopes(at, x, z + 12);
    for (int i = 0; i < 6; i++) {
        double unit[6] = {0}, f[6];
        unit[i] = NOMINAL[i];
        turned_back(o.R, o.V, unit, f);
        accelerate(f);
        for (int j = 0; j < 6; j++) l1_control_slope(at, i, 6 + j, f[j]);
    }
    for (int k = 3; k < 12; k++) {
        Column c = k < 6 ? angle_column(&o, k - 3, z, u) : velocity_column(&o, k - 6, z);
        double *column = columns[k];
        accelerate(c.f);
        for (int i = 0; i < 6; i++) {
            column[i] += c.x[i], column[6 + i] += c.f[i];
            for (int row = 6; row < MOST_STATES && c.x[i]; row++) column[row] += c.x[i] * rates[i][row];
        }
    }
}

static void start(double *z) {
    double x[12];
    hull();
    measured(z, x);
    l1_start(&LAW, x, z + 12);
}

const Loop VEHICLE = {"3.3.3", 48, 12, rate, slopes, start, measure};
