/* A master that makes units, uses them rightly and wrongly, and frees them: for valgrind, and for counting what is in use.

       life PLAN STEPS

   The plan has a line a unit and interface: interface, communication step, library, GUID, resources, and the value
   references of Real inputs, of all Reals, and of the parameters that are Real and that are not, these with values; each
   after their number. Prints a line for each, and ends with 1 where memory grew with the steps, a call was answered as it
   must not be, or the library asked the system for what it has no use for. The last and the blocks in use are seen when
   it is compiled with -DCOUNTED -rdynamic: then functions of the C library are found here first. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <malloc.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

typedef void *Component;
typedef void *State;
typedef void (*Logger)(void *, const char *, int, const char *, const char *, ...);
typedef struct {
    Logger logger;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} Callbacks;
typedef struct { int needed, terminate, nominals, states, has_next; double next; } EventInfo;

enum { CO_SIMULATION = 1, OK = 0, ERROR = 3, MOST = 5000, JITTER = 4096 };

/* Steps between errors and saved states. */
#ifndef ROUND
#define ROUND 50
#endif

static void *library;
static Component unit;
static unsigned inputs[MOST], all[MOST];
static unsigned parameters[MOST], choices[MOST];
static double u[MOST], y[MOST], x[MOST], dx[MOST], z[MOST], parameter[MOST];
static int choice[MOST];
static size_t input_count, all_count, state_count, indicator_count, parameter_count, choice_count;
static int kind, refusals, wrong;
static double step;
static char last[400];

static void log_message(void *environment, const char *name, int status, const char *category, const char *text, ...) {
    (void)environment, (void)name, (void)category;
    if (status >= ERROR) refusals++;
    snprintf(last, sizeof last, "%s", text);
}

static const Callbacks callbacks = {log_message, NULL, NULL, NULL, NULL};

/* What the library asks of the system beside memory, but for reading its own description. */
static int strange;
#ifdef COUNTED
int open64(const char *path, int flags, ...) {
    size_t length = strlen(path), own = strlen("/resources/description.toml");
    int known = length > own && !strcmp(path + length - own, "/resources/description.toml");
    if (!known || (flags & O_ACCMODE) != O_RDONLY) strange++, printf("  opens %s, flags %d\n", path, flags);
    return syscall(SYS_openat, AT_FDCWD, path, flags, 0);
}
char *getenv(const char *name) { return strange++, printf("  asks for the variable %s\n", name), NULL; }
ssize_t write(int file, const void *bytes, size_t size) {
    return strange++, printf("  writes %zu bytes\n", size), syscall(SYS_write, file, bytes, size);
}
ssize_t writev(int file, const struct iovec *parts, int count) {
    return strange++, printf("  writes %d parts\n", count), syscall(SYS_writev, file, parts, count);
}
#endif

/* Blocks in use; the bytes that glibc tells jitter by a few, with how it splits what was freed. */
static long blocks;
#ifdef COUNTED
extern void *__libc_malloc(size_t), *__libc_calloc(size_t, size_t), *__libc_realloc(void *, size_t);
extern void *__libc_memalign(size_t, size_t), __libc_free(void *);
static void *counted(void *block) { return blocks += block != NULL, block; }
void *malloc(size_t size) { return counted(__libc_malloc(size)); }
void *calloc(size_t count, size_t size) { return counted(__libc_calloc(count, size)); }
void *aligned_alloc(size_t alignment, size_t size) { return counted(__libc_memalign(alignment, size)); }
void *realloc(void *block, size_t size) { return block ? __libc_realloc(block, size) : malloc(size); }
void free(void *block) { blocks -= block != NULL, __libc_free(block); }
int posix_memalign(void **block, size_t alignment, size_t size) {
    return (*block = aligned_alloc(alignment, size)) ? 0 : 12;
}
#endif

/* A function of the library, with the arguments that it is called with here. */
#define CALL(name, ...) (((int (*)())dlsym(library, "fmi2" #name))(__VA_ARGS__))

/* Counts answers other than the one that there must be. */
static void expect(int answer, int must, const char *what) {
    if (answer == must) return;
    wrong++;
    printf("  %s answered %d, not %d: %s\n", what, answer, must, last);
}

static Component instantiate(const char *guid, const char *resources) {
    typedef Component Instantiate(const char *, int, const char *, const char *, const Callbacks *, int, int);
    return ((Instantiate *)dlsym(library, "fmi2Instantiate"))("unit", kind, guid, resources, &callbacks, 0, 0);
}

/* From instantiated to where steps begin. */
static void begin(void) {
    EventInfo info = {.needed = 1};
    expect(CALL(SetReal, unit, parameters, parameter_count, parameter), OK, "fmi2SetReal of parameters");
    expect(CALL(SetInteger, unit, choices, choice_count, choice), OK, "fmi2SetInteger of parameters");
    expect(CALL(SetupExperiment, unit, 0, 0.0, 0.0, 0, 0.0), OK, "fmi2SetupExperiment");
    expect(CALL(EnterInitializationMode, unit), OK, "fmi2EnterInitializationMode");
    expect(CALL(ExitInitializationMode, unit), OK, "fmi2ExitInitializationMode");
    if (kind == CO_SIMULATION) return;
    while (info.needed && !wrong) expect(CALL(NewDiscreteStates, unit, &info), OK, "fmi2NewDiscreteStates");
    expect(CALL(EnterContinuousTimeMode, unit), OK, "fmi2EnterContinuousTimeMode");
}

/* A step; what leaves its bounds without a plant around it begins anew. */
static void advance(long k) {
    int status, entered = 0, terminated = 0;
    for (size_t i = 0; i < input_count; i++) u[i] = 0.01 * sin((double)k + (double)i);
    expect(CALL(SetReal, unit, inputs, input_count, u), OK, "fmi2SetReal");
    if (kind == CO_SIMULATION) {
        double now = 0.0;
        expect(CALL(GetRealStatus, unit, 2, &now), OK, "fmi2GetRealStatus");
        status = CALL(DoStep, unit, now, step, 1);
    } else {
        expect(CALL(GetContinuousStates, unit, x, state_count), OK, "fmi2GetContinuousStates");
        status = CALL(GetDerivatives, unit, dx, state_count);
        for (size_t i = 0; i < state_count; i++) x[i] += 1e-3 * step * dx[i];
        if (status == OK) status = CALL(SetContinuousStates, unit, x, state_count);
        if (status == OK) status = CALL(GetEventIndicators, unit, z, indicator_count);
        if (status == OK) status = CALL(CompletedIntegratorStep, unit, 1, &entered, &terminated);
    }
    if (status != OK) {
        expect(CALL(Reset, unit), OK, "fmi2Reset");
        begin();
    }
    expect(CALL(GetReal, unit, all, all_count, y), OK, "fmi2GetReal");
}

/* Calls that have to be refused; each with a message. */
static void call_wrongly(void) {
    const unsigned nowhere = 4000000000u;
    const double nan = NAN;
    int before = refusals;
    expect(CALL(GetReal, unit, &nowhere, (size_t)1, y), ERROR, "fmi2GetReal of an unknown reference");
    expect(CALL(GetReal, unit, (void *)NULL, (size_t)1, y), ERROR, "fmi2GetReal without references");
    expect(CALL(SetReal, unit, all, (size_t)1, &nan), ERROR, "fmi2SetReal with what is no number");
    expect(CALL(GetString, unit, &nowhere, (size_t)1, (void *)y), ERROR, "fmi2GetString of an unknown reference");
    expect(CALL(DoStep, unit, 0.0, -step, 1), ERROR, "fmi2DoStep backwards");
    expect(CALL(EnterInitializationMode, unit), ERROR, "fmi2EnterInitializationMode after it");
    expect(CALL(SetFMUstate, unit, (State)(size_t)12345), ERROR, "fmi2SetFMUstate of no state");
    if (refusals != before + 7) wrong++, printf("  %d messages of 7 refusals\n", refusals - before);
}

/* Saves, writes, reads and restores a state, and reads one that is corrupted. */
static void save(void) {
    static char bytes[1 << 20];
    State saved = NULL, read = NULL;
    size_t size = 0;
    expect(CALL(GetFMUstate, unit, &saved), OK, "fmi2GetFMUstate");
    expect(CALL(SerializedFMUstateSize, unit, saved, &size), OK, "fmi2SerializedFMUstateSize");
    if (size > sizeof bytes) return expect(1, 0, "the size of a state");
    expect(CALL(SerializeFMUstate, unit, saved, bytes, size), OK, "fmi2SerializeFMUstate");
    expect(CALL(DeSerializeFMUstate, unit, bytes, size, &read), OK, "fmi2DeSerializeFMUstate");
    expect(CALL(SetFMUstate, unit, read), OK, "fmi2SetFMUstate");
    bytes[size / 2] ^= 1;
    expect(CALL(DeSerializeFMUstate, unit, bytes, size, &read), ERROR, "fmi2DeSerializeFMUstate of a flipped bit");
    expect(CALL(FreeFMUstate, unit, &saved), OK, "fmi2FreeFMUstate");
    expect(CALL(FreeFMUstate, unit, &read), OK, "fmi2FreeFMUstate");
}

/* Some steps, and what else a master may do. */
static void turn(long first) {
    for (long k = 0; k < ROUND; k++) advance(first + k);
    call_wrongly();
    save();
}

static void live(const char *guid, const char *resources, long steps) {
    State left = NULL;
    expect(instantiate("{another}", resources) != NULL, 0, "fmi2Instantiate with another GUID");
    expect(instantiate(guid, "file:///nowhere") != NULL, 0, "fmi2Instantiate without resources");
    if (!(unit = instantiate(guid, resources))) return expect(1, 0, "fmi2Instantiate");
    begin();
    for (long k = 0; k < 3; k++) turn(k * ROUND);
    long before = mallinfo2().uordblks, blocks_before = blocks;
    for (long k = 3; k < 3 + steps / ROUND && !wrong; k++) turn(k * ROUND);
    long grown = (long)mallinfo2().uordblks - before, more = blocks - blocks_before;
    if (more || grown > JITTER) wrong++, printf("  %ld more blocks, %ld bytes after %ld steps\n", more, grown, steps);
    /* A state that the master forgets goes with its unit. */
    expect(CALL(GetFMUstate, unit, &left), OK, "fmi2GetFMUstate");
    expect(CALL(Terminate, unit), OK, "fmi2Terminate");
    ((void (*)(Component))dlsym(library, "fmi2FreeInstance"))(unit);
}

static size_t references(FILE *plan, unsigned *reference, double *reals, int *integers) {
    size_t count = 0;
    int read = fscanf(plan, "%zu", &count);
    for (size_t k = 0; k < count && count <= MOST && read == 1; k++) {
        read = fscanf(plan, "%u", &reference[k]);
        if (reals) read = fscanf(plan, "%lf", &reals[k]);
        if (integers) read = fscanf(plan, "%d", &integers[k]);
    }
    if (read != 1 || count > MOST) puts("the plan can't be read"), exit(2);
    return count;
}

int main(int count, char **arguments) {
    char file[1024], guid[128], resources[1024];
    FILE *plan = count == 3 ? fopen(arguments[1], "r") : NULL;
    if (!plan) return fprintf(stderr, "life PLAN STEPS\n"), 2;
    int failed = 0;
    while (fscanf(plan, "%d %lf %1023s %127s %1023s %zu %zu", &kind, &step, file, guid, resources, &state_count,
                  &indicator_count) == 7) {
        wrong = 0;
        input_count = references(plan, inputs, NULL, NULL);
        all_count = references(plan, all, NULL, NULL);
        parameter_count = references(plan, parameters, parameter, NULL);
        choice_count = references(plan, choices, NULL, choice);
        printf("%s, %s\n", strrchr(file, '/') + 1, kind ? "co-simulation" : "model exchange");
        if (!(library = dlopen(file, RTLD_NOW | RTLD_LOCAL))) return puts(dlerror()), 1;
        live(guid, resources, atol(arguments[2]));
        dlclose(library);
        /* A destructor that waits for the end of a thread would keep it. */
        if (dlopen(file, RTLD_NOW | RTLD_NOLOAD)) wrong++, puts("  the library stays when it is closed");
        failed |= wrong > 0 || strange > 0;
    }
    fclose(plan);
    puts(failed ? "not as it should be" : "all as it should be");
    return failed;
}
