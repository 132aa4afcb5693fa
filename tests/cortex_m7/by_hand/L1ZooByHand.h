/* The L1 control law of a DC motor (examples/zoo/dc_motor.json), written by hand, with the services of a generated one. */
#ifndef L1_ZOO_BY_HAND_H
#define L1_ZOO_BY_HAND_H

#define CONTROLS 1
#include "moves.h"
/* For services.c: adaptation is the faster the larger the control is, and where no motor answers, roundings are amplified in so few substeps. */
#define SIZE(control) 0.5

typedef double L1ZooByHand_real;
typedef struct {
    double r, x[2];
} L1ZooByHand_inputs;
typedef struct {
    double u;
} L1ZooByHand_outputs;
typedef struct {
    double u_min, u_max, omega_min, omega_max, gamma, K, theta_bound[2], sigma_bound, epsilon, tracking_time, move_limit;
} L1ZooByHand_parameters;
/* Estimates are omega, theta and sigma. */
enum { ESTIMATES = 4 };
typedef struct {
    double x_hat[2], estimate[ESTIMATES], u_ad;
} L1ZooByHand_states;
typedef struct {
    L1ZooByHand_states x;
    Moves moves;
    L1ZooByHand_parameters p;
    double gain[ESTIMATES], centre[ESTIMATES], edge[ESTIMATES], steepness[ESTIMATES], antiwindup, manual, last;
    uint32_t refused, ready;
    bool enabled, active, started, too_long, calibrated;
    uint8_t at_bounds;
} L1ZooByHand;

#define L1ZooByHand_REFUSED 1u
#define L1ZooByHand_LIMITED 32u
#define L1ZooByHand_STEP_TOO_LONG 256u
#define L1ZooByHand_PROJECTION_ACTIVE 512u

void L1ZooByHand_init(L1ZooByHand *self);
bool L1ZooByHand_calibrate(L1ZooByHand *self, const L1ZooByHand_parameters *p);
bool L1ZooByHand_enable(L1ZooByHand *self, bool enabled, const double *manual);
void L1ZooByHand_reset(L1ZooByHand *self);
uint32_t L1ZooByHand_step(L1ZooByHand *self, const L1ZooByHand_inputs *in, L1ZooByHand_outputs *out);
#endif
