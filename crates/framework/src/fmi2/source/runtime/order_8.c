/* The explicit Runge-Kutta method of order 8, for long ways: DOP853, by Prince and Dormand, with the error estimates of order 5
 * and 3 of Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, 2nd ed. (Springer 1993), II.5 and II.10.
 *
 * Where a rate has a kink, the difference from the solution of order 5 is nothing at some places of the kink in a substep. So
 * another one counts as well, which sees these: the fifth divided difference of the derivatives at six of the stages. */

#if UNIT_HAS_ORDER_8

/* Derivatives that are kept: of stage 1, and of 4 to 12. Those of stages 2 and 3 are soon needed no more. */
#define STAGES_8 12
#define KEPT_8 10
#define FOURTH 3

/* Where what follows on each stage stands, in parts of the step; after the last, that is the end. */
static const real NODES_8[STAGES_8] = {
    R(0.05260015195876773), R(0.0789002279381516), R(0.1183503419072274), R(0.2816496580927726), R(1.0) / R(3.0),
    R(1.0) / R(4.0), R(4.0) / R(13.0), R(127.0) / R(195.0), R(3.0) / R(5.0), R(6.0) / R(7.0), R(1.0), R(1.0),
};
/* How many of the derivatives count there, and their weights; the last are those of the solution. */
static const int COUNTS_8[STAGES_8] = {1, 2, 2, 3, 3, 4, 5, 6, 7, 8, 9, 10};
static const real WEIGHTS_8[STAGES_8][KEPT_8] = {
    {R(0.05260015195876773)},
    {R(0.0197250569845379), R(0.0591751709536137)},
    {R(0.02958758547680685), R(0.08876275643042054)},
    {R(0.2413651341592667), R(-0.8845494793282861), R(0.924834003261792)},
    {R(1.0) / R(27.0), R(0.17082860872947386), R(0.12546768756682242)},
    {R(0.037109375), R(0.17025221101954405), R(0.06021653898045596), R(-0.017578125)},
    {R(0.03709200011850479), R(0.17038392571223998), R(0.10726203044637328), R(-0.015319437748624402),
     R(0.008273789163814023)},
    {R(0.6241109587160757), R(-3.3608926294469414), R(-0.868219346841726), R(27.59209969944671), R(20.154067550477894),
     R(-43.48988418106996)},
    {R(0.47766253643826434), R(-2.4881146199716677), R(-0.590290826836843), R(21.230051448181193), R(15.279233632882423),
     R(-33.28821096898486), R(-0.020331201708508627)},
    {R(-0.9371424300859873), R(5.186372428844064), R(1.0914373489967295), R(-8.149787010746927), R(-18.52006565999696),
     R(22.739487099350505), R(2.4936055526796523), R(-3.0467644718982196)},
    {R(2.273310147516538), R(-10.53449546673725), R(-2.0008720582248625), R(-17.9589318631188), R(27.94888452941996),
     R(-2.8589982771350235), R(-8.87285693353063), R(12.360567175794303), R(0.6433927460157636)},
    {R(0.054293734116568765), R(0.0), R(0.0), R(4.450312892752409), R(1.8915178993145003), R(-5.801203960010585),
     R(0.3111643669578199), R(-0.1521609496625161), R(0.20136540080403034), R(0.04471061572777259)},
};
/* Weights in the differences from the solutions of order 5 and 3. */
static const real ERROR_5[KEPT_8] = {
    R(0.01312004499419488), R(0.0), R(0.0), R(-1.2251564463762044), R(-0.4957589496572502), R(1.6643771824549864),
    R(-0.35032884874997366), R(0.3341791187130175), R(0.08192320648511571), R(-0.022355307863886294),
};
static const real ERROR_3[KEPT_8] = {
    R(-0.18980075407240762), R(0.0), R(0.0), R(4.450312892752409), R(1.8915178993145003), R(-5.801203960010585),
    R(-0.4226823213237919), R(-0.1521609496625161), R(0.20136540080403034), R(0.02265179219836082),
};
/* In the divided difference, in units in which it sees a kink about as well as the difference from order 5. */
#define DIVIDED_UNIT R(7e-4)
static const real DIVIDED[KEPT_8] = {
    DIVIDED_UNIT * R(-455.0) / R(18.0), R(0.0), R(0.0), R(0.0), DIVIDED_UNIT * R(66560.0) / R(153.0),
    DIVIDED_UNIT * R(-2599051.0) / R(5130.0), R(0.0), DIVIDED_UNIT * R(81250.0) / R(513.0),
    DIVIDED_UNIT * R(-218491.0) / R(2295.0), DIVIDED_UNIT * R(910.0) / R(27.0),
};
/* How much the difference from order 3 counts beside that from order 5. */
#define PART_OF_3 R(0.1)

/* A difference of a state. */
static real difference_8(const Driver *driver, int state, real h, const real *weights) {
    real sum = R(0.0);
    for (int j = 0; j < KEPT_8; j++) {
        sum += weights[j] * driver->stages[j][state];
    }
    return h * sum;
}

/* The error of order 8 for one that is seen by order 5 and another by order 3. */
static real combined_error(real of_5, real of_3) {
    if (of_5 == R(0.0)) {
        return R(0.0);
    }
    /* Squares of the quotient alone: those of errors may be too small for numbers. */
    real quotient = PART_OF_3 * of_3 / of_5;
    return of_5 / F(sqrt)(R(1.0) + quotient * quotient);
}

/* Advances the states from the start by h and evaluates the problem there. The problem stands anywhere; what it holds is
 * overwritten. */
static Estimate order_8_attempt(Driver *driver, Problem *problem, real h, real relative_tolerance) {
    const Start *start = &driver->start;
    copy(problem->v + FIRST_RATE, start->rates, UNIT_STATES);
    for (int stage = 0; stage < STAGES_8; stage++) {
        int count = COUNTS_8[stage];
        copy(driver->stages[count - 1], problem->v + FIRST_RATE, UNIT_STATES);
        add_stages(problem->v + FIRST_STATE, start->states, h, WEIGHTS_8[stage], driver->stages, count);
        if (stage == FOURTH) {
            /* It is needed further on, stage 3 isn't. */
            copy(driver->stages[1], driver->stages[count - 1], UNIT_STATES);
        }
        problem_evaluate(problem, start->time + NODES_8[stage] * h);
    }
    for (int i = 0; i < UNIT_STATES; i++) {
        real seen = difference_8(driver, i, h, ERROR_5), divided = difference_8(driver, i, h, DIVIDED);
        real of_5 = magnitude(divided) > magnitude(seen) ? divided : seen;
        driver->errors[i] = combined_error(of_5, difference_8(driver, i, h, ERROR_3));
    }
    return scaled_error(driver->errors, start->states, problem->v + FIRST_STATE, relative_tolerance);
}

#endif
