/* Which function may be called when: the state machines of model exchange and of co-simulation (FMI 2.0.4, sections
 * 3.2.3 and 4.2.4; FMI 3.0.2, sections 3.2 and 4.2) as one table. And what is common to all calls. */

#define I (1U << PHASE_INSTANTIATED)
#define M (1U << PHASE_INITIALIZATION)
#define V (1U << PHASE_EVENT)
#define C (1U << PHASE_CONTINUOUS_TIME)
#define S (1U << PHASE_STEP_COMPLETE)
#define D (1U << PHASE_STEP_FAILED)
#define T (1U << PHASE_TERMINATED)
#define E (1U << PHASE_ERROR)
#define ANY ((1U << PHASES) - 1U)
#define DONE (T | E)

/* Function in FMI 2.0, its name in FMI 3.0; in model exchange and in co-simulation of FMI 2.0, and of FMI 3.0. */
#define CALL_TABLE(ROW)                                                                                                        \
    ROW(SetDebugLogging, SetDebugLogging, ANY, ANY, ANY, ANY)                                                                  \
    ROW(SetupExperiment, EnterInitializationMode, I, I, 0, 0)                                                                  \
    ROW(EnterInitializationMode, EnterInitializationMode, I, I, I, I)                                                          \
    ROW(ExitInitializationMode, ExitInitializationMode, M, M, M, M)                                                            \
    /* In error too: masters that are refused there free an instance twice. */                                                 \
    ROW(Terminate, Terminate, V | C | E, S | D | E, V | C | E, V | S | D | E)                                                  \
    ROW(Reset, Reset, ANY, ANY, ANY, ANY)                                                                                      \
    ROW(GetReal, GetFloat64, M | V | C | DONE, M | S | D | DONE, I | M | V | C | DONE, I | M | V | S | D | DONE)               \
    ROW(GetInteger, GetInt32, M | V | C | DONE, M | S | D | DONE, I | M | V | C | DONE, I | M | V | S | D | DONE)              \
    ROW(GetBoolean, GetBoolean, M | V | C | DONE, M | S | D | DONE, I | M | V | C | DONE, I | M | V | S | D | DONE)            \
    ROW(GetString, GetString, M | V | C | DONE, M | S | D | DONE, I | M | V | C | DONE, I | M | V | S | D | DONE)              \
    ROW(SetReal, SetFloat64, I | M | V | C, I | M | S, I | M | V | C, I | M | V | S)                                           \
    /* Inputs in Continuous-Time Mode too, where masters set all of them; a change waits for the next event. */                \
    ROW(SetInteger, SetInt32, I | M | V | C, I | M | S, I | M | V | C, I | M | V | S)                                          \
    ROW(SetBoolean, SetBoolean, I | M | V | C, I | M | S, I | M | V | C, I | M | V | S)                                        \
    ROW(SetString, SetString, I | M | V, I | M | S, I | M | V, I | M | V | S)                                                  \
    ROW(GetFMUstate, GetFMUState, ANY, ANY, ANY, ANY)                                                                          \
    ROW(SetFMUstate, SetFMUState, ANY, ANY, ANY, ANY)                                                                          \
    ROW(FreeFMUstate, FreeFMUState, ANY, ANY, ANY, ANY)                                                                        \
    ROW(SerializedFMUstateSize, SerializedFMUStateSize, ANY, ANY, ANY, ANY)                                                    \
    ROW(SerializeFMUstate, SerializeFMUState, ANY, ANY, ANY, ANY)                                                              \
    ROW(DeSerializeFMUstate, DeserializeFMUState, ANY, ANY, ANY, ANY)                                                          \
    ROW(GetDirectionalDerivative, GetDirectionalDerivative, M | V | C | DONE, M | S | D | DONE, M | V | C | DONE,              \
        M | V | S | D | DONE)                                                                                                  \
    ROW(SetRealInputDerivatives, SetRealInputDerivatives, 0, I | M | S, 0, 0)                                                  \
    ROW(GetRealOutputDerivatives, GetOutputDerivatives, 0, S | D | DONE, 0, S | D | DONE)                                      \
    ROW(DoStep, DoStep, 0, S, 0, S)                                                                                            \
    ROW(CancelStep, CancelStep, 0, 0, 0, 0)                                                                                    \
    ROW(GetStatus, GetStatus, 0, S | D | DONE, 0, 0)                                                                           \
    ROW(GetRealStatus, GetRealStatus, 0, S | D | DONE, 0, 0)                                                                   \
    ROW(GetIntegerStatus, GetIntegerStatus, 0, S | D | DONE, 0, 0)                                                             \
    ROW(GetBooleanStatus, GetBooleanStatus, 0, S | D | DONE, 0, 0)                                                             \
    ROW(GetStringStatus, GetStringStatus, 0, S | D | DONE, 0, 0)                                                               \
    ROW(EnterEventMode, EnterEventMode, V | C, 0, V | C, V | S)                                                                \
    ROW(NewDiscreteStates, UpdateDiscreteStates, V, 0, V, V)                                                                   \
    ROW(EnterContinuousTimeMode, EnterContinuousTimeMode, V, 0, V, 0)                                                          \
    ROW(CompletedIntegratorStep, CompletedIntegratorStep, C, 0, C, 0)                                                          \
    ROW(SetTime, SetTime, V | C, 0, V | C, 0)                                                                                  \
    ROW(SetContinuousStates, SetContinuousStates, C, 0, C, 0)                                                                  \
    ROW(GetDerivatives, GetContinuousStateDerivatives, V | C | DONE, 0, M | V | C | DONE, 0)                                   \
    ROW(GetEventIndicators, GetEventIndicators, M | V | C | DONE, 0, M | V | C | DONE, 0)                                      \
    ROW(GetContinuousStates, GetContinuousStates, M | V | C | DONE, 0, M | V | C | DONE, 0)                                    \
    ROW(GetNominalsOfContinuousStates, GetNominalsOfContinuousStates, I | V | C | DONE, 0, I | M | V | C | DONE, 0)            \
    /* Not in FMI 2.0. */                                                                                                      \
    ROW(GetEnumeration, GetInt64, 0, 0, I | M | V | C | DONE, I | M | V | S | D | DONE)                                        \
    ROW(SetEnumeration, SetInt64, 0, 0, I | M | V | C, I | M | V | S)                                                          \
    ROW(EnterConfigurationMode, EnterConfigurationMode, 0, 0, I, I)                                                            \
    ROW(ExitConfigurationMode, ExitConfigurationMode, 0, 0, 0, 0)                                                              \
    ROW(EnterStepMode, EnterStepMode, 0, 0, 0, V)                                                                              \
    ROW(EvaluateDiscreteStates, EvaluateDiscreteStates, 0, 0, V, V)                                                            \
    ROW(GetAdjointDerivative, GetAdjointDerivative, 0, 0, M | V | C | DONE, M | V | S | D | DONE)                              \
    ROW(GetNumberOfVariableDependencies, GetNumberOfVariableDependencies, 0, 0, ANY, ANY)                                      \
    ROW(GetVariableDependencies, GetVariableDependencies, 0, 0, ANY, ANY)                                                      \
    ROW(GetNumberOfEventIndicators, GetNumberOfEventIndicators, 0, 0, ANY, 0)                                                  \
    ROW(GetNumberOfContinuousStates, GetNumberOfContinuousStates, 0, 0, ANY, 0)

/* The functions that take an instance, but for those that free it, which are always allowed. Named as in FMI 2.0, where they are
 * there. */
#define FUNCTION_ITEM(name, name_3, me_2, cs_2, me_3, cs_3) CALL_##name,
typedef enum { CALL_TABLE(FUNCTION_ITEM) FUNCTIONS } Function;
#undef FUNCTION_ITEM

/* Their names, and in which phases each is allowed, by interface. */
#if UNIT_FMI == 3
#define FUNCTION_NAME(name, name_3, me_2, cs_2, me_3, cs_3) "fmi3" #name_3,
#define FUNCTION_PHASES(name, name_3, me_2, cs_2, me_3, cs_3) {(me_3), (cs_3)},
#else
#define FUNCTION_NAME(name, name_3, me_2, cs_2, me_3, cs_3) "fmi2" #name,
#define FUNCTION_PHASES(name, name_3, me_2, cs_2, me_3, cs_3) {(me_2), (cs_2)},
#endif
static const char *const function_names[FUNCTIONS] = {CALL_TABLE(FUNCTION_NAME)};
static const unsigned short function_phases[FUNCTIONS][2] = {CALL_TABLE(FUNCTION_PHASES)};
#undef FUNCTION_NAME
#undef FUNCTION_PHASES

#undef I
#undef M
#undef V
#undef C
#undef S
#undef D
#undef T
#undef E
#undef ANY
#undef DONE

static const char *const phase_names[PHASES] = {
    "instantiated (not yet initialised)",
    "in Initialization Mode",
    "in Event Mode",
    "in Continuous-Time Mode",
    "initialised, its last step complete",
    "after a discarded step",
    "terminated",
    "in error after a failed step or event; restore a state or reset it, or terminate it",
};

static const char *const interface_names[2] = {"model exchange", "co-simulation"};

/* A call into an instance. What answers it writes its reason into `why`, which begins with the function's name. */
typedef struct {
    Instance *instance;
    Function function;
    unsigned host_modes;
    Text why;
    char room[TEXT_ROOM];
} Call;

static int is_allowed(const Call *call, int phase) {
    return (function_phases[call->function][call->instance->interface] >> phase & 1U) != 0;
}

/* Tells why the instance may not be called now. */
static void tell_not_allowed(Call *call) {
    int interface = (int)call->instance->interface, first = 1;
    if (call->function == CALL_CancelStep && interface == CO_SIMULATION) {
        text_add(&call->why, ": steps are never asynchronous, so there is none to cancel");
        return;
    }
    if (function_phases[call->function][interface] == 0) {
        text_add(&call->why, " belongs to ");
        text_add(&call->why, interface_names[1 - interface]);
        text_add(&call->why, "; this is a ");
        text_add(&call->why, interface_names[interface]);
        text_add(&call->why, " instance");
        return;
    }
    text_add(&call->why, " is not allowed while the instance is ");
    text_add(&call->why, phase_names[call->instance->phase]);
    text_add(&call->why, "; it is allowed when ");
    for (int phase = 0; phase < PHASES; phase++) {
        if (is_allowed(call, phase)) {
            text_add(&call->why, first ? "" : ", or ");
            text_add(&call->why, phase_names[phase]);
            first = 0;
        }
    }
}

/* Begins the reason of a call. */
static Text *why(Call *call) {
    call->why = text_in(call->room, sizeof call->room);
    text_add(&call->why, function_names[call->function]);
    return &call->why;
}

static Status refused(Call *call, const char *reason) {
    text_add(why(call), reason);
    return STATUS_ERROR;
}

/* Whether a call may be answered: the master has an instance, the table allows it, and no pointer that is needed is
 * NULL. */
static int call_begins(Call *call, void *c, Function function, int pointers_given) {
    call->host_modes = host_modes_aside();
    call->instance = c;
    call->function = function;
    call->room[0] = '\0';
    if (c == NULL || call->instance->is_freed) {
        return 0;
    }
    if (!is_allowed(call, (int)call->instance->phase)) {
        why(call);
        tell_not_allowed(call);
        return 0;
    }
    if (!pointers_given) {
        refused(call, ": a pointer is NULL");
    }
    return pointers_given;
}

/* Whether an array may be read or written: NULL may have no elements. */
static int has_elements(const void *array, size_t count) {
    return array != NULL || count == 0;
}

static void release(Instance *instance);

/* Calls the master's logger. */
static void log_to(const Master *master, const char *instance, Status status, int category, const char *text);

/* The logger runs in the host's modes. In FMI 3.0 only errors are sent to a master that asked for no messages. */
static void send(const Instance *instance, Status status, int category, const char *text) {
    if (UNIT_FMI == 3 && status != STATUS_ERROR && !instance->logged[category]) {
        return;
    }
    if (instance->master.logger != NULL) {
        unsigned host = instance->host_modes;
        host_modes_back(host);
        log_to(&instance->master, instance->name, status, category, text);
        (void)host_modes_aside();
    }
}

/* Sends the messages that wait. The master's logger may call this instance again, which then sends the rest of them. */
static void send_waiting(Instance *instance) {
    Log *log = &instance->log;
    while (log->sent < log->count) {
        Message message = log->waiting[log->sent++];
        int left_out = log->left_out, is_last = log->sent == log->count;
        if (is_last) {
            log->sent = log->count = log->left_out = 0;
        }
        char room[TEXT_ROOM];
        Text text = text_in(room, sizeof room);
        text_marked(&text, message.text, message.values, message.count);
        if (is_last && left_out > 0) {
            text_add(&text, " (messages left out after this one: ");
            text_integer(&text, left_out);
            text_add(&text, ")");
        }
        send(instance, message.category == CATEGORY_EVENTS ? STATUS_OK : STATUS_WARNING, message.category, room);
    }
}

static void send_all(const Call *call, Status status) {
    Instance *instance = call->instance;
    instance->log.refused = 0;
    if (instance->log.count == 0 && call->room[0] == '\0') {
        return;
    }
    instance->host_modes = call->host_modes;
    instance->sending++;
    send_waiting(instance);
    if (call->room[0] != '\0') {
        send(instance, status, status == STATUS_DISCARD ? CATEGORY_DISCARD : CATEGORY_ERROR, call->room);
    }
    instance->sending--;
    if (instance->is_freed && instance->sending == 0) {
        release(instance);
    }
}

/* Ends a call: messages and the reason are sent as the last thing that it does, when nothing is half done. */
static Status call_ends(const Call *call, Status status) {
    if (call->instance != NULL) {
        send_all(call, status);
    }
    host_modes_back(call->host_modes);
    return status;
}

/* Answers a call: nothing is done where it isn't allowed, or where a pointer that is needed is NULL. */
#define ANSWER(c, function, pointers_given, answer)                           \
    do {                                                                      \
        Call call;                                                            \
        Status status = STATUS_ERROR;                                         \
        if (call_begins(&call, (c), CALL_##function, (pointers_given) != 0)) { \
            status = (answer);                                                \
        }                                                                     \
        return (MasterStatus)call_ends(&call, status);                        \
    } while (0)
