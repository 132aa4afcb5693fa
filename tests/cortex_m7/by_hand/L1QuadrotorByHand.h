/* The L1 control law of a quadrotor behind a loop for its position (Hashim, section 3.3.2), written by hand, with the services of a generated one. */
#ifndef L1_QUADROTOR_BY_HAND_H
#define L1_QUADROTOR_BY_HAND_H

/* The torques: the thrust isn't watched. */
#define CONTROLS 3
#include "moves.h"
/* For services.c: parameters that aren't real numbers, inputs that are the yaw, and sizes of thrust and torques. With larger torques than
 * these the ten substeps are too few where inputs are no plant's, and roundings grow. */
#define FLAG rotor_limits
#define CHOICE priority
#define CHOICES 3
#define TURNING {3, 18}
#define SIZE(control) ((control) == 0 ? 50 : 0.1)

typedef double L1QuadrotorByHand_real;
typedef struct {
    double r[4], dr[3], ddr[3], p[3], dp[3], x[6];
} L1QuadrotorByHand_inputs;
typedef struct {
    double angles[3], u[4];
} L1QuadrotorByHand_outputs;
typedef struct {
    double m, g, position_gain[3], velocity_gain[3], lift_min, tilt_max, tilt_cosine_min, u_min[4], u_max[4];
    bool rotor_limits;
    double arm_length, drag_to_thrust, rotor_min, rotor_max;
    int32_t priority;
    double omega_min[3], omega_max[3], gamma, K[9], theta_bound[3], sigma_bound[3], epsilon, tracking_time[3], inertia[3], move_limit, origin_range;
} L1QuadrotorByHand_parameters;
typedef struct {
    double x_hat[6], omega[3], theta[3], sigma[3], u_ad[3];
} L1QuadrotorByHand_states;
typedef struct {
    L1QuadrotorByHand_states x;
    Moves moves;
    L1QuadrotorByHand_parameters p;
    L1QuadrotorByHand_outputs last;
    double manual[4], origin, middle[3], half[3], antiwindup[3], follow;
    uint32_t refused, ready;
    bool enabled, active, started, too_long, calibrated;
    uint8_t at_bounds;
} L1QuadrotorByHand;

#define L1QuadrotorByHand_REFUSED 1u
#define L1QuadrotorByHand_LIMITED 32u
#define L1QuadrotorByHand_STEP_TOO_LONG 256u
#define L1QuadrotorByHand_PROJECTION_ACTIVE 512u

void L1QuadrotorByHand_init(L1QuadrotorByHand *self);
bool L1QuadrotorByHand_calibrate(L1QuadrotorByHand *self, const L1QuadrotorByHand_parameters *p);
bool L1QuadrotorByHand_enable(L1QuadrotorByHand *self, bool enabled, const double *manual);
void L1QuadrotorByHand_reset(L1QuadrotorByHand *self);
uint32_t L1QuadrotorByHand_step(L1QuadrotorByHand *self, const L1QuadrotorByHand_inputs *in, L1QuadrotorByHand_outputs *out);
#endif
