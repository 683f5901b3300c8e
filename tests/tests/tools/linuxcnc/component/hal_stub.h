/* HAL and its clock without LinuxCNC: pins in memory, time by hand, what was said in a buffer. Included once, before the component. */
#ifndef HAL_STUB_H
#define HAL_STUB_H

#include "rtapi.h"
#include "rtapi_app.h"
#include "hal.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static long long now_ns = 1000000000;
static char said[1 << 16];

static void die(int line, const char *what)
{
    fprintf(stderr, "line %d: %s\n%s", line, what, said);
    exit(1);
}
#define REQUIRE(right)                                                                                                                               \
    do {                                                                                                                                             \
        if (!(right)) {                                                                                                                              \
            die(__LINE__, #right);                                                                                                                   \
        }                                                                                                                                            \
    } while (0)

long long int rtapi_get_time(void) { return now_ns; }

void rtapi_print_msg(msg_level_t level, const char *format, ...)
{
    const size_t length = strlen(said);
    va_list arguments;
    (void)level;
    va_start(arguments, format);
    vsnprintf(said + length, sizeof said - length, format, arguments);
    va_end(arguments);
}

void *hal_malloc(long int size) { return calloc(1, (size_t)size); }
int hal_init(const char *name) { return name == NULL ? -1 : 1; }
int hal_exit(int component) { return component - 1; }
int hal_ready(int component) { return component - 1; }

int hal_export_funct(const char *name, void (*function)(void *, long), void *argument, int floats, int reentrant, int component)
{
    return name == NULL || function == NULL || argument != NULL || !floats || reentrant || component != 1;
}

/* A pin points to its own place. */
#define NEW_PIN(kind, type)                                                                                                                          \
    int hal_pin_##kind##_newf(hal_pin_dir_t direction, type **pin, int component, const char *format, ...)                                           \
    {                                                                                                                                                \
        (void)direction, (void)component, (void)format;                                                                                              \
        *pin = calloc(1, sizeof **pin);                                                                                                              \
        return *pin == NULL;                                                                                                                         \
    }
NEW_PIN(float, hal_float_t)
NEW_PIN(bit, hal_bit_t)
NEW_PIN(s32, hal_s32_t)
NEW_PIN(u32, hal_u32_t)

#endif
