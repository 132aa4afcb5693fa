/* A small master: closes example 3.2.1 through the three units of a plan, and prints what it recorded.
   The same text is compiled for Linux and for Windows, so that both can be compared number by number. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#include <windows.h>
typedef HMODULE Module;
static Module open_library(const char *path) { return LoadLibraryA(path); }
static void *find(Module module, const char *name) { return (void *)GetProcAddress(module, name); }
#else
#include <dlfcn.h>
typedef void *Module;
static Module open_library(const char *path) { return dlopen(path, RTLD_NOW | RTLD_LOCAL); }
static void *find(Module module, const char *name) { return dlsym(module, name); }
#endif

typedef void *Component;
typedef void (*Logger)(void *, const char *, int, const char *, const char *, ...);
typedef struct {
    Logger logger;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} Callbacks;

typedef Component Instantiate(const char *, int, const char *, const char *, const Callbacks *, int, int);
typedef int Setup(Component, int, double, double, int, double);
typedef int Change(Component);
typedef int Get(Component, const unsigned *, size_t, double *);
typedef int Set(Component, const unsigned *, size_t, const double *);
typedef int Step(Component, double, double, int);
typedef void Free(Component);

enum { MOST = 8 };

typedef struct {
    Module module;
    Component component;
    Get *get;
    Set *set;
    Step *step;
    size_t inputs, outputs;
    unsigned input[MOST], output[MOST];
    double u[MOST], y[MOST];
} Unit;

static void fail(const char *what, const char *detail) {
    fprintf(stderr, "%s: %s\n", what, detail);
    exit(1);
}

static void log_message(void *environment, const char *name, int status, const char *category, const char *text, ...) {
    (void)environment;
    fprintf(stderr, "%s: %d, %s: %s\n", name, status, category, text);
}

static void *required(Unit *unit, const char *name) {
    void *function = find(unit->module, name);
    if (!function) fail("the library lacks", name);
    return function;
}

static void good(int status, const char *call) {
    if (status != 0) fail("not fmi2OK", call);
}

static void line(FILE *plan, char *text, int size) {
    if (!fgets(text, size, plan)) fail("the plan ends", "too early");
    text[strcspn(text, "\r\n")] = 0;
}

static size_t references(FILE *plan, unsigned *reference) {
    size_t count;
    if (fscanf(plan, "%zu", &count) != 1 || count > MOST) fail("the plan", "number of signals");
    for (size_t k = 0; k < count; k++)
        if (fscanf(plan, "%u", &reference[k]) != 1) fail("the plan", "value reference");
    fscanf(plan, " ");
    return count;
}

/* Four lines of the plan: library, GUID, resources; inputs and outputs, each their number and value references. */
static Unit start(FILE *plan) {
    static const Callbacks callbacks = {log_message, calloc, free, NULL, NULL};
    char library[1024], guid[128], resources[1024];
    Unit unit = {0};
    line(plan, library, sizeof library);
    line(plan, guid, sizeof guid);
    line(plan, resources, sizeof resources);
    unit.inputs = references(plan, unit.input);
    unit.outputs = references(plan, unit.output);
    if (!(unit.module = open_library(library))) fail("can't be loaded", library);
    unit.get = (Get *)required(&unit, "fmi2GetReal");
    unit.set = (Set *)required(&unit, "fmi2SetReal");
    unit.step = (Step *)required(&unit, "fmi2DoStep");
    /* No location: the library finds its resources by its own path. */
    const char *location = *resources ? resources : NULL;
    unit.component = ((Instantiate *)required(&unit, "fmi2Instantiate"))("unit", 1, guid, location, &callbacks, 0, 0);
    if (!unit.component) fail("fmi2Instantiate", library);
    good(((Setup *)required(&unit, "fmi2SetupExperiment"))(unit.component, 0, 0.0, 0.0, 0, 0.0), "fmi2SetupExperiment");
    good(((Change *)required(&unit, "fmi2EnterInitializationMode"))(unit.component), "fmi2EnterInitializationMode");
    good(((Change *)required(&unit, "fmi2ExitInitializationMode"))(unit.component), "fmi2ExitInitializationMode");
    good(unit.get(unit.component, unit.output, unit.outputs, unit.y), "fmi2GetReal");
    return unit;
}

static void advance(Unit *unit, double time, double step) {
    if (unit->inputs) good(unit->set(unit->component, unit->input, unit->inputs, unit->u), "fmi2SetReal");
    good(unit->step(unit->component, time, step, 1), "fmi2DoStep");
    good(unit->get(unit->component, unit->output, unit->outputs, unit->y), "fmi2GetReal");
}

static void finish(Unit *unit) {
    good(((Change *)required(unit, "fmi2Terminate"))(unit->component), "fmi2Terminate");
    ((Free *)required(unit, "fmi2FreeInstance"))(unit->component);
}

int main(int count, char **arguments) {
    if (count != 4) fail("usage", "loop PLAN STEP STEPS");
    const double step = atof(arguments[2]);
    const int steps = atoi(arguments[3]);
    FILE *plan = fopen(arguments[1], "r");
    if (!plan) fail("can't be read", arguments[1]);
    Unit reference = start(plan), plant = start(plan), controller = start(plan);
    fclose(plan);
    for (int k = 0; k < steps; k++) {
        const double time = k * step;
        advance(&reference, time, step);
        plant.u[0] = controller.y[0];
        advance(&plant, time, step);
        controller.u[0] = reference.y[0];
        controller.u[1] = plant.y[0];
        controller.u[2] = plant.y[1];
        advance(&controller, time, step);
        printf("%.17g %.17g %.17g %.17g\n", time + step, plant.y[0], plant.y[1], controller.y[0]);
    }
    finish(&reference);
    finish(&plant);
    finish(&controller);
    return 0;
}
