/* Which method integrates, and the eigenvalue that decided it: what the log tells where that is asked for. */

/* So many changes are told: some systems change for ever. */
#define MOST_CHANGES 5

#if UNIT_MOVES

/* Notes what integrates from a time on. News is what integrates for the first time, and a change. */
static void note_method(Driver *driver, int method, real from, const Pace *pace) {
    Choices *choices = &driver->choices;
    Chosen chosen = {BY_EXPLICIT, method != METHOD_AUTOMATIC, 0, from, R(0.0), {R(0.0), R(0.0)}};
    if (method == METHOD_FIXED) {
        chosen.by = BY_FIXED;
    } else {
        chosen.by = pace->stiff ? BY_STIFF : BY_EXPLICIT;
#if UNIT_HAS_SPECTRUM
        if ((pace->limits.order_5.stable > R(0.0)) && ((driver->damped.growth != R(0.0)) || (driver->damped.frequency != R(0.0)))) {
            chosen.substep = R(1.0) / pace->limits.order_5.stable;
            chosen.mode = driver->damped;
        }
#endif
    }
    Integrates before = choices->in_force;
    choices->in_force = chosen.by;
    if ((!choices->seen[chosen.by]) || ((before != BY_NOTHING) && (before != chosen.by) && (choices->changes < MOST_CHANGES))) {
        choices->news = chosen;
    }
    choices->seen[chosen.by] = 1;
}

#endif

/* Takes the latest news; whether there are any: none where it has gone there and back. */
static int take_news(Choices *choices, Chosen *news) {
    *news = choices->news;
    choices->news.by = BY_NOTHING;
    int is_news = 0;
    if ((news->by != BY_NOTHING) && (news->by != choices->told)) {
        is_news = 1;
        if (choices->told != BY_NOTHING) {
            choices->changes++;
        }
        if (choices->changes == MOST_CHANGES) {
            news->is_last = 1;
        }
        choices->told = news->by;
    }
    return is_news;
}

/* Sentences about a method: asked for, without an eigenvalue, with a real one and a pair, and the same for the last time. */
#define TOLD(method) "integrated by " method " from t = \1r s"
#define VALUE ": the eigenvalue \1e2 1/s "
#define PAIR ": the eigenvalue \1e2 \xc2\xb1 \1e2i 1/s "
#define LAST "; further changes are not logged"
#define SENTENCES(method, decides)                                                                                          \
    {TOLD(method) ", as integration_method asks", TOLD(method),        TOLD(method) VALUE decides,                          \
     TOLD(method) PAIR decides,                   TOLD(method) VALUE decides LAST, TOLD(method) PAIR decides LAST}

/* Tells it, before the messages from a place on. */
static void tell_method(Log *log, int place, const Chosen *chosen) {
    static const char *const sentences[METHODS][6] = {
        [BY_EXPLICIT] = SENTENCES("the explicit method", "allows substeps of \1e2 s at order 5"),
        [BY_STIFF] = SENTENCES("the stiff method", "limits the explicit method of order 5 to \1e2 s"),
        [BY_FIXED] = SENTENCES("steps of fixed length", ""),
    };
    real values[4] = {chosen->from, chosen->mode.growth, chosen->substep, R(0.0)};
    int is_pair = 0;
    if (chosen->mode.frequency != R(0.0)) {
        is_pair = 1;
        values[2] = chosen->mode.frequency;
        values[3] = chosen->substep;
    }
    int which = 0;
    if (chosen->is_asked_for == 0) {
        which = (chosen->substep > R(0.0)) ? (2 + is_pair + (2 * chosen->is_last)) : 1;
    }
    tell_before(log, place, CATEGORY_EVENTS, sentences[chosen->by][which], values, 3 + is_pair);
}
