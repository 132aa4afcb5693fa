/* The L1 control law of example 3.3.2 written by hand from its equations (Hashim, (3.19) to (3.22), with projection, anti-windup, a yaw
 * that turns without end, and the limits of four rotors), with the services of a generated one. What only inputs and parameters give is
 * computed once in a step: the position's loop, with its functions of angles, too. */

#include "L1QuadrotorByHand.h"

#include <math.h>
#include <string.h>

#if defined(__FAST_MATH__)
#error "-ffast-math takes away the checks of inputs and outputs for NaN and infinity"
#endif

#define READY 0x7d03e96bu
#define PERIOD 1e-3
#define SUBSTEPS 10
#define PI 3.141592653589793
#define TURN 6.283185307179586

typedef L1QuadrotorByHand Law;
typedef L1QuadrotorByHand_inputs Inputs;
typedef L1QuadrotorByHand_states States;
typedef L1QuadrotorByHand_parameters Parameters;
enum { STATES = sizeof(States) / sizeof(double) };
enum { ATTITUDE = 1, ATTITUDE_DOWN = 2, THRUST = 3 };

/* A_m = (0 I; -diag a, -diag d), K_m and K_g likewise; rows of P B. */
static const double a[3] = {900.25, 1225.25, 1600.25}, d[3] = {60, 70, 80};
static const double PB[3][2] = {
    {0.0005554012774227382, 0.008342590021290395}, {0.00040807998367614433, 0.007148686856909657}, {0.0003124511795035112, 0.0062539056397438}};
static const Parameters defaults = {
    0.5, 9.81, {4, 4, 4}, {4, 4, 4}, 0.3, 0.6, 0.3, {0, -1e15, -1e15, -1e15}, {15, 1e15, 1e15, 1e15}, false, 0.225, 0.038, 0, 3.75, ATTITUDE,
    {0.5, 0.5, 0.5}, {10, 10, 10}, 1e5, {30, 0, 0, 0, 30, 0, 0, 0, 30}, {100, 100, 100}, {100, 100, 100}, 0.1, {-1, -1, -1},
    {4.85e-3, 4.85e-3, 8.81e-3}, 0.13, 0.7853981633974483};

/* What stays as it is during a step, but where the yaw is counted anew: thrust, reference and measured attitude, and what follows from that.
 * The yaw is counted from an origin. */
typedef struct {
    double psi, r, origin, thrust, angles[3], x[6], Kx[3], norm;
} Given;

static double within(double v, double lo, double hi) { return v < lo ? lo : hi < v ? hi : v; }

static bool finite_numbers(const void *from, const void *end)
{
    bool sound = true;
    for (const double *v = from; v != end; v++) sound = sound && isfinite(*v);
    return sound;
}

/* The angle nearest to another one among those that differ from this one by whole turns. */
static double nearest(double angle, double to)
{
    return fabs(angle - to) < PI ? angle : angle - round((angle - to) / TURN) * TURN;
}

/* The position's loop: wanted thrust, roll and pitch. */
static void lead(const Parameters *p, const Inputs *in, Given *now)
{
    const double *angles = in->x, c = cos(angles[2]), s = sin(angles[2]);
    double acceleration[3];
    for (int i = 0; i < 3; i++) {
        acceleration[i] = in->ddr[i] + p->velocity_gain[i] * (in->dr[i] - in->dp[i]) + p->position_gain[i] * (in->r[i] - in->p[i]);
    }
    const double g_z = fmax(p->g + acceleration[2], p->lift_min * p->g);
    now->angles[1] = within(atan((acceleration[0] * c + acceleration[1] * s) / g_z), -p->tilt_max, p->tilt_max);
    now->angles[0] = within(atan(cos(now->angles[1]) * (acceleration[0] * s - acceleration[1] * c) / g_z), -p->tilt_max, p->tilt_max);
    now->thrust = p->m * g_z / fmax(cos(angles[0]) * cos(angles[1]), p->tilt_cosine_min);
}

/* What follows from the attitude, its yaw counted nearest to the predicted one, and the reference nearest to that. */
static void feed_back(Given *now, const States *x)
{
    now->x[2] = nearest(now->psi - now->origin, x->x_hat[2]);
    now->angles[2] = nearest(now->r - now->origin, now->x[2]);
    now->norm = 0;
    for (int k = 0; k < 6; k++) now->norm = fmax(now->norm, fabs(now->x[k]));
    for (int i = 0; i < 3; i++) now->Kx[i] = a[i] * now->x[i] + d[i] * now->x[i + 3];
}

/* The same where the predicted yaw is half a turn away. */
static void count_turns(Given *now, const States *x)
{
    if (!(fabs(now->x[2] - x->x_hat[2]) < PI)) feed_back(now, x);
}

/* Moves the origin of the yaw to the reference where that is far from it, with all that depends on the yaw. */
static void move_origin(const Law *s, Given *now, States *x)
{
    count_turns(now, x);
    const double by = now->angles[2];
    if (fabs(by) <= s->p.origin_range) return;
    now->origin += by;
    x->x_hat[2] -= by;
    x->u_ad[2] -= a[2] * by;
    feed_back(now, x);
}

/* The part of an amount for which there is room. */
static double part_within(double room, double amount) { return amount > fmax(room, 0) ? fmax(room, 0) / amount : 1; }

/* What four rotors give of a thrust and torques: yaw gives way first, then the one of thrust and tilt that has less priority. */
static void allocate(const Parameters *p, double *u)
{
    const double min = p->rotor_min, max = p->rotor_max, yaw = u[3] / (4 * p->drag_to_thrust);
    const double roll = fabs(u[1] / (2 * p->arm_length)), pitch = fabs(u[2] / (2 * p->arm_length)), most = fmax(roll, pitch);
    double quarter = u[0] / 4, part = part_within((max - min) / 2, most);
    const double low = min + part * most, high = max - part * most;
    if ((quarter < low && p->priority != ATTITUDE) || (quarter > high && p->priority == THRUST)) {
        quarter = within(quarter, min, max);
        part = part_within(fmin(max - quarter, quarter - min), most);
    } else {
        quarter = fmax(fmin(quarter, high), low);
    }
    const double more = part * (yaw >= 0 ? pitch : roll), less = part * (yaw >= 0 ? roll : pitch);
    u[0] = 4 * quarter;
    u[1] *= part;
    u[2] *= part;
    u[3] *= part_within(fmin(max - (quarter + more), quarter - less - min), fabs(yaw));
}

/* A control within its own limits, and those of the rotors. False where it is too large for the rotors to mean anything. */
static bool limited(const Parameters *p, const double *wanted, double *u)
{
    bool sound = true;
    for (int i = 0; i < 4; i++) u[i] = within(wanted[i], p->u_min[i], p->u_max[i]);
    if (p->rotor_limits) {
        for (int i = 0; i < 4; i++) sound = sound && fabs(u[i]) <= 1e12;
        allocate(p, u);
    }
    return sound;
}

static bool control(const Law *s, const Given *now, const States *x, double *wanted, double *u)
{
    if (!s->active) {
        memcpy(wanted, s->manual, sizeof s->manual);
    } else {
        wanted[0] = now->thrust;
        for (int i = 0; i < 3; i++) wanted[i + 1] = (x->u_ad[i] - now->Kx[i]) * s->p.inertia[i];
    }
    return limited(&s->p, wanted, u);
}

/* Proj(v, y), v by its distance from the middle of its bounds, which are so far from there. */
static double projection(double away, double y, double half, double epsilon)
{
    if (half <= 0) return 0;
    if (fabs(away) * (epsilon + 1) <= half) return y;
    const double q = away / half, f = ((epsilon + 1) * q * q - 1) / epsilon;
    return f > 0 && q * y > 0 ? y * (1 - f) : y;
}

static void rates(const Law *s, Given *now, const States *x, States *dx)
{
    const Parameters *p = &s->p;
    double wanted[4], u[4], excess[3], missed[3];
    count_turns(now, x);
    control(s, now, x, wanted, u);
    for (int i = 0; i < 3; i++) {
        const double e = x->x_hat[i] - now->x[i], de = x->x_hat[i + 3] - now->x[i + 3];
        if (!s->active) {
            dx->x_hat[i] = de;
            dx->x_hat[i + 3] = -a[i] * e - d[i] * de;
            dx->omega[i] = dx->theta[i] = dx->sigma[i] = 0;
            dx->u_ad[i] = -s->follow * (x->u_ad[i] - (u[i + 1] / p->inertia[i] + now->Kx[i]));
            continue;
        }
        missed[i] = u[i + 1] - wanted[i + 1];
        if (missed[i] != 0) missed[i] /= p->inertia[i];
        const double v = x->u_ad[i] + missed[i], y = -(e * PB[i][0] + de * PB[i][1]);
        const double eta = x->sigma[i] + x->theta[i] * now->norm + x->omega[i] * v;
        excess[i] = eta - a[i] * now->angles[i];
        dx->x_hat[i] = x->x_hat[i + 3];
        dx->x_hat[i + 3] = -a[i] * x->x_hat[i] - d[i] * x->x_hat[i + 3] + eta;
        dx->omega[i] = p->gamma * projection(x->omega[i] - s->middle[i], y * v, s->half[i], p->epsilon);
        dx->theta[i] = p->gamma * projection(x->theta[i], y * now->norm, p->theta_bound[i], p->epsilon);
        dx->sigma[i] = p->gamma * projection(x->sigma[i], y, p->sigma_bound[i], p->epsilon);
    }
    for (int i = 0; s->active && i < 3; i++) {
        dx->u_ad[i] = missed[i] * s->antiwindup[i] - (p->K[i] * excess[0] + p->K[i + 3] * excess[1] + p->K[i + 6] * excess[2]);
    }
}

static void integrate(const Law *s, Given *now, States *x)
{
    const double h = PERIOD / SUBSTEPS;
    for (int k = 0; k < SUBSTEPS; k++) {
        States rate, at;
        double sum[STATES], *from = (double *)x, *to = (double *)&at, *r = (double *)&rate;
        rates(s, now, x, &rate);
        for (int i = 0; i < STATES; i++) { sum[i] = r[i]; to[i] = from[i] + 0.5 * h * r[i]; }
        rates(s, now, &at, &rate);
        for (int i = 0; i < STATES; i++) { sum[i] += 2 * r[i]; to[i] = from[i] + 0.5 * h * r[i]; }
        rates(s, now, &at, &rate);
        for (int i = 0; i < STATES; i++) { sum[i] += 2 * r[i]; to[i] = from[i] + h * r[i]; }
        rates(s, now, &at, &rate);
        for (int i = 0; i < STATES; i++) from[i] += h / 6 * (sum[i] + r[i]);
        move_origin(s, now, x);
    }
}

static uint8_t in_layers(const Law *s, const States *x)
{
    const double edge = sqrt(s->p.epsilon + 1);
    int count = 0;
    for (int i = 0; i < 3; i++) {
        count += s->half[i] > 0 && fabs(x->omega[i] - s->middle[i]) * edge > s->half[i];
        count += s->p.theta_bound[i] > 0 && fabs(x->theta[i]) * edge > s->p.theta_bound[i];
        count += s->p.sigma_bound[i] > 0 && fabs(x->sigma[i]) * edge > s->p.sigma_bound[i];
    }
    return (uint8_t)count;
}

bool L1QuadrotorByHand_calibrate(Law *s, const Parameters *p)
{
    if (!finite_numbers(&p->m, &p->rotor_limits) || !finite_numbers(&p->arm_length, &p->priority) || !finite_numbers(p->omega_min, p + 1)) return false;
    for (int i = 0; i < 4; i++) {
        if (!(p->u_min[i] >= -1e15 && p->u_min[i] < p->u_max[i] && p->u_max[i] <= 1e15)) return false;
    }
    for (int i = 0; i < 3; i++) {
        const double T_t = p->tracking_time[i];
        if (!(p->position_gain[i] >= 0 && p->velocity_gain[i] >= 0 && p->inertia[i] > 0 && p->omega_min[i] <= p->omega_max[i])) return false;
        if (!(p->theta_bound[i] >= 0 && p->sigma_bound[i] >= 0 && (T_t == -1 || T_t == 0 || T_t >= 1e-9))) return false;
    }
    if (!(p->m > 0 && p->g > 0 && p->lift_min > 0 && p->tilt_max > 0 && p->tilt_max <= 1.5 && p->tilt_cosine_min > 0 && p->tilt_cosine_min <= 1)) return false;
    if (!(p->arm_length > 0 && p->drag_to_thrust > 0 && p->rotor_min < p->rotor_max && p->priority >= ATTITUDE && p->priority <= THRUST)) return false;
    if (!(p->gamma > 0 && p->epsilon > 0 && p->epsilon <= 10 && p->move_limit > 0 && p->origin_range > 0 && p->origin_range <= 3)) return false;
    s->p = *p;
    double squares = 0;
    for (int i = 0; i < 3; i++) {
        const double T_t = p->tracking_time[i], *K = p->K + i;
        s->middle[i] = (p->omega_max[i] + p->omega_min[i]) * 0.5;
        s->half[i] = (p->omega_max[i] - p->omega_min[i]) * 0.5;
        s->antiwindup[i] = T_t > 0 ? 1 / T_t : T_t == 0 ? 0 : fabs(K[0]) + fabs(K[3]) + fabs(K[6]);
        squares += K[0] * K[0] + K[3] * K[3] + K[6] * K[6];
    }
    s->follow = sqrt(squares) / 1.7320508075688772;
    s->calibrated = true;
    return true;
}

bool L1QuadrotorByHand_enable(Law *s, bool enabled, const double *manual)
{
    if (!finite_numbers(manual, manual + 4)) return false;
    s->enabled = enabled;
    memcpy(s->manual, manual, sizeof s->manual);
    return true;
}

void L1QuadrotorByHand_reset(Law *s)
{
    memset(&s->x, 0, sizeof s->x);
    memset(&s->moves, 0, sizeof s->moves);
    memset(&s->last, 0, sizeof s->last);
    s->refused = 0;
    s->started = s->too_long = s->calibrated = false;
    s->active = true;
    s->at_bounds = 0;
}

void L1QuadrotorByHand_init(Law *s)
{
    memset(s, 0, sizeof *s);
    s->ready = READY;
    s->enabled = s->active = true;
    L1QuadrotorByHand_calibrate(s, &defaults);
}

/* Estimates within bounds that were tightened. */
static void bring_within_bounds(const Parameters *p, States *x)
{
    for (int i = 0; i < 3; i++) {
        x->omega[i] = within(x->omega[i], p->omega_min[i], p->omega_max[i]);
        x->theta[i] = within(x->theta[i], -p->theta_bound[i], p->theta_bound[i]);
        x->sigma[i] = within(x->sigma[i], -p->sigma_bound[i], p->sigma_bound[i]);
    }
}

/* u_ad with which the control stays where the manual one is. */
static void take_over(const Law *s, const Given *now, States *x)
{
    double u[4];
    limited(&s->p, s->manual, u);
    memcpy(x->x_hat, now->x, sizeof x->x_hat);
    for (int i = 0; i < 3; i++) x->u_ad[i] = u[i + 1] / s->p.inertia[i] + now->Kx[i];
}

/* Before a step: where the law is to go on from. False where there is no start. */
static bool begin(Law *s, const Inputs *in, Given *now, States *x)
{
    const Parameters *p = &s->p;
    now->psi = in->x[2];
    now->r = in->r[3];
    now->origin = s->origin;
    lead(p, in, now);
    memcpy(now->x, in->x, sizeof now->x);
    if (!s->started) {
        const bool is_far = fabs(now->psi) > p->origin_range || fabs(now->r) > p->origin_range;
        now->origin = is_far ? now->psi + nearest(now->r - now->psi, 0) : 0;
        memcpy(x->x_hat, in->x, sizeof x->x_hat);
        x->x_hat[2] -= now->origin;
        for (int i = 0; i < 3; i++) {
            if (!(p->omega_min[i] <= 1 && 1 <= p->omega_max[i])) return false;
            x->omega[i] = 1;
        }
    }
    feed_back(now, x);
    if (s->started ? s->enabled && !s->active : !s->enabled) take_over(s, now, x);
    if (s->calibrated) bring_within_bounds(p, x);
    s->active = s->enabled;
    move_origin(s, now, x);
    return true;
}

uint32_t L1QuadrotorByHand_step(Law *s, const Inputs *in, L1QuadrotorByHand_outputs *out)
{
    if (s->ready != READY) {
        memset(out, 0, sizeof *out);
        return L1QuadrotorByHand_REFUSED;
    }
    const bool was_active = s->active;
    States x = s->x;
    Given now;
    double wanted[4], u[4];
    bool sound = finite_numbers(in, in + 1) && begin(s, in, &now, &x);
    if (sound) {
        integrate(s, &now, &x);
        sound = control(s, &now, &x, wanted, u);
        const double *state = (const double *)&x;
        for (int i = 0; i < STATES; i++) sound = sound && fabs(state[i]) <= 1e12;
        for (int i = 0; i < 4; i++) sound = sound && fabs(u[i]) <= 1e12;
        sound = sound && fabs(in->r[3]) <= 1e12;
    }
    if (!sound) {
        s->active = was_active;
        s->refused += s->refused < UINT32_MAX;
        *out = s->last;
        return L1QuadrotorByHand_REFUSED;
    }
    s->x = x;
    s->origin = now.origin;
    s->started = true;
    s->calibrated = false;
    if (!s->active) memset(&s->moves, 0, sizeof s->moves);
    s->at_bounds = in_layers(s, &x);
    s->too_long = s->active && moves_far(&s->moves, u + 1, s->p.move_limit);
    memcpy(s->last.angles, now.angles, sizeof s->last.angles);
    s->last.angles[2] = in->r[3];
    memcpy(s->last.u, u, sizeof s->last.u);
    *out = s->last;
    bool at_limit = false;
    for (int i = 0; i < 4; i++) at_limit = at_limit || u[i] != wanted[i] || u[i] <= s->p.u_min[i] || u[i] >= s->p.u_max[i];
    return (at_limit ? L1QuadrotorByHand_LIMITED : 0) | (s->too_long ? L1QuadrotorByHand_STEP_TOO_LONG : 0) |
        (s->at_bounds ? L1QuadrotorByHand_PROJECTION_ACTIVE : 0);
}
