/* From reset to main: the vector table, the floating-point unit, memory as C expects it. */

#include <stdint.h>

#include "semihosting.h"

/* Of the linker script. */
extern uint32_t data_start[], data_end[], bss_start[], bss_end[], stack_top[];
extern const uint32_t data_stored[];

int main(void);
void reset(void);

/* The coprocessor access control register: the floating-point unit is off after reset. */
#define ACCESS (*(volatile uint32_t *)0xe000ed88u)
#define FULL_ACCESS_TO_FLOATING_POINT (0xfu << 20)

static void fault(void)
{
    tell_text("fault\n");
    leave(2);
}

typedef struct {
    uint32_t *stack;
    void (*handlers[15])(void);
} Vectors;

__attribute__((section(".vectors"), used)) static const Vectors vectors = {
    stack_top,
    {reset, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault},
};

/* Nothing here computes with floating point: it isn't there before the barriers. */
void reset(void)
{
    ACCESS |= FULL_ACCESS_TO_FLOATING_POINT;
    __asm__ volatile("dsb\n\tisb" ::: "memory");
    const uint32_t *stored = data_stored;
    for (uint32_t *word = data_start; word < data_end; word++) {
        *word = *stored++;
    }
    for (uint32_t *word = bss_start; word < bss_end; word++) {
        *word = 0;
    }
    leave((uint32_t)main());
}
