/* What is integrated, by what, and why a step can't be finished.
 *
 * A communication step is taken by substeps of a one-step method under error control, or by a fixed number of them. It
 * keeps no history: what a continuation goes on with is the Pace, which lies in the block between steps. The files of the
 * integrator, in the order in which they are compiled: problem.c, explicit.c, order_8.c, elimination.c, stiff.c, spectrum.c,
 * stability.c, choice.c, chosen.c, indicators.c, events.c, fixed.c, driver.c. Functions that may fail return 1, or 0 with the error filled in. */

#ifndef ADAPTIVE_FMU_PROBLEM_H
#define ADAPTIVE_FMU_PROBLEM_H

#include "runtime.h"

/* Whether anything moves between time events. */
#define UNIT_MOVES (UNIT_STATES > 0 || UNIT_INDICATORS > 0)
/* The stiff method needs states, and is dense; eigenvalues of larger systems take too long. */
#define UNIT_HAS_ORDER_8 UNIT_MOVES
#define UNIT_HAS_STIFF (UNIT_STATES > 0 && UNIT_STATES <= 2000)
#define UNIT_HAS_SPECTRUM (UNIT_STATES > 0 && UNIT_STATES <= 250)

/* Everything that an evaluation writes, with the states between. */
#define EVALUATED (FIRST_RATE + UNIT_STATES - FIRST_INPUT)

/* A value beyond this, in magnitude, is divergence. */
#define DIVERGENCE_LIMIT R(1e12)
/* Tolerance where the unit has no parameter for it. */
#define DEFAULT_TOLERANCE R(1e-6)

/* The items of integration_method. */
enum { METHOD_AUTOMATIC = 1, METHOD_EXPLICIT, METHOD_STIFF, METHOD_FIXED };

/* How a communication step is integrated. */
typedef struct {
    int method;              /* METHOD_AUTOMATIC where there is no choice */
    int fixed_steps;         /* substeps of METHOD_FIXED */
    real relative_tolerance; /* in each substep, relative to the larger of a state's magnitude and its nominal value */
    real most_work;          /* that a communication step may take, in elementary operations */
    int leaves_end;          /* whether time events at its end are left for what comes after it */
} Settings;

/* A pair of eigenvalues, or a real one: its growth rate in 1/s, its frequency in rad/s. */
typedef struct {
    real growth;
    real frequency;
} Mode;

/* What eigenvalues allow, as the reciprocals of substeps, 1/s; 0 where they set no limit. */
typedef struct {
    real stable;  /* that what decays does */
    real growing; /* that what grows does so at its rate */
} ExplicitLimits;
typedef struct {
    ExplicitLimits order_5; /* the explicit methods */
    ExplicitLimits order_8;
    real stiff; /* the stiff one, that what grows does so at its rate */
    Mode mode;  /* the mode that sets the limit of growth */
    real carried; /* how many times as far as well-damped modes the least damped oscillation carries an error; up to 1: none does */
} Limits;

/* What integrates. */
typedef enum { BY_NOTHING, BY_EXPLICIT, BY_STIFF, BY_FIXED, METHODS } Integrates;

/* A choice between methods: whether a user asked for it, and since when. The substep to which stability holds the explicit
 * method, s, and the mode that does; 0 where none does, or none was looked at. */
typedef struct {
    Integrates by;
    int is_asked_for;
    int is_last; /* whether no further change is told */
    real from;
    real substep;
    Mode mode;
} Chosen;

/* The choices so far, and the one that nobody was told of. */
typedef struct {
    int seen[METHODS];
    Integrates in_force;
    Integrates told; /* the one that was told last */
    int changes;
    Chosen news;
} Choices;

/* What a continuation goes on with. */
typedef struct {
    real substep;   /* to begin with; 0 where none is known yet */
    real substep_8; /* the same of the explicit method of order 8 */
    int stiff;      /* whether the stiff method is in force */
    int evidence;   /* substeps that spoke for the other method, less those that didn't */
    Limits limits;
    real jacobian_size; /* when the stiff method looked at its eigenvalues, 1/s */
    real until_look;    /* work until the next look */
    real interval;      /* work between the last looks of the stiff method */
} Pace;

/* The unit's values, and how its inputs change: linearly from ramp_values, which they have at ramp_time. Where they are
 * held they stay as they are. */
typedef struct {
    real *v;
    int *n;
    int held;
    const real *ramp_values;
    const real *ramp_slopes;
    real ramp_time;
    Log *log;
    int moved; /* true if inputs change within the communication step, or since the one before */
} Problem;

/* Why a step can't be finished. */
enum {
    STEP_DIVERGED = 1,   /* variable, value, time */
    STEP_TOO_SMALL,      /* variable, value, step, tolerance, time */
    STEP_NO_JACOBIAN,    /* variable, time */
    STEP_TOO_MUCH_WORK,  /* events, substeps, step, time; the mode that was followed */
    STEP_ACCUMULATION,   /* variable, events, close, time */
    STEP_GOES_THROUGH,   /* variable, events, time */
    STEP_TOO_MANY_EVENTS,/* events, time */
    STEP_UNSOUND,        /* time; the reasons lie in the log */
    STEP_INVALID,        /* the same; time is no number where they were found at none */
    STEP_PARAMETERS      /* the reasons lie in the log */
};

/* Of a state or an output: its place in the block. Of an event indicator: its number from 0. */
enum { TIME_OF_NEXT_EVENT = -1 };

typedef struct {
    int kind; /* 0: there is none */
    int variable;
    real time;
    real value;
    real step;
    real tolerance;
    long events;
    long substeps;
    long close;
    int follows;
    Mode mode;
} StepError;

/* Where a substep begins: time, states and their derivatives. */
typedef struct {
    real time;
    real states[AT_LEAST_ONE(UNIT_STATES)];
    real rates[AT_LEAST_ONE(UNIT_STATES)];
} Start;

/* The error of an attempt in units of what is tolerated, and the state that has it. */
typedef struct {
    real scaled;
    int state;
} Estimate;

#if UNIT_INDICATORS > 0
/* What is known of the event indicators within a step. What is known of them between steps lies in the block. */
typedef struct {
    /* Values where a substep ends, and between. */
    real after[UNIT_INDICATORS];
    real between[UNIT_INDICATORS];
    /* Which changed sides at the event that is being handled, and the sides where they were. */
    unsigned char crossed[UNIT_INDICATORS];
    real came_from[UNIT_INDICATORS];
    /* Which of them never came back to their sides from the event before. */
    unsigned char never_back[UNIT_INDICATORS];
    /* Which ones an event left as they were, or put to zero. */
    unsigned char untouched[UNIT_INDICATORS];
    /* Changes along the tangents of the motion that an event met and of the one that it left. */
    real approach[UNIT_INDICATORS];
    real leaving[UNIT_INDICATORS];
    /* The length of the substep in which the last event was located, s. */
    real span;
    /* Mean rates in the last substep, and its length; 0 where nothing was before. */
    real slopes[UNIT_INDICATORS];
    real substep;
    /* States behind an event, and discrete values that it met. */
    real states[AT_LEAST_ONE(UNIT_STATES)];
    real discrete[AT_LEAST_ONE(UNIT_DISCRETES)];
    int discrete_integers[AT_LEAST_ONE(UNIT_INTEGER_DISCRETES)];
} Indicators;
#endif

/* Integrates one instance; holds its workspace, and nothing that a continuation depends on. One of zeros is ready. */
typedef struct {
    Start start;
    /* For messages alone. */
    Choices choices;
    /* Work of the communication step so far, in elementary operations. */
    real work;
    /* Whether an explicit substep goes by the method of order 8. Decided anew in each. */
    int by_order_8;
    /* Derivatives at the stages of an explicit method, or the stages of the stiff one and what a further one leaves; the errors
     * of their states. */
    real stages[UNIT_HAS_ORDER_8 ? 10 : UNIT_HAS_STIFF ? 9 : 8][AT_LEAST_ONE(UNIT_STATES)];
    real errors[AT_LEAST_ONE(UNIT_STATES)];
    /* What an evaluation writes, as it is at a step's end. */
    real end[AT_LEAST_ONE(EVALUATED)];
    /* Outputs where a substep begins. */
    real outputs[AT_LEAST_ONE(UNIT_OUTPUTS)];
    /* Which of them a limit cuts there. */
    unsigned char cut[AT_LEAST_ONE(UNIT_OUTPUTS)];
#if UNIT_INDICATORS > 0
    Indicators indicators;
#endif
#if UNIT_HAS_STIFF
    /* The Jacobian where a substep begins, by columns as in unit_rows, and derivatives by time. */
    real jacobian[AT_LEAST_ONE(UNIT_NONZEROS)];
    real by_time[UNIT_STATES];
    /* What is left of a matrix while it is decomposed: for eigenvalues, then for each attempt of the stiff method. */
    real matrix[UNIT_STATES * UNIT_STATES];
    real inverse_pivots[UNIT_STATES];
    int pivots[UNIT_STATES];
    int pivoted;
    real solution[UNIT_STATES];
#endif
#if UNIT_HAS_SPECTRUM
    Mode eigenvalues[UNIT_STATES];
    /* The damped one that held the explicit method to the shortest substeps when they were looked at: for messages alone. */
    Mode damped;
    /* Which of them took more than a permutation to find, and the rounding errors of that. */
    int found_from;
    int found_to;
    real noise;
#endif
} Driver;

/* Brings inputs, signals and derivatives to time t; or inputs and signals alone. */
static void problem_evaluate(Problem *problem, real t);
static void problem_evaluate_signals(Problem *problem, real t);
/* Whether the states are numbers within DIVERGENCE_LIMIT. */
static int check_divergence(const Problem *problem, real time, StepError *error);

/* Advances a problem from t0 to t1, at a pace that is left as the one to go on with. After an error the problem is
 * anywhere in between. */
static int driver_advance(Driver *driver, Problem *problem, real t0, real t1, const Settings *settings, Pace *pace,
                          StepError *error);
/* Handles events that are due at t, before anything is integrated. */
static int driver_settle(Driver *driver, Problem *problem, real t, StepError *error);
/* Handles the events at t: of indicators that changed sides since they were last known, and time events that are due, or lie
 * so little behind it. The problem then stands evaluated. *any: whether there were any. */
static int driver_events_at(Driver *driver, Problem *problem, real t, real slack, int *any, StepError *error);
/* Takes over the sides on which the indicators of an evaluated problem are at t; whether one changed sides, which keeps
 * the side where it was, for the event that this is, or a time event is due. */
static int driver_event_pending(Driver *driver, Problem *problem, real t);
/* An indicator that stands at exactly zero gets the side to which it leaves. The problem is evaluated at t, before and
 * after. */
static void driver_sides_of_zeros(Driver *driver, Problem *problem, real t, real t1, real relative_tolerance);

#endif
