/* All eigenvalues of a matrix of UNIT_STATES rows.
 *
 * Rows and columns are permuted and scaled first (Parlett and Reinsch, Balancing a matrix for calculation of eigenvalues
 * and eigenvectors, Numer. Math. 13 (1969) 293-304). Then reflections bring the matrix to Hessenberg form, and Francis'
 * implicit double shifts split it (Golub and Van Loan, Matrix Computations, 7.4 and 7.5). */

#if UNIT_HAS_SPECTRUM

/* Shifts tried for one eigenvalue before it is given up. Two or three are usual. */
#define MOST_SHIFTS 60
/* After so many shifts without success, one of another kind; and from then on an entry is taken for zero that is no larger
 * than the rounding errors of the whole matrix. Many equal eigenvalues beside a large one are not told apart any further. */
#define UNUSUAL_SHIFT 10
/* Each round of scaling halves what is left; a matrix that needs more is beyond the range of numbers. */
#define MOST_SCALINGS 64

/* An entry of the matrix, by rows. */
#define A(row, column) a[(row) * UNIT_STATES + (column)]

/* Whether the entries of a row or a column are zeros from low up to high, but for the diagonal. */
static int stands_alone(const real *a, int i, int low, int high, int row) {
    for (int j = low; j < high; j++) {
        if (j != i && (row ? A(i, j) : A(j, i)) != R(0.0)) {
            return 0;
        }
    }
    return 1;
}

/* The first row or column that stands alone; high where none does. */
static int first_alone(const real *a, int low, int high, int row) {
    int i = low;
    while (i < high && !stands_alone(a, i, low, high, row)) {
        i++;
    }
    return i;
}

/* Exchanges two rows, and the same columns. */
static void exchange(real *a, int i, int j) {
    if (i == j) {
        return;
    }
    for (int k = 0; k < UNIT_STATES; k++) {
        real kept = A(i, k);
        A(i, k) = A(j, k);
        A(j, k) = kept;
    }
    for (int k = 0; k < UNIT_STATES; k++) {
        real kept = A(k, i);
        A(k, i) = A(k, j);
        A(k, j) = kept;
    }
}

static Mode real_eigenvalue(real value) {
    Mode mode = {value, R(0.0)};
    return mode;
}

/* Takes eigenvalues off that stand alone in a row or a column of what is left, and moves those out of the way. What is
 * left goes from *low up to *high. */
static void permute(Driver *driver, int *low, int *high) {
    real *a = driver->matrix;
    int i;
    *low = 0;
    *high = UNIT_STATES;
    while ((i = first_alone(a, *low, *high, 1)) < *high) {
        *high -= 1;
        exchange(a, i, *high);
        driver->eigenvalues[*high] = real_eigenvalue(A(*high, *high));
    }
    while ((i = first_alone(a, *low, *high, 0)) < *high) {
        exchange(a, i, *low);
        driver->eigenvalues[*low] = real_eigenvalue(A(*low, *low));
        *low += 1;
    }
}

/* Scales row and column i by a power of two, if that brings their sizes together; whether it does. */
static int scale_one(real *a, int i, int low, int high) {
    real row = R(0.0), column = R(0.0);
    for (int j = low; j < high; j++) {
        if (j != i) {
            row += magnitude(A(i, j));
            column += magnitude(A(j, i));
        }
    }
    if (row == R(0.0) || column == R(0.0)) {
        return 0;
    }
    real factor = F(exp2)(F(round)(R(0.5) * F(log2)(row / column)));
    if (!(column * factor + row / factor < R(0.95) * (column + row))) {
        return 0;
    }
    for (int j = low; j < high; j++) {
        A(j, i) *= factor;
    }
    for (int j = low; j < high; j++) {
        A(i, j) /= factor;
    }
    return 1;
}

/* Scales rows and columns until each row is about as large as its column. */
static void scale(real *a, int low, int high) {
    for (int round = 0; round < MOST_SCALINGS; round++) {
        int scaled = 0;
        for (int i = low; i < high; i++) {
            scaled |= scale_one(a, i, low, high);
        }
        if (!scaled) {
            return;
        }
    }
}

/* Clears column k below the first subdiagonal by a reflection of rows and columns; v lies in the column that it clears. */
static void reflect_column(real *a, int k, int low, int high) {
    real squares = R(0.0);
    for (int i = k + 1; i < high; i++) {
        squares += A(i, k) * A(i, k);
    }
    real length = F(sqrt)(squares);
    if (length == R(0.0)) {
        return;
    }
    real first = A(k + 1, k), image = -F(copysign)(length, first);
    A(k + 1, k) = first - image;
    real beta = R(1.0) / (length * (length + magnitude(first)));
    for (int j = k + 1; j < high; j++) {
        real product = R(0.0);
        for (int i = k + 1; i < high; i++) {
            product += A(i, k) * A(i, j);
        }
        for (int i = k + 1; i < high; i++) {
            A(i, j) -= beta * product * A(i, k);
        }
    }
    for (int i = low; i < high; i++) {
        real product = R(0.0);
        for (int j = k + 1; j < high; j++) {
            product += A(i, j) * A(j, k);
        }
        for (int j = k + 1; j < high; j++) {
            A(i, j) -= beta * product * A(j, k);
        }
    }
    for (int i = k + 1; i < high; i++) {
        A(i, k) = R(0.0);
    }
    A(k + 1, k) = image;
}

/* Where the last block that doesn't split begins, of those from low up to end: before it lies an entry that is nothing
 * beside its neighbours, or beside a size that is at least given. */
static int last_block(real *a, int low, int end, real least, real norm) {
    for (int k = end - 1; k > low; k--) {
        real beside = larger(magnitude(A(k, k)) + magnitude(A(k - 1, k - 1)), least);
        real size = beside == R(0.0) ? norm : beside;
        if (magnitude(A(k, k - 1)) <= REAL_EPSILON * size) {
            A(k, k - 1) = R(0.0);
            return k;
        }
    }
    return low;
}

/* The eigenvalues of the block of two rows at k. */
static void pair(const real *a, int k, Mode *values) {
    real first = A(k, k), last = A(k + 1, k + 1);
    real half = R(0.5) * (first - last), product = A(k, k + 1) * A(k + 1, k);
    real discriminant = half * half + product;
    if (discriminant < R(0.0)) {
        values[0].growth = values[1].growth = last + half;
        values[0].frequency = F(sqrt)(-discriminant);
        values[1].frequency = -values[0].frequency;
        return;
    }
    real root = half + F(copysign)(F(sqrt)(discriminant), half);
    values[0] = real_eigenvalue(last + root);
    values[1] = real_eigenvalue(root == R(0.0) ? last : last - product / root);
}

/* Reflects `count` rows and columns from k on, within the block from `start` up to `end`: by the reflection
 * I - v (beta v)' that takes x to a multiple of the first axis. */
static void reflect(real *a, const real *x, int count, int k, int start, int end) {
    real largest = R(0.0), v[3], scaled[3], squares = R(0.0);
    for (int r = 0; r < count; r++) {
        largest = larger(largest, magnitude(x[r]));
    }
    if (largest == R(0.0)) {
        return;
    }
    for (int r = 0; r < count; r++) {
        v[r] = x[r] / largest;
        squares += v[r] * v[r];
    }
    v[0] += F(copysign)(F(sqrt)(squares), v[0]);
    squares = R(0.0);
    for (int r = 0; r < count; r++) {
        squares += v[r] * v[r];
    }
    real beta = R(2.0) / squares;
    for (int r = 0; r < count; r++) {
        scaled[r] = beta * v[r];
    }
    for (int j = k > start ? k - 1 : start; j < end; j++) {
        real product = R(0.0);
        for (int r = 0; r < count; r++) {
            product += A(k + r, j) * scaled[r];
        }
        for (int r = 0; r < count; r++) {
            A(k + r, j) -= product * v[r];
        }
    }
    for (int i = start; i < end && i <= k + count; i++) {
        real product = R(0.0);
        for (int r = 0; r < count; r++) {
            product += A(i, k + r) * scaled[r];
        }
        for (int r = 0; r < count; r++) {
            A(i, k + r) -= product * v[r];
        }
    }
}

/* One implicit double shift of the block from l up to end. An unusual one leaves a cycle of the usual ones. */
static void shift(real *a, int l, int end, int unusual) {
    int m = end - 1;
    real sum, product;
    if (unusual) {
        real size = magnitude(A(m, m - 1)) + magnitude(A(m - 1, m - 2));
        sum = R(1.5) * size;
        product = size * size;
    } else {
        sum = A(m, m) + A(m - 1, m - 1);
        product = A(m, m) * A(m - 1, m - 1) - A(m, m - 1) * A(m - 1, m);
    }
    real x[3];
    x[0] = A(l, l) * (A(l, l) - sum) + A(l, l + 1) * A(l + 1, l) + product;
    x[1] = A(l + 1, l) * (A(l, l) + A(l + 1, l + 1) - sum);
    x[2] = A(l + 1, l) * A(l + 2, l + 1);
    for (int k = l; k < m - 1; k++) {
        reflect(a, x, 3, k, l, end);
        x[0] = A(k + 1, k);
        x[1] = A(k + 2, k);
        x[2] = k + 3 <= m ? A(k + 3, k) : R(0.0);
    }
    reflect(a, x, 2, m - 1, l, end);
    for (int i = l + 2; i <= m; i++) {
        for (int j = i - 3 > l ? i - 3 : l; j < i - 1; j++) {
            A(i, j) = R(0.0);
        }
    }
}

/* Splits the Hessenberg matrix into blocks of one and two rows, from its end; whether that succeeds. */
static int split(Driver *driver, int low, int high, real norm) {
    real *a = driver->matrix;
    int end = high, shifts = 0;
    while (end > low) {
        real least = (shifts < UNUSUAL_SHIFT) ? R(0.0) : norm;
        int start = last_block(a, low, end, least, norm);
        if (end - start > 2) {
            if (shifts >= MOST_SHIFTS) {
                return 0;
            }
            shifts++;
            shift(a, start, end, shifts % UNUSUAL_SHIFT == 0);
            continue;
        }
        if (end - start == 1) {
            driver->eigenvalues[start] = real_eigenvalue(A(start, start));
        } else {
            pair(a, start, &driver->eigenvalues[start]);
        }
        end = start;
        shifts = 0;
    }
    for (int i = 0; i < UNIT_STATES; i++) {
        if (!is_finite(driver->eigenvalues[i].growth) || !is_finite(driver->eigenvalues[i].frequency)) {
            return 0;
        }
    }
    return 1;
}

/* The root of the sum of the squares of what is left. */
static real root_of_squares(const real *a, int low, int high) {
    real squares = R(0.0);
    for (int i = low; i < high; i++) {
        for (int j = low; j < high; j++) {
            squares += A(i, j) * A(i, j);
        }
    }
    return F(sqrt)(squares);
}

/* Finds the eigenvalues of the driver's matrix, by columns or by rows, which is lost in it; whether it could. */
static int find_spectrum(Driver *driver) {
    real *a = driver->matrix;
    /* The shifts need squares of the entries. */
    if (!is_finite(root_of_squares(a, 0, UNIT_STATES))) {
        return 0;
    }
    int low, high;
    permute(driver, &low, &high);
    scale(a, low, high);
    real norm = root_of_squares(a, low, high);
    driver->noise = R(10.0) * (real)UNIT_STATES * REAL_EPSILON * norm;
    driver->found_from = low;
    driver->found_to = high;
    for (int k = low; k < high - 2; k++) {
        reflect_column(a, k, low, high);
    }
    return split(driver, low, high, norm);
}

#undef A

#endif
