/* A Cortex-M4F from reset to newlib's start: its table of vectors, and the floating-point unit switched on. */
#include <stdint.h>

extern uint32_t top_of_stack;
extern void _start(void);

static void stop(void)
{
    for (;;) {
    }
}

/* An interrupt of the timer, for programs without one. */
__attribute__((weak)) void SysTick_Handler(void)
{
    stop();
}

void reset(void)
{
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20; /* CPACR: full access to CP10 and CP11 (ARMv7-M, B3.2.20) */
    __asm__ volatile("dsb\n\tisb");
    _start();
    stop();
}

__attribute__((section(".vectors"), used)) static void (*const vectors[])(void) = {
    (void (*)(void))&top_of_stack, reset, stop, stop, stop, stop, stop, 0, 0, 0, 0, stop, stop, 0, stop, SysTick_Handler,
};
