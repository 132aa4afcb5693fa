/* The peer of the step benchmark: Van der Pol's oscillator as a hand-written FMI 2.0 co-simulation unit in C with one
   forward Euler step of fixed size a communication step, the common way of small C units. Only what the benchmark
   calls is here, with the checks that such units make. */
#include <math.h>
#include <stdlib.h>

typedef struct {
    int state; /* 1: initialised */
    double time;
    double x[2], dx[2];
    double mu;
    double step;
} Instance;

enum { OK = 0, ERROR = 3 };

void *fmi2Instantiate(double step) {
    Instance *s = calloc(1, sizeof *s);
    if (!s) return NULL;
    s->x[0] = 2.0;
    s->mu = 1.0;
    s->step = step;
    s->state = 1;
    return s;
}

void fmi2FreeInstance(void *c) { free(c); }

static void derivatives(Instance *s) {
    s->dx[0] = s->x[1];
    s->dx[1] = s->mu * ((1.0 - s->x[0] * s->x[0]) * s->x[1]) - s->x[0];
}

static int value(Instance *s, unsigned reference, double *v) {
    switch (reference) {
    case 0: *v = s->time; return OK;
    case 1: *v = s->x[0]; return OK;
    case 2: *v = s->dx[0]; return OK;
    case 3: *v = s->x[1]; return OK;
    case 4: *v = s->dx[1]; return OK;
    case 5: *v = s->mu; return OK;
    default: return ERROR;
    }
}

int fmi2GetReal(void *c, const unsigned *references, size_t n, double *values) {
    Instance *s = c;
    if (!s || !(s->state & 1)) return ERROR;
    for (size_t i = 0; i < n; i++)
        if (value(s, references[i], &values[i]) != OK) return ERROR;
    return OK;
}

int fmi2DoStep(void *c, double point, double h, int no_set_prior) {
    Instance *s = c;
    (void)no_set_prior;
    if (!s || !(s->state & 1) || h <= 0.0) return ERROR;
    if (fabs(point - s->time) > 1e-6 * h) return ERROR;
    double end = point + h;
    while (s->time + 0.5 * s->step < end) {
        derivatives(s);
        s->x[0] += s->step * s->dx[0];
        s->x[1] += s->step * s->dx[1];
        s->time += s->step;
    }
    return OK;
}
