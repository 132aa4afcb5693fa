/* Linear equations of the stiff method: (I/(gamma h) - J) x = b.
 *
 * Where the Jacobian is sparse, rows and columns are taken in an order in which little fills in (both stand in the unit's
 * tables), and pivots stay on the diagonal: that is there whatever J is. Where a pivot comes out of the difference of large numbers all the same, an
 * elimination with pivoting takes its place. */

#if UNIT_HAS_STIFF

#if UNIT_SPARSE

/* A pivot may be this part of the numbers that it is the sum of, and what the diagonal held this part of the pivot's sum:
 * so many digits may be lost. */
#ifdef UNIT_FLOAT
#define LOST R(1e-3)
#else
#define LOST R(1e-7)
#endif

/* Eliminates what is left of the diagonal in a row; whether its pivot is accurate. */
static int eliminate_row(Driver *driver, int i) {
    real *row = driver->matrix + i * UNIT_STATES;
    real held = magnitude(row[i]), sum = held;
    for (int entry = unit_filled_rows[i]; entry < unit_filled_right[i]; entry++) {
        int k = unit_filled[entry];
        const real *source = driver->matrix + k * UNIT_STATES;
        real factor = row[k] * driver->inverse_pivots[k];
        row[k] = factor;
        sum += magnitude(factor * source[i]);
        for (int right = unit_filled_right[k]; right < unit_filled_rows[k + 1]; right++) {
            row[unit_filled[right]] -= factor * source[unit_filled[right]];
        }
    }
    driver->inverse_pivots[i] = R(1.0) / row[i];
    return is_finite(sum) && magnitude(row[i]) > LOST * sum && held > LOST * sum;
}

/* Decomposes diagonal I - J by rows, in the order of unit_order; whether that is accurate. */
static int decompose_in_order(Driver *driver, real diagonal) {
    real *a = driver->matrix;
    int *places = driver->pivots;
    for (int i = 0; i < UNIT_STATES; i++) {
        places[unit_order[i]] = i;
        a[i * UNIT_STATES + i] = diagonal;
        for (int entry = unit_filled_rows[i]; entry < unit_filled_rows[i + 1]; entry++) {
            a[i * UNIT_STATES + unit_filled[entry]] = R(0.0);
        }
    }
    for (int column = 0; column < UNIT_STATES; column++) {
        for (int entry = unit_columns[column]; entry < unit_columns[column + 1]; entry++) {
            a[places[unit_rows[entry]] * UNIT_STATES + places[column]] -= driver->jacobian[entry];
        }
    }
    for (int i = 0; i < UNIT_STATES; i++) {
        if (!eliminate_row(driver, i)) {
            return 0;
        }
    }
    return 1;
}

/* Replaces b by the solution, without exchanges. */
static void solve_in_order(Driver *driver, real *b) {
    real *x = driver->solution;
    for (int i = 0; i < UNIT_STATES; i++) {
        const real *row = driver->matrix + i * UNIT_STATES;
        x[i] = b[unit_order[i]];
        for (int entry = unit_filled_rows[i]; entry < unit_filled_right[i]; entry++) {
            x[i] -= row[unit_filled[entry]] * x[unit_filled[entry]];
        }
    }
    for (int i = UNIT_STATES - 1; i >= 0; i--) {
        const real *row = driver->matrix + i * UNIT_STATES;
        for (int entry = unit_filled_right[i]; entry < unit_filled_rows[i + 1]; entry++) {
            x[i] -= row[unit_filled[entry]] * x[unit_filled[entry]];
        }
        x[i] *= driver->inverse_pivots[i];
        b[unit_order[i]] = x[i];
    }
}

#endif

static void exchange_numbers(real *a, int i, int j) {
    real kept = a[i];
    a[i] = a[j];
    a[j] = kept;
}

/* Eliminates below place k of `values` with the multipliers of column k. */
static void subtract_column(real *values, const real *column, int k) {
    real first = values[k];
    for (int i = k + 1; i < UNIT_STATES; i++) {
        values[i] -= column[i] * first;
    }
}

/* Eliminates in the columns from the k-th on, with the largest pivot in it; whether there is one. */
static int eliminate_column(Driver *driver, int k) {
    real *column = driver->matrix + k * UNIT_STATES;
    int pivot = k;
    for (int i = k + 1; i < UNIT_STATES; i++) {
        if (magnitude(column[i]) > magnitude(column[pivot])) {
            pivot = i;
        }
    }
    driver->pivots[k] = pivot;
    if (column[pivot] == R(0.0) || !is_finite(column[pivot])) {
        return 0;
    }
    exchange_numbers(column, k, pivot);
    real factor = R(1.0) / column[k];
    for (int i = k + 1; i < UNIT_STATES; i++) {
        column[i] *= factor;
    }
    for (int j = k + 1; j < UNIT_STATES; j++) {
        real *other = driver->matrix + j * UNIT_STATES;
        exchange_numbers(other, k, pivot);
        subtract_column(other, column, k);
    }
    return 1;
}

/* Decomposes diagonal I - J by columns, with partial pivoting; whether it is regular. */
static int decompose_with_pivots(Driver *driver, real diagonal) {
    real *a = driver->matrix;
    memset(a, 0, sizeof driver->matrix);
    for (int column = 0; column < UNIT_STATES; column++) {
        for (int entry = unit_columns[column]; entry < unit_columns[column + 1]; entry++) {
            a[column * UNIT_STATES + unit_rows[entry]] = -driver->jacobian[entry];
        }
        a[column * UNIT_STATES + column] += diagonal;
    }
    for (int k = 0; k < UNIT_STATES; k++) {
        if (!eliminate_column(driver, k)) {
            return 0;
        }
    }
    /* Multipliers go into the order that the exchanges after them made. */
    for (int k = 0; k < UNIT_STATES; k++) {
        for (int later = k + 1; later < UNIT_STATES; later++) {
            exchange_numbers(a + k * UNIT_STATES, later, driver->pivots[later]);
        }
    }
    return 1;
}

/* Replaces b by the solution, with the exchanges of pivots. */
static void solve_with_pivots(const Driver *driver, real *b) {
    for (int k = 0; k < UNIT_STATES; k++) {
        exchange_numbers(b, k, driver->pivots[k]);
    }
    for (int k = 0; k < UNIT_STATES; k++) {
        subtract_column(b, driver->matrix + k * UNIT_STATES, k);
    }
    for (int k = UNIT_STATES - 1; k >= 0; k--) {
        const real *column = driver->matrix + k * UNIT_STATES;
        b[k] /= column[k];
        for (int i = 0; i < k; i++) {
            b[i] -= column[i] * b[k];
        }
    }
}

/* Decomposes diagonal I - J; whether it is regular. */
static int decompose(Driver *driver, real diagonal) {
#if UNIT_SPARSE
    driver->pivoted = !decompose_in_order(driver, diagonal);
    if (!driver->pivoted) {
        return 1;
    }
#endif
    return decompose_with_pivots(driver, diagonal);
}

/* Replaces b by the solution x of (diagonal I - J) x = b. */
static void solve(Driver *driver, real *b) {
#if UNIT_SPARSE
    if (!driver->pivoted) {
        solve_in_order(driver, b);
        return;
    }
#endif
    solve_with_pivots(driver, b);
}

#endif
