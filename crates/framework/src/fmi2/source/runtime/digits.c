/* Decimal digits of numbers.
 *
 * Digits are found with whole numbers of any length (Steele and White's method as Burger and Dybvig wrote it), so that
 * they are right for every number. It is slow, and messages are rare. */

/* Words of the whole numbers: those of the smallest numbers are powers of two up to about 1100. */
enum { WORDS = 36, MOST_DIGITS = 330 };

/* Of which so many are in use: the last of them isn't zero, and all behind it are. */
typedef struct {
    int words;
    uint32_t word[WORDS];
} Whole;

static void whole_trim(Whole *a) {
    while (a->words > 0 && a->word[a->words - 1] == 0) {
        a->words--;
    }
}

static void whole_multiply(Whole *a, uint32_t factor) {
    uint64_t carry = 0;
    for (int i = 0; i < a->words; i++) {
        carry += (uint64_t)a->word[i] * factor;
        a->word[i] = (uint32_t)carry;
        carry >>= 32;
    }
    if (carry != 0) {
        a->word[a->words++] = (uint32_t)carry;
    }
}

static Whole whole_power_of_two(uint64_t factor, int power) {
    Whole a;
    memset(&a, 0, sizeof a);
    a.word[power / 32] = (uint32_t)factor;
    a.word[power / 32 + 1] = (uint32_t)(factor >> 32);
    a.words = power / 32 + 2;
    whole_trim(&a);
    whole_multiply(&a, (uint32_t)1 << power % 32);
    return a;
}

static int whole_compare(const Whole *a, const Whole *b) {
    if (a->words != b->words) {
        return a->words < b->words ? -1 : 1;
    }
    for (int i = a->words - 1; i >= 0; i--) {
        if (a->word[i] != b->word[i]) {
            return a->word[i] < b->word[i] ? -1 : 1;
        }
    }
    return 0;
}

/* Compares a + b with c. */
static int whole_compare_sum(const Whole *a, const Whole *b, const Whole *c) {
    Whole sum;
    memset(&sum, 0, sizeof sum);
    uint64_t carry = 0;
    sum.words = a->words > b->words ? a->words : b->words;
    for (int i = 0; i < sum.words; i++) {
        carry += (uint64_t)a->word[i] + b->word[i];
        sum.word[i] = (uint32_t)carry;
        carry >>= 32;
    }
    if (carry != 0) {
        sum.word[sum.words++] = (uint32_t)carry;
    }
    return whole_compare(&sum, c);
}

/* Takes b away as often as it goes: the digit. */
static int whole_divide(Whole *a, const Whole *b) {
    int digit = 0;
    while (whole_compare(a, b) >= 0) {
        uint64_t borrow = 0;
        for (int i = 0; i < a->words; i++) {
            uint64_t difference = (uint64_t)a->word[i] - b->word[i] - borrow;
            a->word[i] = (uint32_t)difference;
            borrow = difference >> 63;
        }
        whole_trim(a);
        digit++;
    }
    return digit;
}

/* A number above zero as a fraction, with the halves of the distances to its neighbours in the same measure; `even`:
 * whether what lies right between belongs to it. */
typedef struct {
    Whole number, one, above, below;
    int even;
} Fraction;

#ifdef UNIT_FLOAT
enum { MANTISSA = FLT_MANT_DIG, LEAST_POWER = FLT_MIN_EXP - FLT_MANT_DIG };
#else
enum { MANTISSA = DBL_MANT_DIG, LEAST_POWER = DBL_MIN_EXP - DBL_MANT_DIG };
#endif

static Fraction fraction_of(real value) {
    Fraction f;
    int power;
    real part = F(frexp)(value, &power);
    power -= MANTISSA;
    if (power < LEAST_POWER) {
        /* Subnormal numbers have fewer digits. */
        part = F(ldexp)(part, power - LEAST_POWER);
        power = LEAST_POWER;
    }
    uint64_t mantissa = (uint64_t)F(ldexp)(part, MANTISSA);
    /* A power of two is nearer to the number below it than to the one above. */
    int uneven = mantissa == (uint64_t)1 << (MANTISSA - 1) && power > LEAST_POWER;
    int up = power > 0 ? power : 0, down = power < 0 ? -power : 0;
    f.even = mantissa % 2 == 0;
    f.number = whole_power_of_two(mantissa, up + 1 + uneven);
    f.one = whole_power_of_two(1, down + 1 + uneven);
    f.above = whole_power_of_two(1, up + uneven);
    f.below = whole_power_of_two(1, up);
    return f;
}

/* Digits, with a point before the first, and a power of ten. */
typedef struct {
    char digits[MOST_DIGITS];
    int count;
    int power;
} Decimal;

static void decimal_put(Decimal *d, int digit) {
    d->digits[d->count++] = (char)('0' + digit);
}

/* Rounds up at the last digit. */
static void decimal_round_up(Decimal *d) {
    int last = d->count;
    while (last > 0 && d->digits[last - 1] == '9') {
        d->digits[--last] = '0';
    }
    if (last > 0) {
        d->digits[last - 1]++;
        return;
    }
    d->power++;
    if (d->count == 0) {
        decimal_put(d, 0);
    }
    d->digits[0] = '1';
}

/* Brings the fraction below 1 and to at least 0.1; the power of ten that this takes. `rounded_up`: as it is when rounded
 * up to half of the distance to its neighbour. */
static int fraction_scale(Fraction *f, int rounded_up) {
    Whole nothing, ten_times;
    memset(&nothing, 0, sizeof nothing);
    int power = 0, least = rounded_up && !f->even;
    while (whole_compare_sum(&f->number, rounded_up ? &f->above : &nothing, &f->one) >= least) {
        whole_multiply(&f->one, 10);
        power++;
    }
    for (;;) {
        Whole above = rounded_up ? f->above : nothing;
        ten_times = f->number;
        whole_multiply(&ten_times, 10);
        whole_multiply(&above, 10);
        if (whole_compare_sum(&ten_times, &above, &f->one) >= least) {
            return power;
        }
        f->number = ten_times;
        whole_multiply(&f->above, 10);
        whole_multiply(&f->below, 10);
        power--;
    }
}

/* The fewest digits that tell a number above zero from every other one. */
static void decimal_shortest(Decimal *d, real value) {
    Fraction f = fraction_of(value);
    d->count = 0;
    d->power = fraction_scale(&f, 1);
    for (;;) {
        whole_multiply(&f.number, 10);
        whole_multiply(&f.above, 10);
        whole_multiply(&f.below, 10);
        decimal_put(d, whole_divide(&f.number, &f.one));
        int low = whole_compare(&f.number, &f.below) < f.even;
        int high = whole_compare_sum(&f.number, &f.above, &f.one) > -f.even;
        if (low || high) {
            int nearer_above = whole_compare_sum(&f.number, &f.number, &f.one) >= 0;
            if (high && (!low || nearer_above)) {
                decimal_round_up(d);
            }
            return;
        }
    }
}

/* A number above zero to so many digits, or so many behind the point: rounded to the nearest, between two to the even. */
static void decimal_exact(Decimal *d, real value, int digits, int behind_point) {
    Fraction f = fraction_of(value);
    d->count = 0;
    d->power = fraction_scale(&f, 0);
    int wanted = behind_point ? d->power + digits : digits;
    while (d->count < wanted) {
        whole_multiply(&f.number, 10);
        decimal_put(d, whole_divide(&f.number, &f.one));
    }
    int rest = whole_compare_sum(&f.number, &f.number, &f.one);
    int odd = d->count > 0 && (d->digits[d->count - 1] - '0') % 2 == 1;
    if (wanted >= 0 && (rest > 0 || (rest == 0 && odd))) {
        decimal_round_up(d);
    }
}

/* The first digits of a number above zero, rounded up where digits are left out and `up` says so. */
static void decimal_cut(Decimal *d, real value, int digits, int up) {
    decimal_shortest(d, value);
    int is_short = d->count <= digits;
    for (; d->count < digits; d->count++) {
        d->digits[d->count] = '0';
    }
    d->count = digits;
    if (up && !is_short) {
        decimal_round_up(d);
    }
}
