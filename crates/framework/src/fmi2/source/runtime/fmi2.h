/* The C interface of FMI 2.0.4 (model exchange and co-simulation), as this unit offers it. */

#ifndef ADAPTIVE_FMU_FMI2_H
#define ADAPTIVE_FMU_FMI2_H

#include <stddef.h>

/* Where the sources are compiled into a program, FMI2_FUNCTION_PREFIX goes before every name (by the standard that is the
 * model identifier and an underscore), so that several units fit into one. For a shared library it is not defined, or
 * empty: then the names are those of the standard, and seen outside. */
#if defined(FMI2_FUNCTION_PREFIX) && 0 - FMI2_FUNCTION_PREFIX - 1 != 1
#define FMI2_HAS_PREFIX
#define FMI2_JOIN(prefix, name) prefix##name
#define FMI2_JOINED(prefix, name) FMI2_JOIN(prefix, name)
#define FMI2_NAME(name) FMI2_JOINED(FMI2_FUNCTION_PREFIX, name)
#else
#define FMI2_NAME(name) name
#endif

/* The names that these have in sources of either standard. */
#ifdef FMI2_STATIC_INSTANCES
#define UNIT_STATIC_INSTANCES FMI2_STATIC_INSTANCES
#endif
#ifdef FMI2_STATIC_STATES
#define UNIT_STATIC_STATES FMI2_STATIC_STATES
#endif
#ifdef FMI2_STATIC_NAME
#define UNIT_STATIC_NAME FMI2_STATIC_NAME
#endif

#ifndef FMI2_Export
#if defined(FMI2_HAS_PREFIX)
#define FMI2_Export
#elif defined(_WIN32) || defined(__CYGWIN__)
#define FMI2_Export __declspec(dllexport)
#elif defined(__GNUC__)
#define FMI2_Export __attribute__((visibility("default")))
#else
#define FMI2_Export
#endif
#endif

/* Handles: an instance, the master's own environment, a saved state. */
typedef void *fmi2Component;
typedef void *fmi2ComponentEnvironment;
typedef void *fmi2FMUstate;

/* Values. */
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef char fmi2Char;
typedef char fmi2Byte;
typedef const fmi2Char *fmi2String;
enum { fmi2False, fmi2True };

typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;

typedef void (*fmi2CallbackLogger)(fmi2ComponentEnvironment environment, fmi2String instance, fmi2Status status,
                                   fmi2String category, fmi2String format, ...);
typedef void *(*fmi2CallbackAllocateMemory)(size_t count, size_t size);
typedef void (*fmi2CallbackFreeMemory)(void *memory);
typedef void (*fmi2StepFinished)(fmi2ComponentEnvironment environment, fmi2Status status);

typedef struct {
    fmi2CallbackLogger logger;
    fmi2CallbackAllocateMemory allocateMemory;
    fmi2CallbackFreeMemory freeMemory;
    fmi2StepFinished stepFinished;
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

typedef struct {
    fmi2Boolean newDiscreteStatesNeeded;
    fmi2Boolean terminateSimulation;
    fmi2Boolean nominalsOfContinuousStatesChanged;
    fmi2Boolean valuesOfContinuousStatesChanged;
    fmi2Boolean nextEventTimeDefined;
    fmi2Real nextEventTime;
} fmi2EventInfo;

#define FMI2_FUNCTION(type, name) FMI2_Export type FMI2_NAME(name)

FMI2_FUNCTION(const char *, fmi2GetTypesPlatform)(void);
FMI2_FUNCTION(const char *, fmi2GetVersion)(void);
FMI2_FUNCTION(fmi2Component, fmi2Instantiate)(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                              const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                                              fmi2Boolean logging);
FMI2_FUNCTION(void, fmi2FreeInstance)(fmi2Component c);
FMI2_FUNCTION(fmi2Status, fmi2SetDebugLogging)(fmi2Component c, fmi2Boolean on, size_t count,
                                               const fmi2String categories[]);
FMI2_FUNCTION(fmi2Status, fmi2SetupExperiment)(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance,
                                               fmi2Real start, fmi2Boolean stop_defined, fmi2Real stop);
FMI2_FUNCTION(fmi2Status, fmi2EnterInitializationMode)(fmi2Component c);
FMI2_FUNCTION(fmi2Status, fmi2ExitInitializationMode)(fmi2Component c);
FMI2_FUNCTION(fmi2Status, fmi2Terminate)(fmi2Component c);
FMI2_FUNCTION(fmi2Status, fmi2Reset)(fmi2Component c);

FMI2_FUNCTION(fmi2Status, fmi2GetReal)(fmi2Component c, const fmi2ValueReference references[], size_t count,
                                       fmi2Real values[]);
FMI2_FUNCTION(fmi2Status, fmi2GetInteger)(fmi2Component c, const fmi2ValueReference references[], size_t count,
                                          fmi2Integer values[]);
FMI2_FUNCTION(fmi2Status, fmi2GetBoolean)(fmi2Component c, const fmi2ValueReference references[], size_t count,
                                          fmi2Boolean values[]);
FMI2_FUNCTION(fmi2Status, fmi2GetString)(fmi2Component c, const fmi2ValueReference references[], size_t count,
                                         fmi2String values[]);
FMI2_FUNCTION(fmi2Status, fmi2SetReal)(fmi2Component c, const fmi2ValueReference references[], size_t count,
                                       const fmi2Real values[]);
FMI2_FUNCTION(fmi2Status, fmi2SetInteger)(fmi2Component c, const fmi2ValueReference references[], size_t count,
                                          const fmi2Integer values[]);
FMI2_FUNCTION(fmi2Status, fmi2SetBoolean)(fmi2Component c, const fmi2ValueReference references[], size_t count,
                                          const fmi2Boolean values[]);
FMI2_FUNCTION(fmi2Status, fmi2SetString)(fmi2Component c, const fmi2ValueReference references[], size_t count,
                                         const fmi2String values[]);

FMI2_FUNCTION(fmi2Status, fmi2GetFMUstate)(fmi2Component c, fmi2FMUstate *state);
FMI2_FUNCTION(fmi2Status, fmi2SetFMUstate)(fmi2Component c, fmi2FMUstate state);
FMI2_FUNCTION(fmi2Status, fmi2FreeFMUstate)(fmi2Component c, fmi2FMUstate *state);
FMI2_FUNCTION(fmi2Status, fmi2SerializedFMUstateSize)(fmi2Component c, fmi2FMUstate state, size_t *size);
FMI2_FUNCTION(fmi2Status, fmi2SerializeFMUstate)(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size);
FMI2_FUNCTION(fmi2Status, fmi2DeSerializeFMUstate)(fmi2Component c, const fmi2Byte bytes[], size_t size,
                                                   fmi2FMUstate *state);
FMI2_FUNCTION(fmi2Status, fmi2GetDirectionalDerivative)(fmi2Component c, const fmi2ValueReference unknowns[],
                                                        size_t unknown_count, const fmi2ValueReference knowns[],
                                                        size_t known_count, const fmi2Real seed[], fmi2Real result[]);

/* Co-simulation. */
FMI2_FUNCTION(fmi2Status, fmi2SetRealInputDerivatives)(fmi2Component c, const fmi2ValueReference references[],
                                                       size_t count, const fmi2Integer orders[],
                                                       const fmi2Real values[]);
FMI2_FUNCTION(fmi2Status, fmi2GetRealOutputDerivatives)(fmi2Component c, const fmi2ValueReference references[],
                                                        size_t count, const fmi2Integer orders[], fmi2Real values[]);
FMI2_FUNCTION(fmi2Status, fmi2DoStep)(fmi2Component c, fmi2Real point, fmi2Real step, fmi2Boolean no_set_prior);
FMI2_FUNCTION(fmi2Status, fmi2CancelStep)(fmi2Component c);
FMI2_FUNCTION(fmi2Status, fmi2GetStatus)(fmi2Component c, fmi2StatusKind kind, fmi2Status *value);
FMI2_FUNCTION(fmi2Status, fmi2GetRealStatus)(fmi2Component c, fmi2StatusKind kind, fmi2Real *value);
FMI2_FUNCTION(fmi2Status, fmi2GetIntegerStatus)(fmi2Component c, fmi2StatusKind kind, fmi2Integer *value);
FMI2_FUNCTION(fmi2Status, fmi2GetBooleanStatus)(fmi2Component c, fmi2StatusKind kind, fmi2Boolean *value);
FMI2_FUNCTION(fmi2Status, fmi2GetStringStatus)(fmi2Component c, fmi2StatusKind kind, fmi2String *value);

/* Model exchange. */
FMI2_FUNCTION(fmi2Status, fmi2EnterEventMode)(fmi2Component c);
FMI2_FUNCTION(fmi2Status, fmi2NewDiscreteStates)(fmi2Component c, fmi2EventInfo *info);
FMI2_FUNCTION(fmi2Status, fmi2EnterContinuousTimeMode)(fmi2Component c);
FMI2_FUNCTION(fmi2Status, fmi2CompletedIntegratorStep)(fmi2Component c, fmi2Boolean no_set_prior,
                                                       fmi2Boolean *enter_event_mode, fmi2Boolean *terminate);
FMI2_FUNCTION(fmi2Status, fmi2SetTime)(fmi2Component c, fmi2Real time);
FMI2_FUNCTION(fmi2Status, fmi2SetContinuousStates)(fmi2Component c, const fmi2Real states[], size_t count);
FMI2_FUNCTION(fmi2Status, fmi2GetDerivatives)(fmi2Component c, fmi2Real derivatives[], size_t count);
FMI2_FUNCTION(fmi2Status, fmi2GetEventIndicators)(fmi2Component c, fmi2Real indicators[], size_t count);
FMI2_FUNCTION(fmi2Status, fmi2GetContinuousStates)(fmi2Component c, fmi2Real states[], size_t count);
FMI2_FUNCTION(fmi2Status, fmi2GetNominalsOfContinuousStates)(fmi2Component c, fmi2Real nominals[], size_t count);

#endif
