/* The L1 control law of a robot with two links (Hashim, section 3.3.1), written by hand, with the services of a generated one. */
#ifndef L1_BY_HAND_H
#define L1_BY_HAND_H

#include <stdbool.h>
#include <stdint.h>

typedef double L1ByHand_real;
typedef struct {
    double r[2], x[4];
} L1ByHand_inputs;
typedef struct {
    double u[2];
} L1ByHand_outputs;
typedef struct {
    double u_min[2], u_max[2], omega_min[4], omega_max[4], gamma, K[4], theta_bound[2], sigma_bound[2], epsilon, move_limit, phase_limit;
} L1ByHand_parameters;
typedef struct {
    double x_hat[4], omega[4], theta[2], sigma[2], u_ad[2];
} L1ByHand_states;
/* Farthest moves of a control in parts of its size, by which a step is too long. */
typedef struct {
    double last[2], largest[2], farthest[2], size[2], since[2], count;
} L1ByHand_moves;
typedef struct {
    L1ByHand_states x;
    L1ByHand_moves moves;
    L1ByHand_parameters p;
    double manual[2], last[2], antiwindup[2], follow;
    uint32_t refused, ready;
    bool enabled, active, started, too_long;
    uint8_t at_bounds;
} L1ByHand;

#define L1ByHand_REFUSED 1u
#define L1ByHand_LIMITED 32u
#define L1ByHand_STEP_TOO_LONG 256u
#define L1ByHand_PROJECTION_ACTIVE 512u

void L1ByHand_init(L1ByHand *self);
bool L1ByHand_calibrate(L1ByHand *self, const L1ByHand_parameters *p);
uint32_t L1ByHand_step(L1ByHand *self, const L1ByHand_inputs *in, L1ByHand_outputs *out);
#endif
