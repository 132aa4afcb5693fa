/* The peer of the step benchmark: Van der Pol's oscillator as a hand-written FMI 2.0 co-simulation unit in C with
   forward Euler steps of a size fixed when compiling (STEP), the common way of small C units. Only what the benchmark
   calls is here, with the checks that such units make. */
#include <math.h>
#include <stdlib.h>

typedef struct {
    int state; /* 1: initialised */
    double time;
    double x[2], dx[2];
    double mu;
} Instance;

enum { OK = 0, ERROR = 3 };

void *fmi2Instantiate(const char *name, int kind, const char *guid, const char *location, const void *callbacks,
                      int visible, int logging) {
    Instance *s = calloc(1, sizeof *s);
    (void)name, (void)kind, (void)guid, (void)location, (void)callbacks, (void)visible, (void)logging;
    if (!s) return NULL;
    s->x[0] = 2.0;
    s->mu = 1.0;
    return s;
}

void fmi2FreeInstance(void *c) { free(c); }

int fmi2SetupExperiment(void *c, int tolerance_defined, double tolerance, double start, int stop_defined, double stop) {
    (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop;
    ((Instance *)c)->time = start;
    return OK;
}

int fmi2EnterInitializationMode(void *c) { return c ? OK : ERROR; }

int fmi2ExitInitializationMode(void *c) {
    ((Instance *)c)->state = 1;
    return OK;
}

int fmi2Terminate(void *c) {
    ((Instance *)c)->state = 0;
    return OK;
}

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

int fmi2SetReal(void *c, const unsigned *references, size_t n, const double *values) {
    Instance *s = c;
    if (!s) return ERROR;
    for (size_t i = 0; i < n; i++) {
        if (references[i] != 5) return ERROR;
        s->mu = values[i];
    }
    return OK;
}

int fmi2SetInteger(void *c, const unsigned *references, size_t n, const int *values) {
    (void)references, (void)values;
    return c && n == 0 ? OK : ERROR;
}

int fmi2DoStep(void *c, double point, double h, int no_set_prior) {
    Instance *s = c;
    (void)no_set_prior;
    if (!s || !(s->state & 1) || h <= 0.0) return ERROR;
    if (fabs(point - s->time) > 1e-6 * h) return ERROR;
    double end = point + h;
    while (s->time + 0.5 * STEP < end) {
        derivatives(s);
        s->x[0] += STEP * s->dx[0];
        s->x[1] += STEP * s->dx[1];
        s->time += STEP;
    }
    s->time = end;
    return OK;
}
