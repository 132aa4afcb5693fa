/* A motor as another tool's unit: tau y' = u - y, integrated exactly over each step. The parameter `fault` asks for
   what badly made units do, from the time `fault_time` on. */
#include <math.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { NONE, CRASH, HANG, EXIT, PRINT, NO_NUMBER, ABORT_ON_FREE, LOG, LOG_OFTEN, LOG_FROM_THREAD, WRONG_STATUS, ABORT };
enum { OK, WARNING, DISCARD, ERROR };

typedef void (*Logger)(void *, const char *, int, const char *, const char *, ...);
typedef struct {
    Logger log;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void *finished, *environment;
} Callbacks;

typedef struct {
    double u, y, tau, fault_time, time;
    int fault;
    char name[64];
    const Callbacks *callbacks;
} Motor;

static void say(Motor *m, int status, const char *format) {
    m->callbacks->log(m->callbacks->environment, m->name, status, "logStatusWarning", format, m->name, 42, 1.5);
}

static void *talk(void *argument) {
    for (int k = 0; k < 1000; k++) say(argument, WARNING, "%s in a thread");
    return NULL;
}

void *fmi2Instantiate(const char *name, int kind, const char *guid, const char *resources, const Callbacks *callbacks,
                      int visible, int logging) {
    if (strcmp(guid, "motor") != 0 || getenv("MOTOR_CRASHES")) abort();
    Motor *m = callbacks->allocate(1, sizeof *m);
    m->tau = 0.1;
    m->fault_time = 0.5;
    m->callbacks = callbacks;
    strncpy(m->name, name, sizeof m->name - 1);
    return m;
}

void fmi2FreeInstance(void *c) {
    Motor *m = c;
    if (m->fault == ABORT_ON_FREE) abort();
    m->callbacks->release(m);
}

static double *real(Motor *m, unsigned reference) {
    double *reals[] = {&m->u, &m->y, &m->tau, &m->fault_time};
    return reference < 4 ? reals[reference] : NULL;
}

int fmi2GetReal(void *c, const unsigned *references, size_t n, double *values) {
    for (size_t k = 0; k < n; k++) {
        if (!real(c, references[k])) return ERROR;
        values[k] = *real(c, references[k]);
    }
    return OK;
}

int fmi2SetReal(void *c, const unsigned *references, size_t n, const double *values) {
    for (size_t k = 0; k < n; k++) {
        if (!real(c, references[k])) return ERROR;
        *real(c, references[k]) = values[k];
    }
    return OK;
}

int fmi2GetInteger(void *c, const unsigned *references, size_t n, int *values) {
    for (size_t k = 0; k < n; k++) values[k] = ((Motor *)c)->fault;
    return OK;
}

int fmi2SetInteger(void *c, const unsigned *references, size_t n, const int *values) {
    for (size_t k = 0; k < n; k++) ((Motor *)c)->fault = values[k];
    return OK;
}

int fmi2SetupExperiment(void *c, int tolerance_defined, double tolerance, double start, int stop_defined, double stop) {
    ((Motor *)c)->time = start;
    return OK;
}

int fmi2EnterInitializationMode(void *c) { return OK; }
int fmi2ExitInitializationMode(void *c) { return OK; }
int fmi2Terminate(void *c) { return OK; }

static int misbehave(Motor *m) {
    pthread_t thread;
    switch (m->fault) {
    case CRASH: *(volatile int *)8 = 1; break;
    case HANG: for (;;) pause();
    case EXIT: exit(0);
    case PRINT: printf("the motor is at %g\n", m->y); break;
    case NO_NUMBER: m->y = NAN; break;
    case LOG: say(m, WARNING, "%s is 100 %% warm: \033[31m%d\033[0m degrees, %.2f A"); break;
    case LOG_OFTEN: say(m, WARNING, "%s warns"); break;
    case LOG_FROM_THREAD:
        pthread_create(&thread, NULL, talk, m);
        for (int k = 0; k < 1000; k++) say(m, WARNING, "%s warns");
        pthread_join(thread, NULL);
        break;
    case WRONG_STATUS: return 17;
    case ABORT: fprintf(stderr, "assertion failed: the shaft is broken\n"); abort();
    }
    return OK;
}

int fmi2DoStep(void *c, double time, double step, int no_set_prior) {
    Motor *m = c;
    m->y = m->u + (m->y - m->u) * exp(-step / m->tau);
    m->time = time + step;
    return m->time > m->fault_time + 1e-9 ? misbehave(m) : OK;
}
