/* Why a step can't be finished, in words. */

/* A number of few digits, as near as they come. */
static real rounded(real x) {
    if (x == R(0.0) || !is_finite(x)) {
        return x;
    }
    int digits = 3 - (int)F(floor)(F(log10)(magnitude(x)));
    real power = F(pow)(R(10.0), (real)(digits < 0 ? -digits : digits));
    return digits < 0 ? F(round)(x / power) * power : F(round)(x * power) / power;
}

static void text_mode(Text *text, const Mode *mode) {
    text_add(text, ". A mode");
    if (mode->frequency > R(0.0)) {
        text_add(text, " of ");
        text_number(text, rounded(mode->frequency));
        text_add(text, " rad/s");
    }
    if (mode->growth > R(0.0)) {
        text_add(text, " that grows at ");
        text_number(text, rounded(mode->growth));
        text_add(text, " 1/s");
    } else {
        text_add(text, " that is hardly damped");
    }
    text_add(text, " had to be followed");
}

static void text_indicator(Text *text, int indicator) {
    text_add(text, "event indicator ");
    text_integer(text, (long)indicator + 1);
    if (unit_indicator_names[indicator][0] != '\0') {
        text_add(text, " (");
        text_add(text, unit_indicator_names[indicator]);
        text_add(text, ")");
    }
}

static void text_variable(Text *text, int place) {
    const char *name = place == TIME_OF_NEXT_EVENT ? "the time of the next event" : unit_real_variables[place].name;
    text_add(text, name != NULL ? name : "a hidden variable");
}

static void text_time(Text *text, real time) {
    text_add(text, " at t = ");
    text_number(text, time);
    text_add(text, " s");
}

/* The errors of numbers, as sentences. */
static void text_numeric_error(Text *text, const StepError *error) {
    switch (error->kind) {
    case STEP_DIVERGED:
        text_variable(text, error->variable);
        text_add(text, " = ");
        text_scientific(text, error->value);
        text_time(text, error->time);
        text_add(text, ": the simulation diverges. Check the gains and the loop, or take a smaller communication step");
        break;
    case STEP_TOO_SMALL:
        text_add(text, "no step size reaches the relative tolerance ");
        text_scientific(text, error->tolerance);
        text_add(text, " from ");
        text_variable(text, error->variable);
        text_add(text, " = ");
        text_scientific(text, error->value);
        text_time(text, error->time);
        text_add(text, " (last tried ");
        text_scientific(text, error->step);
        text_add(text, " s). The equations may be singular there, or the simulation diverges");
        break;
    case STEP_NO_JACOBIAN:
        text_add(text, "a derivative of der(");
        text_variable(text, error->variable);
        text_add(text, ") by states or time is no number");
        text_time(text, error->time);
        text_add(text, ", and the stiff method needs it: set integration_method to automatic or explicit");
        break;
    default:
        text_integer(text, error->events);
        text_add(text, " events and ");
        text_integer(text, error->substeps);
        text_add(text, " substeps reached only t = ");
        text_number(text, error->time);
        text_add(text, " s of a communication step of ");
        text_number(text, error->step);
        text_add(text, " s, with all the work that work_limit allows. The system changes too fast for this step: take a "
                       "smaller one or a larger work_limit. If it is stiff and integration_method is explicit, take "
                       "another method");
        if (error->follows) {
            text_mode(text, &error->mode);
        }
    }
}

/* The errors of events, as sentences. */
static void text_event_error(Text *text, const StepError *error) {
    switch (error->kind) {
    case STEP_ACCUMULATION:
        text_add(text, "the events of ");
        text_indicator(text, error->variable);
        text_add(text, " accumulate");
        text_time(text, error->time);
        text_add(text, ": ");
        text_integer(text, error->events);
        text_add(text, " so far, the last ");
        text_integer(text, error->close);
        text_add(text, " of them with no time between (Zeno behaviour). If it is a contact, let it come to rest: when the "
                       "speed after an event is small, set a discrete variable that makes the equations hold it. If it "
                       "is a switch, add hysteresis");
        break;
    case STEP_GOES_THROUGH:
        text_add(text, "event ");
        text_integer(text, error->events);
        text_add(text, " of ");
        text_indicator(text, error->variable);
        text_time(text, error->time);
        text_add(text, " stops the motion, but afterwards the motion goes on through zero. Set a discrete "
                       "variable in the event that makes the equations hold the stopped states");
        break;
    default:
        text_add(text, "more than ");
        text_integer(text, error->events);
        text_add(text, " events");
        text_time(text, error->time);
        text_add(text, ": the system switches without end (Zeno behaviour)");
    }
}

/* Why a step can't be finished, as a sentence; reasons of the unit itself are taken out of the log. */
static void step_error_text(const StepError *error, Log *log, Text *text) {
    switch (error->kind) {
    case STEP_DIVERGED:
    case STEP_TOO_SMALL:
    case STEP_NO_JACOBIAN:
    case STEP_TOO_MUCH_WORK:
        text_numeric_error(text, error);
        break;
    case STEP_ACCUMULATION:
    case STEP_GOES_THROUGH:
    case STEP_TOO_MANY_EVENTS:
        text_event_error(text, error);
        break;
    case STEP_PARAMETERS:
        text_add(text, "parameters refused, the last valid ones are in force again: ");
        log_take_refusals(log, text, NULL);
        break;
    default:
        log_take_refusals(log, text, isnan(error->time) ? NULL : &error->time);
    }
}
