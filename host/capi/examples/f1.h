/* A machine for the C interface of gantry-tau. Written by `gantry-tau header`. Do not edit. */
#ifndef F1_MACHINE_H
#define F1_MACHINE_H

#include "gantry_tau.h"

#define F1_MODEL_F1
#define F1_ROBOT "robots/f1.toml (built in)"
#define F1_AXES 6
#define F1_MOTORS 9
#define F1_KINEMATICS_CHECKSUM 0x4b72ce62u

/* Geometry, with the length of one unit of each axis. */
static const gt_f1_geometry f1_geometry = {
    .carts_m = {{-0.25, -1.12, 0.0}, {1.15, 0.05, 0.0}, {-1.0, 0.55, 0.0}},
    .guideways = {{0.0, 0.0, 1.0}, {0.0, 0.0, 1.0}, {0.0, 0.0, 1.0}},
    .plate_joints_m = {{-0.05, -0.1, 0.02}, {0.0, -0.15, 0.0}, {0.0, 0.15, 0.0}, {0.11, -0.04, 0.0}, {-0.11, -0.04, 0.0}, {0.0, 0.1, 0.0}},
    .platform_joints_m = {{-0.05, -0.1, 0.02}, {0.1, -0.15, 0.03}, {0.1, 0.15, 0.03}, {0.06, 0.1, 0.0}, {-0.16, 0.1, 0.0}, {-0.05, 0.24, 0.0}},
    .lengths_m = {1.7, 1.7, 1.7, 1.7, 1.7, 1.7},
    .inverse_branch = {1, 1, 1},
    .turn_axis = {0.0, 0.0, 1.0},
    .tilt_axis = {0.0, 1.0, 0.0},
    .turn_signs = {-1, 1},
    .has_travel = 1,
    .travel = {{0.2, 3.0}, {0.2, 3.0}, {0.2, 3.0}, {-0.39999999999999997, 0.39999999999999997}, {-0.39999999999999997, 0.39999999999999997}, {-0.39999999999999997, 0.39999999999999997}},
    .metres_per_q = {1.0, 1.0, 1.0, 0.1, 0.1, 0.1},
};

/* Home of the tool centre point, world axes, m. */
static const double f1_home_m[3] = {0.1, 0.0, 0.3};

/* Length of one unit of each axis, m. */
static const double f1_metres_per_q[F1_AXES] = {1.0, 1.0, 1.0, 0.1, 0.1, 0.1};

/* Limits of the offsets and travel of each axis. */
static const gt_axis_config f1_limits[F1_AXES] = {
    {
        .position = {.max = 4000000, .step = 20000, .accel = 40000, .ramp = 100},
        .velocity = {.max = 5000, .step = 200, .accel = 400, .ramp = 50},
        .torque = {.max = 50, .step = 5, .accel = 10, .ramp = 1},
        .nominal_lower_nm = 200000000, .nominal_upper_nm = 3000000000,
        .machine_lower_nm = 190000000, .machine_upper_nm = 3010000000,
        .nominal_step_nm = 2000000,
        .nominal_accel_nm = 20000, .nominal_accel_is_fault = 0,
    },
    {
        .position = {.max = 4000000, .step = 20000, .accel = 40000, .ramp = 100},
        .velocity = {.max = 5000, .step = 200, .accel = 400, .ramp = 50},
        .torque = {.max = 50, .step = 5, .accel = 10, .ramp = 1},
        .nominal_lower_nm = 200000000, .nominal_upper_nm = 3000000000,
        .machine_lower_nm = 190000000, .machine_upper_nm = 3010000000,
        .nominal_step_nm = 2000000,
        .nominal_accel_nm = 20000, .nominal_accel_is_fault = 0,
    },
    {
        .position = {.max = 4000000, .step = 20000, .accel = 40000, .ramp = 100},
        .velocity = {.max = 5000, .step = 200, .accel = 400, .ramp = 50},
        .torque = {.max = 50, .step = 5, .accel = 10, .ramp = 1},
        .nominal_lower_nm = 200000000, .nominal_upper_nm = 3000000000,
        .machine_lower_nm = 190000000, .machine_upper_nm = 3010000000,
        .nominal_step_nm = 2000000,
        .nominal_accel_nm = 20000, .nominal_accel_is_fault = 0,
    },
    {
        .position = {.max = 4000000, .step = 20000, .accel = 40000, .ramp = 100},
        .velocity = {.max = 5000, .step = 200, .accel = 400, .ramp = 50},
        .torque = {.max = 50, .step = 5, .accel = 10, .ramp = 1},
        .nominal_lower_nm = -40000000, .nominal_upper_nm = 40000000,
        .machine_lower_nm = -45000000, .machine_upper_nm = 45000000,
        .nominal_step_nm = 2000000,
        .nominal_accel_nm = 20000, .nominal_accel_is_fault = 0,
    },
    {
        .position = {.max = 4000000, .step = 20000, .accel = 40000, .ramp = 100},
        .velocity = {.max = 5000, .step = 200, .accel = 400, .ramp = 50},
        .torque = {.max = 50, .step = 5, .accel = 10, .ramp = 1},
        .nominal_lower_nm = -40000000, .nominal_upper_nm = 40000000,
        .machine_lower_nm = -45000000, .machine_upper_nm = 45000000,
        .nominal_step_nm = 2000000,
        .nominal_accel_nm = 20000, .nominal_accel_is_fault = 0,
    },
    {
        .position = {.max = 4000000, .step = 20000, .accel = 40000, .ramp = 100},
        .velocity = {.max = 5000, .step = 200, .accel = 400, .ramp = 50},
        .torque = {.max = 50, .step = 5, .accel = 10, .ramp = 1},
        .nominal_lower_nm = -40000000, .nominal_upper_nm = 40000000,
        .machine_lower_nm = -45000000, .machine_upper_nm = 45000000,
        .nominal_step_nm = 2000000,
        .nominal_accel_nm = 20000, .nominal_accel_is_fault = 0,
    },
};

/* Axis of each motor. */
static const uint8_t f1_axis_of_motor[F1_MOTORS] = {0, 0, 1, 1, 2, 2, 3, 4, 5};

/* 1: the robot file has compliances, and there is a compensator; 0: it must be identified first. */
#define F1_HAS_COMPENSATOR 1
/* 1: correct by the exact map (gt_..._exact_correction); 0: to first order (gt_..._correction). */
#define F1_EXACT_CORRECTION 0
/* Joints between platform and tool that give way; the C interface does not correct for them. */
#define F1_WRIST_JOINTS 0

/* Compliances of links and axes, limits of position offsets, and share of the correction. */
static const gt_compensator_config f1_compensator = {
    .link_m_per_n = {5e-7, 6e-7, 5.5e-7, 7e-7, 6.5e-7, 6e-7},
    .axis_per_n = {4.2081e-6, 7.5215e-6, 5.5578e-6, 2e-6, 2e-6, 2e-6},
    .limits_nm = {4000000, 4000000, 4000000, 4000000, 4000000, 4000000},
    .gain = 1.0,
};

/* Force sensor: mounting, tool and filter, for one sample per cycle. */
static const gt_sensor_config f1_sensor = {
    .rotation = {{0.0, -1.0, 0.0}, {1.0, 0.0, 0.0}, {0.0, 0.0, 1.0}},
    .lever_m = {0.0, 0.0, -0.08},
    .tool_weight_n = {0.0, 0.0, -18.0},
    .tool_centre_m = {0.01, 0.0, -0.12},
    .cutoff_hz = 8.0,
    .cycle_s = 0.001,
    .tare_samples = 1000,
    .order = 2,
};

/* Frequencies of the notches of the force sensor's filter with the tool at home, Hz, for gt_sensor_set_notches; 0: no notch. */
static const double f1_notches_hz[3] = {6.82358172944715, 7.830587516126775, 9.981311834828205};
/* Their Q. */
#define F1_NOTCH_Q 0.8

#endif
