/* Configuration of the server (configuration.h). */
#include "configuration.h"

#include <stdio.h>
#include <string.h>

#include "machine.h"

/* Checks that the header of the machine belongs to this module: the client compares the checksum with that of its own robot file. */
static gt_code machine_checksum(uint32_t *checksum, gt_error *error)
{
#ifdef GANTRY_TAU_MODEL_L2
    static GT_MEMORY(GT_L2_SIZE) place;
    gt_l2 *machine;
    const gt_code code = gt_l2_init(&place, sizeof place, &gantry_tau_geometry, &machine, error);
    return code == GT_CODE_OK ? gt_l2_checksum(machine, checksum) : code;
#else
    static GT_MEMORY(GT_F1_SIZE) place;
    gt_f1 *machine;
    const gt_code code = gt_f1_init(&place, sizeof place, &gantry_tau_geometry, &machine, error);
    return code == GT_CODE_OK ? gt_f1_checksum(machine, checksum) : code;
#endif
}

int configure(gt_server_config *config, int lockstep, char *text, size_t size)
{
    gt_error error;
    uint32_t checksum = 0;
    gt_code code = machine_checksum(&checksum, &error);
    if (code == GT_CODE_OK && checksum != GANTRY_TAU_KINEMATICS_CHECKSUM) {
        snprintf(text, size, "machine.h is damaged: its kinematics have the checksum %08x, not %08x", (unsigned)checksum,
                 (unsigned)GANTRY_TAU_KINEMATICS_CHECKSUM);
        return -1;
    }
    if (code == GT_CODE_OK) {
        code = gt_server_config_thesis(config, GANTRY_TAU_AXES);
    }
    config->motors = GANTRY_TAU_MOTORS;
    memcpy(config->axis_of_motor, gantry_tau_axis_of_motor, sizeof gantry_tau_axis_of_motor);
    memcpy(config->axis, gantry_tau_limits, sizeof gantry_tau_limits);
    config->kinematics_checksum = checksum;
    config->capabilities = lockstep ? 1 : 0;
    if (code == GT_CODE_OK) {
        code = gt_server_config_check(config, NULL, &error);
    }
    if (code != GT_CODE_OK) {
        snprintf(text, size, "machine.h is refused: %s, index %d, %g", gt_code_name(code), (int)error.index, error.value);
    }
    return code == GT_CODE_OK ? 0 : -1;
}
