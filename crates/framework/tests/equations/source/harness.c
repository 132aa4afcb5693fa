/* Gives a unit's equations names outside, by the numbers of the methods. */

#include "runtime.h"

struct Log {
    int count;
};

static void log_text(Log *log, int category, const char *text, const real *values, int count)
{
    (void)category;
    (void)text;
    (void)values;
    log->count += count;
}

static void refuse(Log *log, const char *reason, const real *values, int count)
{
    (void)reason;
    (void)values;
    log->count += count;
}

#include "unit.c"

void carry_out(int method, double t, double step, const unsigned char *crossed, double *v, int *n, double *results);
const void *tables(int which);

void carry_out(int method, double t, double step, const unsigned char *crossed, double *v, int *n, double *results)
{
    Log log = { 0 };
    switch (method) {
    case 0:
        unit_prepare(v, n, &log);
        break;
    case 1:
        unit_outputs(t, v, n);
        unit_evaluate(t, v, n);
        break;
    case 2:
        unit_initialise(t, v, n, &log);
        break;
    case 3:
        unit_parameters_changed(t, v, n, &log);
        break;
    case 4:
        unit_check(t, v, n, &log);
        break;
    case 5:
        results[0] = unit_next_time_event(v, n);
        break;
#if UNIT_INDICATORS > 0
    case 6:
        unit_event_indicators(t, v, n, results);
        break;
#endif
    case 7:
        unit_event(t, crossed, v, n, &log);
        break;
    case 8:
        unit_step_completed(t, step, v, n, &log);
        break;
    case 9:
        unit_directional(t, step, v, n, results);
        break;
    case 10:
        unit_start_directional(t, v, n, results);
        break;
#if UNIT_STATES > 0
    case 11:
        unit_jacobian(t, v, n, NULL, results, results + UNIT_NONZEROS);
        break;
#endif
    default:
        break;
    }
}

/* Whatever isn't read above. */
const void *tables(int which)
{
    Log log = { 0 };
    log_text(&log, 0, "", NULL, 0);
    refuse(&log, "", NULL, 0);
    const void *const all[] = { unit_real_variables, unit_integer_variables, unit_start_reals, unit_start_integers,
                                unit_nominals, unit_watched, unit_indicator_names, unit_categories, unit_columns, unit_rows };
    return all[which];
}
