/* Pins of the HAL component (pins.h). */
#include "pins.h"

#include <stdio.h>
#include <string.h>

#include "units.h"

/* The pins as they were made: `net` lets a pointer point to the signal instead, and a pin that was not connected points to its own place. */
static struct pins unconnected;

static int joint_pins(struct joint_pins *pins, int joint, int component)
{
    const struct {
        const char *name;
        hal_pin_dir_t direction;
        hal_float_t **pin;
    } all[] = {
        {"nominal", HAL_IN, &pins->nominal},
        {"position", HAL_IN, &pins->position},
        {"velocity", HAL_IN, &pins->velocity},
        {"torque", HAL_IN, &pins->torque},
        {"reference", HAL_OUT, &pins->reference},
        {"feedback", HAL_OUT, &pins->feedback},
        {"offset", HAL_OUT, &pins->offset},
        {"shadow", HAL_OUT, &pins->shadow},
        {"velocity-offset", HAL_OUT, &pins->velocity_offset},
        {"torque-offset", HAL_OUT, &pins->torque_offset},
        {"travel-lower", HAL_OUT, &pins->travel_lower},
        {"travel-upper", HAL_OUT, &pins->travel_upper},
    };
    int code = 0;
    for (size_t i = 0; i < sizeof all / sizeof *all && code == 0; i++) {
        code = hal_pin_float_newf(all[i].direction, all[i].pin, component, "gantry-tau.%d.%s", joint, all[i].name);
    }
    return code;
}

static int motor_pins(struct motor_pins *pins, int motor, int component)
{
    int code = hal_pin_float_newf(HAL_OUT, &pins->reference, component, "gantry-tau.motor.%d.reference", motor);
    if (code == 0) {
        code = hal_pin_float_newf(HAL_OUT, &pins->velocity_offset, component, "gantry-tau.motor.%d.velocity-offset", motor);
    }
    if (code == 0) {
        code = hal_pin_float_newf(HAL_OUT, &pins->torque_offset, component, "gantry-tau.motor.%d.torque-offset", motor);
    }
    return code;
}

static int common_pins(struct pins *pins, int component)
{
    int code = 0;
    for (int i = 0; i < 6 && code == 0; i++) {
        code = hal_pin_float_newf(HAL_IN, &pins->wrench[i], component, "gantry-tau.wrench-%d", i);
    }
    code = code ? code : hal_pin_bit_newf(HAL_IN, &pins->enable, component, "gantry-tau.enable");
    code = code ? code : hal_pin_bit_newf(HAL_IN, &pins->stop, component, "gantry-tau.stop");
    code = code ? code : hal_pin_bit_newf(HAL_IN, &pins->rearm, component, "gantry-tau.rearm");
    code = code ? code : hal_pin_bit_newf(HAL_IN, &pins->wrench_valid, component, "gantry-tau.wrench-valid");
    code = code ? code : hal_pin_bit_newf(HAL_OUT, &pins->permit, component, "gantry-tau.permit");
    code = code ? code : hal_pin_u32_newf(HAL_OUT, &pins->checksum, component, "gantry-tau.checksum");
    code = code ? code : hal_pin_s32_newf(HAL_OUT, &pins->phase, component, "gantry-tau.phase");
    code = code ? code : hal_pin_s32_newf(HAL_OUT, &pins->cause, component, "gantry-tau.cause");
    code = code ? code : hal_pin_s32_newf(HAL_OUT, &pins->lateness, component, "gantry-tau.lateness");
    /* In and out: an operator sets it back to 0. */
    code = code ? code : hal_pin_s32_newf(HAL_IO, &pins->lateness_max, component, "gantry-tau.lateness-max");
    code = code ? code : hal_pin_u32_newf(HAL_OUT, &pins->tick, component, "gantry-tau.tick");
    code = code ? code : hal_pin_u32_newf(HAL_OUT, &pins->missed, component, "gantry-tau.missed");
    return code ? code : hal_pin_u32_newf(HAL_OUT, &pins->held, component, "gantry-tau.held");
}

struct pins *pins_new(int component)
{
    struct pins *pins = hal_malloc(sizeof *pins);
    int code = pins == NULL ? -1 : 0;
    if (code == 0) {
        memset(pins, 0, sizeof *pins);
        code = common_pins(pins, component);
    }
    for (int joint = 0; joint < GANTRY_TAU_AXES && code == 0; joint++) {
        code = joint_pins(&pins->joint[joint], joint, component);
    }
    for (int motor = 0; motor < GANTRY_TAU_MOTORS && code == 0; motor++) {
        code = motor_pins(&pins->motor[motor], motor, component);
    }
    if (code != 0) {
        return NULL;
    }
    for (int joint = 0; joint < GANTRY_TAU_AXES; joint++) {
        *pins->joint[joint].travel_lower = gt_joint_of_nm(joint, gantry_tau_limits[joint].nominal_lower_nm);
        *pins->joint[joint].travel_upper = gt_joint_of_nm(joint, gantry_tau_limits[joint].nominal_upper_nm);
    }
    *pins->checksum = GANTRY_TAU_KINEMATICS_CHECKSUM;
    unconnected = *pins;
    return pins;
}

int pins_have_wrench(const struct pins *pins)
{
    int has = 1;
    for (int i = 0; i < 6; i++) {
        has &= pins->wrench[i] != unconnected.wrench[i];
    }
    return has;
}

const char *pins_unconnected(const struct pins *pins)
{
    static char name[32]; /* of one thread */
    if (pins->enable == unconnected.enable && !*pins->enable) {
        return "gantry-tau.enable";
    }
    if (pins->permit == unconnected.permit) {
        return "gantry-tau.permit";
    }
    for (int joint = 0; joint < GANTRY_TAU_AXES; joint++) {
        const struct joint_pins *now = &pins->joint[joint], *then = &unconnected.joint[joint];
        if (now->nominal == then->nominal || now->position == then->position) {
            snprintf(name, sizeof name, "gantry-tau.%d.%s", joint, now->nominal == then->nominal ? "nominal" : "position");
            return name;
        }
    }
    return NULL;
}
