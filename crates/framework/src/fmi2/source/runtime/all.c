/* The unit: the only file that is compiled. Nothing but the functions of the standard has a name outside it. */

#include "runtime.h"
#include "standard.h"
#ifndef UNIT_STATIC_INSTANCES
#include <stdlib.h>
#include <time.h>
#endif
#include "problem.h"
#include "text.h"
#include "instance.h"

#include "unit.c"

#include "digits.c"
#include "text.c"

#include "problem.c"
#include "explicit.c"
#include "order_8.c"
#include "elimination.c"
#include "spectrum.c"
#include "stiff.c"
#include "stability.c"
#include "choice.c"
#include "chosen.c"
#include "indicators.c"
#include "events.c"
#include "fixed.c"
#include "driver.c"
#include "failures.c"

#include "execution.c"
#include "exchange.c"

#include "modes.c"
#include "calls.c"
#include "memory.c"
#include "access.c"
#include "derivatives.c"
#include "stepping.c"
#include "exchange_calls.c"
#include "states.c"
#include "both.c"

#if UNIT_FMI == 3
#include "event_mode.c"
#include "dependencies.c"
#include "adjoint.c"
#include "fmi3.c"
#else
#include "fmi2.c"
#endif
