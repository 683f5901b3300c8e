/* The machines of robots/l2.toml and robots/f1.toml. */
#ifndef EXAMPLE_MACHINES_H
#define EXAMPLE_MACHINES_H

#include "gantry_tau.h"

static const gt_l2_geometry l2_geometry = {
    .cart_joints_m = {{0.10, -0.05, 1.28}, {-0.10, -0.29, 0.75}, {0.10, -0.29, 0.75},
                      {-0.12, -0.05, 0.05}, {0.12, -0.05, 0.05}, {0.00, 0.08, 0.05}},
    .guideways = {{1, 0, 0}, {1, 0, 0}, {1, 0, 0}},
    .platform_joints_m = {{0.10, -0.05, 0.03}, {-0.10, 0.06, 0.05}, {0.10, 0.06, 0.05},
                          {-0.12, -0.05, -0.05}, {0.12, -0.05, -0.05}, {0.00, 0.08, -0.05}},
    .lengths_m = {1.0, 1.1, 1.0},
    .rotation = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}},
    .inverse_branch = {1, -1, 1},
    .forward_branch = -1,
    .metres_per_q = {1, 1, 1},
};

static const gt_f1_geometry f1_geometry = {
    .carts_m = {{-0.25, -1.12, 0}, {1.15, 0.05, 0}, {-1.00, 0.55, 0}},
    .guideways = {{0, 0, 1}, {0, 0, 1}, {0, 0, 1}},
    .plate_joints_m = {{-0.05, -0.10, 0.02}, {0, -0.15, 0}, {0, 0.15, 0},
                       {0.11, -0.04, 0}, {-0.11, -0.04, 0}, {0, 0.10, 0}},
    .platform_joints_m = {{-0.05, -0.10, 0.02}, {0.10, -0.15, 0.03}, {0.10, 0.15, 0.03},
                          {0.06, 0.10, 0}, {-0.16, 0.10, 0}, {-0.05, 0.24, 0}},
    .lengths_m = {1.7, 1.7, 1.7, 1.7, 1.7, 1.7},
    .inverse_branch = {1, 1, 1},
    .turn_axis = {0, 0, 1},
    .tilt_axis = {0, 1, 0},
    .turn_signs = {-1, 1},
    .metres_per_q = {1, 1, 1, 0.05, 0.05, 0.05}, /* the screws: m per rad */
};

#endif
