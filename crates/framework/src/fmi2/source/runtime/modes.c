/* The floating-point modes of the processor are the host's own. A host may round in its own way, flush small numbers to zero
 * or let exceptions end it (TwinCAT does): a unit computes in the default modes, and hands back the host's, with its flags of
 * past exceptions. Where SSE2 does the arithmetic, that is; elsewhere the modes are taken as they are. */

#if defined(__SSE2_MATH__) || defined(_M_X64)

#include <emmintrin.h>

/* The six flags of past exceptions; all exceptions masked, rounding to nearest, nothing flushed to zero. */
#define MODE_FLAGS 0x3FU
#define DEFAULT_MODES 0x1F80U

/* Sets the host's modes aside; what they were. */
static unsigned host_modes_aside(void) {
    unsigned host = _mm_getcsr();
    if ((host & ~MODE_FLAGS) != DEFAULT_MODES) {
        _mm_setcsr(DEFAULT_MODES);
    }
    return host;
}

static void host_modes_back(unsigned host) {
    if (_mm_getcsr() != host) {
        _mm_setcsr(host);
    }
}

#else

static unsigned host_modes_aside(void) {
    return 0U;
}

static void host_modes_back(unsigned host) {
    (void)host;
}

#endif
