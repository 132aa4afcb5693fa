/* How long a substep may be for what the equations' modes do: what decays must not be amplified, and what grows must grow
 * as it does.
 *
 * Error control sees what is larger than the tolerance. The amplitude of a mode that starts far below it is multiplied by
 * |R(lambda h)| in each substep, R being the method's stability function (Hairer and Wanner, Solving Ordinary Differential
 * Equations II, IV.3). So whatever the eigenvalues lambda of the exact Jacobian say to grow is resolved: each method has
 * its longest substep at which |R| grows at the right rate. */

#if UNIT_HAS_SPECTRUM

/* Growth of a mode is followed with an error of this part of its rate. */
#define GROWTH_ACCURACY R(0.01)
/* Below this part of its frequency, the growth of a mode can't be told from none. */
#define LEAST_GROWTH R(1e-8)
/* In a substep nothing may grow by more than e to this. */
#define GROWTH_IN_A_SUBSTEP R(0.5)
/* What was followed is forgotten by this factor from one look to the next. */
#define FORGOTTEN R(0.5)
/* A mode that decays more slowly than this part of its frequency may soon grow: the stiff method follows it. */
#define HARDLY_DAMPED R(1e-6)
/* An oscillation that is damped by less than this part of its frequency carries errors on, the farther the less it is damped;
 * so far at most, and one that grows. */
#define CARRYING R(0.05)
#define FARTHEST R(100.0)
#define GROWING R(1000.0)
/* The explicit method's substep stays at this part of its limit of stability. */
#define STABLE_PART R(0.8)
/* Stability along a ray is looked for from lambda h of this magnitude, in such steps, up to the farthest point: of order 5,
 * and 8. */
typedef struct {
    real from;
    real step;
    real to;
} Ray;
static const Ray RAY_5 = {R(0.4), R(0.1), R(3.8)}, RAY_8 = {R(5.6), R(0.2), R(7.0)};
/* What counts as stable, with rounding. */
#define STABLE (R(1.0) + R(8.0) * REAL_EPSILON > R(1.0) + R(1e-9) ? R(1.0) + R(8.0) * REAL_EPSILON : R(1.0) + R(1e-9))
/* Magnitude of lambda h from which the search for a resolved substep goes down, and where it ends. */
#define RESOLVED_FROM R(8.0)
#define RESOLVED_TO R(1e-3)
/* Factor from one trial of that search to the next. */
#define TRIAL R(0.85)
/* So many shorter substeps in a row must be resolved too: the error may pass zero at one of them. */
#define IN_A_ROW 3

typedef struct {
    real re;
    real im;
} Complex;

static Complex complex_product(Complex a, Complex b) {
    Complex product = {a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
    return product;
}

static Complex complex_quotient(Complex a, Complex b) {
    real squares = b.re * b.re + b.im * b.im;
    Complex quotient = {(a.re * b.re + a.im * b.im) / squares, (a.im * b.re - a.re * b.im) / squares};
    return quotient;
}

static Complex complex_polynomial(const real *coefficients, int count, Complex z) {
    Complex sum = {R(0.0), R(0.0)};
    for (int i = 0; i < count; i++) {
        sum = complex_product(sum, z);
        sum.re += coefficients[i];
    }
    return sum;
}

/* What one substep multiplies the solution of x' = lambda x by, for z = lambda h: of the explicit method of order 5. */
static Complex explicit_stability(Complex z) {
    static const real coefficients[7] = {
        R(1.0) / R(600.0), R(1.0) / R(120.0), R(1.0) / R(24.0), R(1.0) / R(6.0), R(0.5), R(1.0), R(1.0),
    };
    return complex_polynomial(coefficients, 7, z);
}

/* The same of the one of order 8. */
static Complex order_8_stability(Complex z) {
    static const real coefficients[13] = {
        R(3.613324578128244e-10), R(1.4947364854591547e-8), R(2.3413451082097797e-7), R(2.691692200169089e-6),
        R(1.0) / R(40320.0),      R(1.0) / R(5040.0),       R(1.0) / R(720.0),        R(1.0) / R(120.0),
        R(1.0) / R(24.0),         R(1.0) / R(6.0),          R(0.5),                   R(1.0),
        R(1.0),
    };
    return complex_polynomial(coefficients, 13, z);
}

static Complex complex_weighted(const real *weights, const Complex *u, int stages) {
    Complex sum = {R(0.0), R(0.0)};
    for (int j = 0; j < stages; j++) {
        sum.re += u[j].re * weights[j];
        sum.im += u[j].im * weights[j];
    }
    return sum;
}

/* The same of the stiff method: its stages on that equation. */
static Complex stiff_stability(Complex z) {
    Complex u[STIFF_STAGES] = {{R(0.0), R(0.0)}};
    Complex x = {R(1.0), R(0.0)}, denominator = {-z.re + R(1.0) / GAMMA, -z.im};
    for (int i = 0; i < STIFF_STAGES; i++) {
        if (i < STIFF_STAGES - 2) {
            x = complex_weighted(STATE_WEIGHTS[i], u, i);
            x.re += R(1.0);
        } else {
            /* The last stages add up. */
            x.re += u[i - 1].re;
            x.im += u[i - 1].im;
        }
        Complex right = complex_product(z, x), known = complex_weighted(STAGE_WEIGHTS[i], u, i);
        right.re += known.re;
        right.im += known.im;
        u[i] = complex_quotient(right, denominator);
    }
    x.re += u[STIFF_STAGES - 1].re;
    x.im += u[STIFF_STAGES - 1].im;
    return x;
}

typedef Complex Stability(Complex z);

/* By how much a method multiplies what goes so far in a direction of the complex plane. */
static real amplification(Stability *stability, Complex direction, real way) {
    Complex z = {direction.re * way, direction.im * way};
    Complex factor = stability(z);
    return F(hypot)(factor.re, factor.im);
}

/* How far an explicit method is stable in a direction of the complex plane. */
static real stable_way(Stability *stability, const Ray *ray, Complex direction) {
    real low = ray->from;
    while (low < ray->to && amplification(stability, direction, low + ray->step) <= STABLE) {
        low += ray->step;
    }
    real high = low + ray->step;
    for (int k = 0; k < 6; k++) {
        real middle = R(0.5) * (low + high);
        if (amplification(stability, direction, middle) <= STABLE) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return low;
}

/* How far a method goes in a direction of the complex plane with a growth rate whose error is at most `allowed`, all in
 * units of |lambda|. */
static real resolved_way(Stability *stability, Complex direction, real allowed) {
    real way = direction.re > R(0.0) ? smaller(RESOLVED_FROM, GROWTH_IN_A_SUBSTEP / direction.re) : RESOLVED_FROM;
    real found = RESOLVED_TO;
    int in_a_row = 0;
    while (way > RESOLVED_TO && in_a_row < IN_A_ROW) {
        real growth = F(log)(larger(amplification(stability, direction, way), REAL_MIN)) / way;
        if (magnitude(growth - direction.re) <= allowed) {
            found = in_a_row == 0 ? way : found;
            in_a_row++;
        } else {
            found = RESOLVED_TO;
            in_a_row = 0;
        }
        way *= TRIAL;
    }
    return found;
}

/* Keeps a damped mode stable by an explicit method, where it isn't yet. */
static void keep_stable(ExplicitLimits *limits, Stability *stability, const Ray *ray, Complex direction, real size) {
    if (limits->stable * (STABLE_PART * ray->from) < size) {
        limits->stable = larger(limits->stable, size / (STABLE_PART * stable_way(stability, ray, direction)));
    }
}

/* The stiff method follows a mode by substeps of the reciprocal of `limit`, 1/s. */
static void follow(Limits *limits, real limit, Mode mode) {
    if (limit > limits->stiff) {
        limits->stiff = limit;
        limits->mode = mode;
    }
}

/* Adds what an eigenvalue asks for whose rounding error may be as large as `noise`. */
static void add_limit(Limits *limits, Mode value, real noise) {
    real size = F(hypot)(value.growth, value.frequency), growth = value.growth;
    if (size <= noise) {
#if UNIT_IS_OPEN
        /* Two integrators, of which the loop around them may make an oscillation that grows. */
        if (value.frequency > R(0.0)) {
            limits->carried = GROWING;
        }
#endif
        /* Whatever it is, it may grow as fast as that. */
        follow(limits, noise / GROWTH_IN_A_SUBSTEP, value);
        return;
    }
    if (value.frequency > R(0.0) && -growth < CARRYING * size) {
        real damped = -growth * FARTHEST > CARRYING * size ? CARRYING * size / -growth : FARTHEST;
        limits->carried = larger(limits->carried, growth > noise ? GROWING : damped);
    }
    Complex direction = {value.growth / size, value.frequency / size};
    if (growth <= R(0.0)) {
        keep_stable(&limits->order_5, explicit_stability, &RAY_5, direction, size);
        keep_stable(&limits->order_8, order_8_stability, &RAY_8, direction, size);
    }
    if (growth > larger(LEAST_GROWTH * size, noise)) {
        real allowed = GROWTH_ACCURACY * growth / size;
        real of_5 = size / resolved_way(explicit_stability, direction, allowed);
        real of_8 = size / resolved_way(order_8_stability, direction, allowed);
        limits->order_5.growing = larger(limits->order_5.growing, of_5);
        limits->order_8.growing = larger(limits->order_8.growing, of_8);
        follow(limits, size / resolved_way(stiff_stability, direction, allowed), value);
    } else if (growth > -larger(HARDLY_DAMPED * size, noise)) {
        follow(limits, size / resolved_way(stiff_stability, direction, HARDLY_DAMPED), value);
    } else {
        /* What decays well sets no limit to the stiff method. */
    }
}

/* The limits for the eigenvalues that were found. */
static void find_limits(Driver *driver, Limits *limits) {
    memset(limits, 0, sizeof *limits);
    driver->damped = (Mode){R(0.0), R(0.0)};
    for (int i = 0; i < UNIT_STATES; i++) {
        if (driver->eigenvalues[i].frequency >= R(0.0)) {
            int is_found = i >= driver->found_from && i < driver->found_to;
            real before = limits->order_5.stable;
            add_limit(limits, driver->eigenvalues[i], is_found ? driver->noise : R(0.0));
            if (limits->order_5.stable > before) {
                driver->damped = driver->eigenvalues[i];
            }
        }
    }
}

/* Keeps what was followed before, for substeps twice as long: where equations change faster than a substep sees, modes
 * that grow come and go. */
static void remember_limits(Limits *limits, const Limits *before) {
    if (limits->stiff < FORGOTTEN * before->stiff) {
        limits->stiff = FORGOTTEN * before->stiff;
        limits->mode = before->mode;
    }
}

/* Keeps most of how far errors were carried before: damping may change sign with the state, errors remain. */
static void keep_carrying(Limits *limits, real before) {
    limits->carried = larger(limits->carried, R(0.9) * before);
}

#endif
