/* The drives' side of the component (drives.h). */
#include "drives.h"

#include <math.h>
#include <stdlib.h>

#include "units.h"

/*
 * While the drives are off the references approach the drives by this share of the distance per period; and references this close, nm, may be
 * switched on. LinuxCNC would step onto the position that it was told last, which is behind the reference by what the drive lags.
 */
enum { SHARE = 64, NEAR_NM = 10000 };

/* Nominal position of each joint in force; the one that this cycle asks for. */
static double nominal[GANTRY_TAU_AXES];
static double wanted[GANTRY_TAU_AXES];
static int64_t offset_nm[GANTRY_TAU_AXES];
static int is_started;

/* Adds an offset to a pin's value; without an offset the value stays the same, bit for bit. */
static double plus(double value, int64_t nm, int joint)
{
    return nm == 0 ? value : value + gt_joint_of_nm(joint, nm);
}

static int to_nm(double value, int joint, int64_t *nm)
{
    return gt_nm_of_joint(joint, value, nm, NULL) == GT_CODE_OK;
}

/* Nominal position of a joint whose drive is off: its reference approaches the drive. */
static double approach(const struct joint_pins *from, int joint)
{
    const double limit = gt_joint_of_nm(joint, gantry_tau_limits[joint].nominal_step_nm);
    const double step = (*from->position - *from->reference) / SHARE;
    int64_t position_nm, reference_nm;
    if (!is_started) {
        return *from->position;
    }
    if (!to_nm(*from->position, joint, &position_nm) || !to_nm(*from->reference, joint, &reference_nm) || position_nm == reference_nm) {
        return nominal[joint];
    }
    return nominal[joint] + (step > limit ? limit : step < -limit ? -limit : step);
}

/* Nominal position that this cycle asks for: LinuxCNC's. */
static double ask(const struct pins *pins, int joint)
{
    const struct joint_pins *from = &pins->joint[joint];
    wanted[joint] = *pins->enable ? *from->nominal : approach(from, joint);
    return wanted[joint];
}

int drives_read(const struct pins *pins, gt_tick_input *input)
{
    int is_read = 1;
    for (int joint = 0; joint < GANTRY_TAU_AXES; joint++) {
        const struct joint_pins *from = &pins->joint[joint];
        gt_actual *actual = &input->actual[joint];
        const double torque = *from->torque;
        int64_t speed_nm_s = 0;
        is_read &= to_nm(ask(pins, joint), joint, &input->nominal_nm[joint]);
        is_read &= to_nm(*from->position, joint, &actual->position_nm);
        is_read &= to_nm(*from->velocity, joint, &speed_nm_s) && llabs(speed_nm_s / 1000) <= INT32_MAX;
        is_read &= fabs(torque) <= INT16_MAX; /* not of NaN */
        if (is_read) {
            actual->velocity_um_s = (int32_t)(speed_nm_s / 1000);
            actual->torque_permille = (int16_t)torque;
        }
    }
    return is_read;
}

void drives_feedback(const struct pins *pins)
{
    for (int joint = 0; joint < GANTRY_TAU_AXES; joint++) {
        const struct joint_pins *to = &pins->joint[joint];
        /* LinuxCNC takes the position of a joint that is off for its command. */
        *to->feedback = is_started && !*pins->enable ? nominal[joint] : plus(*to->position, -offset_nm[joint], joint);
    }
}

void drives_start(const struct pins *pins)
{
    for (int joint = 0; joint < GANTRY_TAU_AXES; joint++) {
        nominal[joint] = wanted[joint];
        *pins->joint[joint].reference = wanted[joint];
    }
    is_started = 1;
}

int drives_are_near(const struct pins *pins)
{
    int is_near = 1;
    for (int joint = 0; joint < GANTRY_TAU_AXES; joint++) {
        int64_t position_nm, reference_nm;
        is_near &= to_nm(*pins->joint[joint].position, joint, &position_nm) && to_nm(*pins->joint[joint].reference, joint, &reference_nm) &&
                   llabs(position_nm - reference_nm) <= NEAR_NM;
    }
    return is_near;
}

/* Writes the reference of a joint: its nominal position, which is `nm` rounded, and its offset, within the machine's travel. */
static void write_reference(const struct pins *pins, int joint, double value, int64_t nm)
{
    const gt_axis_config *limits = &gantry_tau_limits[joint];
    const int64_t reference_nm = nm + offset_nm[joint];
    hal_float_t *reference = pins->joint[joint].reference;
    if (reference_nm > limits->machine_upper_nm) {
        *reference = gt_joint_of_nm(joint, limits->machine_upper_nm);
    } else if (reference_nm < limits->machine_lower_nm) {
        *reference = gt_joint_of_nm(joint, limits->machine_lower_nm);
    } else {
        *reference = plus(value, offset_nm[joint], joint);
    }
}

void drives_hold(const struct pins *pins)
{
    for (int joint = 0; joint < GANTRY_TAU_AXES; joint++) {
        int64_t nm;
        if (to_nm(ask(pins, joint), joint, &nm)) {
            nominal[joint] = wanted[joint];
            write_reference(pins, joint, nominal[joint], nm);
        }
    }
    for (int motor = 0; motor < GANTRY_TAU_MOTORS; motor++) {
        *pins->motor[motor].reference = *pins->joint[gantry_tau_axis_of_motor[motor]].reference;
    }
}

void drives_write(const struct pins *pins, const gt_tick_input *input, const gt_tick_output *output)
{
    for (int motor = 0; motor < GANTRY_TAU_MOTORS; motor++) {
        const int joint = gantry_tau_axis_of_motor[motor];
        const struct joint_pins *to = &pins->joint[joint];
        const gt_axis_state *state = &output->state.axes[joint];
        const gt_reference *reference = &output->motors[motor];
        /* Otherwise core holds the nominal position that is in force. */
        if (input->reading == GT_READING_DONE && state->nominal_nm == input->nominal_nm[joint]) {
            nominal[joint] = wanted[joint];
        }
        offset_nm[joint] = state->offsets.position_nm;
        write_reference(pins, joint, nominal[joint], state->nominal_nm);
        *to->offset = gt_joint_of_nm(joint, offset_nm[joint]);
        *to->shadow = gt_joint_of_nm(joint, state->shadow.position_nm);
        *to->velocity_offset = gt_joint_of_nm(joint, (int64_t)reference->velocity_offset_um_s * 1000);
        *to->torque_offset = reference->torque_offset_permille;
        *pins->motor[motor].reference = *to->reference;
        *pins->motor[motor].velocity_offset = *to->velocity_offset;
        *pins->motor[motor].torque_offset = *to->torque_offset;
    }
}
