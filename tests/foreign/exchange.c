/* A unit for model exchange of another tool. `behaviour` chooses what it is:
   0  samples: x' = 1, and `count` is counted up every tenth of a second, whose times are added up
   1  its next event is always now
   2  a relay that chatters: x' = -1 above 0, else 1
   3  derivatives end in an error behind .3 s
   4  a ball: x'' = -9.81, bounces by half its speed
   5  it integrates its input
   6  a mass on a spring that is three times as stiff from 1 on, as an event switches it: x'' = u - f(x) - x' */
#include <stddef.h>
#include <stdlib.h>

enum { OK, WARNING, DISCARD, ERROR };
typedef struct {
    int more, end, nominals, states, has_time;
    double time;
} Info;
typedef struct {
    double t, x[2], u, next, count, direction;
    int behaviour, bounced;
} Unit;

#define EXPORT __attribute__((visibility("default")))

EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const void *callbacks,
                             int visible, int logging) {
    Unit *c = calloc(1, sizeof(Unit));
    c->direction = 1;
    return c;
}
EXPORT void fmi2FreeInstance(void *c) { free(c); }
EXPORT int fmi2SetupExperiment(Unit *c, int a, double b, double start, int d, double stop) { c->t = start; return OK; }
EXPORT int fmi2EnterInitializationMode(Unit *c) { return OK; }
EXPORT int fmi2ExitInitializationMode(Unit *c) {
    c->next = c->t + 0.1;
    if (c->behaviour == 4) c->x[0] = 1;
    if (c->behaviour == 2) { c->x[0] = -0.05; }
    return OK;
}
EXPORT int fmi2Terminate(Unit *c) { return OK; }

static double *real(Unit *c, unsigned reference) {
    double *all[] = {&c->x[0], &c->x[1], &c->count, &c->u};
    return all[reference];
}
EXPORT int fmi2GetReal(Unit *c, const unsigned *r, size_t n, double *v) {
    for (size_t k = 0; k < n; k++) v[k] = *real(c, r[k]);
    return OK;
}
EXPORT int fmi2SetReal(Unit *c, const unsigned *r, size_t n, const double *v) {
    for (size_t k = 0; k < n; k++) *real(c, r[k]) = v[k];
    return OK;
}
EXPORT int fmi2SetInteger(Unit *c, const unsigned *r, size_t n, const int *v) {
    for (size_t k = 0; k < n; k++) c->behaviour = v[k];
    return OK;
}
EXPORT int fmi2EnterEventMode(Unit *c) { return OK; }
EXPORT int fmi2EnterContinuousTimeMode(Unit *c) { return OK; }
EXPORT int fmi2SetTime(Unit *c, double t) { c->t = t; return OK; }
EXPORT int fmi2SetContinuousStates(Unit *c, const double *x, size_t n) { c->x[0] = x[0]; c->x[1] = x[1]; return OK; }
EXPORT int fmi2GetContinuousStates(Unit *c, double *x, size_t n) { x[0] = c->x[0]; x[1] = c->x[1]; return OK; }
EXPORT int fmi2GetNominalsOfContinuousStates(Unit *c, double *x, size_t n) { x[0] = x[1] = 1; return OK; }
EXPORT int fmi2GetDerivatives(Unit *c, double *dx, size_t n) {
    dx[0] = dx[1] = 0;
    switch (c->behaviour) {
    case 0: case 1: dx[0] = 1; break;
    case 2: dx[0] = c->direction; break;
    case 3: if (c->t > 0.3) return ERROR; dx[0] = 1; break;
    case 4: dx[0] = c->x[1]; dx[1] = -9.81; break;
    case 5: dx[0] = c->u; break;
    case 6: dx[0] = c->x[1]; dx[1] = c->u - c->direction * (c->x[0] - 1) - 1 - c->x[1]; break;
    }
    return OK;
}
EXPORT int fmi2GetEventIndicators(Unit *c, double *z, size_t n) {
    z[0] = c->behaviour == 2 || c->behaviour == 4 ? c->x[0] : 1;
    return OK;
}
EXPORT int fmi2CompletedIntegratorStep(Unit *c, int no_set_prior, int *event, int *end) { *event = *end = 0; return OK; }
EXPORT int fmi2NewDiscreteStates(Unit *c, Info *info) {
    Info none = {0};
    *info = none;
    if (c->behaviour == 0) {
        if (c->t >= c->next) { c->count++; c->next += 0.1; }
        info->has_time = 1;
        info->time = c->next;
    }
    if (c->behaviour == 1) { info->has_time = 1; info->time = c->t; }
    if (c->behaviour == 2) c->direction = c->x[0] > 0 ? -1 : 1;
    if (c->behaviour == 6) c->direction = c->x[0] > 1 ? 3 : 1;
    if (c->behaviour == 4 && c->x[0] <= 0 && c->x[1] < 0) {
        c->x[0] = 0;
        c->x[1] *= -0.5;
        info->states = 1;
    }
    return OK;
}
