/* y = gain (r - u): a controller without states, which passes on what it gets at once. */
#define VARIABLES 4
enum { Y, U, R, GAIN };
#define START(v) (v[R] = 1.0, v[GAIN] = 2.0)

static void outputs(double *v, double time) { v[Y] = v[GAIN] * (v[R] - v[U]); }
static void step(double *v, double time, double h) {}

#include "unit.h"
