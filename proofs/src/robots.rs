//! Machines for the properties of the floats: core's presets.

use gantry_tau_core::model::{f1, l2, presets};

/// Geometry of `robots/l2.toml`, with its nominal travel.
#[must_use]
pub fn l2_geometry() -> l2::Geometry {
    presets::l2()
}

/// A machine in the orientation of the world, if its geometry is valid.
#[must_use]
pub fn l2(geometry: l2::Geometry) -> Option<(l2::Robot, l2::Kinematics)> {
    let robot = l2::Robot::new(geometry).ok()?;
    let upright = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let kinematics = l2::Kinematics::new(&robot, &upright.into()).ok()?;
    Some((robot, kinematics))
}

/// Geometry of `robots/f1.toml`, its travel unchecked.
#[must_use]
pub fn f1_geometry() -> f1::Geometry {
    f1::Geometry {
        travel: None,
        ..presets::f1()
    }
}

/// The kinematics of an F1, if its geometry is valid.
#[must_use]
pub fn f1(geometry: f1::Geometry) -> Option<f1::Kinematics> {
    Some(f1::Kinematics::new(&f1::Robot::new(geometry).ok()?))
}

/// Home of the tool centre point of [`l2_geometry`], metres.
#[must_use]
pub const fn l2_home() -> [f64; 3] {
    [0.0, 0.5, 0.65]
}

/// A point in the middle of the workspace of [`f1_geometry`], metres.
#[must_use]
pub const fn f1_home() -> [f64; 3] {
    [0.0, 0.0, 0.3]
}
