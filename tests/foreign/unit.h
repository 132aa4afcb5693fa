/* A unit of FMI 2.0 for co-simulation as another tool might write it: whatever a test needs, in a few lines of C.

   A source defines VARIABLES, how many there are, and these two functions, then includes this file:
     static void outputs(double *v, double time);        outputs from states, inputs and parameters
     static void step(double *v, double time, double h); states at time + h from those at time
   Values lie in v by their value references, those of integers and truth values too. */

#include <stddef.h>
#include <stdlib.h>

typedef struct {
    double v[VARIABLES];
    double time;
} Unit;

#define EXPORT __attribute__((visibility("default")))
enum { OK = 0, ERROR = 3 };

#ifndef START
#define START(v)
#endif

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }
EXPORT int fmi2SetDebugLogging(void *c, int on, size_t n, const char *const *s) { return OK; }

EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const void *callbacks,
                             int visible, int logging) {
    Unit *unit = calloc(1, sizeof(Unit));
    if (unit) { START(unit->v); }
    return unit;
}

EXPORT void fmi2FreeInstance(void *c) { free(c); }

EXPORT int fmi2SetupExperiment(void *c, int has_tolerance, double tolerance, double start, int has_stop, double stop) {
    ((Unit *)c)->time = start;
    return OK;
}

EXPORT int fmi2EnterInitializationMode(void *c) { return OK; }
EXPORT int fmi2ExitInitializationMode(void *c) { return OK; }
EXPORT int fmi2Terminate(void *c) { return OK; }
EXPORT int fmi2Reset(void *c) { return OK; }

#define ACCESS(Name, type)                                                                            \
    EXPORT int fmi2Get##Name(void *c, const unsigned *reference, size_t count, type *value) {         \
        Unit *unit = c;                                                                               \
        outputs(unit->v, unit->time);                                                                 \
        for (size_t k = 0; k < count; k++) {                                                          \
            if (reference[k] >= VARIABLES) return ERROR;                                              \
            value[k] = (type)unit->v[reference[k]];                                                   \
        }                                                                                             \
        return OK;                                                                                    \
    }                                                                                                 \
    EXPORT int fmi2Set##Name(void *c, const unsigned *reference, size_t count, const type *value) {   \
        Unit *unit = c;                                                                               \
        for (size_t k = 0; k < count; k++) {                                                          \
            if (reference[k] >= VARIABLES) return ERROR;                                              \
            unit->v[reference[k]] = value[k];                                                         \
        }                                                                                             \
        return OK;                                                                                    \
    }

ACCESS(Real, double)
ACCESS(Integer, int)
ACCESS(Boolean, int)

EXPORT int fmi2GetString(void *c, const unsigned *reference, size_t count, const char **value) { return ERROR; }
EXPORT int fmi2SetString(void *c, const unsigned *reference, size_t count, const char *const *value) { return OK; }

EXPORT int fmi2DoStep(void *c, double time, double h, int no_set_state_before) {
    Unit *unit = c;
    step(unit->v, time, h);
    unit->time = time + h;
    return OK;
}
