/* An FMU of FMI 3.0 with an array of each type: y = u at any time, without Event Mode and with it. Crashes where `crash` is set. */

#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"

#define N 2

typedef struct {
    fmi3Float64 float64[N];
    fmi3Float32 float32[N];
    fmi3Int8 int8[N];
    fmi3UInt16 uint16[N];
    fmi3Int64 int64[N];
    fmi3UInt64 uint64;
    fmi3Boolean boolean[N];
    char text[64];
    fmi3Int32 crash;
    fmi3LogMessageCallback log;
    fmi3InstanceEnvironment environment;
} Unit;

static fmi3Status refuse(Unit *unit, const char *message) {
    unit->log(unit->environment, fmi3Error, "logStatusError", message);
    return fmi3Error;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference needed[], size_t n, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    Unit *unit;
    size_t end = strlen(resources);
    if (strcmp(token, "all types") != 0 || end == 0 || resources[end - 1] != '/' || !logging) {
        log(environment, fmi3Error, "logStatusError", "a wrong token, or resources without a separator at the end");
        return NULL;
    }
    unit = calloc(1, sizeof *unit);
    unit->log = log;
    unit->environment = environment;
    unit->float64[0] = 1, unit->float64[1] = 2, unit->float32[0] = unit->float32[1] = 0.5f;
    unit->int64[0] = 1, unit->int64[1] = 7, unit->boolean[1] = fmi3True;
    strcpy(unit->text, "hello");
    return unit;
}

void fmi3FreeInstance(fmi3Instance c) { free(c); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean known, fmi3Float64 tolerance, fmi3Float64 start, fmi3Boolean ends,
    fmi3Float64 stop) {
    return stop > start ? fmi3OK : refuse(c, "the stop time is not after the start time");
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c) { return fmi3OK; }
fmi3Status fmi3Terminate(fmi3Instance c) { return fmi3OK; }

/* Value references: 1 is the input, 2 the output of a type. */
#define ACCESS(Name, type, field, count)                                                                                          \
    fmi3Status fmi3Get##Name(fmi3Instance c, const fmi3ValueReference vr[], size_t n, type values[], size_t size) {               \
        size_t k;                                                                                                                 \
        for (k = 0; k < n; k++)                                                                                                   \
            if (vr[k] / 10 != field##_group || size != n * (count)) return refuse(c, "fmi3Get" #Name ": another number of values"); \
            else memcpy(values + k * (count), &((Unit *)c)->field, (count) * sizeof(type));                                       \
        return fmi3OK;                                                                                                            \
    }                                                                                                                             \
    fmi3Status fmi3Set##Name(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const type values[], size_t size) {         \
        if (n != 1 || vr[0] != field##_group * 10 || size != (count)) return refuse(c, "fmi3Set" #Name ": another number of values"); \
        memcpy(&((Unit *)c)->field, values, (count) * sizeof(type));                                                              \
        return fmi3OK;                                                                                                            \
    }

enum { float64_group = 1, float32_group, int8_group, uint16_group, int64_group, boolean_group = 7, crash_group };

ACCESS(Float64, fmi3Float64, float64, N)
ACCESS(Float32, fmi3Float32, float32, N)
ACCESS(Int8, fmi3Int8, int8, N)
ACCESS(UInt16, fmi3UInt16, uint16, N)
ACCESS(Int64, fmi3Int64, int64, N)

fmi3Status fmi3GetUInt64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3UInt64 values[], size_t size) {
    size_t k;
    for (k = 0; k < n; k++) values[k] = vr[k] == 99 ? N : ((Unit *)c)->uint64;
    return n == size ? fmi3OK : refuse(c, "fmi3GetUInt64: another number of values");
}

fmi3Status fmi3SetUInt64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3UInt64 values[], size_t size) {
    if (n != 1 || vr[0] != 60 || size != 1) return refuse(c, "fmi3SetUInt64: another number of values");
    ((Unit *)c)->uint64 = values[0];
    return fmi3OK;
}

ACCESS(Boolean, fmi3Boolean, boolean, N)
ACCESS(Int32, fmi3Int32, crash, 1)

fmi3Status fmi3SetString(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3String values[], size_t size) {
    strncpy(((Unit *)c)->text, values[0], sizeof ((Unit *)c)->text - 1);
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 step, fmi3Boolean prior, fmi3Boolean *event, fmi3Boolean *end,
    fmi3Boolean *early, fmi3Float64 *last) {
    Unit *unit = c;
    if (unit->crash == 1) abort();
    if (unit->crash == 2) return refuse(c, "it can't make this step");
    *event = *early = fmi3False;
    *end = unit->crash == 3;
    *last = time + step;
    return strcmp(unit->text, "hello") == 0 ? fmi3OK : refuse(c, "the text is not hello");
}
