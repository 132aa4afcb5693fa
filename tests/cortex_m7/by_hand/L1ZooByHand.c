/* The L1 control law of a DC motor written by hand from its equations (Hashim, section 3.2, with the regressor x/state_scale, a baseline
 * outside, projection and anti-windup), with the services of a generated one. Its numbers are those of
 *     adaptive-fmu new l1 --name L1Motor --plant examples/zoo/dc_motor.json --bandwidth 20 --reference 100
 * What follows from inputs is computed once in a period, what follows from parameters once in a calibration. */

#include "L1ZooByHand.h"

#include <string.h>

#if defined(__FAST_MATH__)
#error "-ffast-math takes away the checks of inputs and outputs for NaN and infinity"
#endif

#define READY 0x3d90e1f7u
#define PERIOD 1e-3
#define SUBSTEPS 32

/* A_m, B = (0, B_2), K_m, K_g, P B, and 1/state_scale. */
static const double A_m[2][2] = {{-1, 1000}, {-50.00667, -1000.05}}, B_2 = 1000;
static const double K_m[2] = {6.670000000000287e-6, 4.999999999999449e-5}, K_g = 0.05100672;
static const double PB[2] = {0.0009555341464165996, 0.025204273932719963}, scale[2] = {0.01, 0.22026431718061673};
static const L1ZooByHand_parameters defaults = {-24, 24, 0.8, 1.2, 206000, 100, {1.01, 0.913}, 50, 0.1, -1, 0.13};

/* What inputs give for a whole period: K_m x, K_g r, and the regressor. */
typedef struct {
    double fed_back, goal, phi[2];
} Given;

static double within(double v, double lo, double hi) { return v < lo ? lo : hi < v ? hi : v; }

static double row(const double *m, const double *v) { return m[0] * v[0] + m[1] * v[1]; }

static double control(const L1ZooByHand *s, const L1ZooByHand_states *x, const Given *now)
{
    return within(s->active ? x->u_ad - now->fed_back : s->manual, s->p.u_min, s->p.u_max);
}

/* Proj(y) of an estimate: all of y up to its edge, less beyond it. The gain of one that is frozen is 0. */
static double projection(const L1ZooByHand *s, int k, double estimate, double y)
{
    const double away = estimate - s->centre[k], edge = s->edge[k];
    if (fabs(away) <= edge || !(away * y > 0)) return y;
    return y * (1 - s->steepness[k] * (away * away - edge * edge));
}

static void rates(const L1ZooByHand *s, const L1ZooByHand_states *x, const L1ZooByHand_inputs *in, const Given *now, L1ZooByHand_states *dx)
{
    const double error[2] = {x->x_hat[0] - in->x[0], x->x_hat[1] - in->x[1]}, u = control(s, x, now);
    if (!s->active) {
        memset(dx, 0, sizeof *dx);
        for (int i = 0; i < 2; i++) dx->x_hat[i] = row(A_m[i], error);
        dx->u_ad = -fabs(s->p.K) * (x->u_ad - (u + now->fed_back));
        return;
    }
    const double left = u - (x->u_ad - now->fed_back), y = -row(PB, error);
    const double phi[ESTIMATES] = {x->u_ad + left, now->phi[0], now->phi[1], 1};
    double eta = 0;
    for (int k = 0; k < ESTIMATES; k++) {
        eta += x->estimate[k] * phi[k];
        dx->estimate[k] = projection(s, k, x->estimate[k], s->gain[k] * y * phi[k]);
    }
    dx->x_hat[0] = row(A_m[0], x->x_hat);
    dx->x_hat[1] = row(A_m[1], x->x_hat) + B_2 * eta;
    dx->u_ad = left * s->antiwindup - s->p.K * (eta - now->goal);
}

enum { STATES = sizeof(L1ZooByHand_states) / sizeof(double) };

static void integrate(const L1ZooByHand *s, const L1ZooByHand_inputs *in, const Given *now, L1ZooByHand_states *x)
{
    const double h = PERIOD / SUBSTEPS;
    for (int k = 0; k < SUBSTEPS; k++) {
        L1ZooByHand_states rate, at;
        double sum[STATES], *from = (double *)x, *to = (double *)&at, *r = (double *)&rate;
        rates(s, x, in, now, &rate);
        for (int i = 0; i < STATES; i++) { sum[i] = r[i]; to[i] = from[i] + 0.5 * h * r[i]; }
        rates(s, &at, in, now, &rate);
        for (int i = 0; i < STATES; i++) { sum[i] += 2 * r[i]; to[i] = from[i] + 0.5 * h * r[i]; }
        rates(s, &at, in, now, &rate);
        for (int i = 0; i < STATES; i++) { sum[i] += 2 * r[i]; to[i] = from[i] + h * r[i]; }
        rates(s, &at, in, now, &rate);
        for (int i = 0; i < STATES; i++) from[i] += h / 6 * (sum[i] + r[i]);
    }
}

static uint8_t in_layers(const L1ZooByHand *s, const L1ZooByHand_states *x)
{
    int count = 0;
    for (int k = 0; k < ESTIMATES; k++) count += s->edge[k] > 0 && fabs(x->estimate[k] - s->centre[k]) > s->edge[k];
    return (uint8_t)count;
}

/* The bounds of each estimate. */
static void bounds(const L1ZooByHand_parameters *p, double *lo, double *hi)
{
    lo[0] = p->omega_min;
    hi[0] = p->omega_max;
    for (int k = 1; k < ESTIMATES; k++) {
        hi[k] = k < 3 ? p->theta_bound[k - 1] : p->sigma_bound;
        lo[k] = -hi[k];
    }
}

bool L1ZooByHand_calibrate(L1ZooByHand *s, const L1ZooByHand_parameters *p)
{
    const double *all = (const double *)p, T_t = p->tracking_time;
    double lo[ESTIMATES], hi[ESTIMATES];
    for (unsigned k = 0; k < sizeof *p / sizeof *all; k++) if (!isfinite(all[k])) return false;
    bounds(p, lo, hi);
    for (int k = 0; k < ESTIMATES; k++) if (!(lo[k] <= hi[k])) return false;
    if (!(p->u_min >= -1e15 && p->u_min < p->u_max && p->u_max <= 1e15 && (T_t == -1 || T_t == 0 || T_t >= 1e-9))) return false;
    if (!(p->gamma > 0 && p->epsilon > 0 && p->epsilon <= 10 && p->move_limit > 0)) return false;
    s->p = *p;
    for (int k = 0; k < ESTIMATES; k++) {
        const double half = (hi[k] - lo[k]) * 0.5;
        s->gain[k] = half > 0 ? p->gamma : 0;
        s->centre[k] = (lo[k] + hi[k]) * 0.5;
        s->edge[k] = half / sqrt(p->epsilon + 1);
        s->steepness[k] = (p->epsilon + 1) / (p->epsilon * half * half);
    }
    s->antiwindup = T_t > 0 ? 1 / T_t : T_t == 0 ? 0 : fabs(p->K);
    s->calibrated = true;
    return true;
}

bool L1ZooByHand_enable(L1ZooByHand *s, bool enabled, const double *manual)
{
    if (!isfinite(*manual)) return false;
    s->enabled = enabled;
    s->manual = *manual;
    return true;
}

void L1ZooByHand_reset(L1ZooByHand *s)
{
    memset(&s->x, 0, sizeof s->x);
    memset(&s->moves, 0, sizeof s->moves);
    s->last = 0;
    s->refused = 0;
    s->started = s->too_long = s->calibrated = false;
    s->active = true;
    s->at_bounds = 0;
}

void L1ZooByHand_init(L1ZooByHand *s)
{
    memset(s, 0, sizeof *s);
    s->ready = READY;
    s->enabled = s->active = true;
    L1ZooByHand_calibrate(s, &defaults);
}

uint32_t L1ZooByHand_step(L1ZooByHand *s, const L1ZooByHand_inputs *in, L1ZooByHand_outputs *out)
{
    if (s->ready != READY) {
        out->u = 0;
        return L1ZooByHand_REFUSED;
    }
    bool sound = isfinite(in->r) && isfinite(in->x[0]) && isfinite(in->x[1]);
    const bool was_active = s->active;
    L1ZooByHand_states x = s->x;
    double u = 0;
    if (sound) {
        const Given now = {row(K_m, in->x), K_g * in->r, {scale[0] * in->x[0], scale[1] * in->x[1]}};
        if (!s->started) {
            x.estimate[0] = 1;
            sound = s->p.omega_min <= 1 && 1 <= s->p.omega_max;
        }
        const bool takes_over = s->started && s->enabled && !s->active;
        if (!s->started || takes_over) memcpy(x.x_hat, in->x, sizeof x.x_hat);
        /* u_ad with which the control stays where the manual one is. */
        if (takes_over || (!s->started && !s->enabled)) x.u_ad = within(s->manual, s->p.u_min, s->p.u_max) + now.fed_back;
        /* Estimates within bounds that were tightened. */
        if (s->calibrated) {
            double lo[ESTIMATES], hi[ESTIMATES];
            bounds(&s->p, lo, hi);
            for (int k = 0; k < ESTIMATES; k++) x.estimate[k] = within(x.estimate[k], lo[k], hi[k]);
        }
        s->active = s->enabled;
        integrate(s, in, &now, &x);
        u = control(s, &x, &now);
        const double *state = (const double *)&x;
        for (int i = 0; i < STATES; i++) sound = sound && fabs(state[i]) <= 1e12;
        sound = sound && fabs(u) <= 1e12;
    }
    if (!sound) {
        s->active = was_active;
        s->refused += s->refused < UINT32_MAX;
        out->u = s->last;
        return L1ZooByHand_REFUSED;
    }
    s->x = x;
    s->started = true;
    s->calibrated = false;
    if (!s->active) memset(&s->moves, 0, sizeof s->moves);
    s->at_bounds = in_layers(s, &x);
    s->too_long = s->active && moves_far(&s->moves, &u, s->p.move_limit);
    s->last = out->u = u;
    const bool limited = u <= s->p.u_min || u >= s->p.u_max;
    return (limited ? L1ZooByHand_LIMITED : 0) | (s->too_long ? L1ZooByHand_STEP_TOO_LONG : 0) | (s->at_bounds ? L1ZooByHand_PROJECTION_ACTIVE : 0);
}
