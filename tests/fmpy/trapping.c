/* A unit in a host that traps floating-point exceptions: division by zero, invalid operations and overflow end the program. From
 * the start and from random states, at random inputs, by each method, in both interfaces. */

#define _GNU_SOURCE
#include <fenv.h>
#include <inttypes.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#include "all.c"

/* Fixed steps are short enough for fast adaptation. */
enum { STEPS = 12, BEGINNINGS = 8, FIXED_STEPS = 2000 };

static uint64_t drawn = 1;

/* Between -1 and 1. */
static double any(void)
{
    drawn = drawn * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return (double)(drawn >> 11) / 4503599627370496.0 - 1.0;
}

/* The first beginning is the start itself; then states are scattered. */
static void scatter(int beginning, real *states)
{
    static const double sizes[] = { 0.0, 1e-3, 0.1, 10.0, 1e6 };
    for (int k = 0; k < UNIT_STATES; ++k) {
        states[k] += (real)(sizes[beginning % 5] * (double)unit_nominals[k] * any());
    }
}

/* Tells where it happened, for addr2line. */
static void trapped(int number, siginfo_t *info, void *context)
{
    (void)context;
    fprintf(stderr, "trapped (signal %d, code %d) at %p\n", number, info->si_code, info->si_addr);
    _Exit(2);
}

static void trap(void)
{
    struct sigaction action = { 0 };
    action.sa_sigaction = trapped;
    action.sa_flags = SA_SIGINFO;
    sigaction(SIGFPE, &action, NULL);
    feenableexcept(FE_DIVBYZERO | FE_INVALID | FE_OVERFLOW);
}

static void told(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category, fmi2String text, ...)
{
    (void)environment, (void)name, (void)status, (void)category, (void)text;
    if (getenv("TRAPPING_TELLS") != NULL) {
        fprintf(stderr, "%s: %s\n", category, text);
    }
    /* The master's own modes stand here. */
    if (fegetexcept() != (FE_DIVBYZERO | FE_INVALID | FE_OVERFLOW)) {
        _Exit(3);
    }
}

static const fmi2CallbackFunctions callbacks = { told, calloc, free, NULL, NULL };

static Instance *begun(fmi2Type type, int method)
{
    Instance *c = fmi2Instantiate("unit", type, UNIT_GUID, "", &callbacks, 0, 1);
    fmi2SetupExperiment(c, 1, 1e-6, 0.0, 0, 0.0);
#if AT_INTEGRATION_METHOD >= 0
    const fmi2ValueReference references[] = { UNIT_REALS + AT_INTEGRATION_METHOD, UNIT_REALS + AT_FIXED_STEPS };
    const fmi2Integer values[] = { method, FIXED_STEPS };
    fmi2SetInteger(c, references, 2, values);
#else
    (void)method;
#endif
    fmi2EnterInitializationMode(c);
    fmi2ExitInitializationMode(c);
    return c;
}

static void give_inputs(Instance *c, int beginning)
{
    for (fmi2ValueReference k = FIRST_INPUT; beginning % 2 == 1 && k < FIRST_INPUT + UNIT_INPUTS; ++k) {
        double value = (double)unit_start_reals[k] + 0.1 * any();
        fmi2SetReal(c, &k, 1, &value);
    }
}

/* All bits that were read, mixed. */
static uint64_t bits = 0;

static void mix(fmi2Real value)
{
    uint64_t read = 0;
    memcpy(&read, &value, sizeof read);
    bits = (bits ^ read) * UINT64_C(1099511628211);
}

/* Reads all that can be read, and how it changes. */
static void read_all(Instance *c)
{
    for (fmi2ValueReference reference = 0; reference < UNIT_REALS; ++reference) {
        fmi2Real value = 0.0;
        fmi2GetReal(c, &reference, 1, &value);
        mix(value);
        for (fmi2ValueReference known = FIRST_INPUT; known < FIRST_INPUT + UNIT_INPUTS; ++known) {
            const fmi2Real one = 1.0;
            fmi2GetDirectionalDerivative(c, &reference, 1, &known, 1, &one, &value);
        }
    }
}

/* By a host that rounds so while it steps and reads. */
static int simulated(int beginning, int method, double period, int rounding)
{
    Instance *c = begun(fmi2CoSimulation, method);
    int taken = 0;
    for (int step = 0; step < STEPS; ++step) {
        give_inputs(c, beginning);
        if (step == 1) {
            scatter(beginning, c->block.v + FIRST_STATE);
        }
        /* Stored: a compiler that knows nothing of modes would compute it in the host's. */
        volatile const double time = step * period;
        fesetround(rounding);
        taken += fmi2DoStep(c, time, period, 0) == fmi2OK;
        read_all(c);
        fesetround(FE_TONEAREST);
    }
    fmi2FreeInstance(c);
    return taken;
}

static int exchanged(int beginning, double period)
{
    Instance *c = begun(fmi2ModelExchange, 1);
    fmi2Real values[UNIT_STATES + UNIT_INDICATORS + 1];
    fmi2EventInfo info = { 0 };
    fmi2Boolean event = 0, end = 0;
    int taken = 0;
    fmi2NewDiscreteStates(c, &info);
    for (int step = 0; step < STEPS; ++step) {
        give_inputs(c, beginning);
        fmi2EnterContinuousTimeMode(c);
        fmi2SetTime(c, (step + 1) * period);
        scatter(beginning, c->block.v + FIRST_STATE);
        fmi2GetContinuousStates(c, values, UNIT_STATES);
        fmi2SetContinuousStates(c, values, UNIT_STATES);
        taken += fmi2GetDerivatives(c, values, UNIT_STATES) == fmi2OK;
        fmi2GetEventIndicators(c, values, UNIT_INDICATORS);
        read_all(c);
        fmi2CompletedIntegratorStep(c, 1, &event, &end);
        fmi2EnterEventMode(c);
        fmi2NewDiscreteStates(c, &info);
    }
    fmi2FreeInstance(c);
    return taken;
}

int main(int count, char **arguments)
{
    double period = count > 1 ? atof(arguments[1]) : 1e-3;
    int taken = 0, rounding = count > 2 ? FE_DOWNWARD : FE_TONEAREST;
    trap();
    for (int beginning = 0; beginning < BEGINNINGS; ++beginning) {
        for (int method = 1; method <= 4; ++method) {
            taken += simulated(beginning, method, period, rounding);
        }
        taken += exchanged(beginning, period);
    }
    if (fegetexcept() != (FE_DIVBYZERO | FE_INVALID | FE_OVERFLOW)) {
        return 3;
    }
    printf("%d %" PRIx64 "\n", taken, bits);
    return 0;
}
