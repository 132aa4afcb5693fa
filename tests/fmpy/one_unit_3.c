/* The life of an instance of FMI 3.0, of each interface, as a master leads it, for tools that watch memory: started, stepped through
 * Event Mode, its state saved, serialised, restored and freed, derivatives in both directions, dependences; and what is refused is
 * asked for too. */

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3.h"
#include "unit.h"

enum { STEPS = 20, HIGHEST_REFERENCE = UNIT_REALS + UNIT_INTEGERS + 1, MOST = UNIT_REALS + UNIT_INTEGERS + UNIT_INDICATORS + 1 };

static int messages = 0;

static void told(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String text)
{
    (void)environment, (void)status, (void)category, (void)text;
    ++messages;
}

static void check(int holds, int line)
{
    if (!holds) {
        fprintf(stderr, "one_unit_3.c:%d: not as it must be\n", line);
        exit(1);
    }
}

#define CHECK(holds) check((holds) != 0, __LINE__)

/* Reads all that can be read, and what can't be: variables of another type, hidden ones, elements, one that there isn't. An array is
 * found by the number of its values. */
static double read_all(fmi3Instance c)
{
    double sum = 0.0;
    static double values[MOST];
    for (fmi3ValueReference reference = 0; reference <= HIGHEST_REFERENCE; ++reference) {
        int64_t item = 0;
        int32_t number = 0;
        bool flag = false;
        size_t count = 0;
        for (size_t size = 0; size <= 40; ++size) {
            if (fmi3GetFloat64(c, &reference, 1, values, size) == fmi3OK) {
                sum += values[size - 1];
            }
        }
        sum += fmi3GetInt64(c, &reference, 1, &item, 1) == fmi3OK ? (double)item : 0.0;
        sum += fmi3GetInt32(c, &reference, 1, &number, 1) == fmi3OK ? number : 0.0;
        sum += fmi3GetBoolean(c, &reference, 1, &flag, 1) == fmi3OK ? flag : 0.0;
        if (fmi3GetNumberOfVariableDependencies(c, reference, &count) == fmi3OK) {
            size_t *elements = calloc(2 * count + 1, sizeof *elements);
            fmi3ValueReference *on = calloc(count + 1, sizeof *on);
            fmi3DependencyKind *kinds = calloc(count + 1, sizeof *kinds);
            CHECK(fmi3GetVariableDependencies(c, reference, elements, on, elements + count, kinds, count) == fmi3OK);
            CHECK(fmi3GetVariableDependencies(c, reference, elements, on, elements + count, kinds, count + 1) == fmi3Error);
            CHECK(count == 0 || kinds[count - 1] == fmi3Dependent);
            free(elements);
            free(on);
            free(kinds);
        }
    }
    return sum;
}

/* Derivatives of all that has any by each input, in both directions. */
static void differentiate(fmi3Instance c)
{
    static double seed[MOST], result[MOST];
    for (fmi3ValueReference known = 0; known <= HIGHEST_REFERENCE; ++known) {
        for (fmi3ValueReference unknown = 0; unknown <= HIGHEST_REFERENCE; ++unknown) {
            double one = 1.0, forward = 0.0, backward = 0.0;
            fmi3Status status = fmi3GetDirectionalDerivative(c, &unknown, 1, &known, 1, &one, 1, &forward, 1);
            CHECK(fmi3GetAdjointDerivative(c, &unknown, 1, &known, 1, &one, 1, &backward, 1) == status);
            CHECK(status != fmi3OK || fabs(forward - backward) <= 1e-12 * (1.0 + fabs(forward)));
        }
    }
    CHECK(fmi3GetDirectionalDerivative(c, NULL, 1, NULL, 1, seed, 1, result, 1) == fmi3Error);
}

static void take_step(fmi3Instance c, double t, double step)
{
    bool needed, end, early;
    double last;
    CHECK(fmi3DoStep(c, t, step, true, &needed, &end, &early, &last) == fmi3OK);
    CHECK(!end && !early && last > t);
}

/* Back from a saved state, and from its bytes, the unit goes on as it did. */
static void go_back(fmi3Instance c, double t, double step)
{
    fmi3FMUState state = NULL, again = NULL;
    size_t size = 0;
    CHECK(fmi3GetFMUState(c, &state) == fmi3OK);
    CHECK(fmi3SerializedFMUStateSize(c, state, &size) == fmi3OK);
    fmi3Byte *bytes = malloc(size);
    CHECK(bytes != NULL);
    CHECK(fmi3SerializeFMUState(c, state, bytes, size) == fmi3OK);
    CHECK(fmi3DeserializeFMUState(c, bytes, size - 1, &again) == fmi3Error);
    take_step(c, t, step);
    const double first = read_all(c);
    CHECK(fmi3SetFMUState(c, state) == fmi3OK);
    CHECK(fmi3FreeFMUState(c, &state) == fmi3OK && state == NULL);
    CHECK(fmi3DeserializeFMUState(c, bytes, size, &again) == fmi3OK);
    take_step(c, t, step);
    CHECK(read_all(c) == first);
    bytes[size - 1] ^= 1;
    CHECK(fmi3DeserializeFMUState(c, bytes, size, &state) == fmi3Error);
    free(bytes);
    CHECK(fmi3FreeFMUState(c, &again) == fmi3OK);
}

static void start(fmi3Instance c)
{
    CHECK(c != NULL);
    (void)read_all(c);
    CHECK(fmi3EnterStepMode(c) == fmi3Error);
    CHECK(fmi3EnterInitializationMode(c, true, -1.0, 0.0, false, 0.0) == fmi3Error);
    CHECK(fmi3EnterInitializationMode(c, true, 1e-6, 0.0, false, 0.0) == fmi3OK);
    (void)read_all(c);
    CHECK(fmi3ExitInitializationMode(c) == fmi3OK);
}

static void update(fmi3Instance c)
{
    bool needed, end, nominals, values, defined;
    double time;
    do {
        CHECK(fmi3UpdateDiscreteStates(c, &needed, &end, &nominals, &values, &defined, &time) == fmi3OK);
        CHECK(!end && !nominals);
    } while (needed);
    CHECK(fmi3UpdateDiscreteStates(c, NULL, &end, &nominals, &values, &defined, &time) == fmi3Error);
}

static void co_simulation(bool event_mode)
{
    const double step = 1e-3;
    fmi3Instance c = fmi3InstantiateCoSimulation("unit", UNIT_GUID, NULL, false, true, event_mode, false, NULL, 0, NULL, told, NULL);
    start(c);
    for (int k = 0; k < STEPS; ++k) {
        if (event_mode) {
            update(c);
            CHECK(fmi3EvaluateDiscreteStates(c) == fmi3OK);
            CHECK(fmi3EnterStepMode(c) == fmi3OK);
        }
        go_back(c, k * step, step);
        CHECK((fmi3EnterEventMode(c) == fmi3OK) == event_mode);
    }
    differentiate(c);
    CHECK(fmi3Reset(c) == fmi3OK);
    start(c);
    CHECK(fmi3Terminate(c) == fmi3OK);
    (void)read_all(c);
    fmi3FreeInstance(c);
}

static void model_exchange(void)
{
    fmi3Instance c = fmi3InstantiateModelExchange("unit", UNIT_GUID, NULL, false, true, NULL, told);
    double states[UNIT_STATES + 1], rates[UNIT_STATES + 1], indicators[UNIT_INDICATORS + 1];
    bool event = false, end = false;
    size_t count = 0;
    start(c);
    CHECK(fmi3GetNumberOfContinuousStates(c, &count) == fmi3OK && count == UNIT_STATES);
    CHECK(fmi3GetNumberOfEventIndicators(c, &count) == fmi3OK && count == UNIT_INDICATORS);
    update(c);
    CHECK(fmi3EnterContinuousTimeMode(c) == fmi3OK);
    for (int k = 1; k <= STEPS; ++k) {
        CHECK(fmi3GetContinuousStates(c, states, UNIT_STATES) == fmi3OK);
        CHECK(fmi3GetContinuousStateDerivatives(c, rates, UNIT_STATES) == fmi3OK);
        for (int i = 0; i < UNIT_STATES; ++i) {
            states[i] += 1e-6 * rates[i];
        }
        CHECK(fmi3SetTime(c, 1e-6 * k) == fmi3OK);
        CHECK(fmi3SetContinuousStates(c, states, UNIT_STATES) == fmi3OK);
        CHECK(fmi3GetEventIndicators(c, indicators, UNIT_INDICATORS) == fmi3OK);
        CHECK(fmi3CompletedIntegratorStep(c, true, &event, &end) == fmi3OK);
    }
    (void)read_all(c);
    differentiate(c);
    CHECK(fmi3DoStep(c, 0.0, 1.0, true, &event, &event, &event, &states[0]) == fmi3Error);
    fmi3FreeInstance(c);
}

int main(void)
{
    CHECK(strcmp(fmi3GetVersion(), "3.0") == 0);
    CHECK(fmi3InstantiateModelExchange("unit", "{another}", NULL, false, false, NULL, told) == NULL);
    CHECK(fmi3InstantiateScheduledExecution("unit", UNIT_GUID, NULL, false, false, NULL, told, NULL, NULL, NULL) == NULL);
    co_simulation(false);
    co_simulation(true);
    model_exchange();
    CHECK(messages > 0);
    return 0;
}
