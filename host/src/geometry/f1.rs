//! Calibration of an F1: 64 parameters from poses, 60 of which can be seen.
//!
//! A pose is predicted by the forward kinematics at the measured positions of the axes, from the measured pose on, and
//!
//!     W^T d(pose)/dtheta = s_ij . (dC_i + q_i dV_i + Q_i dP_ij + dQ_i P_ij - R db_ij) - dL_ij
//!
//! there, with `d(pose)` a translation and a rotation vector in the axes of the device. The axes of the plates move by rotation vectors:
//! `a <- exp(d) a` changes `Rot(a, q) p` by `d x (Rot(a, q) p) - Rot(a, q) (d x p)`.
//!
//! What cannot be seen: `C_1` against `P_11` (arm 1 has no plate), and `C_2` against `P_21`, `P_22` along the plates' axis. No step is taken
//! along either.

use gantry_tau_core::model::f1::{self, AXES};
use gantry_tau_core::model::kinematics::{COLD_ITERATIONS, KinematicsError, Pose};
use gantry_tau_core::model::robot::{ARM_OF_LINK, ARMS, LINKS, RobotError};
use nalgebra::{
    DMatrix, DVector, Isometry3, Matrix3, Matrix6, Rotation3, SMatrix, Unit, UnitQuaternion, Vector3, Vector6,
};

use super::MeasuredPose;
use super::agreement::Model;
use super::frames::{apply, rotation_vector};
use crate::fit::least_squares::Rows;
use crate::sim::joints::joint;

/// First parameters of the groups `C` (9), `V` (9), `P` (18), `b` (18), `L` (6), `ax` (2), `ax6` (2), and their number.
const C: usize = 0;
const V: usize = 9;
const P: usize = 18;
const B: usize = 36;
const L: usize = 54;
const AX: usize = 60;
const AX6: usize = 62;
/// All of them.
pub const PARAMETERS: usize = 64;
/// Those that can be seen.
pub const OBSERVABLE: usize = 60;
/// Changes that would matter: of a place or a length, m, and of a direction, rad. Ten times those of an L2: some combinations of joints move
/// the tool so little that sixty poses know them to centimetres only, and are estimated all the same.
const TOLERANCE_M: f64 = 1.0;
const TOLERANCE_RAD: f64 = 1.0;
/// Standard deviation of a combination that no step may be taken along, m.
const FIXED_M: f64 = 1e-9;

/// Reason why a machine predicts no pose.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PredictionError {
    /// Its parameters are refused.
    #[error(transparent)]
    Robot(#[from] RobotError),
    /// A pose cannot be reached.
    #[error("pose {index}: {error}")]
    Unreachable {
        /// Index of the pose.
        index: usize,
        /// What the kinematics say.
        error: KinematicsError,
    },
}

/// Measured poses, and what the device's noise is.
#[derive(Clone, Copy, Debug)]
pub struct Poses<'a> {
    /// The poses; one without an orientation is not used.
    pub poses: &'a [MeasuredPose<AXES>],
    /// Whitening matrix `W`: `W^T W` is the inverse of the covariance of place (m) and rotation vector (rad).
    pub whitening: Matrix6<f64>,
}

/// Returns the machine as the device sees it: world axes moved by `device`, platform axes and tool centre point replaced by the target's,
/// which is at `target` on the platform.
#[must_use]
pub fn seen_by(geometry: &f1::Geometry, device: &Isometry3<f64>, target: &Isometry3<f64>) -> f1::Geometry {
    let turn = device.rotation;
    let to_target = target.inverse();
    f1::Geometry {
        carts_m: geometry.carts_m.map(|cart| apply(device, &cart)),
        guideways: geometry.guideways.map(|guideway| turn * guideway),
        plate_joints_m: geometry.plate_joints_m.map(|joint| turn * joint),
        platform_joints_m: geometry.platform_joints_m.map(|joint| apply(&to_target, &joint)),
        turn_axis: turn * geometry.turn_axis,
        tilt_axis: turn * geometry.tilt_axis,
        ..*geometry
    }
}

/// Returns two unit vectors across a direction.
fn across(axis: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let axis = axis.normalize();
    let least = Vector3::ith(axis.iamin(), 1.0);
    let first = axis.cross(&least).normalize();
    [first, axis.cross(&first)]
}

/// Change of each parameter that would matter.
fn scales(geometry: &f1::Geometry) -> DVector<f64> {
    let mut scales = DVector::repeat(PARAMETERS, TOLERANCE_M);
    for (arm, guideway) in geometry.guideways.iter().enumerate() {
        scales.fixed_rows_mut::<3>(V + 3 * arm).fill(TOLERANCE_RAD * guideway.norm());
    }
    scales.rows_mut(AX, PARAMETERS - AX).fill(TOLERANCE_RAD);
    scales
}

/// Returns a machine changed by a step of its parameters.
fn stepped(geometry: &f1::Geometry, step: &DVector<f64>) -> f1::Geometry {
    let vector = |first: usize| step.fixed_rows::<3>(first).into_owned();
    let turned = |axis: &Vector3<f64>, first: usize| {
        let [one, other] = across(axis);
        UnitQuaternion::from_scaled_axis(one * step[first] + other * step[first + 1]) * axis
    };
    f1::Geometry {
        carts_m: std::array::from_fn(|arm| geometry.carts_m[arm] + vector(C + 3 * arm)),
        guideways: std::array::from_fn(|arm| geometry.guideways[arm] + vector(V + 3 * arm)),
        plate_joints_m: std::array::from_fn(|link| geometry.plate_joints_m[link] + vector(P + 3 * link)),
        platform_joints_m: std::array::from_fn(|link| geometry.platform_joints_m[link] + vector(B + 3 * link)),
        lengths_m: std::array::from_fn(|link| geometry.lengths_m[link] + step[L + link]),
        turn_axis: turned(&geometry.turn_axis, AX),
        tilt_axis: turned(&geometry.tilt_axis, AX6),
        ..*geometry
    }
}

/// Returns the pose with the axes at `q`, the one near `seed`. To rounding: core's tolerance of a billionth of a link is followed by one
/// more step, so that derivatives can be seen in differences.
///
/// # Errors
/// As [`f1::Kinematics::forward_from`].
pub fn forward(kinematics: &f1::Kinematics, q: &[f64; AXES], seed: &Pose) -> Result<Pose, KinematicsError> {
    let mut pose = kinematics.forward_from(q, seed, COLD_ITERATIONS)?.value;
    let geometry = kinematics.robot().geometry();
    let errors = Vector6::from_fn(|link, _| {
        let on_platform = pose.position_m + pose.rotation * geometry.platform_joints_m[link];
        (joint(geometry, link, q).place_m - on_platform).norm() - geometry.lengths_m[link]
    });
    // Moving the platform by a step shortens the links by `W^T step`.
    let step = lines(geometry, q, &pose).try_inverse().ok_or(KinematicsError::NotFinite)? * errors;
    pose.position_m += step.fixed_rows::<3>(0);
    pose.rotation = Rotation3::from_scaled_axis(step.fixed_rows::<3>(3).into_owned()).into_inner() * pose.rotation;
    Ok(pose)
}

/// `W^T`: row `s, l x s` per link.
fn lines(geometry: &f1::Geometry, q: &[f64; AXES], pose: &Pose) -> Matrix6<f64> {
    let mut lines = Matrix6::zeros();
    for link in 0..LINKS {
        let lever = pose.rotation * geometry.platform_joints_m[link];
        let s = (joint(geometry, link, q).place_m - pose.position_m - lever).normalize();
        lines.fixed_view_mut::<1, 3>(link, 0).copy_from(&s.transpose());
        lines.fixed_view_mut::<1, 3>(link, 3).copy_from(&lever.cross(&s).transpose());
    }
    lines
}

/// Derivative of a pose by the parameters.
fn derivative(geometry: &f1::Geometry, q: &[f64; AXES], pose: &Pose) -> SMatrix<f64, 6, PARAMETERS> {
    let lines = lines(geometry, q, pose);
    let mut lengths = SMatrix::<f64, 6, PARAMETERS>::zeros();
    let (turn_axis, tilt_axis) = (Unit::new_normalize(geometry.turn_axis), Unit::new_normalize(geometry.tilt_axis));
    for link in 0..LINKS {
        let arm = ARM_OF_LINK[link];
        let s = lines.fixed_view::<1, 3>(link, 0).transpose();
        let sign = |plate: usize| geometry.turn_signs[plate].sign();
        let (turn, tilt) = match arm {
            1 => (Rotation3::from_axis_angle(&turn_axis, sign(0) * q[3]), Rotation3::identity()),
            2 => (Rotation3::from_axis_angle(&turn_axis, sign(1) * q[4]), Rotation3::from_axis_angle(&tilt_axis, q[5])),
            _ => (Rotation3::identity(), Rotation3::identity()),
        };
        let mut set = |first: usize, row: Vector3<f64>| {
            lengths.fixed_view_mut::<1, 3>(link, first).copy_from(&row.transpose());
        };
        set(C + 3 * arm, s);
        set(V + 3 * arm, s * q[arm]);
        set(P + 3 * link, (turn * tilt).inverse() * s);
        set(B + 3 * link, -(pose.rotation.transpose() * s));
        lengths[(link, L + link)] = -1.0;
        let (plate, tilted) = (geometry.plate_joints_m[link], tilt * geometry.plate_joints_m[link]);
        for (index, d) in across(&geometry.turn_axis).iter().enumerate() {
            lengths[(link, AX + index)] = s.dot(&(d.cross(&(turn * tilted)) - turn * d.cross(&tilted)));
        }
        for (index, d) in across(&geometry.tilt_axis).iter().enumerate() {
            lengths[(link, AX6 + index)] = s.dot(&(turn * (d.cross(&tilted) - tilt * d.cross(&plate))));
        }
    }
    lines.try_inverse().unwrap_or_else(|| Matrix6::repeat(f64::NAN)) * lengths
}

/// Rows that keep what cannot be seen: `P_11`, and the mean of `P_21`, `P_22` along the plates' axis.
fn fixed(geometry: &f1::Geometry) -> SMatrix<f64, 4, PARAMETERS> {
    let mut rows = SMatrix::<f64, 4, PARAMETERS>::zeros();
    rows.fixed_view_mut::<3, 3>(0, P).copy_from(&Matrix3::from_diagonal_element(1.0 / FIXED_M));
    let along = geometry.turn_axis.normalize() / (2.0 * FIXED_M);
    for link in [1, 2] {
        rows.fixed_view_mut::<1, 3>(3, P + 3 * link).copy_from(&along.transpose());
    }
    rows
}

impl Poses<'_> {
    /// Residual and derivative of one pose, whitened; `None` for a pose without an orientation.
    fn row(
        &self,
        kinematics: &f1::Kinematics,
        index: usize,
    ) -> Result<Option<(Vector6<f64>, SMatrix<f64, 6, PARAMETERS>)>, PredictionError> {
        let measured = &self.poses[index];
        let Some(rotation) = measured.rotation else { return Ok(None) };
        let seed = Pose { position_m: measured.position_m, rotation: rotation.to_rotation_matrix().into_inner() };
        let pose =
            forward(kinematics, &measured.q, &seed).map_err(|error| PredictionError::Unreachable { index, error })?;
        let away = measured.position_m - pose.position_m;
        let turned = rotation_vector(&(seed.rotation * pose.rotation.transpose()));
        let residual = Vector6::new(away.x, away.y, away.z, turned.x, turned.y, turned.z);
        let derivative = derivative(kinematics.robot().geometry(), &measured.q, &pose);
        Ok(Some((self.whitening * residual, self.whitening * derivative)))
    }

    fn kinematics(geometry: &f1::Geometry) -> Result<f1::Kinematics, PredictionError> {
        Ok(f1::Kinematics::new(&f1::Robot::new(f1::Geometry { travel: None, ..*geometry })?))
    }
}

impl Model for Poses<'_> {
    type State = f1::Geometry;
    type Error = PredictionError;
    const COMPONENTS: usize = 6;

    fn count(&self) -> usize {
        self.poses.len()
    }

    fn rows(&self, geometry: &f1::Geometry, used: &[usize]) -> Result<Rows, PredictionError> {
        let kinematics = Self::kinematics(geometry)?;
        let size = 6 * used.len();
        let mut residuals = DVector::zeros(size + 4);
        let mut derivatives = DMatrix::zeros(size + 4, PARAMETERS);
        let mut degrees = 0;
        for (row, &index) in used.iter().enumerate() {
            if let Some((residual, derivative)) = self.row(&kinematics, index)? {
                residuals.fixed_rows_mut::<6>(6 * row).copy_from(&residual);
                derivatives.fixed_view_mut::<6, PARAMETERS>(6 * row, 0).copy_from(&derivative);
                degrees += 6;
            }
        }
        derivatives.fixed_view_mut::<4, PARAMETERS>(size, 0).copy_from(&fixed(geometry));
        // The four fixed combinations are no readings, and take away none.
        Ok(Rows { residuals, derivatives, degrees: degrees + (PARAMETERS - OBSERVABLE) })
    }

    fn length_sd(&self, geometry: &f1::Geometry, index: usize) -> f64 {
        let row = Self::kinematics(geometry).and_then(|kinematics| self.row(&kinematics, index));
        row.map_or(f64::INFINITY, |row| row.map_or(0.0, |(residual, _)| residual.norm()))
    }

    fn scales(&self, geometry: &f1::Geometry) -> DVector<f64> {
        scales(geometry)
    }

    fn stepped(geometry: &f1::Geometry, step: &DVector<f64>) -> f1::Geometry {
        stepped(geometry, step)
    }
}

/// Names of the carts' origins, for the parameters' list: there are as many as arms.
const _: () =
    assert!(V == 3 * ARMS && P == V + 3 * ARMS && B == P + 3 * LINKS && L == B + 3 * LINKS && AX == L + LINKS);

#[cfg(test)]
mod tests;
