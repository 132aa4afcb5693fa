/* Functions of numbers that equations call and that C doesn't have as they are meant. */

#ifndef ADAPTIVE_FMU_NUMBERS_H
#define ADAPTIVE_FMU_NUMBERS_H

/* 1 with the sign of the number; no number has no sign. */
static inline real sign(real x)
{
    return x != x ? x : F(copysign)(R(1.0), x);
}

/* The angle within (-pi, pi] that differs by whole turns, exactly, from one beyond that. */
static inline real wrapped_far(real angle)
{
    const real half = R(3.141592653589793);
    const real turn = R(6.283185307179586);
    const real rest = F(fmod)(angle, turn);
    if (rest > half) {
        return rest - turn;
    }
    return rest <= -half ? rest + turn : rest;
}

/* The same from any. */
static inline real wrapped(real angle)
{
    return (F(fabs)(angle) < R(3.141592653589793)) ? angle : wrapped_far(angle);
}

/* The whole turns from an angle to within a half turn. */
static inline real turns(real angle)
{
    const real turn = R(6.283185307179586);
    return (F(fabs)(angle) < R(3.141592653589793)) ? R(0.0) : (F(round)((wrapped_far(angle) - angle) / turn) * turn);
}

/* The integer that a number is, without its fraction: the nearest there is where it is too large, 0 of what is no number. */
static inline int whole(real x)
{
    if (x != x) {
        return 0;
    }
    if (x <= R(-2147483648.0)) {
        return INT_MIN;
    }
    return x >= R(2147483647.0) ? INT_MAX : (int)x;
}

/* The same among wider integers. */
static inline int64_t wide(real x)
{
    if (x != x) {
        return 0;
    }
    if (x <= R(-9223372036854775808.0)) {
        return INT64_MIN;
    }
    return x >= R(9223372036854775808.0) ? INT64_MAX : (int64_t)x;
}

/* A power with a whole exponent, by squares. */
static inline real power(real x, int exponent)
{
    real product = R(1.0);
    const int inverse = exponent < 0;
    for (;;) {
        if (exponent % 2 != 0) {
            product *= x;
        }
        exponent /= 2;
        if (exponent == 0) {
            return inverse ? R(1.0) / product : product;
        }
        x *= x;
    }
}

/* One more word taken into a number all of whose bits depend on all bits of the words (the output of SplitMix64). */
static inline uint64_t scrambled(uint64_t number, uint64_t word)
{
    uint64_t bits = number + word + UINT64_C(0x9e3779b97f4a7c15);
    bits = (bits ^ (bits >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    bits = (bits ^ (bits >> 27)) * UINT64_C(0x94d049bb133111eb);
    return bits ^ (bits >> 31);
}

/* A number in (0, 1]. */
static inline double uniform(uint64_t bits)
{
    return (double)((bits >> 11) + 1) / 9007199254740992.0;
}

/* Random bits for a sample of a channel. */
static inline uint64_t random_bits(real seed, real channel, real sample)
{
    uint64_t stream = scrambled(0, (uint64_t)(int64_t)whole(seed));
    stream = scrambled(stream, (uint64_t)whole(channel));
    return scrambled(stream, (uint64_t)wide(sample));
}

/* A number of (0, 1], each as likely, for a sample of a channel. */
static inline real uniform_number(real seed, real channel, real sample)
{
    return (real)uniform(scrambled(random_bits(seed, channel, sample), 0));
}

/* The number of a sample of a channel, with mean 0 and standard deviation 1 (Box and Muller). */
static inline real noise(real seed, real channel, real sample)
{
    const uint64_t stream = random_bits(seed, channel, sample);
    const double radius = uniform(scrambled(stream, 0));
    const double angle = uniform(scrambled(stream, 1));
    return (real)(sqrt(-2.0 * log(radius)) * cos(6.28318530717958647692 * angle));
}

#endif
