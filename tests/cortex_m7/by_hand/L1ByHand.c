/* The L1 control law of example 3.3.1 written by hand from its equations (Hashim, (3.19) to (3.22), with projection and anti-windup),
 * with the services of a generated one: refusal of what is no number with the states unchanged, status bits, manual control,
 * calibration. What a generated law costs is compared with it. */

#include "L1ByHand.h"

#include <math.h>
#include <string.h>

#if defined(__FAST_MATH__)
#error "-ffast-math takes away the checks of inputs and outputs for NaN and infinity"
#endif

#define READY 0x51a2b3c4u
#define PERIOD 1e-4
#define SUBSTEPS 10

/* A_m = (0 I; -diag a, -diag d), K_m and K_g likewise; rows of P B. */
static const double a[2] = {90025.0, 160025.0}, d[2] = {600.0, 800.0};
static const double PB[2][2] = {{5.554012766921314e-6, 0.0008333425900212408}, {3.124511795918399e-6, 0.0006250039056397407}};
static const L1ByHand_parameters defaults = {
    {-1e15, -1e15}, {1e15, 1e15}, {0.5, -2, -2, 0.5}, {10, 2, 2, 10}, 1e5, {30, 0, 0, 30}, {100, 100}, {10, 10}, 0.1, {-1, -1}, 0.13};

static double within(double v, double lo, double hi) { return v < lo ? lo : hi < v ? hi : v; }

/* Proj(v, y) within lo and hi. */
static double projection(double v, double y, double lo, double hi, double epsilon)
{
    const double h = (hi - lo) * 0.5, away = v - (lo + hi) * 0.5;
    if (h <= 0) return 0;
    if (fabs(away) * (epsilon + 1) <= h) return y;
    const double q = away / h, f = ((epsilon + 1) * q * q - 1) / epsilon;
    return f > 0 && q * y > 0 ? y * (1 - f) : y;
}

static void control(const L1ByHand *s, const L1ByHand_states *x, const L1ByHand_inputs *in, double *unlimited, double *u)
{
    for (int i = 0; i < 2; i++) {
        unlimited[i] = s->active ? x->u_ad[i] - (a[i] * in->x[i] + d[i] * in->x[i + 2]) : s->manual[i];
        u[i] = within(unlimited[i], s->p.u_min[i], s->p.u_max[i]);
    }
}

static void rates(const L1ByHand *s, const L1ByHand_states *x, const L1ByHand_inputs *in, L1ByHand_states *dx)
{
    const L1ByHand_parameters *p = &s->p;
    double unlimited[2], v[2], eta[2], excess[2];
    control(s, x, in, unlimited, v);
    double norm = fabs(in->x[0]);
    for (int i = 1; i < 4; i++) norm = fmax(norm, fabs(in->x[i]));
    for (int i = 0; i < 2; i++) {
        const double Kx = a[i] * in->x[i] + d[i] * in->x[i + 2];
        eta[i] = x->sigma[i] + Kx + x->theta[i] * norm + x->omega[i] * v[0] + x->omega[i + 2] * v[1];
        excess[i] = eta[i] - a[i] * in->r[i];
        const double e = x->x_hat[i] - in->x[i], de = x->x_hat[i + 2] - in->x[i + 2];
        if (!s->active) {
            dx->x_hat[i] = de;
            dx->x_hat[i + 2] = -a[i] * e - d[i] * de;
            dx->omega[i] = dx->omega[i + 2] = dx->theta[i] = dx->sigma[i] = 0;
            dx->u_ad[i] = -s->follow * (x->u_ad[i] - (v[i] + Kx));
            continue;
        }
        dx->x_hat[i] = x->x_hat[i + 2];
        dx->x_hat[i + 2] = -a[i] * x->x_hat[i] - d[i] * x->x_hat[i + 2] + eta[i];
        const double y = -(e * PB[i][0] + de * PB[i][1]);
        for (int j = 0; j < 2; j++) {
            const int k = i + 2 * j;
            dx->omega[k] = p->gamma * projection(x->omega[k], y * v[j], p->omega_min[k], p->omega_max[k], p->epsilon);
        }
        dx->theta[i] = p->gamma * projection(x->theta[i], y * norm, -p->theta_bound[i], p->theta_bound[i], p->epsilon);
        dx->sigma[i] = p->gamma * projection(x->sigma[i], y, -p->sigma_bound[i], p->sigma_bound[i], p->epsilon);
    }
    for (int i = 0; s->active && i < 2; i++) {
        dx->u_ad[i] = (v[i] - unlimited[i]) * s->antiwindup[i] - (p->K[i] * excess[0] + p->K[i + 2] * excess[1]);
    }
}

enum { STATES = sizeof(L1ByHand_states) / sizeof(double) };

static void integrate(const L1ByHand *s, const L1ByHand_inputs *in, L1ByHand_states *x)
{
    const double h = PERIOD / SUBSTEPS;
    for (int k = 0; k < SUBSTEPS; k++) {
        L1ByHand_states rate, at;
        double sum[STATES], *from = (double *)x, *to = (double *)&at, *r = (double *)&rate;
        rates(s, x, in, &rate);
        for (int i = 0; i < STATES; i++) { sum[i] = r[i]; to[i] = from[i] + 0.5 * h * r[i]; }
        rates(s, &at, in, &rate);
        for (int i = 0; i < STATES; i++) { sum[i] += 2 * r[i]; to[i] = from[i] + 0.5 * h * r[i]; }
        rates(s, &at, in, &rate);
        for (int i = 0; i < STATES; i++) { sum[i] += 2 * r[i]; to[i] = from[i] + h * r[i]; }
        rates(s, &at, in, &rate);
        for (int i = 0; i < STATES; i++) from[i] += h / 6 * (sum[i] + r[i]);
    }
}

static uint8_t in_layers(const L1ByHand *s, const L1ByHand_states *x)
{
    const double edge = sqrt(s->p.epsilon + 1);
    int count = 0;
    for (int k = 0; k < 4; k++) {
        const double h = (s->p.omega_max[k] - s->p.omega_min[k]) * 0.5, c = (s->p.omega_max[k] + s->p.omega_min[k]) * 0.5;
        count += h > 0 && fabs(x->omega[k] - c) * edge > h;
    }
    for (int i = 0; i < 2; i++) {
        count += s->p.theta_bound[i] > 0 && fabs(x->theta[i]) * edge > s->p.theta_bound[i];
        count += s->p.sigma_bound[i] > 0 && fabs(x->sigma[i]) * edge > s->p.sigma_bound[i];
    }
    return (uint8_t)count;
}

bool L1ByHand_calibrate(L1ByHand *s, const L1ByHand_parameters *p)
{
    const double *all = (const double *)p;
    for (unsigned k = 0; k < sizeof *p / sizeof *all; k++) if (!isfinite(all[k])) return false;
    for (int i = 0; i < 2; i++) {
        const double T_t = p->tracking_time[i];
        if (!(p->u_min[i] >= -1e15 && p->u_min[i] < p->u_max[i] && p->u_max[i] <= 1e15)) return false;
        if (!(p->theta_bound[i] >= 0 && p->sigma_bound[i] >= 0 && (T_t == -1 || T_t == 0 || T_t >= 1e-9))) return false;
    }
    for (int k = 0; k < 4; k++) if (!(p->omega_min[k] <= p->omega_max[k])) return false;
    if (!(p->gamma > 0 && p->epsilon > 0 && p->epsilon <= 10 && p->move_limit > 0)) return false;
    s->p = *p;
    for (int i = 0; i < 2; i++) {
        const double T_t = p->tracking_time[i];
        s->antiwindup[i] = T_t > 0 ? 1 / T_t : T_t == 0 ? 0 : fabs(p->K[i]) + fabs(p->K[i + 2]);
    }
    s->follow = sqrt(p->K[0] * p->K[0] + p->K[1] * p->K[1] + p->K[2] * p->K[2] + p->K[3] * p->K[3]) / 1.4142135623730951;
    s->calibrated = true;
    return true;
}

bool L1ByHand_enable(L1ByHand *s, bool enabled, const double *manual)
{
    if (!isfinite(manual[0]) || !isfinite(manual[1])) return false;
    s->enabled = enabled;
    memcpy(s->manual, manual, sizeof s->manual);
    return true;
}

void L1ByHand_reset(L1ByHand *s)
{
    memset(&s->x, 0, sizeof s->x);
    memset(&s->moves, 0, sizeof s->moves);
    memset(s->last, 0, sizeof s->last);
    s->refused = 0;
    s->started = s->too_long = s->calibrated = false;
    s->active = true;
    s->at_bounds = 0;
}

/* Estimates within bounds that were tightened. */
static void bring_within_bounds(const L1ByHand_parameters *p, L1ByHand_states *x)
{
    for (int k = 0; k < 4; k++) x->omega[k] = within(x->omega[k], p->omega_min[k], p->omega_max[k]);
    for (int i = 0; i < 2; i++) {
        x->theta[i] = within(x->theta[i], -p->theta_bound[i], p->theta_bound[i]);
        x->sigma[i] = within(x->sigma[i], -p->sigma_bound[i], p->sigma_bound[i]);
    }
}

/* u_ad with which the control stays where the manual one is. */
static void take_over(const L1ByHand *s, const L1ByHand_inputs *in, L1ByHand_states *x)
{
    memcpy(x->x_hat, in->x, sizeof x->x_hat);
    for (int i = 0; i < 2; i++) {
        x->u_ad[i] = within(s->manual[i], s->p.u_min[i], s->p.u_max[i]) + (a[i] * in->x[i] + d[i] * in->x[i + 2]);
    }
}

void L1ByHand_init(L1ByHand *s)
{
    memset(s, 0, sizeof *s);
    s->ready = READY;
    s->enabled = s->active = true;
    L1ByHand_calibrate(s, &defaults);
}

uint32_t L1ByHand_step(L1ByHand *s, const L1ByHand_inputs *in, L1ByHand_outputs *out)
{
    const double *given = (const double *)in;
    if (s->ready != READY) {
        memset(out, 0, sizeof *out);
        return L1ByHand_REFUSED;
    }
    bool sound = true;
    const bool was_active = s->active;
    for (unsigned k = 0; k < sizeof *in / sizeof *given; k++) sound = sound && isfinite(given[k]);
    L1ByHand_states x = s->x;
    if (sound) {
        if (!s->started) {
            memcpy(x.x_hat, in->x, sizeof x.x_hat);
            x.omega[0] = x.omega[3] = 1;
            for (int k = 0; k < 4; k++) sound = sound && s->p.omega_min[k] <= x.omega[k] && x.omega[k] <= s->p.omega_max[k];
            if (!s->enabled) take_over(s, in, &x);
        } else if (s->enabled && !s->active) {
            take_over(s, in, &x);
        }
        if (s->calibrated) bring_within_bounds(&s->p, &x);
        s->active = s->enabled;
        integrate(s, in, &x);
        const double *state = (const double *)&x;
        for (int i = 0; i < STATES; i++) sound = sound && fabs(state[i]) <= 1e12;
    }
    double unlimited[2], u[2];
    if (sound) {
        control(s, &x, in, unlimited, u);
        sound = fabs(u[0]) <= 1e12 && fabs(u[1]) <= 1e12;
    }
    if (!sound) {
        s->active = was_active;
        s->refused += s->refused < UINT32_MAX;
        memcpy(out->u, s->last, sizeof out->u);
        return L1ByHand_REFUSED;
    }
    s->x = x;
    s->started = true;
    s->calibrated = false;
    if (!s->active) memset(&s->moves, 0, sizeof s->moves);
    s->at_bounds = in_layers(s, &x);
    s->too_long = s->active && moves_far(&s->moves, u, s->p.move_limit);
    memcpy(s->last, u, sizeof u);
    memcpy(out->u, u, sizeof u);
    bool limited = false;
    for (int i = 0; i < 2; i++) limited = limited || u[i] <= s->p.u_min[i] || u[i] >= s->p.u_max[i];
    return (limited ? L1ByHand_LIMITED : 0) | (s->too_long ? L1ByHand_STEP_TOO_LONG : 0) | (s->at_bounds ? L1ByHand_PROJECTION_ACTIVE : 0);
}
