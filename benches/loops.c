/* The peer of whole loops: plant, reference and controller of examples 3.3.1 and 3.3.2 in plain C, integrated together
   by the classical Runge-Kutta method with a fixed step. The equations are those of docs/plants and docs/controllers.

   loops LOOP SAMPLES PERIOD SUBSTEPS: takes SAMPLES periods of so many equal steps, and prints the seconds that it
   took, then the plant's state at the end of each period, a line each. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { MOST_CHANNELS = 3, MOST_STATES = 30 };

/* L1 law for m double integrators, x = (q, q'), of which each has two poles re +- j im. */
typedef struct {
    int m, full, inside; /* full: omega_hat is a matrix; inside: the baseline is part of what the estimates see */
    double re[MOST_CHANNELS], im[MOST_CHANNELS];
    double adaptation_gain, feedback_gain, theta_bound, sigma_bound;
    double omega_min, omega_max, omega_off; /* bounds on the diagonal; beside it omega_off to either side */
} Law;

static const Law ROBOT_FAST = {2, 1, 1, {-300, -400}, {5, 5}, 1e5, 30, 100, 10, .5, 10, 2};
static const Law ROBOT_SLOW = {2, 1, 1, {-30, -40}, {.5, .5}, 1e5, 30, 100, 10, .5, 10, 2};
static const Law ATTITUDE = {3, 0, 0, {-30, -35, -40}, {.5, .5, .5}, 1e5, 30, 100, 100, .5, 10, 0};

static int omegas(const Law *law) { return law->full ? law->m * law->m : law->m; }

/* The rate y of an estimate v within its bounds. */
static inline double projected(double v, double y, double low, double high) {
    const double tolerance = .1;
    double d = v - .5 * (low + high), h = .5 * (high - low);
    double f = ((1 + tolerance) * d * d - h * h) / (tolerance * h * h);
    return f > 0 && d * y > 0 ? y * (1 - f) : y;
}

/* The control and the rates of the states z = (x_hat, omega_hat, theta_hat, sigma_hat, u_ad). */
static inline void l1(const Law *law, const double *r, const double *x, const double *z, double *u, double *dz) {
    const int m = law->m;
    const double *omega = z + 2 * m, *theta = omega + omegas(law), *sigma = theta + m, *u_ad = sigma + m;
    double *d_omega = dz + 2 * m, *d_theta = d_omega + omegas(law), *d_sigma = d_theta + m, *d_u = d_sigma + m;
    double baseline[MOST_CHANNELS], v[MOST_CHANNELS], phi = 0;
    for (int i = 0; i < 2 * m; i++) phi = fmax(phi, fabs(x[i]));
    for (int i = 0; i < m; i++) {
        double stiffness = law->re[i] * law->re[i] + law->im[i] * law->im[i];
        baseline[i] = stiffness * x[i] - 2 * law->re[i] * x[m + i];
        u[i] = u_ad[i] - baseline[i];
        v[i] = law->inside ? u[i] : u_ad[i];
    }
    for (int i = 0; i < m; i++) {
        double k = law->re[i] * law->re[i] + law->im[i] * law->im[i], d = -2 * law->re[i], g = law->adaptation_gain;
        /* The last row of P of this channel, from A_m' P + P A_m = -I. */
        double p12 = 1 / (2 * k), p22 = (1 + 2 * p12) / (2 * d);
        double s = p12 * (x[i] - z[i]) + p22 * (x[m + i] - z[m + i]);
        double eta = theta[i] * phi + sigma[i] + (law->inside ? baseline[i] : 0);
        for (int j = law->full ? 0 : i; j < (law->full ? m : i + 1); j++) {
            int at = law->full ? i * m + j : i;
            double low = i == j ? law->omega_min : -law->omega_off, high = i == j ? law->omega_max : law->omega_off;
            eta += omega[at] * v[j];
            d_omega[at] = g * projected(omega[at], s * v[j], low, high);
        }
        d_theta[i] = g * projected(theta[i], s * phi, -law->theta_bound, law->theta_bound);
        d_sigma[i] = g * projected(sigma[i], s, -law->sigma_bound, law->sigma_bound);
        dz[i] = z[m + i];
        dz[m + i] = -k * z[i] - d * z[m + i] + eta;
        d_u[i] = -law->feedback_gain * (eta - k * r[i]);
    }
}

/* The predictor starts at the measured state, omega_hat at the identity, the rest at zero. */
static void start(const Law *law, const double *x, double *z) {
    memcpy(z, x, 2 * law->m * sizeof *z);
    for (int i = 0; i < law->m; i++) z[2 * law->m + (law->full ? i * law->m + i : i)] = 1;
}

/* Rate of the robot's state under torques u. */
static inline void robot(const double *x, const double *u, double *dx) {
    const double m1 = 3.2, l1 = .5, i1 = .96, m2 = 2, l2 = .4, i2 = .841, k1 = 1, k2 = 1, g = 9.81;
    double c1 = cos(x[0]), c2 = cos(x[1]), c12 = cos(x[0] + x[1]), w1 = x[2], w2 = x[3];
    double m11 = i1 + i2 + m1 * l1 * l1 / 4 + m2 * (l1 * l1 + l2 * l2 / 4 + l1 * l2 * c2);
    double m12 = i2 + m2 * (l2 * l2 / 4 + l1 * l2 * c2 / 2), m22 = i2 + m2 * l2 * l2 / 4;
    double c = m2 * l1 * l2 * sin(x[1]) / 2;
    double g2 = m2 * g * l2 * c12 / 2, g1 = m1 * g * l1 * c1 / 2 + m2 * g * l1 * c1 + g2;
    double f1 = u[0] - (-c * w2 + k1) * w1 + c * (w1 + w2) * w2 - g1;
    double f2 = u[1] - c * w1 * w1 - k2 * w2 - g2;
    double det = m11 * m22 - m12 * m12;
    dx[0] = w1, dx[1] = w2;
    dx[2] = (m22 * f1 - m12 * f2) / det, dx[3] = (m11 * f2 - m12 * f1) / det;
}

static inline void robot_loop(const Law *law, double t, const double *z, double *dz) {
    double r[2] = {.5 * cos(.7 * t), -.6 * cos(.65 * t)}, u[2];
    l1(law, r, z, z + 4, u, dz + 4);
    robot(z, u, dz);
}

static void robot_fast(double t, const double *z, double *dz) { robot_loop(&ROBOT_FAST, t, z, dz); }
static void robot_slow(double t, const double *z, double *dz) { robot_loop(&ROBOT_SLOW, t, z, dz); }

static const double INERTIA[3] = {4.85e-3, 4.85e-3, 8.81e-3}, MASS = .5, GRAVITY = 9.81;

/* The trajectory's position with two derivatives; the yaw is returned. */
static inline double trajectory(double t, double *p, double *dp, double *ddp) {
    double s = sin(.4 * t), c = cos(.4 * t), e = exp(-.5 * t);
    p[0] = s, dp[0] = .4 * c, ddp[0] = -.16 * s;
    p[1] = 1 - c, dp[1] = .4 * s, ddp[1] = .16 * c;
    p[2] = 2 * (1 - e * (1 + .5 * t)), dp[2] = .5 * t * e, ddp[2] = .5 * e * (1 - .5 * t);
    return .3 * sin(.3 * t);
}

static inline double within(double value, double limit) { return fmax(-limit, fmin(limit, value)); }

static void quadrotor_loop(double t, const double *z, double *dz) {
    const double *p = z, *v = z + 3, *angle = z + 6, *w = z + 9;
    double r[3], dr[3], ddr[3], a[3], wanted[3], torque[3], tilt_max = .6;
    wanted[2] = trajectory(t, r, dr, ddr);
    for (int i = 0; i < 3; i++) a[i] = ddr[i] + 4 * (dr[i] - v[i]) + 4 * (r[i] - p[i]);
    double cf = cos(angle[0]), sf = sin(angle[0]), ct = cos(angle[1]), st = sin(angle[1]);
    double cp = cos(angle[2]), sp = sin(angle[2]), g_z = fmax(GRAVITY + a[2], .3 * GRAVITY);
    wanted[1] = within(atan((a[0] * cp + a[1] * sp) / g_z), tilt_max);
    wanted[0] = within(atan(cos(wanted[1]) * (a[0] * sp - a[1] * cp) / g_z), tilt_max);
    double thrust = fmax(0, fmin(15, MASS * g_z / fmax(cf * ct, .3))) / MASS;
    l1(&ATTITUDE, wanted, angle, z + 12, torque, dz + 12);
    const double *I = INERTIA;
    for (int i = 0; i < 3; i++) dz[i] = v[i], dz[6 + i] = w[i];
    dz[3] = (cf * st * cp + sf * sp) * thrust;
    dz[4] = (cf * st * sp - sf * cp) * thrust;
    dz[5] = cf * ct * thrust - GRAVITY;
    /* What the law commands are accelerations: the nominal inertia that makes torques of them is the body's own. */
    dz[9] = (I[1] - I[2]) / I[0] * w[1] * w[2] + torque[0];
    dz[10] = (I[2] - I[0]) / I[1] * w[0] * w[2] + torque[1];
    dz[11] = (I[0] - I[1]) / I[2] * w[0] * w[1] + torque[2];
}

typedef void Rate(double t, const double *z, double *dz);

static inline void runge_kutta(Rate *rate, int n, double t, double h, double *z) {
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

typedef struct {
    const char *name;
    Rate *rate;
    int states, measured; /* of the loop and of the plant */
    const Law *law;
    int attitude; /* where the part of the plant's state begins that the law takes */
} Loop;

static const Loop LOOPS[] = {
    {"3.3.1-case1", robot_fast, 18, 4, &ROBOT_FAST, 0},
    {"3.3.1-case2", robot_slow, 18, 4, &ROBOT_SLOW, 0},
    {"3.3.2-case1", quadrotor_loop, 30, 12, &ATTITUDE, 6},
};

static double seconds(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec + 1e-9 * now.tv_nsec;
}

static void run(const Loop *loop, int samples, double period, int substeps) {
    double z[MOST_STATES] = {0}, *rows = malloc(samples * loop->measured * sizeof *rows), h = period / substeps;
    if (loop->attitude) z[6] = .1, z[7] = -.1, z[8] = .2;
    start(loop->law, z + loop->attitude, z + loop->measured);
    double begun = seconds();
    for (int k = 0; k < samples; k++) {
        for (int j = 0; j < substeps; j++) runge_kutta(loop->rate, loop->states, k * period + j * h, h, z);
        memcpy(rows + k * loop->measured, z, loop->measured * sizeof *z);
    }
    printf("%.9g\n", seconds() - begun);
    for (int k = 0; k < samples * loop->measured; k++)
        printf("%.17g%c", rows[k], (k + 1) % loop->measured ? ',' : '\n');
    free(rows);
}

int main(int count, char **arguments) {
    for (size_t i = 0; count == 5 && i < sizeof LOOPS / sizeof *LOOPS; i++)
        if (!strcmp(arguments[1], LOOPS[i].name)) {
            run(&LOOPS[i], atoi(arguments[2]), atof(arguments[3]), atoi(arguments[4]));
            return 0;
        }
    fprintf(stderr, "usage: loops LOOP SAMPLES PERIOD SUBSTEPS\n");
    return 2;
}
