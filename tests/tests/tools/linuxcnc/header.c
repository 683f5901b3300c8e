/* Prints the machine of machine.h: checksum by its name and by the library, home in nm, and what the linked library does not read. */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "gantry_tau.h"
#include "machine.h"

#ifdef GANTRY_TAU_MODEL_L2
static GT_MEMORY(GT_L2_SIZE) memory;
#else
static GT_MEMORY(GT_F1_SIZE) memory;
#endif

int main(void)
{
    int64_t home_nm[GANTRY_TAU_AXES];
    uint32_t checksum = 0;
    gt_error error;
    gt_code code;
#ifdef GANTRY_TAU_MODEL_L2
    gt_l2 *machine;
    code = gt_l2_init(&memory, sizeof memory, &gantry_tau_geometry, &machine, &error);
    code = code != GT_CODE_OK ? code : gt_l2_inverse(machine, gantry_tau_home_m, home_nm, &error);
    code = code != GT_CODE_OK ? code : gt_l2_checksum(machine, &checksum);
#else
    const gt_pose home = {.position_m = {gantry_tau_home_m[0], gantry_tau_home_m[1], gantry_tau_home_m[2]},
                          .rotation = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    gt_f1 *machine;
    code = gt_f1_init(&memory, sizeof memory, &gantry_tau_geometry, &machine, &error);
    code = code != GT_CODE_OK ? code : gt_f1_inverse(machine, &home, NULL, home_nm, NULL, &error);
    code = code != GT_CODE_OK ? code : gt_f1_checksum(machine, &checksum);
#endif
    if (code != GT_CODE_OK) {
        printf("FAILED: %s\n", gt_code_name(code));
        return 1;
    }
    printf("%s %08lx %08lx\n", GANTRY_TAU_ROBOT, (unsigned long)GANTRY_TAU_KINEMATICS_CHECKSUM, (unsigned long)checksum);
    for (int axis = 0; axis < GANTRY_TAU_AXES; axis++) {
        const gt_axis_config *limits = &gantry_tau_limits[axis];
        uint64_t bits;
        memcpy(&bits, &gantry_tau_metres_per_q[axis], sizeof bits);
        printf("axis %lld, %llx, %lld to %lld in %lld to %lld by %lu", (long long)home_nm[axis], (unsigned long long)bits,
               (long long)limits->nominal_lower_nm, (long long)limits->nominal_upper_nm, (long long)limits->machine_lower_nm,
               (long long)limits->machine_upper_nm, (unsigned long)limits->nominal_step_nm);
        const gt_limits *channels[] = {&limits->position, &limits->velocity, &limits->torque};
        for (int channel = 0; channel < 3; channel++) {
            const gt_limits *of = channels[channel];
            printf(", %ld %ld %ld %ld", (long)of->max, (long)of->step, (long)of->accel, (long)of->ramp);
        }
        printf("\n");
    }
    for (int motor = 0; motor < GANTRY_TAU_MOTORS; motor++) {
        printf("motor %d\n", gantry_tau_axis_of_motor[motor]);
    }
    return 0;
}
