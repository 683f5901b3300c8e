/* A machine for the C interface of gantry-tau. Written by `gantry-tau header`. Do not edit. */
#ifndef L2_MACHINE_H
#define L2_MACHINE_H

#include "gantry_tau.h"

#define L2_MODEL_L2
#define L2_ROBOT "robots/l2.toml (built in)"
#define L2_AXES 3
#define L2_MOTORS 3
#define L2_KINEMATICS_CHECKSUM 0xd6f1164eu

/* Geometry, with the length of one unit of each axis. */
static const gt_l2_geometry l2_geometry = {
    .cart_joints_m = {{0.1, -0.05, 1.28}, {-0.1, -0.29, 0.75}, {0.1, -0.29, 0.75}, {-0.12, -0.05, 0.05}, {0.12, -0.05, 0.05}, {0.0, 0.08, 0.05}},
    .guideways = {{1.0, 0.0, 0.0}, {1.0, 0.0, 0.0}, {1.0, 0.0, 0.0}},
    .platform_joints_m = {{0.1, -0.05, 0.03}, {-0.1, 0.06, 0.05}, {0.1, 0.06, 0.05}, {-0.12, -0.05, -0.05}, {0.12, -0.05, -0.05}, {0.0, 0.08, -0.05}},
    .lengths_m = {1.0, 1.1, 1.0},
    .rotation = {{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}},
    .inverse_branch = {1, -1, 1},
    .forward_branch = -1,
    .has_travel = 1,
    .travel = {{-0.5, 2.0}, {-2.0, 0.5}, {-0.5, 2.0}},
    .metres_per_q = {1.0, 1.0, 1.0},
};

/* Home of the tool centre point, world axes, m. */
static const double l2_home_m[3] = {0.0, 0.5, 0.65};

/* Length of one unit of each axis, m. */
static const double l2_metres_per_q[L2_AXES] = {1.0, 1.0, 1.0};

/* Limits of the offsets and travel of each axis. */
static const gt_axis_config l2_limits[L2_AXES] = {
    {
        .position = {.max = 2000000, .step = 5000, .accel = 10000, .ramp = 100},
        .velocity = {.max = 5000, .step = 200, .accel = 400, .ramp = 50},
        .torque = {.max = 50, .step = 5, .accel = 10, .ramp = 1},
        .nominal_lower_nm = -500000000, .nominal_upper_nm = 2000000000,
        .machine_lower_nm = -510000000, .machine_upper_nm = 2010000000,
        .nominal_step_nm = 2000000,
        .nominal_accel_nm = 20000, .nominal_accel_is_fault = 0,
        .agitation_nm_per_tick = 100,
    },
    {
        .position = {.max = 2000000, .step = 5000, .accel = 10000, .ramp = 100},
        .velocity = {.max = 5000, .step = 200, .accel = 400, .ramp = 50},
        .torque = {.max = 50, .step = 5, .accel = 10, .ramp = 1},
        .nominal_lower_nm = -2000000000, .nominal_upper_nm = 500000000,
        .machine_lower_nm = -2010000000, .machine_upper_nm = 510000000,
        .nominal_step_nm = 2000000,
        .nominal_accel_nm = 20000, .nominal_accel_is_fault = 0,
        .agitation_nm_per_tick = 100,
    },
    {
        .position = {.max = 2000000, .step = 5000, .accel = 10000, .ramp = 100},
        .velocity = {.max = 5000, .step = 200, .accel = 400, .ramp = 50},
        .torque = {.max = 50, .step = 5, .accel = 10, .ramp = 1},
        .nominal_lower_nm = -500000000, .nominal_upper_nm = 2000000000,
        .machine_lower_nm = -510000000, .machine_upper_nm = 2010000000,
        .nominal_step_nm = 2000000,
        .nominal_accel_nm = 20000, .nominal_accel_is_fault = 0,
        .agitation_nm_per_tick = 100,
    },
};

/* Axis of each motor. */
static const uint8_t l2_axis_of_motor[L2_MOTORS] = {0, 1, 2};

/* 1: the robot file has compliances, and there is a compensator; 0: it must be identified first. */
#define L2_HAS_COMPENSATOR 1
/* 1: correct by the exact map (gt_..._exact_correction); 0: to first order (gt_..._correction). */
#define L2_EXACT_CORRECTION 0
/* Joints between platform and tool that give way; the C interface does not correct for them. */
#define L2_WRIST_JOINTS 0

/* Compliances of links and axes, limits of position offsets, and share of the correction. */
static const gt_compensator_config l2_compensator = {
    .link_m_per_n = {5e-7, 6e-7, 5.5e-7, 7e-7, 6.5e-7, 6e-7},
    .axis_per_n = {4.06e-8, 5.09e-8, 6e-8},
    .limits_nm = {2000000, 2000000, 2000000},
    .gain = 1.0,
};

/* Force sensor: mounting, tool and filter, for one sample per cycle. */
static const gt_sensor_config l2_sensor = {
    .rotation = {{0.0, -1.0, 0.0}, {1.0, 0.0, 0.0}, {0.0, 0.0, 1.0}},
    .lever_m = {0.0, 0.0, -0.08},
    .tool_weight_n = {0.0, 0.0, -18.0},
    .tool_centre_m = {0.01, 0.0, -0.12},
    .cutoff_hz = 6.0,
    .cycle_s = 0.001,
    .tare_samples = 1000,
    .order = 2,
};

/* Frequencies of the notches of the force sensor's filter with the tool at home, Hz, for gt_sensor_set_notches; 0: no notch. */
static const double l2_notches_hz[3] = {20.711082781618327, 57.61896771642341, 0.0};
/* Their Q. */
#define L2_NOTCH_Q 0.7

#endif
