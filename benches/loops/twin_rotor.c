/* Example 3.4.2: a twin rotor and an L1 law with unmatched uncertainty. Nominally each axis is a chain of its own,
   (angle, rate, rotor), whose rate takes what is unmatched. States: the plant's six, the lag of the main rotor's
   torque; x_hat, the diagonal of omega_hat (beside it the bounds leave no room), theta_hat, sigma_hat, theta_2,
   sigma_2, and the filter 1/s. */
#include <math.h>

#include "l1.h"
#include "loop.h"

enum { LAG = 6, X_HAT = 7, OMEGA = 13, THETA = 15, SIGMA = 17, THETA_2 = 19, SIGMA_2 = 21, FILTER = 23, STATES = 25 };

static const double I1 = .068, A1 = .0135, B1 = .0924, B1_PSI = .006, B2_PSI = .001, K1 = 1.1, T11 = 1.1;
static const double I2 = .02, A2 = .02, B2 = .09, B1_PHI = .1, B2_PHI = .01, K2 = .8;
static const double WIDTH = .01, M_G = .32, CENTRIFUGAL = .0163, K_GY = .05, K_C = -.2, T_0 = 3.5, T_P = 2;
static const double ADAPTATION = 1e5, FEEDBACK = 5, THETA_BOUND = 50, SIGMA_BOUND = 15, OMEGA_MIN = .25, OMEGA_MAX = 5;

/* The places of an axis' states, its nominal dynamics rate' = a1 angle + a2 rate + a3 rotor, rotor' = a4 rotor + b u,
   and what follows from the desired poles. */
typedef struct {
    int at[3];
    double a1, a2, a3, a4, b;
    double k[3];      /* gain of the baseline */
    double am[3];     /* the last row of A_m */
    double p[2][3];   /* rows of P: that of the rotor times b, that of the rate */
    double kg, h0, h1; /* H_m^-1 H_um = h0 + h1 s */
} Axis;

static Axis AXES[2];

/* Solves the n equations m x = m[.][n] in place. */
static void solve(int n, double m[6][7]) {
    for (int c = 0; c < n; c++) {
        int best = c;
        for (int r = c; r < n; r++)
            if (fabs(m[r][c]) > fabs(m[best][c])) best = r;
        for (int j = 0; j <= n; j++) {
            double kept = m[c][j];
            m[c][j] = m[best][j], m[best][j] = kept;
        }
        for (int r = 0; r < n; r++) {
            double factor = m[r][c] / m[c][c];
            for (int j = c; r != c && j <= n; j++) m[r][j] -= factor * m[c][j];
        }
    }
    for (int r = 0; r < n; r++) m[r][n] /= m[r][r];
}

/* P of A_m' P + P A_m = -I, of which the upper triangle is unknown. */
static void lyapunov(const double am[3][3], double p[3][3]) {
    static const int index[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};
    double m[6][7] = {{0}};
    for (int i = 0; i < 3; i++)
        for (int j = i; j < 3; j++) {
            double *row = m[index[i][j]];
            for (int k = 0; k < 3; k++) row[index[k][j]] += am[k][i], row[index[i][k]] += am[k][j];
            row[6] = -(i == j);
        }
    solve(6, m);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) p[i][j] = m[index[i][j]][6];
}

/* Gains for the poles -15, -17 and -20: those of s^3 + c2 s^2 + c1 s + c0. */
static void design(Axis *o) {
    const double c2 = 52, c1 = 895, c0 = 5100;
    o->am[2] = -(c2 + o->a2);
    o->am[1] = (o->a2 * o->am[2] - o->a1 - c1) / o->a3;
    o->am[0] = (o->a1 * o->am[2] - c0) / o->a3;
    for (int j = 0; j < 3; j++) o->k[j] = ((j == 2 ? o->a4 : 0) - o->am[j]) / o->b;
    double am[3][3] = {{0, 1, 0}, {o->a1, o->a2, o->a3}, {o->am[0], o->am[1], o->am[2]}}, p[3][3];
    lyapunov(am, p);
    for (int j = 0; j < 3; j++) o->p[0][j] = o->b * p[2][j], o->p[1][j] = p[1][j];
    o->kg = c0 / (o->a3 * o->b);
    o->h0 = -o->am[2] / (o->a3 * o->b), o->h1 = 1 / (o->a3 * o->b);
}

static void start(double *z) {
    AXES[0] = (Axis){{0, 1, 4}, -M_G / I1, -B1_PSI / I1, B1 / I1, -1 / T11, K1 / T11, .kg = 0};
    AXES[1] = (Axis){{2, 3, 5}, 0, -B1_PHI / I2, B2 / I2, -1, K2, .kg = 0};
    for (int i = 0; i < 2; i++) design(&AXES[i]);
    z[OMEGA] = z[OMEGA + 1] = 1;
}

static inline double smooth_start(double t) { return 1 - exp(-.5 * t) * (1 + .5 * t + .125 * t * t); }

static inline void plant(const double *z, const double *u, double *dz) {
    double w1 = z[1], w2 = z[3], s = sin(z[0]), c = cos(z[0]), tau1 = z[4], tau2 = z[5];
    double torque1 = A1 * tau1 * tau1 + B1 * tau1, torque2 = A2 * tau2 * tau2 + B2 * tau2;
    double reaction = K_C * (T_0 / T_P * torque1 + (1 - T_0 / T_P) * z[LAG]);
    dz[0] = w1, dz[2] = w2;
    dz[1] = (torque1 - M_G * s + CENTRIFUGAL * w2 * w2 * 2 * s * c - B1_PSI * w1 - B2_PSI * tanh(w1 / WIDTH) -
             K_GY * torque1 * w2 * c) / I1;
    dz[3] = (torque2 - B1_PHI * w2 - B2_PHI * tanh(w2 / WIDTH) - reaction) / I2;
    dz[4] = (K1 * u[0] - tau1) / T11, dz[5] = K2 * u[1] - tau2;
    dz[LAG] = (torque1 - z[LAG]) / T_P;
}

/* What the law makes of the state: u_ad, the norm, and of each axis the errors weighed by P and the estimates' sums. */
typedef struct {
    double u_ad[2], phi, s[2], s2[2], eta[2], eta2[2];
    int largest;
} Signals;

static inline Signals signals(const double *z) {
    Signals o = {.largest = 0};
    for (int i = 1; i < 6; i++)
        if (fabs(z[i]) > fabs(z[o.largest])) o.largest = i;
    o.phi = fabs(z[o.largest]);
    for (int i = 0; i < 2; i++) {
        const Axis *axis = &AXES[i];
        o.eta2[i] = z[THETA_2 + i] * o.phi + z[SIGMA_2 + i];
        o.u_ad[i] = -FEEDBACK * (z[FILTER + i] + axis->h1 * o.eta2[i]);
        for (int j = 0; j < 3; j++) {
            double e = z[axis->at[j]] - z[X_HAT + axis->at[j]];
            o.s[i] += axis->p[0][j] * e, o.s2[i] += axis->p[1][j] * e;
        }
        o.eta[i] = z[OMEGA + i] * o.u_ad[i] + z[THETA + i] * o.phi + z[SIGMA + i];
    }
    return o;
}


static void rate(double t, const double *z, double *dz) {
    double f = smooth_start(t), r[2] = {f * (.2 + .1 * sin(.3 * t)), f * .3 * sin(.2 * t)}, u[2];
    Signals o = signals(z);
    for (int i = 0; i < 2; i++) {
        const Axis *axis = &AXES[i];
        const double *hat = z + X_HAT;
        double angle = hat[axis->at[0]], rate = hat[axis->at[1]], rotor = hat[axis->at[2]], g = ADAPTATION;
        u[i] = o.u_ad[i];
        for (int j = 0; j < 3; j++) u[i] -= axis->k[j] * z[axis->at[j]];
        dz[X_HAT + axis->at[0]] = rate;
        dz[X_HAT + axis->at[1]] = axis->a1 * angle + axis->a2 * rate + axis->a3 * rotor + o.eta2[i];
        dz[X_HAT + axis->at[2]] =
            axis->am[0] * angle + axis->am[1] * rate + axis->am[2] * rotor + axis->b * o.eta[i];
        dz[OMEGA + i] = g * projected(z[OMEGA + i], o.s[i] * o.u_ad[i], OMEGA_MIN, OMEGA_MAX);
        dz[THETA + i] = g * projected(z[THETA + i], o.s[i] * o.phi, -THETA_BOUND, THETA_BOUND);
        dz[SIGMA + i] = g * projected(z[SIGMA + i], o.s[i], -SIGMA_BOUND, SIGMA_BOUND);
        dz[THETA_2 + i] = g * projected(z[THETA_2 + i], o.s2[i] * o.phi, -THETA_BOUND, THETA_BOUND);
        dz[SIGMA_2 + i] = g * projected(z[SIGMA_2 + i], o.s2[i], -SIGMA_BOUND, SIGMA_BOUND);
        dz[FILTER + i] = o.eta[i] + axis->h0 * o.eta2[i] - axis->kg * r[i];
    }
    plant(z, u, dz);
}

static inline void plant_slopes(const double *z, double *const *columns) {
    double w1 = z[1], w2 = z[3], s = sin(z[0]), c = cos(z[0]), torque1 = A1 * z[4] * z[4] + B1 * z[4];
    double d1 = 2 * A1 * z[4] + B1, d2 = 2 * A2 * z[5] + B2, h1 = tanh(w1 / WIDTH), h2 = tanh(w2 / WIDTH);
    columns[1][0] = columns[3][2] = 1;
    columns[0][1] = (-M_G * c + CENTRIFUGAL * w2 * w2 * 2 * (c * c - s * s) + K_GY * torque1 * w2 * s) / I1;
    columns[1][1] = -(B1_PSI + B2_PSI * (1 - h1 * h1) / WIDTH) / I1;
    columns[3][1] = (CENTRIFUGAL * 4 * w2 * s * c - K_GY * torque1 * c) / I1;
    columns[4][1] = d1 * (1 - K_GY * w2 * c) / I1;
    columns[3][3] = -(B1_PHI + B2_PHI * (1 - h2 * h2) / WIDTH) / I2;
    columns[4][3] = -K_C * T_0 / T_P * d1 / I2, columns[5][3] = d2 / I2;
    columns[LAG][3] = -K_C * (1 - T_0 / T_P) / I2;
    columns[4][4] = -1 / T11, columns[5][5] = -1;
    columns[4][LAG] = d1 / T_P, columns[LAG][LAG] = -1 / T_P;
}

/* Adds to a row that takes eta_2 of an axis with this slope. */
static inline void eta2_slopes(const Signals *o, int i, int row, double slope, const double *z,
                               double *const *columns) {
    columns[THETA_2 + i][row] += slope * o->phi;
    columns[SIGMA_2 + i][row] += slope;
    columns[o->largest][row] += slope * z[THETA_2 + i] * copysign(1, z[o->largest]);
}

/* The same of u_ad. */
static inline void u_slopes(const Signals *o, int i, int row, double slope, const double *z, double *const *columns) {
    columns[FILTER + i][row] -= FEEDBACK * slope;
    eta2_slopes(o, i, row, -FEEDBACK * slope * AXES[i].h1, z, columns);
}

/* The same of eta. */
static inline void eta_slopes(const Signals *o, int i, int row, double slope, const double *z, double *const *columns) {
    columns[OMEGA + i][row] += slope * o->u_ad[i];
    columns[THETA + i][row] += slope * o->phi;
    columns[SIGMA + i][row] += slope;
    columns[o->largest][row] += slope * z[THETA + i] * copysign(1, z[o->largest]);
    u_slopes(o, i, row, slope * z[OMEGA + i], z, columns);
}

/* An estimate's row, whose rate is g Proj(v, s w) with s = p e: all slopes but that in w, which is returned. */
static inline double estimate_slopes(const double *p, const Axis *axis, int estimate, double s, double w, double low,
                                     double high, const double *z, double *const *columns) {
    double slope, part = ADAPTATION * projection(z[estimate], s * w, low, high, &slope);
    columns[estimate][estimate] += ADAPTATION * s * w * slope;
    for (int j = 0; j < 3; j++) {
        columns[axis->at[j]][estimate] += part * w * p[j];
        columns[X_HAT + axis->at[j]][estimate] -= part * w * p[j];
    }
    return part * s;
}

static inline void adaptation_slopes(const Signals *o, int i, const double *z, double *const *columns) {
    const Axis *axis = &AXES[i];
    const double *p = axis->p[0], *p2 = axis->p[1], bound = THETA_BOUND, s = o->s[i], s2 = o->s2[i];
    double sign = copysign(1, z[o->largest]), *largest = columns[o->largest];
    double in_u = estimate_slopes(p, axis, OMEGA + i, s, o->u_ad[i], OMEGA_MIN, OMEGA_MAX, z, columns);
    u_slopes(o, i, OMEGA + i, in_u, z, columns);
    largest[THETA + i] += sign * estimate_slopes(p, axis, THETA + i, s, o->phi, -bound, bound, z, columns);
    largest[THETA_2 + i] += sign * estimate_slopes(p2, axis, THETA_2 + i, s2, o->phi, -bound, bound, z, columns);
    estimate_slopes(p, axis, SIGMA + i, s, 1, -SIGMA_BOUND, SIGMA_BOUND, z, columns);
    estimate_slopes(p2, axis, SIGMA_2 + i, s2, 1, -SIGMA_BOUND, SIGMA_BOUND, z, columns);
}

static void slopes(double t, const double *z, double *const *columns) {
    Signals o = signals(z);
    (void)t;
    plant_slopes(z, columns);
    for (int i = 0; i < 2; i++) {
        const Axis *axis = &AXES[i];
        const double nominal[3] = {axis->a1, axis->a2, axis->a3}, gain = i ? K2 : K1 / T11;
        for (int j = 0; j < 3; j++) {
            columns[axis->at[j]][4 + i] -= gain * axis->k[j];
            columns[X_HAT + axis->at[j]][X_HAT + axis->at[1]] += nominal[j];
            columns[X_HAT + axis->at[j]][X_HAT + axis->at[2]] += axis->am[j];
        }
        u_slopes(&o, i, 4 + i, gain, z, columns);
        columns[X_HAT + axis->at[1]][X_HAT + axis->at[0]] += 1;
        eta2_slopes(&o, i, X_HAT + axis->at[1], 1, z, columns);
        eta_slopes(&o, i, X_HAT + axis->at[2], axis->b, z, columns);
        eta_slopes(&o, i, FILTER + i, 1, z, columns);
        eta2_slopes(&o, i, FILTER + i, axis->h0, z, columns);
        adaptation_slopes(&o, i, z, columns);
    }
}

const Loop TWIN_ROTOR = {"3.4.2", STATES, 6, rate, slopes, start, 0};
