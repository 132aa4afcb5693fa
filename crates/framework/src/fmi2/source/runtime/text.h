/* Texts of messages, made without <stdio.h>, and what equations tell while they run. */

#ifndef ADAPTIVE_FMU_TEXT_H
#define ADAPTIVE_FMU_TEXT_H

/* A text for the master's logger. By FMI 2.0 that is a format of printf, so a percent sign is written as two; and it is one line, so control characters are escaped. What has no room is cut, with an ellipsis at its end. */
typedef struct {
    char *at;
    size_t room;
    size_t length;
    int is_cut;
} Text;

static Text text_in(char *room, size_t size);
static void text_add(Text *text, const char *part);
static void text_integer(Text *text, long long value);
/* A number with the fewest digits that tell it from every other one, and with an exponent where it would else be a row
 * of zeros. */
static void text_number(Text *text, real value);
/* The same, always with an exponent. */
static void text_scientific(Text *text, real value);
/* A constant with marks where numbers go; see runtime.h. */
static void text_marked(Text *text, const char *marked, const real *values, int count);

/* A call's text: long enough for most lists of reasons. */
enum { TEXT_ROOM = 2048 };
/* A refusal by limits has the value and two limits; what is told of a method, a time, an eigenvalue and a substep. */
enum { MOST_VALUES = UNIT_MOST_VALUES > 4 ? UNIT_MOST_VALUES : 4 };
/* Messages and reasons that wait. A step may have many events; what finds no room is counted. */
enum { MOST_WAITING = UNIT_MOST_MESSAGES + 16, MOST_REASONS = UNIT_MOST_MESSAGES > 8 ? UNIT_MOST_MESSAGES : 8 };

/* A message, or a reason for which something is refused. */
typedef struct {
    const char *name; /* of the variable that a reason is about; NULL where the text says all */
    const char *text;
    int category;
    int count;
    real values[MOST_VALUES];
} Message;

/* Messages until they are sent, and reasons until they are told. */
struct Log {
    Message waiting[MOST_WAITING];
    Message reasons[MOST_REASONS];
    int count;    /* of messages */
    int sent;     /* how many of them are sent; all of them between calls */
    int left_out; /* messages that found no room */
    int refused;  /* reasons, those that found no room among them */
};

/* How far a log has come, to take back what is told after it. */
typedef struct {
    int count;
    int left_out;
} LogPlace;

/* Tells something before the messages from a place on; where there is no room, the last one gives way. */
static void tell_before(Log *log, int place, int category, const char *text, const real *values, int count);
static LogPlace log_place(const Log *log);
static void log_take_back(Log *log, LogPlace place);
/* Refuses a variable's value. */
static void refuse_value(Log *log, const char *name, const char *reason, const real *values, int count);
/* How many reasons there are. */
static int log_refused(const Log *log);
/* Takes the reasons out, with the time at which they were found, where they were found at one; else NULL. */
static void log_take_refusals(Log *log, Text *text, const real *time);

#endif
