/* A unit of one output y = t and one parameter k = 1, for co-simulation, with faults that are chosen when it is built:
   NAN_OUTPUT, FAILING_STEP, OTHER_START, ONLY_ONE, NO_STEP (not exported), NO_STATE (not exported), UNLOADABLE;
   and with what the standard allows: STRICT (the parameter can't be read in Initialization Mode), FIXED_STEP (each step
   must be 0.3 s, to the last digit), NAN_LOCAL (the variable 2 is NaN). */
#include <math.h>
#include <stddef.h>
#include <stdlib.h>

#define STUB(name, ...) int name(__VA_ARGS__) { return 3; }
#define DONE(name, ...) int name(__VA_ARGS__) { return 0; }

typedef void *C;
typedef struct { double k, time; int initialized; } Unit;
static int instances = 0;

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }

C fmi2Instantiate(const char *name, int kind, const char *guid, const char *at, const void *f, int visible, int log) {
#ifdef ONLY_ONE
    if (instances) return NULL;
#endif
    Unit *unit = calloc(1, sizeof(Unit));
    unit->k = 1.0;
#ifdef OTHER_START
    unit->k = 2.0;
#endif
    instances++;
    return unit;
}

void fmi2FreeInstance(C unit) { instances--; free(unit); }

int fmi2GetReal(C c, const unsigned *references, size_t n, double *values) {
    Unit *unit = c;
#ifdef STRICT
    for (size_t i = 0; i < n; i++) if (references[i] == 1 && !unit->initialized) return 3;
#endif
    for (size_t i = 0; i < n; i++) values[i] = references[i] == 1 ? unit->k : unit->time;
#ifdef NAN_OUTPUT
    for (size_t i = 0; i < n; i++) if (references[i] == 0 && unit->time > 0.25) values[i] = NAN;
#endif
#ifdef NAN_LOCAL
    for (size_t i = 0; i < n; i++) if (references[i] == 2) values[i] = NAN;
#endif
    return 0;
}

int fmi2SetReal(C c, const unsigned *references, size_t n, const double *values) {
    for (size_t i = 0; i < n; i++) if (references[i] == 1) ((Unit *)c)->k = values[i];
    return 0;
}

#ifndef NO_STEP
int fmi2DoStep(C c, double time, double step, int new_values) {
#ifdef FAILING_STEP
    if (time > 0.25) return 3;
#endif
#ifdef FIXED_STEP
    if (step != 0.3) return 3;
#endif
    ((Unit *)c)->time = time + step;
    return 0;
}
#endif

#ifdef UNLOADABLE
extern int nothing_of_this_name;
int *missing = &nothing_of_this_name;
#endif

#ifndef NO_STATE
STUB(fmi2GetFMUstate, C c, void **state)
#endif

DONE(fmi2SetDebugLogging, C c, int on, size_t n, const char *const *categories)
DONE(fmi2SetupExperiment, C c, int a, double b, double start, int d, double stop)
DONE(fmi2EnterInitializationMode, C c)
int fmi2ExitInitializationMode(C c) { ((Unit *)c)->initialized = 1; return 0; }
DONE(fmi2Terminate, C c)
DONE(fmi2Reset, C c)
DONE(fmi2GetInteger, C c, const unsigned *references, size_t n, int *values)
DONE(fmi2GetBoolean, C c, const unsigned *references, size_t n, int *values)
DONE(fmi2GetString, C c, const unsigned *references, size_t n, const char **values)
DONE(fmi2SetInteger, C c, const unsigned *references, size_t n, const int *values)
DONE(fmi2SetBoolean, C c, const unsigned *references, size_t n, const int *values)
DONE(fmi2SetString, C c, const unsigned *references, size_t n, const char *const *values)
STUB(fmi2SetFMUstate, C c, void *state)
STUB(fmi2FreeFMUstate, C c, void **state)
STUB(fmi2SerializedFMUstateSize, C c, void *state, size_t *size)
STUB(fmi2SerializeFMUstate, C c, void *state, char *bytes, size_t size)
STUB(fmi2DeSerializeFMUstate, C c, const char *bytes, size_t size, void **state)
STUB(fmi2GetDirectionalDerivative, C c, const unsigned *z, size_t nz, const unsigned *v, size_t nv, const double *d, double *r)
STUB(fmi2SetRealInputDerivatives, C c, const unsigned *references, size_t n, const int *order, const double *values)
STUB(fmi2GetRealOutputDerivatives, C c, const unsigned *references, size_t n, const int *order, double *values)
STUB(fmi2CancelStep, C c)
STUB(fmi2GetStatus, C c, int kind, int *value)
STUB(fmi2GetRealStatus, C c, int kind, double *value)
STUB(fmi2GetIntegerStatus, C c, int kind, int *value)
STUB(fmi2GetBooleanStatus, C c, int kind, int *value)
STUB(fmi2GetStringStatus, C c, int kind, const char **value)
