/* A master in C: what a unit costs through the functions that any tool calls.

   unit LIBRARY GUID LOCATION LIVES STEP CHECK TIMED GET[,GET...] [INPUT=VALUE...] [CHOICE:ITEM...]

   Prints, a line each, the seconds of the processor (so that other programs don't count) that it took to load the
   library, that one of LIVES of an instance took (instantiated, initialised, terminated, freed), and one of TIMED
   communication steps (inputs set, step, outputs read); and the outputs after the first CHECK steps. */
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

typedef void *Component;

typedef struct {
    void *logger, *(*allocate)(size_t, size_t), (*release)(void *), *finished, *environment;
} Callbacks;

static struct {
    Component (*instantiate)(const char *, int, const char *, const char *, const Callbacks *, int, int);
    int (*setup)(Component, int, double, double, int, double);
    int (*enter)(Component);
    int (*leave)(Component);
    int (*set_real)(Component, const unsigned *, size_t, const double *);
    int (*set_integer)(Component, const unsigned *, size_t, const int *);
    int (*get_real)(Component, const unsigned *, size_t, double *);
    int (*do_step)(Component, double, double, int);
    int (*terminate)(Component);
    void (*release)(Component);
} fmi;

enum { MOST = 1000, LIVES = 20 };

static void must(int holds, const char *what) {
    if (holds) return;
    fprintf(stderr, "%s\n", what);
    exit(1);
}

static double seconds(void) {
    struct timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return now.tv_sec + 1e-9 * now.tv_nsec;
}

static void *symbol(void *library, const char *name) {
    void *found = dlsym(library, name);
    must(found != NULL, name);
    return found;
}

static void load(const char *path) {
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    must(library != NULL, "the library can't be loaded");
    *(void **)&fmi.instantiate = symbol(library, "fmi2Instantiate");
    *(void **)&fmi.setup = symbol(library, "fmi2SetupExperiment");
    *(void **)&fmi.enter = symbol(library, "fmi2EnterInitializationMode");
    *(void **)&fmi.leave = symbol(library, "fmi2ExitInitializationMode");
    *(void **)&fmi.set_real = symbol(library, "fmi2SetReal");
    *(void **)&fmi.set_integer = symbol(library, "fmi2SetInteger");
    *(void **)&fmi.get_real = symbol(library, "fmi2GetReal");
    *(void **)&fmi.do_step = symbol(library, "fmi2DoStep");
    *(void **)&fmi.terminate = symbol(library, "fmi2Terminate");
    *(void **)&fmi.release = symbol(library, "fmi2FreeInstance");
}

typedef struct {
    unsigned input[MOST], output[MOST], choice[MOST];
    double set[MOST], got[MOST];
    int item[MOST];
    size_t inputs, outputs, choices;
} Ports;

/* Some units want one. */
static void logger(void *of, const char *instance, int status, const char *category, const char *message, ...) {
    (void)of, (void)instance, (void)status, (void)category, (void)message;
}

static Component started(char **unit, const Ports *p) {
    static const Callbacks callbacks = {(void *)logger, calloc, free, NULL, NULL};
    Component c = fmi.instantiate("unit", 1, unit[1], unit[2], &callbacks, 0, 0);
    must(c != NULL, "fmi2Instantiate");
    if (p->choices) must(fmi.set_integer(c, p->choice, p->choices, p->item) == 0, "fmi2SetInteger");
    must(fmi.setup(c, 0, 0, 0, 0, 0) == 0 && fmi.enter(c) == 0 && fmi.leave(c) == 0, "initialisation");
    return c;
}

static double life(char **unit, const Ports *p, int lives) {
    double begun = seconds();
    for (int i = 0; i < lives; i++) {
        Component c = started(unit, p);
        must(fmi.terminate(c) == 0, "fmi2Terminate");
        fmi.release(c);
    }
    return (seconds() - begun) / lives;
}

static void take_steps(Component c, Ports *p, double *time, double step, long count) {
    for (long k = 0; k < count; k++, *time += step) {
        if (p->inputs) must(fmi.set_real(c, p->input, p->inputs, p->set) == 0, "fmi2SetReal");
        must(fmi.do_step(c, *time, step, 1) == 0, "fmi2DoStep");
        must(fmi.get_real(c, p->output, p->outputs, p->got) == 0, "fmi2GetReal");
    }
}

static void read_ports(Ports *p, char *outputs, char **inputs, int count) {
    for (char *at = strtok(outputs, ","); at && p->outputs < MOST; at = strtok(NULL, ","))
        p->output[p->outputs++] = strtoul(at, NULL, 10);
    for (int i = 0; i < count && i < MOST; i++) {
        char *value = strpbrk(inputs[i], "=:");
        must(value != NULL, "INPUT=VALUE or CHOICE:ITEM");
        unsigned reference = strtoul(inputs[i], NULL, 10);
        if (*value == '=') {
            p->input[p->inputs] = reference, p->set[p->inputs++] = atof(value + 1);
        } else {
            p->choice[p->choices] = reference, p->item[p->choices++] = atoi(value + 1);
        }
    }
}

int main(int count, char **arguments) {
    static Ports ports;
    must(count >= 9, "usage: unit LIBRARY GUID LOCATION LIVES STEP CHECK TIMED GET[,GET...] [INPUT=VALUE...] [CHOICE:ITEM...]");
    double step = atof(arguments[5]), begun = seconds();
    long check = atol(arguments[6]), timed = atol(arguments[7]);
    read_ports(&ports, arguments[8], arguments + 9, count - 9);
    load(arguments[1]);
    printf("%.9g\n", seconds() - begun);
    printf("%.9g\n", life(arguments + 1, &ports, atoi(arguments[4])));
    Component c = started(arguments + 1, &ports);
    double time = 0;
    take_steps(c, &ports, &time, step, check);
    double at_check[MOST];
    memcpy(at_check, ports.got, sizeof at_check);
    begun = seconds();
    take_steps(c, &ports, &time, step, timed);
    printf("%.9g\n", (seconds() - begun) / timed);
    for (size_t i = 0; i < ports.outputs; i++) printf("%.17g%c", at_check[i], i + 1 < ports.outputs ? ',' : '\n');
    fmi.release(c);
    return 0;
}
