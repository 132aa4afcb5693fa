/* Active disturbance rejection control of a robot with two links, written by hand, with the services of a generated one. */
#ifndef LADRC_BY_HAND_H
#define LADRC_BY_HAND_H

#define CONTROLS 2
#include "moves.h"

typedef double LadrcByHand_real;
typedef struct {
    double r[2], dr[2], ddr[2], y[2];
} LadrcByHand_inputs;
typedef struct {
    double u[2];
} LadrcByHand_outputs;
typedef struct {
    double u_min[2], u_max[2], omega_c[2], omega_o[2], move_limit;
} LadrcByHand_parameters;
typedef struct {
    double z[3][2], u_b[2];
} LadrcByHand_states;
typedef struct {
    LadrcByHand_states x;
    Moves moves;
    LadrcByHand_parameters p;
    double k[2][2], l[3][2], manual[2], last[2];
    uint32_t refused, ready;
    bool enabled, active, started, too_long;
} LadrcByHand;

#define LadrcByHand_REFUSED 1u
#define LadrcByHand_LIMITED 32u
#define LadrcByHand_STEP_TOO_LONG 256u

void LadrcByHand_init(LadrcByHand *self);
bool LadrcByHand_calibrate(LadrcByHand *self, const LadrcByHand_parameters *p);
bool LadrcByHand_enable(LadrcByHand *self, bool enabled, const double *manual);
void LadrcByHand_reset(LadrcByHand *self);
uint32_t LadrcByHand_step(LadrcByHand *self, const LadrcByHand_inputs *in, LadrcByHand_outputs *out);
#endif
