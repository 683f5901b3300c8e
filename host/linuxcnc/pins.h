/* Pins of the HAL component: README.md has their meaning, units and directions. */
#ifndef GANTRY_TAU_PINS_H
#define GANTRY_TAU_PINS_H

#include "rtapi.h"
#include "hal.h"

#include "gantry_tau.h"
#include "machine.h"

/* Pins of a joint, `gantry-tau.N.`: one per axis of the machine. */
struct joint_pins {
    hal_float_t *nominal, *position, *velocity, *torque;
    hal_float_t *reference, *feedback, *offset, *shadow, *velocity_offset, *torque_offset;
    hal_float_t *travel_lower, *travel_upper;
};

/* Pins of a motor, `gantry-tau.motor.M.`: motors of one axis receive equal references. */
struct motor_pins {
    hal_float_t *reference, *velocity_offset, *torque_offset;
};

struct pins {
    struct joint_pins joint[GANTRY_TAU_AXES];
    struct motor_pins motor[GANTRY_TAU_MOTORS];
    hal_float_t *wrench[6];
    hal_bit_t *enable, *stop, *rearm, *wrench_valid, *permit;
    hal_s32_t *phase, *cause, *lateness, *lateness_max;
    hal_u32_t *tick, *missed, *held, *checksum;
};

/* Names the first pin that must be connected and is not, once all files of HAL are loaded; NULL if there is none. */
const char *pins_unconnected(const struct pins *pins);

/* True if every pin of the force sensor is connected. */
int pins_have_wrench(const struct pins *pins);

/* Makes all pins, in HAL's memory. Returns them; NULL after an error, which HAL has reported. */
struct pins *pins_new(int component);

#endif
