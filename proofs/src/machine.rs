//! The machines the properties of the floats are asked of: that of `robots/l2.toml`, with its nominal travel, and the vectors' F1.

use gantry_tau_core::model::robot::Branch;
use gantry_tau_core::model::{f1, l2};

/// The geometry of `robots/l2.toml`.
#[must_use]
pub fn geometry() -> l2::Geometry {
    let along_x = [1.0, 0.0, 0.0];
    l2::Geometry {
        cart_joints_m: [
            [0.10, -0.05, 1.28].into(),
            [-0.10, -0.29, 0.75].into(),
            [0.10, -0.29, 0.75].into(),
            [-0.12, -0.05, 0.05].into(),
            [0.12, -0.05, 0.05].into(),
            [0.00, 0.08, 0.05].into(),
        ],
        guideways: [along_x.into(), along_x.into(), along_x.into()],
        platform_joints_m: [
            [0.10, -0.05, 0.03].into(),
            [-0.10, 0.06, 0.05].into(),
            [0.10, 0.06, 0.05].into(),
            [-0.12, -0.05, -0.05].into(),
            [0.12, -0.05, -0.05].into(),
            [0.00, 0.08, -0.05].into(),
        ],
        lengths_m: [1.0, 1.1, 1.0],
        configuration: l2::Configuration {
            inverse: [Branch::Positive, Branch::Negative, Branch::Positive],
            forward: Branch::Negative,
        },
        travel: Some([(-0.5, 2.0), (-2.0, 0.5), (-0.5, 2.0)]),
    }
}

/// A machine in the orientation of the world, if it is one.
#[must_use]
pub fn nominal(geometry: l2::Geometry) -> Option<(l2::Robot, l2::Kinematics)> {
    let robot = l2::Robot::new(geometry).ok()?;
    let upright = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let nominal = l2::Kinematics::new(&robot, &upright.into()).ok()?;
    Some((robot, nominal))
}

/// The F1 of `tests/data/tau_vectors.json`, its travel unchecked.
#[must_use]
pub fn six_link_geometry() -> f1::Geometry {
    f1::Geometry {
        carts_m: [
            [-0.25, -1.12, 0.0].into(),
            [1.15, 0.05, 0.0].into(),
            [-1.0, 0.55, 0.0].into(),
        ],
        guideways: [[0.0, 0.0, 1.0]; 3].map(Into::into),
        plate_joints_m: [
            [-0.05, -0.1, 0.02].into(),
            [0.0, -0.15, 0.0].into(),
            [0.0, 0.15, 0.0].into(),
            [0.11, -0.04, 0.0].into(),
            [-0.11, -0.04, 0.0].into(),
            [0.0, 0.1, 0.0].into(),
        ],
        platform_joints_m: [
            [-0.05, -0.1, 0.02].into(),
            [0.1, -0.15, 0.03].into(),
            [0.1, 0.15, 0.03].into(),
            [0.06, 0.1, 0.0].into(),
            [-0.16, 0.1, 0.0].into(),
            [-0.05, 0.24, 0.0].into(),
        ],
        lengths_m: [1.7; 6],
        configuration: [Branch::Positive; 3],
        turn_axis: [0.0, 0.0, 1.0].into(),
        tilt_axis: [0.0, 1.0, 0.0].into(),
        turn_signs: [Branch::Negative, Branch::Positive],
        travel: None,
    }
}

/// The kinematics of a machine with six axes, if it is one.
#[must_use]
pub fn six_link(geometry: f1::Geometry) -> Option<f1::Kinematics> {
    Some(f1::Kinematics::new(&f1::Robot::new(geometry).ok()?))
}

/// Home of the tool centre point of [`geometry`], metres.
#[must_use]
pub const fn home() -> [f64; 3] {
    [0.0, 0.5, 0.65]
}

/// A place in the middle of the workspace of [`six_link_geometry`], metres.
#[must_use]
pub const fn six_link_home() -> [f64; 3] {
    [0.0, 0.0, 0.3]
}
