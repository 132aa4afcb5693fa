/* A quadrotor with a loop for its position and an L1 law for its attitude, which is measured (example 3.3.2) or comes
   from an observer (example 7.5.3, case 1). The plant's filtered disturbances are left out: in these cases nothing
   depends on them. States: position, velocity, angles, their rates; (the observer's;) the law's. */
#include "l1.h"
#include "loop.h"

static const Law ATTITUDE = {3, 0, 0, {-30, -35, -40}, {.5, .5, .5}, 1e5, 30, 100, 100, .5, 10, 0};
static const double INERTIA[3] = {4.85e-3, 4.85e-3, 8.81e-3}, MASS = .5, GRAVITY = 9.81;
static const double POSITION_GAIN = 4, VELOCITY_GAIN = 4, LIFT_MIN = .3, TILT_MAX = .6, TILT_COSINE_MIN = .3;
static const double THRUST_MAX = 15;

/* The trajectory's position with two derivatives; the yaw is returned. */
static inline double trajectory(double t, double *p, double *dp, double *ddp) {
    double s = sin(.4 * t), c = cos(.4 * t), e = exp(-.5 * t);
    p[0] = s, dp[0] = .4 * c, ddp[0] = -.16 * s;
    p[1] = 1 - c, dp[1] = .4 * s, ddp[1] = .16 * c;
    p[2] = 2 * (1 - e * (1 + .5 * t)), dp[2] = .5 * t * e, ddp[2] = .5 * e * (1 - .5 * t);
    return .3 * sin(.3 * t);
}

static inline double within(double value, double limit) { return fmax(-limit, fmin(limit, value)); }

/* What the loop for the position wants: an acceleration, of which angles and thrust (by mass) follow. */
typedef struct {
    double a[3], g_z, cf, sf, ct, st, cp, sp, pitch, roll; /* pitch, roll: tangents of the angles */
    double wanted[3], carried, thrust;
} Outer;

static inline Outer outer(double t, const double *z) {
    const double *p = z, *v = z + 3, *angle = z + 6;
    double r[3], dr[3], ddr[3];
    Outer o;
    o.wanted[2] = trajectory(t, r, dr, ddr);
    for (int i = 0; i < 3; i++) o.a[i] = ddr[i] + VELOCITY_GAIN * (dr[i] - v[i]) + POSITION_GAIN * (r[i] - p[i]);
    o.cf = cos(angle[0]), o.sf = sin(angle[0]), o.ct = cos(angle[1]), o.st = sin(angle[1]);
    o.cp = cos(angle[2]), o.sp = sin(angle[2]), o.g_z = fmax(GRAVITY + o.a[2], LIFT_MIN * GRAVITY);
    o.pitch = (o.a[0] * o.cp + o.a[1] * o.sp) / o.g_z;
    o.wanted[1] = within(atan(o.pitch), TILT_MAX);
    o.roll = cos(o.wanted[1]) * (o.a[0] * o.sp - o.a[1] * o.cp) / o.g_z;
    o.wanted[0] = within(atan(o.roll), TILT_MAX);
    o.carried = fmax(o.cf * o.ct, TILT_COSINE_MIN);
    o.thrust = fmax(0, fmin(THRUST_MAX, MASS * o.g_z / o.carried)) / MASS;
    return o;
}

/* The plant's rates under angular accelerations. */
static inline void body(const Outer *o, const double *z, const double *torque, double *dz) {
    const double *v = z + 3, *w = z + 9, *I = INERTIA;
    for (int i = 0; i < 3; i++) dz[i] = v[i], dz[6 + i] = w[i];
    dz[3] = (o->cf * o->st * o->cp + o->sf * o->sp) * o->thrust;
    dz[4] = (o->cf * o->st * o->sp - o->sf * o->cp) * o->thrust;
    dz[5] = o->cf * o->ct * o->thrust - GRAVITY;
    /* What the law commands are accelerations: the nominal inertia that makes torques of them is the body's own. */
    dz[9] = (I[1] - I[2]) / I[0] * w[1] * w[2] + torque[0];
    dz[10] = (I[2] - I[0]) / I[1] * w[0] * w[2] + torque[1];
    dz[11] = (I[0] - I[1]) / I[2] * w[0] * w[1] + torque[2];
}

static void rate(double t, const double *z, double *dz) {
    double torque[3];
    Outer o = outer(t, z);
    l1(&ATTITUDE, o.wanted, z + 6, z + 12, torque, dz + 12);
    body(&o, z, torque, dz);
}

/* Adds to the rows of the law's u_ad what position, velocity and yaw do by the wanted angles. */
static inline void wanted_slopes(const Outer *o, int row, double *const *columns) {
    double across = o->a[0] * o->sp - o->a[1] * o->cp, lift = GRAVITY + o->a[2] > LIFT_MIN * GRAVITY;
    double d_pitch = fabs(o->wanted[1]) < TILT_MAX ? 1 / (1 + o->pitch * o->pitch) / o->g_z : 0;
    double d_roll = fabs(o->wanted[0]) < TILT_MAX ? 1 / (1 + o->roll * o->roll) / o->g_z : 0;
    double c = cos(o->wanted[1]), s = sin(o->wanted[1]);
    /* In the accelerations along x, y and z, and in the yaw. */
    double pitch[4] = {d_pitch * o->cp, d_pitch * o->sp, -d_pitch * o->pitch * lift, -d_pitch * across}, roll[4];
    double turned[4] = {c * o->sp, -c * o->cp, -o->roll * lift, c * o->pitch * o->g_z};
    for (int j = 0; j < 4; j++) roll[j] = d_roll * (turned[j] - s * across * pitch[j]);
    for (int i = 0; i < 2; i++) {
        const double *slopes = i ? pitch : roll;
        double gain = ATTITUDE.feedback_gain * stiffness(&ATTITUDE, i);
        for (int j = 0; j < 3; j++) {
            columns[j][row + i] -= gain * POSITION_GAIN * slopes[j];
            columns[3 + j][row + i] -= gain * VELOCITY_GAIN * slopes[j];
        }
        columns[8][row + i] += gain * slopes[3];
    }
}

static inline void push_slopes(const Outer *o, double *const *columns) {
    double T = o->thrust, free = T > 0 && T < THRUST_MAX / MASS;
    double tilted = free * (o->cf * o->ct > TILT_COSINE_MIN) * T / o->carried;
    double lifted = free * (GRAVITY + o->a[2] > LIFT_MIN * GRAVITY) / o->carried;
    double along[3] = {o->cf * o->st * o->cp + o->sf * o->sp, o->cf * o->st * o->sp - o->sf * o->cp, o->cf * o->ct};
    double in_roll[3] = {
        -o->sf * o->st * o->cp + o->cf * o->sp, -o->sf * o->st * o->sp - o->cf * o->cp, -o->sf * o->ct,
    };
    double in_pitch[3] = {o->cf * o->ct * o->cp, o->cf * o->ct * o->sp, -o->cf * o->st};
    for (int i = 0; i < 3; i++) {
        columns[2][3 + i] -= POSITION_GAIN * lifted * along[i];
        columns[5][3 + i] -= VELOCITY_GAIN * lifted * along[i];
        columns[6][3 + i] += T * in_roll[i] + tilted * o->sf * o->ct * along[i];
        columns[7][3 + i] += T * in_pitch[i] + tilted * o->cf * o->st * along[i];
    }
    columns[8][3] -= T * along[1], columns[8][4] += T * along[0];
}

static inline void body_slopes(const Outer *o, const double *z, Place at, double *const *columns) {
    const double *w = z + 9, *I = INERTIA;
    double gyro[3] = {(I[1] - I[2]) / I[0], (I[2] - I[0]) / I[1], (I[0] - I[1]) / I[2]};
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        columns[3 + i][i] += 1, columns[9 + i][6 + i] += 1;
        columns[9 + j][9 + i] += gyro[i] * w[k], columns[9 + k][9 + i] += gyro[i] * w[j];
        l1_control_slope(at, i, 9 + i, 1);
    }
    push_slopes(o, columns);
    wanted_slopes(o, at.row + 15, columns);
}

static void slopes(double t, const double *z, double *const *columns) {
    Outer o = outer(t, z);
    Place at = {&ATTITUDE, columns + 6, columns + 12, 12};
    body_slopes(&o, z, at, columns);
    l1_slopes(at, z + 6, z + 12);
}

static const double START[3] = {.1, -.1, .2};

static void start(double *z) {
    memcpy(z + 6, START, sizeof START);
    l1_start(&ATTITUDE, z + 6, z + 12);
}

const Loop QUADROTOR = {"3.3.2-case1", 30, 12, rate, slopes, start, 0};

/* The observer's states are x_obs = (angles, rates), beta and delta. */
enum { OBSERVER = 12, BETA = OBSERVER + 6, DELTA, OBSERVED_LAW };
static const double K1[3] = {140, 150, 170}, K2[3] = {4900.25, 5625.25, 7225.25};
static const double GAMMA = 100, LEAK = 1e-4, LAMBDA_0 = 2.5, D_0 = .625;

/* What its equations are made of; y_2, x_2: squares of the norms. */
typedef struct {
    double e[3], norm, y_2, x_2, beta_l;
} Observed;

static inline Observed observed(const double *z) {
    const double *y = z + 6, *x = z + OBSERVER;
    Observed o = {.y_2 = 0};
    for (int i = 0; i < 3; i++) {
        o.e[i] = x[i] - y[i];
        o.norm += o.e[i] * o.e[i], o.y_2 += y[i] * y[i], o.x_2 += x[i] * x[i] + x[3 + i] * x[3 + i];
    }
    o.norm = sqrt(o.norm);
    o.beta_l = 1 + o.y_2 * o.y_2 * (1 + o.x_2) + 2 * z[DELTA];
    return o;
}

static void observed_rate(double t, const double *z, double *dz) {
    const double *x = z + OBSERVER;
    double torque[3];
    Outer o = outer(t, z);
    Observed s = observed(z);
    l1(&ATTITUDE, o.wanted, x, z + OBSERVED_LAW, torque, dz + OBSERVED_LAW);
    body(&o, z, torque, dz);
    for (int i = 0; i < 3; i++) {
        dz[OBSERVER + i] = x[3 + i] - K1[i] * s.e[i];
        dz[OBSERVER + 3 + i] = torque[i] - (K2[i] + z[BETA] * s.beta_l) * s.e[i];
    }
    dz[BETA] = GAMMA * (s.norm * s.beta_l - LEAK * z[BETA]);
    dz[DELTA] = -LAMBDA_0 * z[DELTA] + s.y_2 * s.y_2 + D_0;
}

/* Adds what a state does by beta_l, whose slope in it this is. */
static inline void beta_l_slopes(const Observed *s, double beta, double slope, double *column) {
    for (int i = 0; i < 3; i++) column[OBSERVER + 3 + i] -= beta * slope * s->e[i];
    column[BETA] += GAMMA * s->norm * slope;
}

static inline void observer_slopes(const double *z, const Observed *s, double *const *columns) {
    const double *y = z + 6, *x = z + OBSERVER;
    double y_4 = s->y_2 * s->y_2, beta = z[BETA];
    for (int i = 0; i < 3; i++) {
        double pull = K2[i] + beta * s->beta_l, in_norm = s->norm > 0 ? GAMMA * s->beta_l * s->e[i] / s->norm : 0;
        double *measured = columns[6 + i], *angle = columns[OBSERVER + i], *rate = columns[OBSERVER + 3 + i];
        measured[OBSERVER + i] += K1[i], angle[OBSERVER + i] -= K1[i], rate[OBSERVER + i] += 1;
        measured[OBSERVER + 3 + i] += pull, angle[OBSERVER + 3 + i] -= pull;
        measured[BETA] -= in_norm, angle[BETA] += in_norm;
        measured[DELTA] += 4 * s->y_2 * y[i];
        columns[BETA][OBSERVER + 3 + i] -= s->beta_l * s->e[i];
        beta_l_slopes(s, beta, 4 * s->y_2 * y[i] * (1 + s->x_2), measured);
        beta_l_slopes(s, beta, 2 * y_4 * x[i], angle);
        beta_l_slopes(s, beta, 2 * y_4 * x[3 + i], rate);
    }
    beta_l_slopes(s, beta, 2, columns[DELTA]);
    columns[BETA][BETA] -= GAMMA * LEAK;
    columns[DELTA][DELTA] -= LAMBDA_0;
}

static void observed_slopes(double t, const double *z, double *const *columns) {
    Outer o = outer(t, z);
    Observed s = observed(z);
    Place at = {&ATTITUDE, columns + OBSERVER, columns + OBSERVED_LAW, OBSERVED_LAW};
    body_slopes(&o, z, at, columns);
    observer_slopes(z, &s, columns);
    for (int i = 0; i < 3; i++) l1_control_slope(at, i, OBSERVER + 3 + i, 1);
    l1_slopes(at, z + OBSERVER, z + OBSERVED_LAW);
}

static void observed_start(double *z) {
    memcpy(z + 6, START, sizeof START);
    memcpy(z + OBSERVER, START, sizeof START);
    z[BETA] = z[DELTA] = 1;
    l1_start(&ATTITUDE, z + OBSERVER, z + OBSERVED_LAW);
}

const Loop OBSERVED_QUADROTOR = {"7.5.3-case1", 38, 12, observed_rate, observed_slopes, observed_start, 0};
