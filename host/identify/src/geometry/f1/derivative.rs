//! Forward kinematics of an F1 to rounding, and the derivatives of a pose.

use gantry_tau_core::model::f1::{self, AXES};
use gantry_tau_core::model::kinematics::{COLD_ITERATIONS, KinematicsError, Pose};
use gantry_tau_core::model::robot::{ARM_OF_LINK, LINKS};
use gantry_tau_machine::elastic::joints::joint;
use nalgebra::{Matrix6, Rotation3, SMatrix, Unit, Vector3, Vector6};

use super::parameters::{AX, AX6, B, C, L, P, PARAMETERS, V};
use crate::fit::frames::across;

/// Returns the pose with the axes at `q`, the one near `seed`. To rounding: core's tolerance of a
/// billionth of a link is followed by one more step, so that derivatives can be seen in
/// differences.
///
/// # Errors
/// As [`f1::Kinematics::forward_from`].
pub fn forward(
    kinematics: &f1::Kinematics,
    q: &[f64; AXES],
    seed: &Pose,
) -> Result<Pose, KinematicsError> {
    let mut pose = kinematics.forward_from(q, seed, COLD_ITERATIONS)?.value;
    let geometry = kinematics.robot().geometry();
    let errors = Vector6::from_fn(|link, _| {
        let on_platform = pose.position_m + pose.rotation * geometry.platform_joints_m[link];
        (joint(geometry, link, q).place_m - on_platform).norm() - geometry.lengths_m[link]
    });
    // Moving the platform by a step shortens the links by `W^T step`.
    let step = lines(geometry, q, &pose)
        .try_inverse()
        .ok_or(KinematicsError::NotFinite)?
        * errors;
    pose.position_m += step.fixed_rows::<3>(0);
    pose.rotation = Rotation3::from_scaled_axis(step.fixed_rows::<3>(3).into_owned()).into_inner()
        * pose.rotation;
    Ok(pose)
}

/// `W^T`: row `s, l x s` per link.
pub(super) fn lines(geometry: &f1::Geometry, q: &[f64; AXES], pose: &Pose) -> Matrix6<f64> {
    let mut lines = Matrix6::zeros();
    for link in 0..LINKS {
        let lever = pose.rotation * geometry.platform_joints_m[link];
        let s = (joint(geometry, link, q).place_m - pose.position_m - lever).normalize();
        lines
            .fixed_view_mut::<1, 3>(link, 0)
            .copy_from(&s.transpose());
        lines
            .fixed_view_mut::<1, 3>(link, 3)
            .copy_from(&lever.cross(&s).transpose());
    }
    lines
}

/// Derivative of a pose by the parameters.
pub(crate) fn derivative(
    geometry: &f1::Geometry,
    q: &[f64; AXES],
    pose: &Pose,
) -> SMatrix<f64, 6, PARAMETERS> {
    let lines = lines(geometry, q, pose);
    let mut lengths = SMatrix::<f64, 6, PARAMETERS>::zeros();
    for link in 0..LINKS {
        let arm = ARM_OF_LINK[link];
        let s = lines.fixed_view::<1, 3>(link, 0).transpose();
        let Turns { turn, tilt } = Turns::of(geometry, q, arm);
        let vectors: [(usize, Vector3<f64>); 4] = [
            (C + 3 * arm, s),
            (V + 3 * arm, s * q[arm]),
            (P + 3 * link, (turn * tilt).inverse() * s),
            (B + 3 * link, -(pose.rotation.transpose() * s)),
        ];
        for (first, row) in vectors {
            lengths
                .fixed_view_mut::<1, 3>(link, first)
                .copy_from(&row.transpose());
        }
        lengths[(link, L + link)] = -1.0;
        let plate = geometry.plate_joints_m[link];
        let tilted = tilt * plate;
        for (index, d) in across(&geometry.turn_axis).iter().enumerate() {
            lengths[(link, AX + index)] =
                s.dot(&(d.cross(&(turn * tilted)) - turn * d.cross(&tilted)));
        }
        for (index, d) in across(&geometry.tilt_axis).iter().enumerate() {
            lengths[(link, AX6 + index)] =
                s.dot(&(turn * (d.cross(&tilted) - tilt * d.cross(&plate))));
        }
    }
    lines
        .try_inverse()
        .unwrap_or_else(|| Matrix6::repeat(f64::NAN))
        * lengths
}

/// Rotations of the plate of an arm from where it is at `q = 0`.
pub(super) struct Turns {
    /// About the axis of both plates; it comes last.
    pub(super) turn: Rotation3<f64>,
    /// About the second axis of plate 3.
    pub(super) tilt: Rotation3<f64>,
}

impl Turns {
    /// Rotations with the axes at `q`; none for arm 1, whose joint is on the cart.
    pub(super) fn of(geometry: &f1::Geometry, q: &[f64; AXES], arm: usize) -> Self {
        match arm {
            1 => Self {
                turn: plate_turn(geometry, 0, q[3]),
                tilt: Rotation3::identity(),
            },
            2 => Self {
                turn: plate_turn(geometry, 1, q[4]),
                tilt: Rotation3::from_axis_angle(&Unit::new_normalize(geometry.tilt_axis), q[5]),
            },
            _ => Self {
                turn: Rotation3::identity(),
                tilt: Rotation3::identity(),
            },
        }
    }
}

/// Rotation of a plate about the axis of both plates.
fn plate_turn(geometry: &f1::Geometry, plate: usize, q: f64) -> Rotation3<f64> {
    let axis = Unit::new_normalize(geometry.turn_axis);
    Rotation3::from_axis_angle(&axis, geometry.turn_signs[plate].sign() * q)
}
