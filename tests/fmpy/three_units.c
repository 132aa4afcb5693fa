/* Three units in one program, linked by prefixed names: example 3.2.1's loop for four seconds, its largest tracking error from
 * the second second on. */

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#include "fmi2.h"

#define UNIT(name) \
    fmi2Component name##_fmi2Instantiate(fmi2String, fmi2Type, fmi2String, fmi2String, const fmi2CallbackFunctions *, \
                                         fmi2Boolean, fmi2Boolean); \
    fmi2Status name##_fmi2SetupExperiment(fmi2Component, fmi2Boolean, fmi2Real, fmi2Real, fmi2Boolean, fmi2Real); \
    fmi2Status name##_fmi2EnterInitializationMode(fmi2Component); \
    fmi2Status name##_fmi2ExitInitializationMode(fmi2Component); \
    fmi2Status name##_fmi2GetReal(fmi2Component, const fmi2ValueReference *, size_t, fmi2Real *); \
    fmi2Status name##_fmi2SetReal(fmi2Component, const fmi2ValueReference *, size_t, const fmi2Real *); \
    fmi2Status name##_fmi2SetInteger(fmi2Component, const fmi2ValueReference *, size_t, const fmi2Integer *); \
    fmi2Status name##_fmi2DoStep(fmi2Component, fmi2Real, fmi2Real, fmi2Boolean); \
    void name##_fmi2FreeInstance(fmi2Component);

UNIT(NonlinearSiso)
UNIT(L1NonlinearSiso)
UNIT(ReferenceNonlinearSiso)

static void told(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category, fmi2String text, ...)
{
    (void)environment;
    fprintf(stderr, "%s %d %s: %s\n", name, (int)status, category, text);
}

static const fmi2CallbackFunctions callbacks = { told, calloc, free, NULL, NULL };

static void check(fmi2Status status)
{
    if (status != fmi2OK) {
        exit(1);
    }
}

/* Hands a value on. The references come from the descriptions. */
#define CONNECT(from, output, to, input) \
    do { \
        const fmi2ValueReference references[2] = { from##_##output, to##_##input }; \
        fmi2Real value; \
        check(from##_fmi2GetReal(from, &references[0], 1, &value)); \
        check(to##_fmi2SetReal(to, &references[1], 1, &value)); \
    } while (0)

#define BY_THE_EXPLICIT_METHOD(name) \
    do { \
        const fmi2ValueReference reference = name##_method; \
        const fmi2Integer method = 2; \
        check(name##_fmi2SetInteger(name, &reference, 1, &method)); \
    } while (0)

#define INSTANTIATE(name) \
    fmi2Component name = name##_fmi2Instantiate(#name, fmi2CoSimulation, name##_GUID, "", &callbacks, 0, 0); \
    if (name == NULL) { \
        return 2; \
    }

#define START(name) \
    check(name##_fmi2SetupExperiment(name, 0, 0.0, 0.0, 0, 0.0)); \
    check(name##_fmi2EnterInitializationMode(name)); \
    check(name##_fmi2ExitInitializationMode(name))

int main(void)
{
    INSTANTIATE(NonlinearSiso)
    INSTANTIATE(L1NonlinearSiso)
    INSTANTIATE(ReferenceNonlinearSiso)
    BY_THE_EXPLICIT_METHOD(NonlinearSiso);
    BY_THE_EXPLICIT_METHOD(L1NonlinearSiso);
    START(NonlinearSiso);
    START(L1NonlinearSiso);
    START(ReferenceNonlinearSiso);
    double largest = 0.0;
    for (int k = 0; k < 4000; ++k) {
        const double t = 1e-3 * k;
        const fmi2ValueReference references[2] = { ReferenceNonlinearSiso_r, NonlinearSiso_x1 };
        fmi2Real r;
        fmi2Real y;
        CONNECT(ReferenceNonlinearSiso, r, L1NonlinearSiso, r);
        CONNECT(NonlinearSiso, x1, L1NonlinearSiso, x1);
        CONNECT(NonlinearSiso, x2, L1NonlinearSiso, x2);
        CONNECT(L1NonlinearSiso, u, NonlinearSiso, u);
        check(ReferenceNonlinearSiso_fmi2GetReal(ReferenceNonlinearSiso, &references[0], 1, &r));
        check(NonlinearSiso_fmi2GetReal(NonlinearSiso, &references[1], 1, &y));
        if (k >= 2000) {
            largest = fmax(largest, fabs(y - r));
        }
        check(ReferenceNonlinearSiso_fmi2DoStep(ReferenceNonlinearSiso, t, 1e-3, 1));
        check(L1NonlinearSiso_fmi2DoStep(L1NonlinearSiso, t, 1e-3, 1));
        CONNECT(L1NonlinearSiso, u, NonlinearSiso, u);
        check(NonlinearSiso_fmi2DoStep(NonlinearSiso, t, 1e-3, 1));
    }
    NonlinearSiso_fmi2FreeInstance(NonlinearSiso);
    L1NonlinearSiso_fmi2FreeInstance(L1NonlinearSiso);
    ReferenceNonlinearSiso_fmi2FreeInstance(ReferenceNonlinearSiso);
    printf("%.17g\n", largest);
    return 0;
}
