//! The machines the properties of the floats are asked of: that of `robots/l2.toml`, with its nominal travel, and the vectors' F1.

use gantry_tau_core::model::kinematics::Nominal;
use gantry_tau_core::model::kinematics::SixLinkKinematics;
use gantry_tau_core::model::robot::{
    Branch, Configuration, Geometry, Robot, SixLink, SixLinkGeometry,
};

/// The geometry of `robots/l2.toml`.
#[must_use]
pub fn geometry() -> Geometry {
    let along_x = [1.0, 0.0, 0.0];
    Geometry {
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
        configuration: Configuration {
            inverse: [Branch::Positive, Branch::Negative, Branch::Positive],
            forward: Branch::Negative,
        },
        travel: Some([(-0.5, 2.0), (-2.0, 0.5), (-0.5, 2.0)]),
    }
}

/// A machine in the orientation of the world, if it is one.
#[must_use]
pub fn nominal(geometry: Geometry) -> Option<(Robot, Nominal)> {
    let robot = Robot::new(geometry).ok()?;
    let upright = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let nominal = Nominal::new(&robot, &upright.into()).ok()?;
    Some((robot, nominal))
}

/// The F1 of `tests/data/tau_vectors.json`, its travel unchecked.
#[must_use]
pub fn six_link_geometry() -> SixLinkGeometry {
    SixLinkGeometry {
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
pub fn six_link(geometry: SixLinkGeometry) -> Option<SixLinkKinematics> {
    Some(SixLinkKinematics::new(&SixLink::new(geometry).ok()?))
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
