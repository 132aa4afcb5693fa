/* Active disturbance rejection control of a robot with two links, written by hand from its equations (Herbst, section 2): an observer
 * z_1' = z_2 + l_1 e, z_2' = z_3 + l_2 e + B_0 u, z_3' = l_3 e of each channel, e = y - z_1, with l = (3 w, 3 w^2, w^3), w = omega_o, and
 * u = B_0^-1 (r'' + k_2 (r' - z_2) + k_1 (r - z_1) - z_3) + u_b, with k = (omega_c^2, 2 omega_c), u_b' = -omega_c u_b. */

#include "LadrcByHand.h"

#include <string.h>

#if defined(__FAST_MATH__)
#error "-ffast-math takes away the checks of inputs and outputs for NaN and infinity"
#endif

#define READY 0x6c2e90b5u
#define PERIOD 1e-3

static const double B_0[2][2] = {{0.6185940921241755, -0.7529250567548326}, {-0.7529250567548326, 2.0022030278199425}};
static const double B_0_inverse[2][2] = {{2.9810000000000008, 1.1210000000000004}, {1.1210000000000004, 0.9210000000000003}};
static const LadrcByHand_parameters defaults = {{-1e15, -1e15}, {1e15, 1e15}, {8, 8}, {30, 30}, 0.13};

static double within(double v, double lo, double hi) { return v < lo ? lo : hi < v ? hi : v; }

static double row(const double *m, const double *v) { return m[0] * v[0] + m[1] * v[1]; }

/* What each channel is driven with, r'' + k_2 (r' - z_2) + k_1 (r - z_1) - z_3. */
static void wanted(const LadrcByHand *s, const LadrcByHand_states *x, const LadrcByHand_inputs *in, double *w)
{
    for (int i = 0; i < 2; i++) {
        w[i] = in->ddr[i] + s->k[1][i] * (in->dr[i] - x->z[1][i]) + s->k[0][i] * (in->r[i] - x->z[0][i]) - x->z[2][i];
    }
}

static void control(const LadrcByHand *s, const LadrcByHand_states *x, const LadrcByHand_inputs *in, double *u)
{
    double w[2];
    wanted(s, x, in, w);
    for (int i = 0; i < 2; i++) {
        u[i] = within(s->active ? row(B_0_inverse[i], w) + x->u_b[i] : s->manual[i], s->p.u_min[i], s->p.u_max[i]);
    }
}

static void rates(const LadrcByHand *s, const LadrcByHand_states *x, const LadrcByHand_inputs *in, LadrcByHand_states *dx)
{
    double u[2];
    control(s, x, in, u);
    for (int i = 0; i < 2; i++) {
        const double e = in->y[i] - x->z[0][i];
        dx->z[0][i] = x->z[1][i] + s->l[0][i] * e;
        dx->z[1][i] = x->z[2][i] + s->l[1][i] * e + row(B_0[i], u);
        dx->z[2][i] = s->l[2][i] * e;
        dx->u_b[i] = -s->p.omega_c[i] * x->u_b[i];
    }
}

enum { STATES = sizeof(LadrcByHand_states) / sizeof(double) };

static void integrate(const LadrcByHand *s, const LadrcByHand_inputs *in, LadrcByHand_states *x)
{
    const double h = PERIOD;
    LadrcByHand_states rate, at;
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

bool LadrcByHand_calibrate(LadrcByHand *s, const LadrcByHand_parameters *p)
{
    const double *all = (const double *)p;
    for (unsigned k = 0; k < sizeof *p / sizeof *all; k++) if (!isfinite(all[k])) return false;
    for (int i = 0; i < 2; i++) {
        if (!(p->u_min[i] >= -1e15 && p->u_min[i] < p->u_max[i] && p->u_max[i] <= 1e15)) return false;
        if (!(p->omega_c[i] > 0 && (p->omega_o[i] == -1 || p->omega_o[i] > 0))) return false;
    }
    if (!(p->move_limit > 0)) return false;
    s->p = *p;
    for (int i = 0; i < 2; i++) {
        const double c = p->omega_c[i], o = p->omega_o[i] == -1 ? 10 * c : p->omega_o[i];
        s->k[0][i] = c * c;
        s->k[1][i] = 2 * c;
        s->l[0][i] = 3 * o;
        s->l[1][i] = 3 * o * o;
        s->l[2][i] = o * o * o;
    }
    return true;
}

bool LadrcByHand_enable(LadrcByHand *s, bool enabled, const double *manual)
{
    if (!isfinite(manual[0]) || !isfinite(manual[1])) return false;
    s->enabled = enabled;
    memcpy(s->manual, manual, sizeof s->manual);
    return true;
}

void LadrcByHand_reset(LadrcByHand *s)
{
    memset(&s->x, 0, sizeof s->x);
    memset(&s->moves, 0, sizeof s->moves);
    memset(s->last, 0, sizeof s->last);
    s->refused = 0;
    s->started = s->too_long = false;
    s->active = true;
}

void LadrcByHand_init(LadrcByHand *s)
{
    memset(s, 0, sizeof *s);
    s->ready = READY;
    s->enabled = s->active = true;
    LadrcByHand_calibrate(s, &defaults);
}

/* u_b with which the control stays where the manual one is. */
static void take_over(const LadrcByHand *s, const LadrcByHand_inputs *in, LadrcByHand_states *x)
{
    double w[2];
    wanted(s, x, in, w);
    for (int i = 0; i < 2; i++) x->u_b[i] = within(s->manual[i], s->p.u_min[i], s->p.u_max[i]) - row(B_0_inverse[i], w);
}

uint32_t LadrcByHand_step(LadrcByHand *s, const LadrcByHand_inputs *in, LadrcByHand_outputs *out)
{
    const double *given = (const double *)in;
    if (s->ready != READY) {
        memset(out, 0, sizeof *out);
        return LadrcByHand_REFUSED;
    }
    bool sound = true;
    const bool was_active = s->active;
    for (unsigned k = 0; k < sizeof *in / sizeof *given; k++) sound = sound && isfinite(given[k]);
    LadrcByHand_states x = s->x;
    double u[2];
    if (sound) {
        if (!s->started) memcpy(x.z[0], in->y, sizeof x.z[0]);
        if (s->started && s->enabled && !s->active) take_over(s, in, &x);
        s->active = s->enabled;
        integrate(s, in, &x);
        control(s, &x, in, u);
        const double *state = (const double *)&x;
        for (int i = 0; i < STATES; i++) sound = sound && fabs(state[i]) <= 1e12;
        sound = sound && fabs(u[0]) <= 1e12 && fabs(u[1]) <= 1e12;
    }
    if (!sound) {
        s->active = was_active;
        s->refused += s->refused < UINT32_MAX;
        memcpy(out->u, s->last, sizeof out->u);
        return LadrcByHand_REFUSED;
    }
    s->x = x;
    s->started = true;
    if (!s->active) memset(&s->moves, 0, sizeof s->moves);
    s->too_long = s->active && moves_far(&s->moves, u, s->p.move_limit);
    memcpy(s->last, u, sizeof u);
    memcpy(out->u, u, sizeof u);
    bool limited = false;
    for (int i = 0; i < 2; i++) limited = limited || u[i] <= s->p.u_min[i] || u[i] >= s->p.u_max[i];
    return (limited ? LadrcByHand_LIMITED : 0) | (s->too_long ? LadrcByHand_STEP_TOO_LONG : 0);
}
