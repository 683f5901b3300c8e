/* The drives' side of the component (drives.h). */
#include "drives.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "units.h"

/*
 * While the drives are off the references approach the drives by this share of the distance per period; and references this close, nm, may be
 * switched on. LinuxCNC would step onto the position that it was told last, which is behind the reference by what the drive lags.
 */
enum { SHARE = 64, NEAR_NM = 10000 };

/* What a cycle has read: nominal positions in LinuxCNC's units and in nm, measurements. */
struct reading {
    double nominal[GANTRY_TAU_AXES];
    int64_t nominal_nm[GANTRY_TAU_AXES];
    gt_actual actual[GANTRY_TAU_AXES];
};

/* Of the last cycle; of the last one that was accepted. */
static struct reading seen, accepted;
/* Nominal position of each joint in force. */
static double nominal[GANTRY_TAU_AXES];
static int64_t offset_nm[GANTRY_TAU_AXES];
static int is_started;

static int to_nm(double value, int joint, int64_t *nm)
{
    return gt_nm_of_joint(joint, value, nm, NULL) == GT_CODE_OK;
}

/* Nominal position of a joint whose drive is off: with the offset in force it approaches the drive. */
static double approach(double position, int joint)
{
    const double limit = gt_joint_of_nm(joint, gantry_tau_limits[joint].nominal_step_nm);
    const double distance = position - gt_joint_of_nm(joint, offset_nm[joint]) - nominal[joint];
    const double step = distance / SHARE;
    if (!is_started) {
        return position;
    }
    return nominal[joint] + (step > limit ? limit : step < -limit ? -limit : step);
}

int drives_read(const struct pins *pins)
{
    int is_read = 1;
    for (int joint = 0; joint < GANTRY_TAU_AXES; joint++) {
        const struct joint_pins *from = &pins->joint[joint];
        gt_actual *actual = &seen.actual[joint];
        const double torque = *from->torque;
        int64_t speed_nm_s = 0;
        /* The start is where the drives are, on or off. */
        seen.nominal[joint] = *pins->enable && is_started ? *from->nominal : approach(*from->position, joint);
        is_read &= to_nm(seen.nominal[joint], joint, &seen.nominal_nm[joint]);
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

void drives_accept(gt_tick_input *input)
{
    accepted = seen;
    for (int joint = 0; joint < GANTRY_TAU_AXES; joint++) {
        input->nominal_nm[joint] = seen.nominal_nm[joint];
        input->actual[joint] = seen.actual[joint];
    }
}

void drives_feedback(const struct pins *pins)
{
    for (int joint = 0; joint < GANTRY_TAU_AXES; joint++) {
        const struct joint_pins *to = &pins->joint[joint];
        const double position = *to->position;
        /* LinuxCNC takes the position of a joint that is off for its command. Without an offset the drive's stays the same, bit for bit. */
        *to->feedback = is_started && !*pins->enable ? nominal[joint]
                        : offset_nm[joint] == 0      ? position
                                                     : position - gt_joint_of_nm(joint, offset_nm[joint]);
    }
}

void drives_start(void)
{
    for (int joint = 0; joint < GANTRY_TAU_AXES; joint++) {
        nominal[joint] = accepted.nominal[joint];
    }
    is_started = 1;
}

/* True if two positions of a joint are near each other. */
static int are_near(double one, double other, int joint)
{
    int64_t one_nm, other_nm;
    return to_nm(one, joint, &one_nm) && to_nm(other, joint, &other_nm) && llabs(one_nm - other_nm) <= NEAR_NM;
}

int drives_agree(const struct pins *pins, char *text, size_t size)
{
    for (int joint = 0; joint < GANTRY_TAU_AXES; joint++) {
        const struct joint_pins *of = &pins->joint[joint];
        const char *unit = gt_is_plate(joint) ? "degrees" : "mm";
        const double position = *of->position, reference = *of->reference, command = *of->nominal;
        if (!are_near(position, reference, joint)) {
            if (text != NULL) {
                snprintf(text, size,
                         "joint %d: gantry-tau.%d.position is %.6f %s, %.6f from the reference: the drive moves, or stands beyond the machine's travel", joint,
                         joint, position, unit, position - reference);
            }
            return 0;
        }
        if (!are_near(command, nominal[joint], joint)) {
            if (text != NULL) {
                snprintf(text, size,
                         "joint %d: gantry-tau.%d.nominal is %.6f %s, %.6f from the nominal position in force: check the wires of joint.%d.motor-pos-cmd and "
                         "joint.%d.motor-pos-fb",
                         joint, joint, command, unit, command - nominal[joint], joint, joint);
            }
            return 0;
        }
    }
    return 1;
}

/* Writes the references that core gave out. Motors of one joint have equal ones. */
static void write_motors(const struct pins *pins, const gt_reference *references)
{
    for (int motor = 0; motor < GANTRY_TAU_MOTORS; motor++) {
        const int joint = gantry_tau_axis_of_motor[motor];
        const gt_reference *reference = &references[motor];
        const struct joint_pins *to = &pins->joint[joint];
        *to->reference = gt_joint_of_nm(joint, reference->position_nm);
        *to->velocity_offset = gt_joint_of_nm(joint, (int64_t)reference->velocity_offset_um_s * 1000);
        *to->torque_offset = reference->torque_offset_permille;
        *pins->motor[motor].reference = *to->reference;
        *pins->motor[motor].velocity_offset = *to->velocity_offset;
        *pins->motor[motor].torque_offset = *to->torque_offset;
    }
}

void drives_hold(const struct pins *pins, const gt_held *held)
{
    for (int joint = 0; held->follows && joint < GANTRY_TAU_AXES; joint++) {
        nominal[joint] = accepted.nominal[joint];
    }
    if (held->write) {
        write_motors(pins, held->motors);
    }
}

void drives_write(const struct pins *pins, const gt_tick_input *input, const gt_tick_output *output)
{
    for (int joint = 0; joint < GANTRY_TAU_AXES; joint++) {
        const struct joint_pins *to = &pins->joint[joint];
        const gt_axis_state *state = &output->state.axes[joint];
        /* Otherwise core holds the nominal position that is in force. */
        if (state->nominal_nm == input->nominal_nm[joint]) {
            nominal[joint] = accepted.nominal[joint];
        }
        offset_nm[joint] = state->offsets.position_nm;
        *to->offset = gt_joint_of_nm(joint, offset_nm[joint]);
        *to->shadow = gt_joint_of_nm(joint, state->shadow.position_nm);
    }
    write_motors(pins, output->motors);
}
