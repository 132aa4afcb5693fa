/* Takes the steps of a law over recorded inputs, and tells what they took and what they gave, all in hexadecimal:
 *
 *     step TICKS OUTPUT ...    ticks of the timer, and the bits of each output
 *     event STEP               in which an indicator changed sides, or the status
 *     refused STEPS            how many steps were refused
 *     empty TICKS              between two readings of the timer with nothing in between
 *     stack BYTES              the most that a step has used
 *
 * Nothing is told before all steps are taken: the stack that telling takes isn't the law's. */

#include <stdint.h>
#include <string.h>

#include "recorded.h"
#include "semihosting.h"

/* A timer of the board (CMSDK APB timer 0) with 32 bits, that counts down. It goes by the emulator's clock, which each
 * instruction moves by the same time. */
typedef struct {
    uint32_t control, value, reload, interrupt;
} Timer;
#define TIMER ((volatile Timer *)0x40000000u)
#define FROM 0xffffffffu
#define PAINT 0xa5c3961eu

/* Of the linker script. */
extern uint32_t stack_end[];

/* recorded.h names the law: its types and functions, how many outputs it has, what its inputs are, and the sides of its
 * indicators. */
static law controller;
static law_real outputs[RECORDED_STEPS][LAW_OUTPUTS];
static uint32_t ticks[RECORDED_STEPS];
static unsigned char has_event[RECORDED_STEPS];

/* What is told next: the longest line has all outputs, 17 characters each. */
static char line[32 + 17 * LAW_OUTPUTS];

static void begin(void)
{
    TIMER->value = FROM;
}

static uint32_t passed(void)
{
    return FROM - TIMER->value;
}

/* All of the stack below the function that calls. */
__attribute__((noinline)) static uint32_t *paint(void)
{
    uint32_t *here = __builtin_frame_address(0);
    for (volatile uint32_t *word = stack_end; word < here; word++) {
        *word = PAINT;
    }
    return here;
}

/* How much of it is painted over. */
static uint32_t used_below(const uint32_t *top)
{
    const uint32_t *word = stack_end;
    while (word < top && *word == PAINT) {
        word++;
    }
    return (uint32_t)((const char *)top - (const char *)word);
}

/* A number in hexadecimal behind a blank; where the line goes on. */
static char *put(char *at, uint64_t number, int digits)
{
    *at++ = ' ';
    while (digits-- > 0) {
        *at++ = "0123456789abcdef"[number >> (4 * digits) & 15];
    }
    return at;
}

static void tell_line(char *end)
{
    memcpy(end, "\n", 2);
    tell_text(line);
}

static void tell_number(const char *name, uint32_t number)
{
    size_t length = strlen(name);
    memcpy(line, name, length);
    tell_line(put(line + length, number, 8));
}

static void tell_step(int step)
{
    memcpy(line, "step", 4);
    char *at = put(line + 4, ticks[step], 8);
    for (int k = 0; k < LAW_OUTPUTS; k++) {
        double output = outputs[step][k];
        uint64_t bits;
        memcpy(&bits, &output, sizeof bits);
        at = put(at, bits, 16);
    }
    tell_line(at);
}

int main(void)
{
    TIMER->reload = FROM;
    TIMER->control = 1;
    begin();
    const uint32_t empty = passed();
    law_init(&controller);
    uint32_t refused = 0, last = 0;
    const uint32_t *top = paint();
    for (int step = 0; step < RECORDED_STEPS; step++) {
        const uint32_t sides = LAW_SIDES(controller);
        begin();
        /* Structs of numbers alone. */
        const uint32_t status =
            law_step(&controller, (const law_inputs *)(const void *)recorded[step], (law_outputs *)(void *)outputs[step]);
        ticks[step] = passed();
        /* Sides that a discrete value turns are the same after its event. */
        has_event[step] = LAW_SIDES(controller) != sides || status != last;
        last = status;
        refused += (status & LAW_REFUSED) != 0;
    }
    const uint32_t stack = used_below(top);
    for (int step = 0; step < RECORDED_STEPS; step++) {
        tell_step(step);
        if (has_event[step]) {
            tell_number("event", (uint32_t)step);
        }
    }
    tell_number("refused", refused);
    tell_number("empty", empty);
    tell_number("stack", stack);
    return 0;
}
