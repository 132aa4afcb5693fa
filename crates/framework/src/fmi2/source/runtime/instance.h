/* One instance of the unit: its values, its parameters as a transaction, its inputs within a step, its saved states. */

#ifndef ADAPTIVE_FMU_INSTANCE_H
#define ADAPTIVE_FMU_INSTANCE_H

/* With UNIT_STATIC_INSTANCES: how many states each instance may save, and bytes of its name. */
#ifndef UNIT_STATIC_STATES
#define UNIT_STATIC_STATES 1
#endif
#ifndef UNIT_STATIC_NAME
#define UNIT_STATIC_NAME 64
#endif

/* The state of an instance. */
typedef enum {
    PHASE_INSTANTIATED,    /* after instantiation, or a reset */
    PHASE_INITIALIZATION,  /* Initialization Mode */
    PHASE_EVENT,           /* Event Mode: at an event, or right after initialisation; in FMI 2.0 in model exchange only */
    PHASE_CONTINUOUS_TIME, /* model exchange: being integrated by the master */
    PHASE_STEP_COMPLETE,   /* co-simulation: initialised; the last step, if any, is complete. Step Mode in FMI 3.0 */
    PHASE_STEP_FAILED,     /* co-simulation: the last step was discarded */
    PHASE_TERMINATED,      /* after the end */
    PHASE_ERROR,           /* a step or an event failed; values are those before it */
    PHASES
} Phase;

/* The items of choices that every unit has. */
enum { INPUTS_HOLD = 1, INPUTS_EXTRAPOLATE, INPUTS_INTERPOLATE };
enum { ON_FAILURE_ERROR = 1, ON_FAILURE_DISCARD };
/* Log categories that every unit has; its warnings have others. */
enum { CATEGORY_ERROR, CATEGORY_DISCARD, CATEGORY_WARNING, CATEGORY_EVENTS };

/* Tolerances below this only add up rounding errors. */
#define TIGHTEST_TOLERANCE R(1e-12)
/* How far, in parts of the step, a master's communication point may lie from where the instance stands: a clock of single
 * precision, or of whole microseconds, is no nearer. */
#define COMMUNICATION_POINT_SLACK 1e-3
/* Up to this, in parts of the step, it is the rounding of a master that adds up its steps, which needs no message. */
#define COMMUNICATION_POINT_ROUNDING 1e-6

/* All values. A copy of them is a copy of the instance. */
typedef struct {
    real v[UNIT_REALS];
    int n[AT_LEAST_ONE(UNIT_INTEGERS)];
} Block;

/* Everything that a continuation depends on. */
typedef struct {
    Block block;
    Phase phase;
    int has_stop_time;
    double stop_time;
} Snapshot;

/* A saved state. What the master holds is its slot and the slot's generation, never an address. */
typedef struct {
    size_t generation;
    Snapshot *saved; /* NULL where the slot is free */
} Slot;

typedef struct {
    Block block;
    Block saved;  /* as before the step that is being tried; a place to compute with other values, when none is */
    int fresh;    /* whether nothing was changed since everything was computed */
    Driver driver;
    real changes[UNIT_REALS]; /* directions go in, derivatives come out */
#if UNIT_INPUTS > 0
    real ramp_values[UNIT_INPUTS];
    real ramp_slopes[UNIT_INPUTS];
#endif
    Log log;

    Interface interface;
    Phase phase;
    int has_stop_time;
    double stop_time;

    Master master;
    char *name;
    unsigned char logged[UNIT_CATEGORIES]; /* log categories in which debug messages are wanted; in FMI 3.0 any but errors */
    int points_differ; /* whether it was logged that the master's communication points aren't the sums of its steps */
    int sending;     /* how many calls are sending messages: the master's logger may call in again */
    int is_freed;
    unsigned host_modes; /* of the floating-point unit, for the master's logger */
#if UNIT_FMI == 3
    int event_mode;   /* whether the master of a co-simulation handles events, in Event Mode, */
    int early_return; /* and whether a step may end at one */
    real indicators[AT_LEAST_ONE(UNIT_INDICATORS)]; /* as they were found last */
#endif

    size_t salt; /* mixed into generations, so that a state of another instance isn't taken for one of its own */
    Slot *slots;
    size_t slot_count;
#ifdef UNIT_STATIC_INSTANCES
    Slot slot_room[UNIT_STATIC_STATES];
    Snapshot snapshots[UNIT_STATIC_STATES];
    char name_room[UNIT_STATIC_NAME];
#endif
} Instance;

#endif
