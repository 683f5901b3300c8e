//! Calibration of an F1: 64 parameters from poses, 60 of which can be seen.
//!
//! A pose is predicted by the forward kinematics at the measured positions of the axes, from the
//! measured pose on, and
//!
//! ```text
//! W^T d(pose)/dtheta = s_ij . (dC_i + q_i dV_i + Q_i dP_ij + dQ_i P_ij - R db_ij) - dL_ij
//! ```
//!
//! there, with `d(pose)` a translation and a rotation vector in the axes of the device. The axes of
//! the plates move by rotation vectors: `a <- exp(d) a` changes `Rot(a, q) p` by
//! `d x (Rot(a, q) p) - Rot(a, q) (d x p)`.
//!
//! Not seen: `C_1` against `P_11` (arm 1 has no plate), and `C_2` against `P_21`, `P_22` along the
//! plates' axis. No step is taken along either.

mod derivative;
mod diagnostics;
mod parameters;
mod placed;

use gantry_tau_core::model::f1::{self, AXES};
use gantry_tau_core::model::kinematics::KinematicsError;
use gantry_tau_core::model::robot::RobotError;
use nalgebra::{DMatrix, DVector, Isometry3, Matrix6, SMatrix, Vector3, Vector6};

use super::robust_fit::{Model, RobustFit};
use crate::fit::frames::{apply, rotation_vector};
use crate::fit::least_squares::Rows;
use crate::measurements::poses::MeasuredPose;
pub(crate) use derivative::derivative;
pub use derivative::forward;
pub use diagnostics::{Departure, Diagnostic};
use parameters::stepped;
pub(crate) use parameters::{KEPT, fixed, scales, unseen};
pub use parameters::{OBSERVABLE, PARAMETERS, parameters};
pub use placed::Placed;

/// Reason why a machine predicts no pose.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PredictionError {
    /// Its parameters are refused.
    #[error(transparent)]
    Robot(#[from] RobotError),
    /// The frames of device and target do not follow from the poses.
    #[error("the poses turn too little: device and target cannot be distinguished")]
    Frames,
    /// A pose cannot be reached.
    #[error("pose number {}: {error}", index + 1)]
    Unreachable {
        /// Index of the pose.
        index: usize,
        /// Error of the kinematics.
        error: KinematicsError,
    },
}

/// Measured poses, and what the device's noise is.
#[derive(Clone, Copy, Debug)]
pub struct Poses<'a> {
    /// The poses; one without an orientation is not used.
    pub poses: &'a [MeasuredPose<AXES>],
    /// Whitening matrix `W`: `W^T W` is the inverse of the covariance of place (m) and rotation
    /// vector (rad).
    pub whitening: Matrix6<f64>,
}

/// Returns the machine as the device sees it: world axes moved by `device`, platform axes and tool
/// centre point replaced by the target's, which is at `target` on the platform.
#[must_use]
pub fn seen_by(
    geometry: &f1::Geometry,
    device: &Isometry3<f64>,
    target: &Isometry3<f64>,
) -> f1::Geometry {
    let turn = device.rotation;
    let to_target = target.inverse();
    f1::Geometry {
        carts_m: geometry.carts_m.map(|cart| apply(device, &cart)),
        guideways: geometry.guideways.map(|guideway| turn * guideway),
        plate_joints_m: geometry.plate_joints_m.map(|joint| turn * joint),
        platform_joints_m: geometry
            .platform_joints_m
            .map(|joint| apply(&to_target, &joint)),
        turn_axis: turn * geometry.turn_axis,
        tilt_axis: turn * geometry.tilt_axis,
        ..*geometry
    }
}

/// Residual and derivative of one pose.
type PoseRow = (Vector6<f64>, SMatrix<f64, 6, PARAMETERS>);

impl Poses<'_> {
    /// Residual and derivative of one pose, whitened; `None` for a pose without an orientation.
    fn row(
        &self,
        kinematics: &f1::Kinematics,
        index: usize,
    ) -> Result<Option<PoseRow>, PredictionError> {
        let measured = &self.poses[index];
        let Some(seed) = measured.pose() else {
            return Ok(None);
        };
        let pose = forward(kinematics, &measured.q, &seed)
            .map_err(|error| PredictionError::Unreachable { index, error })?;
        let away = measured.position_m - pose.position_m;
        let turned = rotation_vector(&(seed.rotation * pose.rotation.transpose()));
        let residual = Vector6::new(away.x, away.y, away.z, turned.x, turned.y, turned.z);
        let derivative = derivative(kinematics.robot().geometry(), &measured.q, &pose);
        Ok(Some((
            self.whitening * residual,
            self.whitening * derivative,
        )))
    }

    fn kinematics(geometry: &f1::Geometry) -> Result<f1::Kinematics, PredictionError> {
        Ok(f1::Kinematics::new(&f1::Robot::new(f1::Geometry {
            travel: None,
            ..*geometry
        })?))
    }
}

impl Poses<'_> {
    /// Residuals of the places that were used: place and rest, m, in the frame of the device.
    #[must_use]
    pub fn residuals(&self, geometry: &f1::Geometry, outliers: &[usize]) -> Vec<[Vector3<f64>; 2]> {
        let Ok(kinematics) = Self::kinematics(geometry) else {
            return Vec::new();
        };
        let used = self
            .poses
            .iter()
            .enumerate()
            .filter(|(index, _)| !outliers.contains(index));
        used.filter_map(|(_, pose)| {
            let predicted = forward(&kinematics, &pose.q, &pose.pose()?).ok()?;
            Some([pose.position_m, pose.position_m - predicted.position_m])
        })
        .collect()
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
        let rows = used
            .iter()
            .map(|index| self.row(&kinematics, *index))
            .collect::<Result<Vec<_>, _>>()?;
        let rows: Vec<_> = rows.into_iter().flatten().collect();
        let size = 6 * rows.len();
        // Four rows more fix the combinations that no pose shows: they are not readings, and take
        // none away.
        let mut residuals = DVector::zeros(size + 4);
        let mut derivatives = DMatrix::zeros(size + 4, PARAMETERS);
        for (place, (residual, derivative)) in rows.into_iter().enumerate() {
            residuals
                .fixed_rows_mut::<6>(6 * place)
                .copy_from(&residual);
            derivatives
                .fixed_view_mut::<6, PARAMETERS>(6 * place, 0)
                .copy_from(&derivative);
        }
        derivatives
            .fixed_view_mut::<4, PARAMETERS>(size, 0)
            .copy_from(&fixed(geometry));
        Ok(Rows::new(residuals, derivatives))
    }

    fn away_m(&self, geometry: &f1::Geometry, index: usize) -> Option<f64> {
        let kinematics = Self::kinematics(geometry).ok()?;
        let measured = &self.poses[index];
        let predicted = forward(&kinematics, &measured.q, &measured.pose()?).ok()?;
        Some((measured.position_m - predicted.position_m).norm())
    }

    fn length_sd(&self, geometry: &f1::Geometry, index: usize) -> f64 {
        let row = Self::kinematics(geometry).and_then(|kinematics| self.row(&kinematics, index));
        row.map_or(f64::INFINITY, |row| {
            row.map_or(0.0, |(residual, _)| residual.norm())
        })
    }

    fn scales(&self, geometry: &f1::Geometry) -> DVector<f64> {
        scales(geometry)
    }

    fn stepped(geometry: &f1::Geometry, step: &DVector<f64>) -> f1::Geometry {
        stepped(geometry, step)
    }
}

/// A calibrated machine, as the device sees it.
pub type Calibrated = RobustFit<f1::Geometry>;

#[cfg(test)]
mod tests;
