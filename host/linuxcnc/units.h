/*
 * Units of LinuxCNC and of the core; the one place where they meet.
 *
 * LinuxCNC, by [TRAJ]LINEAR_UNITS = mm and ANGULAR_UNITS = degree: joints of carts and X Y Z in mm, joints of plates and A B C in degrees.
 * The core: positions of axes in nm, q times metres_per_q for a plate as well; poses in m with a rotation matrix.
 *
 * Orientation: R = Rz(C) Ry(B) Rx(A), as of LinuxCNC's genhexkins. B of 90 degrees is singular, and out of reach of the plates.
 */
#ifndef GANTRY_TAU_UNITS_H
#define GANTRY_TAU_UNITS_H

#include <emcpos.h>
#include <rtapi_math.h>

#include "gantry_tau.h"
#include "machine.h"

#define GT_RAD_PER_DEGREE (M_PI / 180.0)

/* 1 if a joint is a plate, in degrees. */
static inline int gt_is_plate(int joint)
{
    return GANTRY_TAU_AXES > GT_ARMS && joint >= GT_ARMS;
}

/* Position of a joint, nm, rounded; an error if it is NaN, infinite or too large. */
static inline gt_code gt_nm_of_joint(int joint, double position, int64_t *position_nm, gt_error *error)
{
    const double metres = gt_is_plate(joint) ? position * GT_RAD_PER_DEGREE * gantry_tau_metres_per_q[joint] : position / 1e3;
    return gt_position_from_metres(metres, position_nm, error);
}

/* Position of a joint, mm or degrees. */
static inline double gt_joint_of_nm(int joint, int64_t position_nm)
{
    const double nm = (double)position_nm;
    return gt_is_plate(joint) ? nm / 1e9 / gantry_tau_metres_per_q[joint] / GT_RAD_PER_DEGREE : nm / 1e6;
}

/* Pose of the tool, from mm and degrees. */
static inline gt_pose gt_pose_of_world(const EmcPose *world)
{
    const double sa = sin(world->a * GT_RAD_PER_DEGREE), ca = cos(world->a * GT_RAD_PER_DEGREE);
    const double sb = sin(world->b * GT_RAD_PER_DEGREE), cb = cos(world->b * GT_RAD_PER_DEGREE);
    const double sc = sin(world->c * GT_RAD_PER_DEGREE), cc = cos(world->c * GT_RAD_PER_DEGREE);
    const gt_pose pose = {
        .position_m = {world->tran.x / 1e3, world->tran.y / 1e3, world->tran.z / 1e3},
        .rotation = {{cc * cb, cc * sb * sa - sc * ca, cc * sb * ca + sc * sa},
                     {sc * cb, sc * sb * sa + cc * ca, sc * sb * ca - cc * sa},
                     {-sb, cb * sa, cb * ca}},
    };
    return pose;
}

/* Sets X Y Z and A B C, in mm and degrees; U V W become 0. */
static inline void gt_world_of_pose(const gt_pose *pose, EmcPose *world)
{
    const double(*r)[3] = pose->rotation;
    world->tran.x = pose->position_m[0] * 1e3;
    world->tran.y = pose->position_m[1] * 1e3;
    world->tran.z = pose->position_m[2] * 1e3;
    world->a = atan2(r[2][1], r[2][2]) / GT_RAD_PER_DEGREE;
    world->b = atan2(-r[2][0], sqrt(r[0][0] * r[0][0] + r[1][0] * r[1][0])) / GT_RAD_PER_DEGREE;
    world->c = atan2(r[1][0], r[0][0]) / GT_RAD_PER_DEGREE;
    world->u = world->v = world->w = 0;
}

#endif
