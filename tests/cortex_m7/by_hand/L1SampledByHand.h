/* The sampled L1 control law of a robot with two links, written by hand, with the services of a generated one. */
#ifndef L1_SAMPLED_BY_HAND_H
#define L1_SAMPLED_BY_HAND_H

#include <stdbool.h>
#include <stdint.h>

typedef double L1SampledByHand_real;
typedef struct {
    double r[2], dr[2], x[4];
} L1SampledByHand_inputs;
typedef struct {
    double u[2];
} L1SampledByHand_outputs;
typedef struct {
    double u_min[2], u_max[2], K[2];
} L1SampledByHand_parameters;
typedef struct {
    double zeta[2], rates_before[2], held[2];
} L1SampledByHand_state;
typedef struct {
    L1SampledByHand_state d;
    L1SampledByHand_parameters p;
    double manual[2], last[2], left[2];
    uint32_t refused, ready;
    bool enabled, active, started;
} L1SampledByHand;

#define L1SampledByHand_REFUSED 1u
#define L1SampledByHand_LIMITED 32u

void L1SampledByHand_init(L1SampledByHand *self);
bool L1SampledByHand_calibrate(L1SampledByHand *self, const L1SampledByHand_parameters *p);
bool L1SampledByHand_enable(L1SampledByHand *self, bool enabled, const double *manual);
void L1SampledByHand_reset(L1SampledByHand *self);
uint32_t L1SampledByHand_step(L1SampledByHand *self, const L1SampledByHand_inputs *in, L1SampledByHand_outputs *out);
#endif
