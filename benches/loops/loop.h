/* Whole loops as systems of differential equations, for whichever integrator: z' = f(t, z), and its Jacobian matrix. */
#ifndef LOOP_H
#define LOOP_H

#include <time.h>

enum { MOST_STATES = 48, MOST_MEASURED = 12 };

typedef void Rate(double t, const double *z, double *dz);

/* columns[j][i] becomes the slope of rate i in state j; they are zero before the call. */
typedef void Slopes(double t, const double *z, double *const *columns);

typedef struct {
    const char *name;
    int states, measured; /* of the loop, and of the plant as it is recorded */
    Rate *rate;
    Slopes *slopes;
    void (*start)(double *z);                      /* from zeros */
    void (*measure)(const double *z, double *x); /* none where what is recorded comes first */
} Loop;

extern const Loop ROBOT_FAST, ROBOT_SLOW, QUADROTOR, OBSERVED_QUADROTOR, VEHICLE, TWIN_ROTOR, ACTUATED;

/* The loop of that name, or none. */
const Loop *find_loop(const char *name);

/* Writes the plant's state to a row of the record. */
void record(const Loop *loop, const double *z, double *row);

/* Prints the seconds that a run took, then its rows. */
void tell(const Loop *loop, double seconds, int samples, const double *rows);

static inline double seconds_now(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec + 1e-9 * now.tv_nsec;
}

#endif
