/* The functions of FMI 3.0, but for those that FMI 2.0 has, too (both.c). */

FMI3_FUNCTION(const char *, fmi3GetVersion)(void) {
    return "3.0";
}

static void log_to(const Master *master, const char *instance, Status status, int category, const char *text) {
    (void)instance;
    master->logger(master->environment, (fmi3Status)status, unit_categories[category], text);
}

FMI3_FUNCTION(fmi3Instance, fmi3InstantiateModelExchange)(fmi3String name, fmi3String token, fmi3String resources,
                                                          fmi3Boolean visible, fmi3Boolean logging,
                                                          fmi3InstanceEnvironment environment,
                                                          fmi3LogMessageCallback logger) {
    (void)resources, (void)visible;
    const Master master = {environment, logger, NULL, NULL};
    Instance *instance = instantiate(&master, "fmi3InstantiateModelExchange", MODEL_EXCHANGE, name, token, logging);
    if (instance != NULL) {
        instance->event_mode = instance->early_return = 0;
    }
    return instance;
}

FMI3_FUNCTION(fmi3Instance, fmi3InstantiateCoSimulation)(fmi3String name, fmi3String token, fmi3String resources,
                                                         fmi3Boolean visible, fmi3Boolean logging,
                                                         fmi3Boolean event_mode, fmi3Boolean early_return,
                                                         const fmi3ValueReference intermediate[], size_t count,
                                                         fmi3InstanceEnvironment environment,
                                                         fmi3LogMessageCallback logger,
                                                         fmi3IntermediateUpdateCallback update) {
    (void)resources, (void)visible, (void)intermediate, (void)count, (void)update;
    const Master master = {environment, logger, NULL, NULL};
    Instance *instance = instantiate(&master, "fmi3InstantiateCoSimulation", CO_SIMULATION, name, token, logging);
    if (instance != NULL) {
        instance->event_mode = event_mode;
        instance->early_return = event_mode && early_return;
    }
    return instance;
}

/* No unit has it. */
FMI3_FUNCTION(fmi3Instance, fmi3InstantiateScheduledExecution)(fmi3String name, fmi3String token, fmi3String resources,
                                                               fmi3Boolean visible, fmi3Boolean logging,
                                                               fmi3InstanceEnvironment environment,
                                                               fmi3LogMessageCallback logger,
                                                               fmi3ClockUpdateCallback update,
                                                               fmi3LockPreemptionCallback lock,
                                                               fmi3UnlockPreemptionCallback unlock) {
    (void)token, (void)resources, (void)visible, (void)logging, (void)update, (void)lock, (void)unlock;
    const Master master = {environment, logger, NULL, NULL};
    tell_no_instance(&master, "fmi3InstantiateScheduledExecution", name,
                     "there is no scheduled execution: use co-simulation or model exchange");
    return NULL;
}

FMI3_FUNCTION(void, fmi3FreeInstance)(fmi3Instance c) {
    free_instance(c);
}

static Status enter_initialization_mode(Call *call, int tolerance_defined, double tolerance, double start, int stop_defined,
                                        double stop) {
    Status status = setup_experiment(call, tolerance_defined, tolerance, start, stop_defined, stop);
    return status == STATUS_OK ? go_to(call, PHASE_INITIALIZATION) : status;
}

FMI3_FUNCTION(fmi3Status, fmi3EnterInitializationMode)(fmi3Instance c, fmi3Boolean tolerance_defined,
                                                       fmi3Float64 tolerance, fmi3Float64 start,
                                                       fmi3Boolean stop_defined, fmi3Float64 stop) {
    ANSWER(c, EnterInitializationMode, 1,
           enter_initialization_mode(&call, tolerance_defined, tolerance, start, stop_defined, stop));
}

FMI3_FUNCTION(fmi3Status, fmi3EnterEventMode)(fmi3Instance c) {
    ANSWER(c, EnterEventMode, 1, enter_event_mode_of_step(&call));
}

FMI3_FUNCTION(fmi3Status, fmi3EnterConfigurationMode)(fmi3Instance c) {
    ANSWER(c, EnterConfigurationMode, 1, refused(&call, ": this FMU has no structural parameters"));
}

/* Never allowed. */
FMI3_FUNCTION(fmi3Status, fmi3ExitConfigurationMode)(fmi3Instance c) {
    ANSWER(c, ExitConfigurationMode, 1, STATUS_ERROR);
}

FMI3_GETTER(Float64) {
    ANSWER(c, GetReal, has_elements(references, count) && has_elements(values, values_count),
           check_values_of(&call, references, count, values_count)
               ? get_real(&call, walk_over(references, count), values)
               : STATUS_ERROR);
}

FMI3_SETTER(Float64) {
    ANSWER(c, SetReal, has_elements(references, count) && has_elements(values, values_count),
           check_values_of(&call, references, count, values_count)
               ? set_real_values(&call, walk_over(references, count), values)
               : STATUS_ERROR);
}

/* A Boolean of a master's may be any byte. */
static void put_whole(Function function, void *values, size_t k, int value) {
    if (function == CALL_GetEnumeration) {
        ((fmi3Int64 *)values)[k] = value;
    } else if (function == CALL_GetBoolean) {
        ((fmi3Boolean *)values)[k] = value != 0;
    } else {
        ((fmi3Int32 *)values)[k] = value;
    }
}

static int64_t whole_at(Function function, const void *values, size_t k) {
    if (function == CALL_SetEnumeration) {
        return ((const fmi3Int64 *)values)[k];
    }
    return function == CALL_SetBoolean ? ((const unsigned char *)values)[k] : ((const fmi3Int32 *)values)[k];
}

/* The getter and the setter of a type of whole numbers. */
#define WHOLE_ACCESS(Type, name, type)                                                                                 \
    FMI3_GETTER(Type) {                                                                                                \
        ANSWER(c, Get##name, has_elements(references, count) && has_elements(values, values_count),                    \
               check_whole(&call, references, count, values_count)                                                     \
                   ? get_integer(&call, type, walk_over(references, count), values)                                    \
                   : STATUS_ERROR);                                                                                    \
    }                                                                                                                  \
    FMI3_SETTER(Type) {                                                                                                \
        ANSWER(c, Set##name, has_elements(references, count) && has_elements(values, values_count),                    \
               check_whole(&call, references, count, values_count)                                                     \
                   ? set_integer_values(&call, type, walk_over(references, count), values)                             \
                   : STATUS_ERROR);                                                                                    \
    }
WHOLE_ACCESS(Int32, Integer, TYPE_INTEGER)
WHOLE_ACCESS(Int64, Enumeration, TYPE_INTEGER)
WHOLE_ACCESS(Boolean, Boolean, TYPE_BOOLEAN)

/* Functions of types that no unit has: they give and set nothing. */
static Status no_such_type(Call *call, const char *function, const char *type, size_t count) {
    if (count == 0) {
        return STATUS_OK;
    }
    call->why = text_in(call->room, sizeof call->room);
    text_add(&call->why, function);
    text_add(&call->why, ": this FMU has no variable of type ");
    text_add(&call->why, type);
    return STATUS_ERROR;
}

/* Allowed in the same phases: in all of them. */
#define NO_TYPE(function, type, count) \
    ANSWER(c, GetNumberOfVariableDependencies, 1, no_such_type(&call, function, type, (count)))
#define NO_ACCESS(Type)                              \
    FMI3_GETTER(Type) {                              \
        (void)references, (void)values;              \
        (void)values_count;                          \
        NO_TYPE("fmi3Get" #Type, #Type, count);      \
    }                                                \
    FMI3_SETTER(Type) {                              \
        (void)references, (void)values;              \
        (void)values_count;                          \
        NO_TYPE("fmi3Set" #Type, #Type, count);      \
    }
NO_ACCESS(Float32)
NO_ACCESS(Int8)
NO_ACCESS(UInt8)
NO_ACCESS(Int16)
NO_ACCESS(UInt16)
NO_ACCESS(UInt32)
NO_ACCESS(UInt64)
NO_ACCESS(String)

FMI3_FUNCTION(fmi3Status, fmi3GetBinary)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                         size_t sizes[], fmi3Binary values[], size_t values_count) {
    (void)references, (void)sizes, (void)values, (void)values_count;
    NO_TYPE("fmi3GetBinary", "Binary", count);
}

FMI3_FUNCTION(fmi3Status, fmi3SetBinary)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                         const size_t sizes[], const fmi3Binary values[], size_t values_count) {
    (void)references, (void)sizes, (void)values, (void)values_count;
    NO_TYPE("fmi3SetBinary", "Binary", count);
}

FMI3_FUNCTION(fmi3Status, fmi3GetClock)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                        fmi3Clock values[]) {
    (void)references, (void)values;
    NO_TYPE("fmi3GetClock", "Clock", count);
}

FMI3_FUNCTION(fmi3Status, fmi3SetClock)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                        const fmi3Clock values[]) {
    (void)references, (void)values;
    NO_TYPE("fmi3SetClock", "Clock", count);
}

FMI3_FUNCTION(fmi3Status, fmi3GetIntervalDecimal)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                                  fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[]) {
    (void)references, (void)intervals, (void)qualifiers;
    NO_TYPE("fmi3GetIntervalDecimal", "Clock", count);
}

FMI3_FUNCTION(fmi3Status, fmi3GetIntervalFraction)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                                   fmi3UInt64 counters[], fmi3UInt64 resolutions[],
                                                   fmi3IntervalQualifier qualifiers[]) {
    (void)references, (void)counters, (void)resolutions, (void)qualifiers;
    NO_TYPE("fmi3GetIntervalFraction", "Clock", count);
}

FMI3_FUNCTION(fmi3Status, fmi3GetShiftDecimal)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                               fmi3Float64 shifts[]) {
    (void)references, (void)shifts;
    NO_TYPE("fmi3GetShiftDecimal", "Clock", count);
}

FMI3_FUNCTION(fmi3Status, fmi3GetShiftFraction)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                                fmi3UInt64 counters[], fmi3UInt64 resolutions[]) {
    (void)references, (void)counters, (void)resolutions;
    NO_TYPE("fmi3GetShiftFraction", "Clock", count);
}

FMI3_FUNCTION(fmi3Status, fmi3SetIntervalDecimal)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                                  const fmi3Float64 intervals[]) {
    (void)references, (void)intervals;
    NO_TYPE("fmi3SetIntervalDecimal", "Clock", count);
}

FMI3_FUNCTION(fmi3Status, fmi3SetIntervalFraction)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                                   const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]) {
    (void)references, (void)counters, (void)resolutions;
    NO_TYPE("fmi3SetIntervalFraction", "Clock", count);
}

FMI3_FUNCTION(fmi3Status, fmi3SetShiftDecimal)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                               const fmi3Float64 shifts[]) {
    (void)references, (void)shifts;
    NO_TYPE("fmi3SetShiftDecimal", "Clock", count);
}

FMI3_FUNCTION(fmi3Status, fmi3SetShiftFraction)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                                const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]) {
    (void)references, (void)counters, (void)resolutions;
    NO_TYPE("fmi3SetShiftFraction", "Clock", count);
}

FMI3_FUNCTION(fmi3Status, fmi3ActivateModelPartition)(fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time) {
    (void)clock, (void)time;
    NO_TYPE("fmi3ActivateModelPartition", "Clock", 1);
}

FMI3_FUNCTION(fmi3Status, fmi3GetNumberOfVariableDependencies)(fmi3Instance c, fmi3ValueReference dependent,
                                                               size_t *count) {
    ANSWER(c, GetNumberOfVariableDependencies, count != NULL, count_dependences(&call, dependent, count));
}

FMI3_FUNCTION(fmi3Status, fmi3GetVariableDependencies)(fmi3Instance c, fmi3ValueReference dependent,
                                                       size_t dependent_elements[], fmi3ValueReference independents[],
                                                       size_t independent_elements[], fmi3DependencyKind kinds[],
                                                       size_t count) {
    Dependences found = {dependent_elements, independents, independent_elements, kinds, 0};
    ANSWER(c, GetVariableDependencies,
           has_elements(dependent_elements, count) && has_elements(independents, count) &&
               has_elements(independent_elements, count) && has_elements(kinds, count),
           give_dependences(&call, dependent, &found, count));
}

/* References and numbers of values of unknowns and knowns, as the functions of derivatives have them. */
typedef struct {
    const Reference *references;
    size_t count;
    size_t values;
} Asked;

static int check_asked(Call *call, Asked unknowns, Asked knowns) {
    return check_values_of(call, unknowns.references, unknowns.count, unknowns.values) &&
           check_values_of(call, knowns.references, knowns.count, knowns.values);
}

#define DERIVATIVES_GIVEN                                                                                              \
    (has_elements(unknowns, unknown_count) && has_elements(knowns, known_count) && has_elements(seed, seed_count) &&   \
     has_elements(result, result_count))

FMI3_FUNCTION(fmi3Status, fmi3GetDirectionalDerivative)(fmi3Instance c, const fmi3ValueReference unknowns[],
                                                        size_t unknown_count, const fmi3ValueReference knowns[],
                                                        size_t known_count, const fmi3Float64 seed[], size_t seed_count,
                                                        fmi3Float64 result[], size_t result_count) {
    const Asked of = {unknowns, unknown_count, result_count}, by = {knowns, known_count, seed_count};
    ANSWER(c, GetDirectionalDerivative, DERIVATIVES_GIVEN,
           check_asked(&call, of, by) ? get_directional_derivative(&call, walk_over(unknowns, unknown_count),
                                                                   walk_over(knowns, known_count), seed, result)
                                      : STATUS_ERROR);
}

FMI3_FUNCTION(fmi3Status, fmi3GetAdjointDerivative)(fmi3Instance c, const fmi3ValueReference unknowns[],
                                                    size_t unknown_count, const fmi3ValueReference knowns[],
                                                    size_t known_count, const fmi3Float64 seed[], size_t seed_count,
                                                    fmi3Float64 result[], size_t result_count) {
    const Asked of = {unknowns, unknown_count, seed_count}, by = {knowns, known_count, result_count};
    ANSWER(c, GetAdjointDerivative, DERIVATIVES_GIVEN,
           check_asked(&call, of, by) ? get_adjoint_derivative(&call, walk_over(unknowns, unknown_count),
                                                               walk_over(knowns, known_count), seed, result)
                                      : STATUS_ERROR);
}

FMI3_FUNCTION(fmi3Status, fmi3GetOutputDerivatives)(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                                    const fmi3Int32 orders[], fmi3Float64 values[],
                                                    size_t values_count) {
    ANSWER(c, GetRealOutputDerivatives,
           has_elements(references, count) && has_elements(orders, count) && has_elements(values, values_count),
           check_values_of(&call, references, count, values_count)
               ? get_output_derivatives(&call, walk_over(references, count), orders, values)
               : STATUS_ERROR);
}

static Status evaluate_discrete_states(Call *call) {
    evaluate(call->instance);
    return STATUS_OK;
}

FMI3_FUNCTION(fmi3Status, fmi3EvaluateDiscreteStates)(fmi3Instance c) {
    ANSWER(c, EvaluateDiscreteStates, 1, evaluate_discrete_states(&call));
}

FMI3_FUNCTION(fmi3Status, fmi3UpdateDiscreteStates)(fmi3Instance c, fmi3Boolean *needed, fmi3Boolean *terminate_now,
                                                    fmi3Boolean *nominals, fmi3Boolean *values, fmi3Boolean *defined,
                                                    fmi3Float64 *time) {
    Update update = {0, 0, R(0.0)};
    const int given = needed != NULL && terminate_now != NULL && nominals != NULL && values != NULL && defined != NULL &&
                      time != NULL;
    Call call;
    Status status = STATUS_ERROR;
    if (call_begins(&call, c, CALL_NewDiscreteStates, given)) {
        status = new_discrete_states(&call, &update);
    }
    if (status == STATUS_OK) {
        /* Other units may answer to outputs that have jumped; their answer is another update's. */
        *needed = update.changed != 0;
        *terminate_now = *nominals = false;
        *values = update.states_jumped != 0;
        *defined = isfinite(update.next_event) != 0;
        *time = *defined ? (double)update.next_event : 0.0;
    }
    return (fmi3Status)call_ends(&call, status);
}

static Status give_number(size_t *count, size_t number) {
    *count = number;
    return STATUS_OK;
}

FMI3_FUNCTION(fmi3Status, fmi3GetNumberOfEventIndicators)(fmi3Instance c, size_t *count) {
    ANSWER(c, GetNumberOfEventIndicators, count != NULL, give_number(count, UNIT_INDICATORS));
}

FMI3_FUNCTION(fmi3Status, fmi3GetNumberOfContinuousStates)(fmi3Instance c, size_t *count) {
    ANSWER(c, GetNumberOfContinuousStates, count != NULL, give_number(count, UNIT_STATES));
}

FMI3_FUNCTION(fmi3Status, fmi3EnterStepMode)(fmi3Instance c) {
    ANSWER(c, EnterStepMode, 1, enter_step_mode(&call));
}

FMI3_FUNCTION(fmi3Status, fmi3DoStep)(fmi3Instance c, fmi3Float64 point, fmi3Float64 step, fmi3Boolean no_set_prior,
                                      fmi3Boolean *event_needed, fmi3Boolean *terminate_now, fmi3Boolean *early_return,
                                      fmi3Float64 *last_time) {
    (void)no_set_prior;
    const int given = event_needed != NULL && terminate_now != NULL && early_return != NULL && last_time != NULL;
    Stepped stepped = {0, 0, 0.0};
    Call call;
    Status status = STATUS_ERROR;
    if (call_begins(&call, c, CALL_DoStep, given)) {
        status = step_with_events(&call, point, step, &stepped);
        *event_needed = stepped.event_needed != 0;
        *terminate_now = false;
        *early_return = stepped.early_return != 0;
        *last_time = stepped.last_time;
    }
    return (fmi3Status)call_ends(&call, status);
}
