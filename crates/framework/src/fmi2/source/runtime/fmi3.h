/* The C interface of FMI 3.0.2 (model exchange and co-simulation), as this unit offers it. */

#ifndef ADAPTIVE_FMU_FMI3_H
#define ADAPTIVE_FMU_FMI3_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Where the sources are compiled into a program, FMI3_FUNCTION_PREFIX goes before every name (by the standard that is the
 * model identifier and an underscore), so that several units fit into one. For a shared library it is not defined, or
 * empty: then the names are those of the standard, and seen outside. With FMI3_OVERRIDE_FUNCTION_PREFIX it is
 * FMI3_ACTUAL_FUNCTION_PREFIX that goes before them, where that is defined. */
#if !defined(FMI3_OVERRIDE_FUNCTION_PREFIX) && defined(FMI3_FUNCTION_PREFIX) && 0 - FMI3_FUNCTION_PREFIX - 1 != 1
#define FMI3_ACTUAL_FUNCTION_PREFIX FMI3_FUNCTION_PREFIX
#endif
#ifdef FMI3_ACTUAL_FUNCTION_PREFIX
#define FMI3_JOIN(prefix, name) prefix##name
#define FMI3_JOINED(prefix, name) FMI3_JOIN(prefix, name)
#define FMI3_NAME(name) FMI3_JOINED(FMI3_ACTUAL_FUNCTION_PREFIX, name)
#else
#define FMI3_NAME(name) name
#endif

#ifndef FMI3_Export
#if defined(FMI3_ACTUAL_FUNCTION_PREFIX)
#define FMI3_Export
#elif defined(_WIN32) || defined(__CYGWIN__)
#define FMI3_Export __declspec(dllexport)
#elif defined(__GNUC__)
#define FMI3_Export __attribute__((visibility("default")))
#else
#define FMI3_Export
#endif
#endif

/* Handles: an instance, the master's own environment, a saved state. */
typedef void *fmi3Instance;
typedef void *fmi3InstanceEnvironment;
typedef void *fmi3FMUState;

/* Values. */
typedef uint32_t fmi3ValueReference;
typedef float fmi3Float32;
typedef double fmi3Float64;
typedef int8_t fmi3Int8;
typedef uint8_t fmi3UInt8;
typedef int16_t fmi3Int16;
typedef uint16_t fmi3UInt16;
typedef int32_t fmi3Int32;
typedef uint32_t fmi3UInt32;
typedef int64_t fmi3Int64;
typedef uint64_t fmi3UInt64;
typedef bool fmi3Boolean;
typedef bool fmi3Clock;
typedef char fmi3Char;
typedef uint8_t fmi3Byte;
typedef const fmi3Char *fmi3String;
typedef const fmi3Byte *fmi3Binary;

typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef enum {
    fmi3Independent,
    fmi3Constant,
    fmi3Fixed,
    fmi3Tunable,
    fmi3Discrete,
    fmi3Dependent
} fmi3DependencyKind;
typedef enum { fmi3IntervalNotYetKnown, fmi3IntervalUnchanged, fmi3IntervalChanged } fmi3IntervalQualifier;

typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category,
                                       fmi3String message);
typedef void (*fmi3ClockUpdateCallback)(fmi3InstanceEnvironment environment);
typedef void (*fmi3IntermediateUpdateCallback)(fmi3InstanceEnvironment environment, fmi3Float64 time,
                                               fmi3Boolean set_requested, fmi3Boolean get_allowed,
                                               fmi3Boolean step_finished, fmi3Boolean can_return_early,
                                               fmi3Boolean *early_return_requested, fmi3Float64 *early_return_time);
typedef void (*fmi3LockPreemptionCallback)(void);
typedef void (*fmi3UnlockPreemptionCallback)(void);

#define FMI3_FUNCTION(type, name) FMI3_Export type FMI3_NAME(name)

FMI3_FUNCTION(const char *, fmi3GetVersion)(void);
FMI3_FUNCTION(fmi3Status, fmi3SetDebugLogging)(fmi3Instance c, fmi3Boolean on, size_t count,
                                               const fmi3String categories[]);
FMI3_FUNCTION(fmi3Instance, fmi3InstantiateModelExchange)(fmi3String name, fmi3String token, fmi3String resources,
                                                          fmi3Boolean visible, fmi3Boolean logging,
                                                          fmi3InstanceEnvironment environment,
                                                          fmi3LogMessageCallback logger);
FMI3_FUNCTION(fmi3Instance, fmi3InstantiateCoSimulation)(fmi3String name, fmi3String token, fmi3String resources,
                                                         fmi3Boolean visible, fmi3Boolean logging,
                                                         fmi3Boolean event_mode, fmi3Boolean early_return,
                                                         const fmi3ValueReference intermediate[], size_t count,
                                                         fmi3InstanceEnvironment environment,
                                                         fmi3LogMessageCallback logger,
                                                         fmi3IntermediateUpdateCallback update);
FMI3_FUNCTION(fmi3Instance, fmi3InstantiateScheduledExecution)(fmi3String name, fmi3String token, fmi3String resources,
                                                               fmi3Boolean visible, fmi3Boolean logging,
                                                               fmi3InstanceEnvironment environment,
                                                               fmi3LogMessageCallback logger,
                                                               fmi3ClockUpdateCallback update,
                                                               fmi3LockPreemptionCallback lock,
                                                               fmi3UnlockPreemptionCallback unlock);
FMI3_FUNCTION(void, fmi3FreeInstance)(fmi3Instance c);
FMI3_FUNCTION(fmi3Status, fmi3EnterInitializationMode)(fmi3Instance c, fmi3Boolean tolerance_defined,
                                                       fmi3Float64 tolerance, fmi3Float64 start,
                                                       fmi3Boolean stop_defined, fmi3Float64 stop);
FMI3_FUNCTION(fmi3Status, fmi3ExitInitializationMode)(fmi3Instance c);
FMI3_FUNCTION(fmi3Status, fmi3EnterEventMode)(fmi3Instance c);
FMI3_FUNCTION(fmi3Status, fmi3Terminate)(fmi3Instance c);
FMI3_FUNCTION(fmi3Status, fmi3Reset)(fmi3Instance c);

/* fmi3GetFloat64, fmi3SetFloat64 and those of the other types. */
#define FMI3_GETTER(Type)                                                                                              \
    FMI3_FUNCTION(fmi3Status, fmi3Get##Type)(fmi3Instance c, const fmi3ValueReference references[], size_t count,        \
                                             fmi3##Type values[], size_t values_count)
#define FMI3_SETTER(Type)                                                                                              \
    FMI3_FUNCTION(fmi3Status, fmi3Set##Type)(fmi3Instance c, const fmi3ValueReference references[], size_t count,        \
                                             const fmi3##Type values[], size_t values_count)
FMI3_GETTER(Float32);
FMI3_GETTER(Float64);
FMI3_GETTER(Int8);
FMI3_GETTER(UInt8);
FMI3_GETTER(Int16);
FMI3_GETTER(UInt16);
FMI3_GETTER(Int32);
FMI3_GETTER(UInt32);
FMI3_GETTER(Int64);
FMI3_GETTER(UInt64);
FMI3_GETTER(Boolean);
FMI3_GETTER(String);
FMI3_SETTER(Float32);
FMI3_SETTER(Float64);
FMI3_SETTER(Int8);
FMI3_SETTER(UInt8);
FMI3_SETTER(Int16);
FMI3_SETTER(UInt16);
FMI3_SETTER(Int32);
FMI3_SETTER(UInt32);
FMI3_SETTER(Int64);
FMI3_SETTER(UInt64);
FMI3_SETTER(Boolean);
FMI3_SETTER(String);
FMI3_FUNCTION(fmi3Status, fmi3GetBinary)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                         size_t sizes[], fmi3Binary values[], size_t values_count);
FMI3_FUNCTION(fmi3Status, fmi3SetBinary)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                         const size_t sizes[], const fmi3Binary values[], size_t values_count);

FMI3_FUNCTION(fmi3Status, fmi3GetClock)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                        fmi3Clock values[]);
FMI3_FUNCTION(fmi3Status, fmi3SetClock)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                        const fmi3Clock values[]);
FMI3_FUNCTION(fmi3Status, fmi3GetIntervalDecimal)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                                  fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[]);
FMI3_FUNCTION(fmi3Status, fmi3GetIntervalFraction)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                                   fmi3UInt64 counters[], fmi3UInt64 resolutions[],
                                                   fmi3IntervalQualifier qualifiers[]);
FMI3_FUNCTION(fmi3Status, fmi3GetShiftDecimal)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                               fmi3Float64 shifts[]);
FMI3_FUNCTION(fmi3Status, fmi3GetShiftFraction)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                                fmi3UInt64 counters[], fmi3UInt64 resolutions[]);
FMI3_FUNCTION(fmi3Status, fmi3SetIntervalDecimal)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                                  const fmi3Float64 intervals[]);
FMI3_FUNCTION(fmi3Status, fmi3SetIntervalFraction)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                                   const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]);
FMI3_FUNCTION(fmi3Status, fmi3SetShiftDecimal)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                               const fmi3Float64 shifts[]);
FMI3_FUNCTION(fmi3Status, fmi3SetShiftFraction)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                                const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]);
FMI3_FUNCTION(fmi3Status, fmi3ActivateModelPartition)(fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time);

FMI3_FUNCTION(fmi3Status, fmi3GetNumberOfVariableDependencies)(fmi3Instance c, fmi3ValueReference dependent,
                                                               size_t *count);
FMI3_FUNCTION(fmi3Status, fmi3GetVariableDependencies)(fmi3Instance c, fmi3ValueReference dependent,
                                                       size_t dependent_elements[], fmi3ValueReference independents[],
                                                       size_t independent_elements[], fmi3DependencyKind kinds[],
                                                       size_t count);
FMI3_FUNCTION(fmi3Status, fmi3GetFMUState)(fmi3Instance c, fmi3FMUState *state);
FMI3_FUNCTION(fmi3Status, fmi3SetFMUState)(fmi3Instance c, fmi3FMUState state);
FMI3_FUNCTION(fmi3Status, fmi3FreeFMUState)(fmi3Instance c, fmi3FMUState *state);
FMI3_FUNCTION(fmi3Status, fmi3SerializedFMUStateSize)(fmi3Instance c, fmi3FMUState state, size_t *size);
FMI3_FUNCTION(fmi3Status, fmi3SerializeFMUState)(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size);
FMI3_FUNCTION(fmi3Status, fmi3DeserializeFMUState)(fmi3Instance c, const fmi3Byte bytes[], size_t size,
                                                   fmi3FMUState *state);
FMI3_FUNCTION(fmi3Status, fmi3GetDirectionalDerivative)(fmi3Instance c, const fmi3ValueReference unknowns[],
                                                        size_t unknown_count, const fmi3ValueReference knowns[],
                                                        size_t known_count, const fmi3Float64 seed[], size_t seed_count,
                                                        fmi3Float64 result[], size_t result_count);
FMI3_FUNCTION(fmi3Status, fmi3GetAdjointDerivative)(fmi3Instance c, const fmi3ValueReference unknowns[],
                                                    size_t unknown_count, const fmi3ValueReference knowns[],
                                                    size_t known_count, const fmi3Float64 seed[], size_t seed_count,
                                                    fmi3Float64 result[], size_t result_count);
FMI3_FUNCTION(fmi3Status, fmi3EnterConfigurationMode)(fmi3Instance c);
FMI3_FUNCTION(fmi3Status, fmi3ExitConfigurationMode)(fmi3Instance c);
FMI3_FUNCTION(fmi3Status, fmi3EvaluateDiscreteStates)(fmi3Instance c);
FMI3_FUNCTION(fmi3Status, fmi3UpdateDiscreteStates)(fmi3Instance c, fmi3Boolean *needed, fmi3Boolean *terminate_now,
                                                    fmi3Boolean *nominals, fmi3Boolean *values, fmi3Boolean *defined,
                                                    fmi3Float64 *time);

/* Model exchange. */
FMI3_FUNCTION(fmi3Status, fmi3EnterContinuousTimeMode)(fmi3Instance c);
FMI3_FUNCTION(fmi3Status, fmi3CompletedIntegratorStep)(fmi3Instance c, fmi3Boolean no_set_prior, fmi3Boolean *event_mode,
                                                       fmi3Boolean *terminate_now);
FMI3_FUNCTION(fmi3Status, fmi3SetTime)(fmi3Instance c, fmi3Float64 time);
FMI3_FUNCTION(fmi3Status, fmi3SetContinuousStates)(fmi3Instance c, const fmi3Float64 states[], size_t count);
FMI3_FUNCTION(fmi3Status, fmi3GetContinuousStateDerivatives)(fmi3Instance c, fmi3Float64 derivatives[], size_t count);
FMI3_FUNCTION(fmi3Status, fmi3GetEventIndicators)(fmi3Instance c, fmi3Float64 indicators[], size_t count);
FMI3_FUNCTION(fmi3Status, fmi3GetContinuousStates)(fmi3Instance c, fmi3Float64 states[], size_t count);
FMI3_FUNCTION(fmi3Status, fmi3GetNominalsOfContinuousStates)(fmi3Instance c, fmi3Float64 nominals[], size_t count);
FMI3_FUNCTION(fmi3Status, fmi3GetNumberOfEventIndicators)(fmi3Instance c, size_t *count);
FMI3_FUNCTION(fmi3Status, fmi3GetNumberOfContinuousStates)(fmi3Instance c, size_t *count);

/* Co-simulation. */
FMI3_FUNCTION(fmi3Status, fmi3EnterStepMode)(fmi3Instance c);
FMI3_FUNCTION(fmi3Status, fmi3GetOutputDerivatives)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                                    const fmi3Int32 orders[], fmi3Float64 values[],
                                                    size_t values_count);
FMI3_FUNCTION(fmi3Status, fmi3DoStep)(fmi3Instance c, fmi3Float64 point, fmi3Float64 step, fmi3Boolean no_set_prior,
                                      fmi3Boolean *event_needed, fmi3Boolean *terminate_now, fmi3Boolean *early_return,
                                      fmi3Float64 *last_time);

#endif
