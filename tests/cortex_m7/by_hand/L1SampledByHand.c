/* The sampled L1 control law of a robot with two links written by hand: sigma = L^-1 (x - x_before - B_d u) by the rates,
 * zeta+ = e^(-K T) zeta + (1 - e^(-K T)) (K_g r - W sigma), u = W^-1 (zeta - K_d x), with the services of a generated one. */

#include "L1SampledByHand.h"

#include <math.h>
#include <string.h>

#if defined(__FAST_MATH__)
#error "-ffast-math takes away the checks of inputs and outputs for NaN and infinity"
#endif

#define READY 0x4b1de77bu
#define T 0.005

/* The nominal input gain W, its inverse; W T and the inverse of that, row by row; K_d = (diag a, diag d); K_g. */
static const double W[2][2] = {{0.6185940921241755, -0.7529250567548326}, {-0.7529250567548326, 2.0022030278199425}};
static const double W_inverse[2][2] = {{2.9810000000000003, 1.1210000000000002}, {1.1210000000000002, 0.9210000000000002}};
static const double B_d[2][2] = {{0.0030929704606208774, -0.003764625283774163}, {-0.003764625283774163, 0.010011015139099712}};
static const double L_inverse[2][2] = {{596.2000000000003, 224.20000000000013}, {224.20000000000016, 184.20000000000007}};
static const double a[2] = {776.3058901461254, 1314.5462777686885}, d[2] = {53.77712058902176, 69.2223564872939};
static const L1SampledByHand_parameters defaults = {{-1e15, -1e15}, {1e15, 1e15}, {30, 30}};

static double within(double v, double lo, double hi) { return v < lo ? lo : hi < v ? hi : v; }

static double row(const double *m, const double *v) { return m[0] * v[0] + m[1] * v[1]; }

static double fed_back(const L1SampledByHand_inputs *in, int i) { return a[i] * in->x[i] + d[i] * in->x[i + 2]; }

/* The control in force. */
static double in_force(const L1SampledByHand *s, const L1SampledByHand_state *now, int i)
{
    return s->active ? now->held[i] : within(s->manual[i], s->p.u_min[i], s->p.u_max[i]);
}

/* zeta with which the control stays where it is. */
static void follow(L1SampledByHand_state *now, const L1SampledByHand_inputs *in)
{
    for (int i = 0; i < 2; i++) now->zeta[i] = row(W[i], now->held) + fed_back(in, i);
}

/* The filter with this estimate, and the control. */
static void control(const L1SampledByHand *s, L1SampledByHand_state *now, const L1SampledByHand_inputs *in, const double *sigma)
{
    double wanted[2];
    for (int i = 0; i < 2; i++) {
        now->zeta[i] = s->left[i] * now->zeta[i] + (1 - s->left[i]) * (a[i] * in->r[i] - row(W[i], sigma));
        wanted[i] = now->zeta[i] - fed_back(in, i);
    }
    for (int i = 0; i < 2; i++) now->held[i] = within(row(W_inverse[i], wanted), s->p.u_min[i], s->p.u_max[i]);
}

static void start(const L1SampledByHand *s, L1SampledByHand_state *now, const L1SampledByHand_inputs *in)
{
    const double none[2] = {0, 0};
    memcpy(now->rates_before, in->x + 2, sizeof now->rates_before);
    memset(now->zeta, 0, sizeof now->zeta);
    control(s, now, in, none);
    if (s->active) return;
    for (int i = 0; i < 2; i++) now->held[i] = in_force(s, now, i);
    follow(now, in);
}

static void sample(const L1SampledByHand *s, L1SampledByHand_state *now, const L1SampledByHand_inputs *in, bool takes_over)
{
    double u[2], left[2], sigma[2];
    for (int i = 0; i < 2; i++) u[i] = in_force(s, now, i);
    for (int i = 0; i < 2; i++) left[i] = in->x[i + 2] - (now->rates_before[i] + row(B_d[i], u));
    for (int i = 0; i < 2; i++) sigma[i] = row(L_inverse[i], left);
    memcpy(now->rates_before, in->x + 2, sizeof now->rates_before);
    if (s->active && !takes_over) {
        control(s, now, in, sigma);
    } else {
        for (int i = 0; i < 2; i++) now->held[i] = within(u[i], s->p.u_min[i], s->p.u_max[i]);
        follow(now, in);
    }
}

bool L1SampledByHand_calibrate(L1SampledByHand *s, const L1SampledByHand_parameters *p)
{
    for (int i = 0; i < 2; i++) {
        if (!(p->u_min[i] >= -1e15 && p->u_min[i] < p->u_max[i] && p->u_max[i] <= 1e15 && p->K[i] > 0 && isfinite(p->K[i]))) return false;
    }
    s->p = *p;
    for (int i = 0; i < 2; i++) s->left[i] = exp(-p->K[i] * T);
    return true;
}

bool L1SampledByHand_enable(L1SampledByHand *s, bool enabled, const double *manual)
{
    if (!isfinite(manual[0]) || !isfinite(manual[1])) return false;
    s->enabled = enabled;
    memcpy(s->manual, manual, sizeof s->manual);
    return true;
}

void L1SampledByHand_reset(L1SampledByHand *s)
{
    memset(&s->d, 0, sizeof s->d);
    memset(s->last, 0, sizeof s->last);
    s->refused = 0;
    s->started = false;
    s->active = true;
}

void L1SampledByHand_init(L1SampledByHand *s)
{
    memset(s, 0, sizeof *s);
    s->ready = READY;
    s->enabled = s->active = true;
    L1SampledByHand_calibrate(s, &defaults);
}

uint32_t L1SampledByHand_step(L1SampledByHand *s, const L1SampledByHand_inputs *in, L1SampledByHand_outputs *out)
{
    const double *given = (const double *)in;
    if (s->ready != READY) {
        memset(out, 0, sizeof *out);
        return L1SampledByHand_REFUSED;
    }
    bool sound = true;
    const bool was_active = s->active;
    for (unsigned k = 0; k < sizeof *in / sizeof *given; k++) sound = sound && isfinite(given[k]);
    L1SampledByHand_state now = s->d;
    double u[2];
    if (sound) {
        const bool takes_over = s->started && s->enabled && !s->active;
        if (takes_over) {
            for (int i = 0; i < 2; i++) now.held[i] = in_force(s, &now, i);
        }
        s->active = s->enabled;
        if (!s->started) start(s, &now, in);
        sample(s, &now, in, takes_over);
        for (int i = 0; i < 2; i++) u[i] = in_force(s, &now, i);
        sound = fabs(u[0]) <= 1e12 && fabs(u[1]) <= 1e12;
    }
    if (!sound) {
        s->active = was_active;
        s->refused += s->refused < UINT32_MAX;
        memcpy(out->u, s->last, sizeof out->u);
        return L1SampledByHand_REFUSED;
    }
    s->d = now;
    s->started = true;
    memcpy(s->last, u, sizeof u);
    memcpy(out->u, u, sizeof u);
    bool limited = false;
    for (int i = 0; i < 2; i++) limited = limited || u[i] <= s->p.u_min[i] || u[i] >= s->p.u_max[i];
    return limited ? L1SampledByHand_LIMITED : 0;
}
