/* Which function may be called when: the state machines of model exchange and of co-simulation (FMI 2.0.4, sections
 * 3.2.3 and 4.2.4) as one table. And what is common to all calls. */

#define I (1U << PHASE_INSTANTIATED)
#define M (1U << PHASE_INITIALIZATION)
#define V (1U << PHASE_EVENT)
#define C (1U << PHASE_CONTINUOUS_TIME)
#define S (1U << PHASE_STEP_COMPLETE)
#define D (1U << PHASE_STEP_FAILED)
#define T (1U << PHASE_TERMINATED)
#define E (1U << PHASE_ERROR)
#define ANY ((1U << PHASES) - 1U)

/* Function, in model exchange, in co-simulation. */
#define CALL_TABLE(ROW)                                                              \
    ROW(SetDebugLogging, ANY, ANY)                                                   \
    ROW(SetupExperiment, I, I)                                                       \
    ROW(EnterInitializationMode, I, I)                                               \
    ROW(ExitInitializationMode, M, M)                                                \
    /* In error too: masters that are refused there free an instance twice. */       \
    ROW(Terminate, V | C | E, S | D | E)                                             \
    ROW(Reset, ANY, ANY)                                                             \
    ROW(GetReal, M | V | C | T | E, M | S | D | T | E)                               \
    ROW(GetInteger, M | V | C | T | E, M | S | D | T | E)                            \
    ROW(GetBoolean, M | V | C | T | E, M | S | D | T | E)                            \
    ROW(GetString, M | V | C | T | E, M | S | D | T | E)                             \
    ROW(SetReal, I | M | V | C, I | M | S)                                           \
    /* Inputs in Continuous-Time Mode too, where masters set all of them; a change   \
     * waits for the next event. */                                                  \
    ROW(SetInteger, I | M | V | C, I | M | S)                                        \
    ROW(SetBoolean, I | M | V | C, I | M | S)                                        \
    ROW(SetString, I | M | V, I | M | S)                                             \
    ROW(GetFMUstate, ANY, ANY)                                                       \
    ROW(SetFMUstate, ANY, ANY)                                                       \
    ROW(FreeFMUstate, ANY, ANY)                                                      \
    ROW(SerializedFMUstateSize, ANY, ANY)                                            \
    ROW(SerializeFMUstate, ANY, ANY)                                                 \
    ROW(DeSerializeFMUstate, ANY, ANY)                                               \
    ROW(GetDirectionalDerivative, M | V | C | T | E, M | S | D | T | E)              \
    ROW(SetRealInputDerivatives, 0, I | M | S)                                       \
    ROW(GetRealOutputDerivatives, 0, S | D | T | E)                                  \
    ROW(DoStep, 0, S)                                                                \
    ROW(CancelStep, 0, 0)                                                            \
    ROW(GetStatus, 0, S | D | T | E)                                                 \
    ROW(GetRealStatus, 0, S | D | T | E)                                             \
    ROW(GetIntegerStatus, 0, S | D | T | E)                                          \
    ROW(GetBooleanStatus, 0, S | D | T | E)                                          \
    ROW(GetStringStatus, 0, S | D | T | E)                                           \
    ROW(EnterEventMode, V | C, 0)                                                    \
    ROW(NewDiscreteStates, V, 0)                                                     \
    ROW(EnterContinuousTimeMode, V, 0)                                               \
    ROW(CompletedIntegratorStep, C, 0)                                               \
    ROW(SetTime, V | C, 0)                                                           \
    ROW(SetContinuousStates, C, 0)                                                   \
    ROW(GetDerivatives, V | C | T | E, 0)                                            \
    ROW(GetEventIndicators, M | V | C | T | E, 0)                                    \
    ROW(GetContinuousStates, M | V | C | T | E, 0)                                   \
    ROW(GetNominalsOfContinuousStates, I | V | C | T | E, 0)

/* The functions that take an instance, but for fmi2FreeInstance, which is always allowed. */
#define FUNCTION_ITEM(function, model_exchange, co_simulation) CALL_##function,
typedef enum { CALL_TABLE(FUNCTION_ITEM) FUNCTIONS } Function;
#undef FUNCTION_ITEM

#define FUNCTION_NAME(function, model_exchange, co_simulation) "fmi2" #function,
static const char *const function_names[FUNCTIONS] = {CALL_TABLE(FUNCTION_NAME)};
#undef FUNCTION_NAME

/* In which phases each is allowed, by interface. */
#define FUNCTION_PHASES(function, model_exchange, co_simulation) {(model_exchange), (co_simulation)},
static const unsigned short function_phases[FUNCTIONS][2] = {CALL_TABLE(FUNCTION_PHASES)};
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
    if (call->function == CALL_CancelStep && interface == fmi2CoSimulation) {
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
    text_add(&call->why, "; it is when ");
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

static fmi2Status refused(Call *call, const char *reason) {
    text_add(why(call), reason);
    return fmi2Error;
}

/* Whether a call may be answered: the master has an instance, the table allows it, and no pointer that is needed is
 * NULL. */
static int call_begins(Call *call, fmi2Component c, Function function, int pointers_given) {
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

/* The logger runs in the host's modes. */
static void send(const Instance *instance, fmi2Status status, int category, const char *text) {
    const fmi2CallbackFunctions *master = &instance->callbacks;
    if (master->logger != NULL) {
        unsigned host = instance->host_modes;
        host_modes_back(host);
        master->logger(master->componentEnvironment, instance->name, status, unit_categories[category], text);
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
        send(instance, message.category == CATEGORY_EVENTS ? fmi2OK : fmi2Warning, message.category, room);
    }
}

static void send_all(const Call *call, fmi2Status status) {
    Instance *instance = call->instance;
    instance->log.refused = 0;
    if (instance->log.count == 0 && call->room[0] == '\0') {
        return;
    }
    instance->host_modes = call->host_modes;
    instance->sending++;
    send_waiting(instance);
    if (call->room[0] != '\0') {
        send(instance, status, status == fmi2Discard ? CATEGORY_DISCARD : CATEGORY_ERROR, call->room);
    }
    instance->sending--;
    if (instance->is_freed && instance->sending == 0) {
        release(instance);
    }
}

/* Ends a call: messages and the reason are sent as the last thing that it does, when nothing is half done. */
static fmi2Status call_ends(const Call *call, fmi2Status status) {
    if (call->instance != NULL) {
        send_all(call, status);
    }
    host_modes_back(call->host_modes);
    return status;
}
