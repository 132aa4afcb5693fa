/* Calls a generated controller and one that is written by hand alike, at random, and compares answers, outputs and states: enabling,
 * calibration, reset, inputs that are no numbers. GENERATED and BY_HAND are their names, SEED begins the random numbers.
 * Their parameters and states are real numbers in the same order, but for parameters that the header by hand names: FLAG is true or false,
 * CHOICE is 1 to CHOICES. TURNING are the inputs that are one angle, which turns without end, SIZE(k) is how large control k may be.
 * Inputs that aren't the responses of a plant may lead a controller to where it amplifies roundings. A second generated one, which is rounded
 * in another way, shows where, and differences may be as large there. */

#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define JOINED(name, part) name##part
#define OF(name, part) JOINED(name, part)
#define G(part) OF(GENERATED, part)
#define H(part) OF(BY_HAND, part)

enum { PARAMETERS = sizeof(G(_parameters)) / sizeof(double), INPUTS = sizeof(G(_inputs)) / sizeof(double) };
enum { OUTPUTS = sizeof(G(_outputs)) / sizeof(double), CONTROLLED = sizeof(((G(_parameters) *)0)->u_min) / sizeof(double) };
enum { LOWER = offsetof(G(_parameters), u_min) / sizeof(double), UPPER = offsetof(G(_parameters), u_max) / sizeof(double) };
/* A sampled law has no continuous states. */
#ifndef SAMPLED
enum { STATES = sizeof(G(_states)) / sizeof(double) };
#endif
#ifndef SIZE
#define SIZE(control) 50
#endif
enum { STEPS = 50000 };

static double random_number(void) { return 2.0 * rand() / RAND_MAX - 1; }

static int fails(const char *what, int step)
{
    printf("%s differs in step %d\n", what, step);
    return 1;
}

/* Parameters that aren't real numbers. */
static void draw_whole(void *parameters)
{
#ifdef FLAG
    ((G(_parameters) *)parameters)->FLAG = rand() % 2;
#endif
#ifdef CHOICE
    ((G(_parameters) *)parameters)->CHOICE = 1 + rand() % CHOICES;
#endif
    (void)parameters;
}

/* Parameters as somebody may give them. */
static void draw(double *parameters)
{
    memcpy(parameters, &G(_defaults), sizeof G(_defaults));
    for (int k = 0; k < PARAMETERS; k++) {
        if (rand() % 4 == 0) parameters[k] *= 1 + 0.3 * random_number();
    }
    /* A bound of 0 freezes an estimate, and some times and bandwidths follow from others where they are -1. */
    if (rand() % 4 == 0) parameters[rand() % PARAMETERS] = -(rand() % 2);
    for (int k = 0; k < CONTROLLED; k++) {
        parameters[LOWER + k] = -SIZE(k) * fabs(random_number());
        parameters[UPPER + k] = SIZE(k) * fabs(random_number());
    }
    draw_whole(parameters);
}

/* Makes one of them odd: outside of what is allowed, or so that the controller amplifies roundings where it keeps it. */
static void make_odd(double *parameters)
{
    static const double odd[] = {-1, 0, 1e-10, 0.01, 20, 1e20};
    parameters[rand() % PARAMETERS] = rand() % 3 == 0 ? NAN : odd[rand() % 6];
    draw_whole(parameters);
}

/* How far two arrays of numbers are apart, in parts of the larger ones. */
static double apart(const double *one, const double *other, int count)
{
    double most = 0;
    for (int k = 0; k < count; k++) most = fmax(most, fabs(one[k] - other[k]) / fmax(1, fabs(one[k])));
    return most;
}

int main(void)
{
    static GENERATED generated, rounded;
    static BY_HAND by_hand;
    double in[INPUTS], out[OUTPUTS], out_rounded[OUTPUTS], given[OUTPUTS], manual[OUTPUTS], parameters[PARAMETERS], phase[INPUTS];
    int count[5] = {0}, amplified = 0, edges = 0;
    srand(SEED);
    memset(&generated, 0x5a, sizeof generated);
    memset(&by_hand, 0x5a, sizeof by_hand);
    by_hand.enabled = by_hand.active = true;
    for (int k = 0; k < INPUTS; k++) {
        in[k] = 0;
        phase[k] = 3 * random_number();
    }
    if ((G(_step)(&generated, (const void *)in, (void *)out) & G(_REFUSED)) == 0 || out[0] != 0) return fails("no start", 0);
    if ((H(_step)(&by_hand, (const void *)in, (void *)given) & H(_REFUSED)) == 0 || given[0] != 0) return fails("no start", 0);
    G(_init)(&generated);
    rounded = generated;
    H(_init)(&by_hand);
    for (int step = 0; step < STEPS; step++) {
        if (rand() % 70 == 0 || (step == 0 && SEED % 2)) {
            for (int k = 0; k < OUTPUTS; k++) manual[k] = rand() % 9 ? 0.8 * SIZE(k) * random_number() : NAN;
            const bool enabled = rand() % 2;
            G(_enable)(&rounded, enabled, (const void *)manual);
            if (G(_enable)(&generated, enabled, (const void *)manual) != H(_enable)(&by_hand, enabled, manual)) return fails("enabling", step);
        }
        if (rand() % 150 == 0 || (step == 0 && SEED % 3)) {
            /* Where a set with an odd parameter is refused, those before stay in force; where it is taken, usual ones follow. */
            bool is_odd = rand() % 2 == 0, follows = false;
            do {
                draw(parameters);
                if (is_odd) make_odd(parameters);
                G(_calibrate)(&rounded, (const void *)parameters);
                const bool taken = H(_calibrate)(&by_hand, (const void *)parameters);
                if (taken != (G(_calibrate)(&generated, (const void *)parameters) == 0)) return fails("calibration", step);
                count[taken ? 0 : 1]++;
                follows = taken ? is_odd : follows;
                is_odd = false;
            } while (follows);
        }
        if (rand() % 700 == 0) {
            G(_reset)(&generated);
            G(_reset)(&rounded);
            H(_reset)(&by_hand);
        }
        const double size = step / 1000 % 3 * 1e-2, time = step * 1e-2;
        for (int k = 0; k < INPUTS; k++) in[k] = size * sin((k + 1) * time + phase[k]);
        if (rand() % 40 == 0) in[rand() % INPUTS] = rand() % 3 == 0 ? 1e13 : rand() % 2 ? NAN : -INFINITY;
#ifdef TURNING
        static const int turning[] = TURNING;
        for (unsigned k = 0; k < sizeof turning / sizeof *turning; k++) {
            double *angle = &in[turning[k]];
            /* 1e13 has no digits left that tell an angle. The two angles are apart: where they are equal, roundings decide whether u moves. */
            *angle = *angle == 1e13 ? NAN : *angle + 3 * sin(time / 20 + 0.01 * k) + 6.283185307179586 * (rand() % 3);
        }
#endif
        const unsigned status = G(_step)(&generated, (const void *)in, (void *)out), reasons = 30;
        const unsigned other = G(_step)(&rounded, (const void *)in, (void *)out_rounded), found = H(_step)(&by_hand, (const void *)in, (void *)given);
        double by_rounding = apart(out, out_rounded, OUTPUTS), by_another = apart(out, given, OUTPUTS);
#ifndef SAMPLED
        const double *x = (const double *)&generated.x;
        double *x_rounded = (double *)&rounded.x;
        by_rounding = fmax(by_rounding, apart(x, x_rounded, STATES));
        by_another = fmax(by_another, apart(x, (const double *)&by_hand.x, STATES));
        for (int k = 0; k < STATES; k++) x_rounded[k] *= 1 + 3e-15 * random_number();
#endif
        if (status != other || !(by_rounding <= 1e-9)) {
            amplified++;
            G(_reset)(&generated);
            G(_reset)(&rounded);
            H(_reset)(&by_hand);
            continue;
        }
        /* A control at its limit but for a rounding. */
        edges += (status & ~reasons) != found;
        if (edges > 3) return fails("the status", step);
        if (!(by_another <= 1e-11 + 1000 * by_rounding)) return fails("an output or a state", step);
        if (generated.refused != by_hand.refused) return fails("the number of refused steps", step);
        count[2] += (status & G(_REFUSED)) != 0;
        count[3] += (status & G(_LIMITED)) != 0;
        count[4] += by_hand.active ? 0 : 1;
    }
    printf("calibrations %d, refused %d; steps refused %d, at limits %d, by hand %d\n", count[0], count[1], count[2], count[3], count[4]);
    printf("roundings amplified %d\n", amplified);
    for (int k = 0; k < 5; k++) {
        if (count[k] < 20 || amplified > STEPS / 100) return fails("too little", STEPS);
    }
    return 0;
}
