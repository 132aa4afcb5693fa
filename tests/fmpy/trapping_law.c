/* A law for a target in a host that traps floating-point exceptions: division by zero, invalid operations and overflow end the
 * program. From the start and from random states, at random inputs. law.h names the law: its types and functions, how many inputs
 * and states it has. */

#define _GNU_SOURCE
#include <fenv.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>

#include "law.h"

enum { STEPS = 12, BEGINNINGS = 8 };

static uint64_t drawn = 1;

/* Between -1 and 1. */
static double any(void)
{
    drawn = drawn * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return (double)(drawn >> 11) / 4503599627370496.0 - 1.0;
}

/* Tells where it happened, for addr2line. */
static void trapped(int number, siginfo_t *info, void *context)
{
    (void)context;
    fprintf(stderr, "trapped (signal %d, code %d) at %p\n", number, info->si_code, info->si_addr);
    _Exit(2);
}

int main(void)
{
    static law self;
    static const double sizes[] = { 0.0, 1e-9, 1e-3, 0.03, 0.1 };
    law_real inputs[LAW_INPUTS];
    law_outputs outputs;
    struct sigaction action = { 0 };
    int taken = 0;
    action.sa_sigaction = trapped;
    action.sa_flags = SA_SIGINFO;
    sigaction(SIGFPE, &action, NULL);
    feenableexcept(FE_DIVBYZERO | FE_INVALID | FE_OVERFLOW);
    for (int beginning = 0; beginning < BEGINNINGS; ++beginning) {
        law_init(&self);
        for (int step = 0; step < STEPS; ++step) {
            for (int k = 0; k < LAW_INPUTS; ++k) {
                inputs[k] = starts[k] + (beginning % 2 == 0 ? 0 : (law_real)(0.1 * any()));
            }
            for (int k = 0; step == 1 && k < LAW_STATES; ++k) {
                STATES(self)[k] += (law_real)(sizes[beginning % 5] * any());
            }
            taken += (law_step(&self, (const law_inputs *)(const void *)inputs, &outputs) & LAW_REFUSED) == 0;
        }
    }
    printf("%d\n", taken);
    return 0;
}
