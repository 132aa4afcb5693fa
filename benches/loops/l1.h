/* The L1 law of docs/controllers for m double integrators, x = (q, q'), of which each has two poles re +- j im. Its
   states are z = (x_hat, omega_hat, theta_hat, sigma_hat, u_ad). */
#ifndef L1_H
#define L1_H

#include <math.h>
#include <string.h>

enum { MOST_CHANNELS = 6 };

typedef struct {
    int m, full, inside; /* full: omega_hat is a matrix; inside: the baseline is part of what the estimates see */
    double re[MOST_CHANNELS], im[MOST_CHANNELS];
    double adaptation_gain, feedback_gain, theta_bound, sigma_bound;
    double omega_min, omega_max, omega_off; /* bounds on the diagonal; beside it omega_off to either side */
} Law;

static inline int omegas(const Law *law) { return law->full ? law->m * law->m : law->m; }

/* Stiffness and damping of a channel's desired dynamics. */
static inline double stiffness(const Law *law, int i) { return law->re[i] * law->re[i] + law->im[i] * law->im[i]; }
static inline double damping(const Law *law, int i) { return -2 * law->re[i]; }

/* How an estimate v at the bounds scales its rate y; *slope is how that factor changes with v. */
static inline double projection(double v, double y, double low, double high, double *slope) {
    const double tolerance = .1;
    double d = v - .5 * (low + high), h = .5 * (high - low), scale = 1 / (tolerance * h * h);
    double f = ((1 + tolerance) * d * d - h * h) * scale;
    int active = f > 0 && d * y > 0;
    *slope = active ? -2 * (1 + tolerance) * d * scale : 0;
    return active ? 1 - f : 1;
}

static inline double projected(double v, double y, double low, double high) {
    double slope;
    return y * projection(v, y, low, high, &slope);
}

/* The control under references r, and the rates. */
static inline void l1(const Law *law, const double *r, const double *x, const double *z, double *u, double *dz) {
    const int m = law->m;
    const double *omega = z + 2 * m, *theta = omega + omegas(law), *sigma = theta + m, *u_ad = sigma + m;
    double *d_omega = dz + 2 * m, *d_theta = d_omega + omegas(law), *d_sigma = d_theta + m, *d_u = d_sigma + m;
    double baseline[MOST_CHANNELS], v[MOST_CHANNELS], phi = 0;
    for (int i = 0; i < 2 * m; i++) phi = fmax(phi, fabs(x[i]));
    for (int i = 0; i < m; i++) {
        baseline[i] = stiffness(law, i) * x[i] + damping(law, i) * x[m + i];
        u[i] = u_ad[i] - baseline[i];
        v[i] = law->inside ? u[i] : u_ad[i];
    }
    for (int i = 0; i < m; i++) {
        double k = stiffness(law, i), d = damping(law, i), g = law->adaptation_gain;
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
static inline void l1_start(const Law *law, const double *x, double *z) {
    memcpy(z, x, 2 * law->m * sizeof *z);
    for (int i = 0; i < law->m; i++) z[2 * law->m + (law->full ? i * law->m + i : i)] = 1;
}

/* Where the law's part of a Jacobian matrix goes: the columns of x, those of its states, and its first row. */
typedef struct {
    const Law *law;
    double *const *x, *const *z;
    int row;
} Place;

/* Adds to a row that takes control i with this slope. */
static inline void l1_control_slope(Place at, int i, int row, double slope) {
    const Law *law = at.law;
    at.x[i][row] -= slope * stiffness(law, i);
    at.x[law->m + i][row] -= slope * damping(law, i);
    at.z[4 * law->m + omegas(law) + i][row] += slope;
}

/* Adds to a row that takes v_j, what the estimates see of the control. */
static inline void l1_seen_slope(Place at, int j, int row, double slope) {
    if (at.law->inside)
        l1_control_slope(at, j, row, slope);
    else
        at.z[4 * at.law->m + omegas(at.law) + j][row] += slope;
}

/* Adds to a row that takes s of channel i. */
static inline void l1_error_slope(Place at, int i, int row, double slope) {
    const int m = at.law->m;
    double p12 = 1 / (2 * stiffness(at.law, i)), p22 = (1 + 2 * p12) / (2 * damping(at.law, i));
    at.x[i][row] += p12 * slope, at.x[m + i][row] += p22 * slope;
    at.z[i][row] -= p12 * slope, at.z[m + i][row] -= p22 * slope;
}

/* An estimate's row, whose rate is g Proj(v, s w): the slopes in v and s, and what is returned, that in w. */
static inline double l1_estimate_slopes(Place at, int i, int estimate, const double *z, double s, double w,
                                        double low, double high) {
    double slope, g = at.law->adaptation_gain, part = g * projection(z[estimate], s * w, low, high, &slope);
    at.z[estimate][at.row + estimate] += g * s * w * slope;
    l1_error_slope(at, i, at.row + estimate, part * w);
    return part * s;
}

/* The slopes of eta_hat of channel i, times a factor, in a row. */
static inline void l1_eta_slopes(Place at, int i, int row, double factor, int largest, const double *x,
                                 const double *z, const double *v) {
    const Law *law = at.law;
    const int m = law->m, theta = 2 * m + omegas(law) + i;
    double phi = fabs(x[largest]);
    at.z[theta][row] += factor * phi;
    at.z[theta + m][row] += factor;
    at.x[largest][row] += factor * z[theta] * copysign(1, x[largest]);
    if (law->inside) at.x[i][row] += factor * stiffness(law, i), at.x[m + i][row] += factor * damping(law, i);
    for (int j = law->full ? 0 : i; j < (law->full ? m : i + 1); j++) {
        int omega = 2 * m + (law->full ? i * m + j : i);
        at.z[omega][row] += factor * v[j];
        l1_seen_slope(at, j, row, factor * z[omega]);
    }
}

/* The slopes of the rates in the measured state and in the law's own states. */
static inline void l1_slopes(Place at, const double *x, const double *z) {
    const Law *law = at.law;
    const int m = law->m, n = omegas(law);
    const double *u_ad = z + 4 * m + n;
    double v[MOST_CHANNELS];
    int largest = 0;
    for (int i = 0; i < 2 * m; i++)
        if (fabs(x[i]) > fabs(x[largest])) largest = i;
    for (int i = 0; i < m; i++)
        v[i] = u_ad[i] - (law->inside ? stiffness(law, i) * x[i] + damping(law, i) * x[m + i] : 0);
    for (int i = 0; i < m; i++) {
        double k = stiffness(law, i), d = damping(law, i), p12 = 1 / (2 * k), p22 = (1 + 2 * p12) / (2 * d);
        double s = p12 * (x[i] - z[i]) + p22 * (x[m + i] - z[m + i]);
        int theta = 2 * m + n + i, sigma = theta + m;
        for (int j = law->full ? 0 : i; j < (law->full ? m : i + 1); j++) {
            int omega = 2 * m + (law->full ? i * m + j : i);
            double low = i == j ? law->omega_min : -law->omega_off, high = i == j ? law->omega_max : law->omega_off;
            double seen = l1_estimate_slopes(at, i, omega, z, s, v[j], low, high);
            l1_seen_slope(at, j, at.row + omega, seen);
        }
        double sign = copysign(1, x[largest]), bound = law->theta_bound;
        double in_phi = l1_estimate_slopes(at, i, theta, z, s, fabs(x[largest]), -bound, bound);
        at.x[largest][at.row + theta] += in_phi * sign;
        l1_estimate_slopes(at, i, sigma, z, s, 1, -law->sigma_bound, law->sigma_bound);
        at.z[m + i][at.row + i] += 1;
        at.z[i][at.row + m + i] -= k, at.z[m + i][at.row + m + i] -= d;
        l1_eta_slopes(at, i, at.row + m + i, 1, largest, x, z, v);
        l1_eta_slopes(at, i, at.row + 4 * m + n + i, -law->feedback_gain, largest, x, z, v);
    }
}

#endif
