/*
 * LinuxCNC kinematics of a Gantry-Tau robot, over the C interface of gantry-tau. The machine is machine.h, written by `gantry-tau header`.
 *
 * L2: three joints, X Y Z. F1: six joints, X Y Z A B C. Units: units.h. Joints are whole nanometres, as references of the core.
 *
 * A pose that the machine cannot take is an error, and the joints stay as they are. The inverse depends on its pose alone. The forward
 * kinematics of an F1 is found from the last pose.
 *
 * Pins:
 *     gantrytaukins.code      s32    code (gt_code) of the last refused call; 0 before the first
 *     gantrytaukins.index     s32    axis or arm that it is about, counted from 0; -1 for none
 *     gantrytaukins.refused   u32    number of refused calls
 *     gantrytaukins.residual  float  largest error of a link's length in the last solution, m; 0 for an L2, whose solution is closed
 *     gantrytaukins.checksum  u32    checksum of the kinematic parameters, as gantry-tau has it
 *     gantrytaukins.home-N    float  position of joint N at the robot file's home, mm or degrees
 */
#include <rtapi.h>
#include <rtapi_app.h>
#include <rtapi_string.h>
#include <hal.h>
#include <kinematics.h>

#include "units.h"

MODULE_AUTHOR("gantry-tau");
MODULE_DESCRIPTION("Kinematics of Gantry-Tau robots");
/* These sources: MIT OR Apache-2.0. A binary is linked into LinuxCNC, and so GPL as a whole. */
MODULE_LICENSE("GPL");

KINS_NOT_SWITCHABLE
EXPORT_SYMBOL(kinematicsType);
EXPORT_SYMBOL(kinematicsForward);
EXPORT_SYMBOL(kinematicsInverse);

static struct pins {
    hal_s32_t *code, *index;
    hal_u32_t *refused, *checksum;
    hal_float_t *residual;
    hal_float_t *home[GANTRY_TAU_AXES];
} *pins;
static int component;

/* Codes of the last call of each direction: a message is printed when one changes. */
static gt_code last_forward, last_inverse;

/* 1 after the first pose that forward kinematics found. LinuxCNC calls it before the drives' positions are known, too: not counted. */
static int located;

#ifdef GANTRY_TAU_MODEL_L2

static GT_MEMORY(GT_L2_SIZE) memory;
static gt_l2 *machine;

static gt_code create(uint32_t *checksum, gt_error *error)
{
    const gt_code code = gt_l2_init(&memory, sizeof memory, &gantry_tau_geometry, &machine, error);
    return code == GT_CODE_OK ? gt_l2_checksum(machine, checksum) : code;
}

static gt_code inverse(const gt_pose *pose, int64_t *positions_nm, double *residual_m, gt_error *error)
{
    *residual_m = 0;
    return gt_l2_inverse(machine, pose->position_m, positions_nm, error);
}

/* The pose has no orientation: A B C stay 0. */
static gt_code forward(const int64_t *positions_nm, gt_pose *pose, double *residual_m, gt_error *error)
{
    static const gt_pose unturned = {.rotation = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    *residual_m = 0;
    *pose = unturned;
    return gt_l2_forward(machine, positions_nm, pose->position_m, error);
}

#else

/* After an error a tracker needs up to three calls: from its last pose, with more steps from there, from the synchronised form. */
enum { ATTEMPTS = 4 };

static GT_MEMORY(GT_F1_SIZE) memory;
static GT_MEMORY(GT_F1_TRACKER_SIZE) tracker_memory;
static gt_f1 *machine;
static gt_f1_tracker *tracker;

static gt_pose home_pose(void)
{
    const gt_pose pose = {
        .position_m = {gantry_tau_home_m[0], gantry_tau_home_m[1], gantry_tau_home_m[2]},
        .rotation = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}},
    };
    return pose;
}

/* A calibrated machine has no synchronised form: the first pose is found from home. */
static gt_code create(uint32_t *checksum, gt_error *error)
{
    const gt_pose home = home_pose();
    gt_code code = gt_f1_init(&memory, sizeof memory, &gantry_tau_geometry, &machine, error);
    if (code == GT_CODE_OK) {
        code = gt_f1_tracker_init(&tracker_memory, sizeof tracker_memory, machine, &tracker, error);
    }
    if (code == GT_CODE_OK) {
        code = gt_f1_tracker_start_from(tracker, &home);
    }
    return code == GT_CODE_OK ? gt_f1_checksum(machine, checksum) : code;
}

static gt_code inverse(const gt_pose *pose, int64_t *positions_nm, double *residual_m, gt_error *error)
{
    gt_solved solved = {0};
    const gt_code code = gt_f1_inverse(machine, pose, NULL, positions_nm, &solved, error);
    *residual_m = solved.residual_m;
    return code;
}

static gt_code forward(const int64_t *positions_nm, gt_pose *pose, double *residual_m, gt_error *error)
{
    gt_solved solved = {0};
    gt_code code = GT_CODE_OTHER;
    for (int attempt = 0; attempt < ATTEMPTS && code != GT_CODE_OK; attempt++) {
        code = gt_f1_tracker_pose(tracker, positions_nm, pose, &solved, error);
    }
    *residual_m = solved.residual_m;
    return code;
}

#endif

/* Notes the outcome of a call. Returns 0, or -1 for an error. */
static int outcome(const char *what, gt_code *last, gt_code code, const gt_error *error, double residual_m)
{
    if (code == GT_CODE_OK) {
        *pins->residual = residual_m;
    } else {
        *pins->code = code;
        *pins->index = error->index;
        *pins->refused += 1;
        if (code != *last) {
            rtapi_print_msg(RTAPI_MSG_ERR, "gantrytaukins: %s: %s, axis or arm %d\n", what, gt_code_name(code), (int)error->index);
        }
    }
    *last = code;
    return code == GT_CODE_OK ? 0 : -1;
}

KINEMATICS_TYPE kinematicsType(void)
{
    return KINEMATICS_BOTH;
}

int kinematicsForward(const double *joints, EmcPose *world, const KINEMATICS_FORWARD_FLAGS *fflags, KINEMATICS_INVERSE_FLAGS *iflags)
{
    int64_t positions_nm[GANTRY_TAU_AXES];
    double residual_m = 0;
    gt_pose pose;
    gt_error error;
    gt_code code = GT_CODE_OK;
    (void)fflags;
    (void)iflags;

    for (int joint = 0; joint < GANTRY_TAU_AXES && code == GT_CODE_OK; joint++) {
        code = gt_nm_of_joint(joint, joints[joint], &positions_nm[joint], &error);
        error.index = joint;
    }
    if (code == GT_CODE_OK) {
        code = forward(positions_nm, &pose, &residual_m, &error);
    }
    if (code == GT_CODE_OK) {
        gt_world_of_pose(&pose, world);
        located = 1;
    }
    if (!located) {
        return -1;
    }
    return outcome("forward", &last_forward, code, &error, residual_m);
}

int kinematicsInverse(const EmcPose *world, double *joints, const KINEMATICS_INVERSE_FLAGS *iflags, KINEMATICS_FORWARD_FLAGS *fflags)
{
    const gt_pose pose = gt_pose_of_world(world);
    int64_t positions_nm[GANTRY_TAU_AXES];
    double residual_m = 0;
    gt_error error;
    const gt_code code = inverse(&pose, positions_nm, &residual_m, &error);
    (void)iflags;
    (void)fflags;

    if (code == GT_CODE_OK) {
        for (int joint = 0; joint < GANTRY_TAU_AXES; joint++) {
            joints[joint] = gt_joint_of_nm(joint, positions_nm[joint]);
        }
    }
    return outcome("inverse", &last_inverse, code, &error, residual_m);
}

static int export_pins(void)
{
    int failed = 0;
    pins = hal_malloc(sizeof *pins);
    if (!pins) {
        return -1;
    }
    failed |= hal_pin_s32_newf(HAL_OUT, &pins->code, component, "gantrytaukins.code");
    failed |= hal_pin_s32_newf(HAL_OUT, &pins->index, component, "gantrytaukins.index");
    failed |= hal_pin_u32_newf(HAL_OUT, &pins->refused, component, "gantrytaukins.refused");
    failed |= hal_pin_u32_newf(HAL_OUT, &pins->checksum, component, "gantrytaukins.checksum");
    failed |= hal_pin_float_newf(HAL_OUT, &pins->residual, component, "gantrytaukins.residual");
    for (int joint = 0; joint < GANTRY_TAU_AXES; joint++) {
        failed |= hal_pin_float_newf(HAL_OUT, &pins->home[joint], component, "gantrytaukins.home-%d", joint);
    }
    return failed;
}

static int refuse(const char *why)
{
    rtapi_print_msg(RTAPI_MSG_ERR, "gantrytaukins: %s (machine of %s)\n", why, GANTRY_TAU_ROBOT);
    return -EINVAL;
}

/* Checks the machine; returns what is wrong, or null. */
static const char *check(uint32_t *checksum)
{
    gt_error error;
    gt_code code;
    if (gt_abi_version() != GT_ABI_VERSION) {
        return "gantry_tau.h and libgantry_tau.a have different versions";
    }
    code = create(checksum, &error);
    if (code != GT_CODE_OK) {
        return gt_code_name(code);
    }
    return *checksum == GANTRY_TAU_KINEMATICS_CHECKSUM ? NULL : "machine.h was changed: its checksum is not that of its numbers";
}

int rtapi_app_main(void)
{
    EmcPose home = {{gantry_tau_home_m[0] * 1e3, gantry_tau_home_m[1] * 1e3, gantry_tau_home_m[2] * 1e3}, 0, 0, 0, 0, 0, 0};
    double joints[GANTRY_TAU_AXES];
    uint32_t checksum = 0;
    const char *wrong = check(&checksum);

    if (wrong) {
        return refuse(wrong);
    }
    component = hal_init("gantrytaukins");
    if (component < 0) {
        return component;
    }
    if (export_pins() != 0 || kinematicsInverse(&home, joints, NULL, NULL) != 0) {
        hal_exit(component);
        return refuse("no memory for pins, or home is out of reach");
    }
    *pins->checksum = checksum;
    *pins->index = -1;
    for (int joint = 0; joint < GANTRY_TAU_AXES; joint++) {
        *pins->home[joint] = joints[joint];
    }
    hal_ready(component);
    return 0;
}

void rtapi_app_exit(void)
{
    hal_exit(component);
}
