/* Decimal digits of random numbers as messages of units have them (digits.c), against those of the C library. */

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef double real;
#define F(name) name
#define R(number) number

#include "digits.c"

static uint64_t bits(void) {
    static uint64_t state = 1;
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return state;
}

/* A number above zero: of any size, a short one, or one that is nearly nothing. */
static double number(int kind) {
    double value;
    uint64_t any = bits() & (kind == 0 ? UINT64_C(0xfffffffffffff) : UINT64_C(0x7fffffffffffffff));
    memcpy(&value, &any, sizeof value);
    return kind == 1 ? (double)(bits() % 100000) / (double)(1 + bits() % 1000) : value;
}

static double value_of(const Decimal *d) {
    char text[MOST_DIGITS + 20];
    sprintf(text, "0.%.*se%d", d->count, d->digits, d->power);
    return strtod(text, NULL);
}

/* Whether a number cut to so many digits is as near as it can be without being beyond the number, or short of it. */
static int is_cut(double value, int digits, int up) {
    Decimal cut, beyond;
    decimal_cut(&cut, value, digits, up);
    beyond = cut;
    if (up) {
        for (int last = digits; beyond.digits[--last]-- == '0';) {
            beyond.digits[last] = '9';
        }
        return value_of(&cut) >= value && value_of(&beyond) < value;
    }
    decimal_round_up(&beyond);
    return value_of(&cut) <= value && value_of(&beyond) > value;
}

int main(void) {
    for (int k = 0; k < 30000; k++) {
        double value = number(k % 3);
        if (!(value > 0.0 && value <= DBL_MAX)) {
            continue;
        }
        Decimal shortest, rounded;
        decimal_shortest(&shortest, value);
        decimal_exact(&rounded, value, 6, 0);
        char fewer[40], six[40];
        sprintf(fewer, "%.*e", shortest.count > 1 ? shortest.count - 2 : 0, value);
        sprintf(six, "%.5e", value);
        int is_shortest = shortest.count == 1 || strtod(fewer, NULL) != value;
        if (value_of(&shortest) != value || !is_shortest || value_of(&rounded) != strtod(six, NULL)) {
            printf("%.17g\n", value);
            return 1;
        }
        if (!is_cut(value, 1 + k % 7, 0) || !is_cut(value, 1 + k % 7, 1)) {
            printf("%.17g cut\n", value);
            return 1;
        }
    }
    return 0;
}
