/* Words to the debugger, or the emulator, that runs the program: all that it has in place of a screen. */

#ifndef SEMIHOSTING_H
#define SEMIHOSTING_H

#include <stdint.h>

enum { SEMIHOSTING_WRITE_TEXT = 0x04, SEMIHOSTING_EXIT = 0x20, APPLICATION_EXIT = 0x20026 };

/* The call has its number and its argument in the first two registers, as a function has. */
static inline void semihosting(uint32_t operation, const void *argument)
{
    register uint32_t first __asm__("r0") = operation;
    register const void *second __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xab" : "+r"(first) : "r"(second) : "memory");
}

static inline void tell_text(const char *text)
{
    semihosting(SEMIHOSTING_WRITE_TEXT, text);
}

/* Ends the program. */
static inline void leave(uint32_t status)
{
    const uint32_t reason[2] = {APPLICATION_EXIT, status};
    for (;;) {
        semihosting(SEMIHOSTING_EXIT, reason);
    }
}

#endif
