/* A PID controller written by hand: u = S (P + I + D), P = K_p (b r - y), D = K_d N (c r - y - w), w' = N (c r - y - w),
 * I' = K_i (r - y) + (u - u before its limits)/(S T_t), with the services of a generated one. */

#include "PidByHand.h"

#include <string.h>

#if defined(__FAST_MATH__)
#error "-ffast-math takes away the checks of inputs and outputs for NaN and infinity"
#endif

#define READY 0x2f70c1d9u
#define PERIOD 1e-3
#define S 0.5

static const PidByHand_parameters defaults = {-1e15, 1e15, 64, 5, 20, 1, 1, 100, -1, 0.13};

static double within(double v, double lo, double hi) { return v < lo ? lo : hi < v ? hi : v; }

static double control(const PidByHand *s, const PidByHand_states *x, const PidByHand_inputs *in, double *unlimited)
{
    const PidByHand_parameters *p = &s->p;
    const double P = p->K_p * (p->b * in->r - in->y), D = p->K_d * p->N * (p->c * in->r - in->y - x->w);
    *unlimited = s->active ? S * (P + x->I + D) : s->manual;
    return within(*unlimited, p->u_min, p->u_max);
}

/* I with which the control stays where the manual one is. */
static double taken_over(const PidByHand *s, const PidByHand_states *x, const PidByHand_inputs *in)
{
    const PidByHand_parameters *p = &s->p;
    const double P = p->K_p * (p->b * in->r - in->y), D = p->K_d * p->N * (p->c * in->r - in->y - x->w);
    return within(s->manual, p->u_min, p->u_max) / S - P - D;
}

static PidByHand_states rates(const PidByHand *s, const PidByHand_states *x, const PidByHand_inputs *in)
{
    double unlimited;
    const double u = control(s, x, in, &unlimited);
    PidByHand_states dx = {0, s->p.N * (s->p.c * in->r - in->y - x->w)};
    if (s->active) {
        dx.I = s->p.K_i * (in->r - in->y) + (s->T_t > 0 ? (u - unlimited) / S / s->T_t : 0);
    }
    return dx;
}

static PidByHand_states along(const PidByHand_states *x, double h, const PidByHand_states *dx)
{
    return (PidByHand_states){x->I + h * dx->I, x->w + h * dx->w};
}

static PidByHand_states integrated(const PidByHand *s, const PidByHand_states *x, const PidByHand_inputs *in)
{
    const double h = PERIOD;
    const PidByHand_states a = rates(s, x, in), to_b = along(x, 0.5 * h, &a);
    const PidByHand_states b = rates(s, &to_b, in), to_c = along(x, 0.5 * h, &b);
    const PidByHand_states c = rates(s, &to_c, in), to_d = along(x, h, &c), d = rates(s, &to_d, in);
    const PidByHand_states sum = {a.I + 2 * b.I + 2 * c.I + d.I, a.w + 2 * b.w + 2 * c.w + d.w};
    return along(x, h / 6, &sum);
}

bool PidByHand_calibrate(PidByHand *s, const PidByHand_parameters *p)
{
    const double *all = (const double *)p;
    for (unsigned k = 0; k < sizeof *p / sizeof *all; k++) if (!isfinite(all[k])) return false;
    if (!(p->u_min >= -1e15 && p->u_min < p->u_max && p->u_max <= 1e15 && p->K_p >= 0 && p->K_i >= 0 && p->K_d >= 0 && p->N > 0 && p->move_limit > 0)) return false;
    if (!(p->tracking_time == -1 || p->tracking_time == 0 || p->tracking_time >= 1e-9)) return false;
    s->p = *p;
    s->T_t = p->tracking_time;
    if (p->K_i == 0) {
        s->T_t = 0;
    } else if (p->tracking_time == -1) {
        s->T_t = p->K_d > 0 ? sqrt(p->K_d / p->K_i) : p->K_p > 0 ? p->K_p / p->K_i : 1 / p->N;
    }
    return true;
}

bool PidByHand_enable(PidByHand *s, bool enabled, const double *manual)
{
    if (!isfinite(*manual)) return false;
    s->enabled = enabled;
    s->manual = *manual;
    return true;
}

void PidByHand_reset(PidByHand *s)
{
    memset(&s->x, 0, sizeof s->x);
    memset(&s->moves, 0, sizeof s->moves);
    s->last = 0;
    s->refused = 0;
    s->started = s->too_long = false;
    s->active = true;
}

void PidByHand_init(PidByHand *s)
{
    memset(s, 0, sizeof *s);
    s->ready = READY;
    s->enabled = s->active = true;
    PidByHand_calibrate(s, &defaults);
}

uint32_t PidByHand_step(PidByHand *s, const PidByHand_inputs *in, PidByHand_outputs *out)
{
    if (s->ready != READY) {
        out->u = 0;
        return PidByHand_REFUSED;
    }
    bool sound = isfinite(in->r) && isfinite(in->y);
    PidByHand_states x = s->x;
    const bool was_active = s->active;
    double u = 0, unlimited = 0;
    if (sound) {
        if (!s->started) x.w = s->p.c * in->r - in->y;
        /* Without a jump. */
        if (s->enabled && !s->active) x.I = taken_over(s, &x, in);
        s->active = s->enabled;
        x = integrated(s, &x, in);
        u = control(s, &x, in, &unlimited);
        sound = fabs(x.I) <= 1e12 && fabs(x.w) <= 1e12 && fabs(u) <= 1e12;
    }
    if (!sound) {
        s->active = was_active;
        s->refused += s->refused < UINT32_MAX;
        out->u = s->last;
        return PidByHand_REFUSED;
    }
    s->x = x;
    s->started = true;
    if (!s->active) memset(&s->moves, 0, sizeof s->moves);
    s->too_long = s->active && moves_far(&s->moves, &u, s->p.move_limit);
    s->last = out->u = u;
    return (u <= s->p.u_min || u >= s->p.u_max ? PidByHand_LIMITED : 0) | (s->too_long ? PidByHand_STEP_TOO_LONG : 0);
}
