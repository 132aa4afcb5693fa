/* The law of a unit without FMI, for firmware: no strings, no allocation, steps of fixed length. law.c is compiled alone,
 * with the unit's files beside it, and its functions begin with UNIT_LAW_PREFIX (`law` where it isn't defined):
 *
 *     static law controller;
 *     law_init(&controller);
 *     law_step(&controller, inputs, outputs);    every UNIT_LAW_PERIOD seconds
 *
 * Parameters are those of the unit. With UNIT_FLOAT, a law that reads time or has events is to be put at its start anew
 * before UNIT_LAW_PERIOD is lost in the rounding of its time: after 10^5 steps it has two digits left. Several laws of one
 * unit have a workspace in common: their steps are taken one after the other, never from two threads at a time. */

#ifndef ADAPTIVE_FMU_LAW_H
#define ADAPTIVE_FMU_LAW_H

#include "real.h"
#include "unit.h"

#ifndef UNIT_LAW_PREFIX
#define UNIT_LAW_PREFIX law
#endif

#define LAW_JOIN(prefix, name) prefix##name
#define LAW_JOINED(prefix, name) LAW_JOIN(prefix, name)
#define LAW_NAME(name) LAW_JOINED(UNIT_LAW_PREFIX, name)

/* One law: all that it goes on with. A copy of it goes on as it does. */
typedef struct {
    real v[UNIT_REALS];
    int n[AT_LEAST_ONE(UNIT_INTEGERS)];
} UNIT_LAW_PREFIX;

/* Puts a law at its start. */
void LAW_NAME(_init)(UNIT_LAW_PREFIX *self);

/* Takes one step of UNIT_LAW_PERIOD with the unit's Real inputs (UNIT_INPUTS of them, held), and gives its Real outputs
 * (UNIT_REAL_OUTPUTS), both in the order of the description. 0 where the step can't be taken: then nothing has changed,
 * and `outputs` is as it was. */
int LAW_NAME(_step)(UNIT_LAW_PREFIX *self, const real *inputs, real *outputs);

#endif
