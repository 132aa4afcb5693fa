/* Numbers, as all files of a source unit have them. */

#ifndef ADAPTIVE_FMU_REAL_H
#define ADAPTIVE_FMU_REAL_H

#include <float.h>
#include <math.h>
#include <stddef.h>

/* double, or float where UNIT_FLOAT is defined. R(x) is a constant, F(name) a function of <math.h>; LARGE(x) and
 * SMALL(x) are constants that float can't hold. */
#ifdef UNIT_FLOAT
typedef float real;
#define R(x) x##f
#define F(name) name##f
#define LARGE(x) FLT_MAX
#define SMALL(x) FLT_MIN
#define REAL_MAX FLT_MAX
#define REAL_MIN FLT_MIN
#define REAL_EPSILON FLT_EPSILON
#else
typedef double real;
#define R(x) x
#define F(name) name
#define LARGE(x) x
#define SMALL(x) x
#define REAL_MAX DBL_MAX
#define REAL_MIN DBL_MIN
#define REAL_EPSILON DBL_EPSILON
#endif

/* The length of an array that may have no elements. */
#define AT_LEAST_ONE(n) ((n) > 0 ? (n) : 1)

#endif
