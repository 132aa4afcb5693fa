/* Farthest moves of a control in parts of its size, by which a step is too long: of CONTROLS controls. */
#ifndef MOVES_H
#define MOVES_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

typedef struct {
    double last[CONTROLS], largest[CONTROLS], farthest[CONTROLS], size[CONTROLS], since[CONTROLS], count;
} Moves;

static inline bool moves_far(Moves *m, const double *u, double limit)
{
    const bool has_left = m->count > 0;
    bool counts = has_left;
    double worst = 0;
    for (int i = 0; i < CONTROLS; i++) {
        const double now = fabs(u[i]), moved = fabs(u[i] - m->last[i]);
        counts |= moved > 0;
        m->last[i] = u[i];
        if (has_left) m->farthest[i] = fmax(m->farthest[i], moved);
        m->largest[i] = fmax(m->largest[i], now);
        const bool grows = now > m->size[i] * 1.1;
        m->since[i] = grows ? 0 : m->since[i] + 1;
        if (grows) m->size[i] = now;
    }
    m->count += counts;
    for (int i = 0; i < CONTROLS; i++) {
        const double wait = fmin(fmax(m->count - m->since[i], 20), 1000);
        if (m->since[i] >= wait && m->largest[i] > 0) worst = fmax(worst, m->farthest[i] / m->largest[i]);
    }
    return worst > limit;
}
#endif
