/* The life of an instance of each interface, as a master leads it, for tools that watch memory: started, stepped, its state
 * saved, serialised, restored and freed; and what is refused is asked for too. */

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#include "fmi2.h"
#include "unit.h"

enum { STEPS = 20, HIGHEST_REFERENCE = UNIT_REALS + UNIT_INTEGERS };

static int messages = 0;

static void told(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category, fmi2String text, ...)
{
    (void)environment, (void)name, (void)status, (void)category, (void)text;
    ++messages;
}

static const fmi2CallbackFunctions callbacks = { told, calloc, free, NULL, NULL };

static void check(int holds, int line)
{
    if (!holds) {
        fprintf(stderr, "one_unit.c:%d: not as it must be\n", line);
        exit(1);
    }
}

#define CHECK(holds) check((holds) != 0, __LINE__)

/* Reads all that can be read, and what can't be: variables of another type, hidden ones, one that there isn't. */
static double read_all(fmi2Component c)
{
    double sum = 0.0;
    for (fmi2ValueReference reference = 0; reference <= HIGHEST_REFERENCE; ++reference) {
        fmi2Real value = 0.0;
        fmi2Integer number = 0;
        if (fmi2GetReal(c, &reference, 1, &value) == fmi2OK) {
            sum += value;
        }
        if (fmi2GetInteger(c, &reference, 1, &number) == fmi2OK) {
            sum += number;
        }
    }
    return sum;
}

/* Back from a saved state, and from its bytes, the unit goes on as it did. */
static void go_back(fmi2Component c, double t, double step)
{
    fmi2FMUstate state = NULL;
    fmi2FMUstate again = NULL;
    size_t size = 0;
    CHECK(fmi2GetFMUstate(c, &state) == fmi2OK);
    CHECK(fmi2SerializedFMUstateSize(c, state, &size) == fmi2OK);
    fmi2Byte *bytes = malloc(size);
    CHECK(bytes != NULL);
    CHECK(fmi2SerializeFMUstate(c, state, bytes, size) == fmi2OK);
    CHECK(fmi2DeSerializeFMUstate(c, bytes, size - 1, &again) == fmi2Error);
    CHECK(fmi2DoStep(c, t, step, 0) == fmi2OK);
    const double first = read_all(c);
    CHECK(fmi2SetFMUstate(c, state) == fmi2OK);
    CHECK(fmi2FreeFMUstate(c, &state) == fmi2OK && state == NULL);
    CHECK(fmi2DeSerializeFMUstate(c, bytes, size, &again) == fmi2OK);
    CHECK(fmi2DoStep(c, t, step, 0) == fmi2OK);
    CHECK(read_all(c) == first);
    CHECK(fmi2SetFMUstate(c, again) == fmi2OK);
    CHECK(fmi2DoStep(c, t, step, 0) == fmi2OK);
    CHECK(read_all(c) == first);
    /* A corrupted byte is noticed. `again` stays, and goes with the instance. */
    bytes[size - 1] ^= 1;
    state = NULL;
    CHECK(fmi2DeSerializeFMUstate(c, bytes, size, &state) == fmi2Error);
    free(bytes);
}

static fmi2Component started(fmi2Type type)
{
    fmi2Component c = fmi2Instantiate("unit", type, UNIT_GUID, "", &callbacks, 0, 1);
    CHECK(c != NULL);
    CHECK(fmi2DoStep(c, 0.0, 1e-3, 0) == fmi2Error);
    CHECK(fmi2SetupExperiment(c, 1, 1e-6, 0.0, 0, 0.0) == fmi2OK);
    CHECK(fmi2EnterInitializationMode(c) == fmi2OK);
    (void)read_all(c);
    CHECK(fmi2ExitInitializationMode(c) == fmi2OK);
    return c;
}

static void take_steps(fmi2Component c, double step)
{
    for (int k = 0; k < STEPS; ++k) {
        go_back(c, k * step, step);
    }
}

static void exchange(void)
{
    fmi2Component c = started(fmi2ModelExchange);
    fmi2EventInfo info;
    fmi2Real states[UNIT_STATES + 1];
    fmi2Real rates[UNIT_STATES + 1];
    fmi2Real indicators[UNIT_INDICATORS + 1];
    fmi2Boolean event = 0;
    fmi2Boolean end = 0;
    do {
        CHECK(fmi2NewDiscreteStates(c, &info) == fmi2OK);
    } while (info.newDiscreteStatesNeeded);
    CHECK(fmi2EnterContinuousTimeMode(c) == fmi2OK);
    for (int k = 1; k <= STEPS; ++k) {
        CHECK(fmi2GetContinuousStates(c, states, UNIT_STATES) == fmi2OK);
        CHECK(fmi2GetDerivatives(c, rates, UNIT_STATES) == fmi2OK);
        for (int i = 0; i < UNIT_STATES; ++i) {
            states[i] += 1e-6 * rates[i];
        }
        CHECK(fmi2SetTime(c, 1e-6 * k) == fmi2OK);
        CHECK(fmi2SetContinuousStates(c, states, UNIT_STATES) == fmi2OK);
        CHECK(fmi2GetEventIndicators(c, indicators, UNIT_INDICATORS) == fmi2OK);
        CHECK(fmi2CompletedIntegratorStep(c, 1, &event, &end) == fmi2OK);
    }
    (void)read_all(c);
    CHECK(fmi2Terminate(c) == fmi2OK);
    fmi2FreeInstance(c);
}

int main(void)
{
    CHECK(fmi2Instantiate("unit", fmi2CoSimulation, "{another}", "", &callbacks, 0, 0) == NULL);
    fmi2Component c = started(fmi2CoSimulation);
    take_steps(c, 1e-3);
    CHECK(fmi2DoStep(c, 7.0, 1e-3, 0) == fmi2Error);
    CHECK(fmi2Reset(c) == fmi2OK);
    fmi2FreeInstance(c);
    exchange();
    CHECK(messages > 0);
    return 0;
}
