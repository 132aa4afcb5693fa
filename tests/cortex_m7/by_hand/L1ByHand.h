/* The L1 control law of a robot with two links (Hashim, section 3.3.1), written by hand, with the services of a generated one. */
#ifndef L1_BY_HAND_H
#define L1_BY_HAND_H

#define CONTROLS 2
#include "moves.h"

typedef double L1ByHand_real;
typedef struct {
    double r[2], x[4];
} L1ByHand_inputs;
typedef struct {
    double u[2];
} L1ByHand_outputs;
typedef struct {
    double u_min[2], u_max[2], omega_min[4], omega_max[4], gamma, K[4], theta_bound[2], sigma_bound[2], epsilon, tracking_time[2], move_limit;
} L1ByHand_parameters;
typedef struct {
    double x_hat[4], omega[4], theta[2], sigma[2], u_ad[2];
} L1ByHand_states;
typedef struct {
    L1ByHand_states x;
    Moves moves;
    L1ByHand_parameters p;
    double manual[2], last[2], antiwindup[2], follow;
    uint32_t refused, ready;
    bool enabled, active, started, too_long, calibrated;
    uint8_t at_bounds;
} L1ByHand;

#define L1ByHand_REFUSED 1u
#define L1ByHand_LIMITED 32u
#define L1ByHand_STEP_TOO_LONG 256u
#define L1ByHand_PROJECTION_ACTIVE 512u

void L1ByHand_init(L1ByHand *self);
bool L1ByHand_calibrate(L1ByHand *self, const L1ByHand_parameters *p);
bool L1ByHand_enable(L1ByHand *self, bool enabled, const double *manual);
void L1ByHand_reset(L1ByHand *self);
uint32_t L1ByHand_step(L1ByHand *self, const L1ByHand_inputs *in, L1ByHand_outputs *out);
#endif
