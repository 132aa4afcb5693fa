/* A PID controller with a filtered derivative and a tracking integral, written by hand, with the services of a generated one. */
#ifndef PID_BY_HAND_H
#define PID_BY_HAND_H

#define CONTROLS 1
#include "moves.h"

typedef double PidByHand_real;
typedef struct {
    double r, y;
} PidByHand_inputs;
typedef struct {
    double u;
} PidByHand_outputs;
typedef struct {
    double u_min, u_max, K_p, K_i, K_d, b, c, N, tracking_time, move_limit;
} PidByHand_parameters;
typedef struct {
    double I, w;
} PidByHand_states;
typedef struct {
    PidByHand_states x;
    Moves moves;
    PidByHand_parameters p;
    double T_t, manual, last;
    uint32_t refused, ready;
    bool enabled, active, started, too_long;
} PidByHand;

#define PidByHand_REFUSED 1u
#define PidByHand_LIMITED 32u
#define PidByHand_STEP_TOO_LONG 256u

void PidByHand_init(PidByHand *self);
void PidByHand_reset(PidByHand *self);
bool PidByHand_enable(PidByHand *self, bool enabled, const double *manual);
bool PidByHand_calibrate(PidByHand *self, const PidByHand_parameters *p);
uint32_t PidByHand_step(PidByHand *self, const PidByHand_inputs *in, PidByHand_outputs *out);
#endif
