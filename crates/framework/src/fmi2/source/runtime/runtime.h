/* What the files of a source unit share. Everything is compiled as one translation unit (all.c), so that nothing but the
 * functions of the standard has a name outside it: several units can be linked into one program. */

#ifndef ADAPTIVE_FMU_RUNTIME_H
#define ADAPTIVE_FMU_RUNTIME_H

#include <limits.h>
#include <stdint.h>
#include <string.h>

#include "real.h"

/* Types of variables, and what may be done with one. */
enum { TYPE_REAL, TYPE_INTEGER, TYPE_BOOLEAN };
enum { ACCESS_HIDDEN, ACCESS_FIXED, ACCESS_TUNABLE, ACCESS_INPUT, ACCESS_LOCAL, ACCESS_OUTPUT, ACCESS_DESIGNED };
/* Which limits a variable has. */
enum { LIMIT_MIN = 1, LIMIT_ABOVE_MIN = 2, LIMIT_MAX = 4 };

/* A real variable, by its place in the block. */
typedef struct {
    const char *name; /* as users know it; NULL where it isn't shown */
    unsigned char access;
    unsigned char limits;
    real min;
    real max;
} RealVariable;

/* An integer, a Boolean or a choice, by its place in the block. */
typedef struct {
    const char *name;
    unsigned char access;
    unsigned char type;
    unsigned char has_limits; /* of any integer, hidden ones too, in the block; else it may be any */
    int min;
    int max;
    const char *items; /* "1 hold, 2 extrapolate" of a choice; NULL elsewhere */
} IntegerVariable;

/* A continuous output that isn't a state, or what counts as one; the output in whose magnitude it counts, and that one's nominal
 * value. */
typedef struct {
    int place;
    int output;
    real nominal;
} Output;

/* An array of FMI 3.0: its first element's place, integers behind the reals, and its rows and columns. */
typedef struct {
    int first;
    int rows;
    int columns;
} Array;

/* What an output, a state or a derivative depends on while a simulation runs, and at its start: so many places in a list, from the
 * first on. */
typedef struct {
    int place;
    int running;
    int first_running;
    int starts;
    int first_start;
} Dependent;

/* Messages that the equations leave, until they are sent: the texts are constants with marks where numbers go. A mark is
 * the byte 1, then n (all digits), r (rounded for a person), e or f (with an exponent, or without) and for these two the
 * number of digits behind the point, as a digit. */
typedef struct Log Log;
/* Tells a message of a log category (its place in unit_categories). */
static void log_text(Log *log, int category, const char *text, const real *values, int count);
/* Refuses what was asked for: a start, a point, parameters. */
static void refuse(Log *log, const char *reason, const real *values, int count);

#include "unit.h"
#include "numbers.h"

#endif
