/* Start of a program on an emulated Cortex-M7 (QEMU mps2-an500): vectors, and the floating-point unit. newlib does the rest. */
#include <stdint.h>

extern void _start(void);
extern uint32_t __stack;
void reset(void);

static void hang(void)
{
    for (;;) {
    }
}

void reset(void)
{
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20; /* CPACR: full access to CP10 and CP11 */
    __asm__ volatile("dsb\n isb");
    _start();
    hang();
}

__attribute__((section(".vectors"), used)) static const struct {
    uint32_t *stack;
    void (*handlers[15])(void);
} vectors = {&__stack, {reset, hang, hang, hang, hang, hang}};
