//! Calibration: the geometry of a machine from measured poses `[T 3.2]`.

#![expect(clippy::indexing_slicing, reason = "arms, axes and parameters are counted by the arrays themselves")]

pub mod agreement;
pub mod answer;
pub mod calibrate;
pub mod deviation;
pub mod f1;
pub mod frames;
pub mod l2;
pub mod parallel;

use gantry_tau_core::model::kinematics::Pose;
use nalgebra::{UnitQuaternion, Vector3};

use crate::output::Name;

/// A pose that a device outside of the robot has measured, in the axes of the device.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredPose<const N: usize> {
    /// Its name in the file.
    pub name: Name,
    /// Positions of the axes, q-units.
    pub q: [f64; N],
    /// Place of the target, m.
    pub position_m: Vector3<f64>,
    /// Orientation of the target, where the device sees it.
    pub rotation: Option<UnitQuaternion<f64>>,
}

impl<const N: usize> MeasuredPose<N> {
    /// The pose, where the orientation was measured.
    #[must_use]
    pub fn pose(&self) -> Option<Pose> {
        let rotation = self.rotation?.to_rotation_matrix().into_inner();
        Some(Pose { position_m: self.position_m, rotation })
    }
}
