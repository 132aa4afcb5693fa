/* y' = u - y by one step of Euler's method: a plant that delays what it passes on. */
#define VARIABLES 3
enum { Y, U, X };

static void outputs(double *v, double time) { v[Y] = v[X]; }
static void step(double *v, double time, double h) { v[X] += h * (v[U] - v[X]); }

#include "unit.h"
