//! An L2 in the frame that was asked for.

use nalgebra::{DMatrix, Isometry3};

use super::super::{CalibrateOptions, FrameOption};
use crate::geometry::l2::{self, Nominal, turned_covariance};

/// The machine in the frame that was asked for.
pub(super) struct Placed {
    pub(super) nominal: Nominal,
    pub(super) covariance: DMatrix<f64>,
    /// Takes a place of that frame to the device's.
    pub(super) motion: Isometry3<f64>,
    /// Motion from the robot file's frame, with which platform's axes and home move along; none
    /// unless the frame is the device's.
    pub(super) along: Isometry3<f64>,
}

impl Placed {
    pub(super) fn new(
        options: &CalibrateOptions,
        state: &Nominal,
        moved: l2::InRobotFrame,
        frame: Option<Isometry3<f64>>,
        covariance: &DMatrix<f64>,
    ) -> Self {
        let along = Isometry3::identity();
        match (&options.frame, frame) {
            (FrameOption::Measured, _) => Self {
                nominal: *state,
                covariance: covariance.clone(),
                motion: Isometry3::identity(),
                along: moved.motion,
            },
            (FrameOption::Points(_), Some(motion)) => Self {
                nominal: state.moved(&motion.inverse()),
                covariance: turned_covariance(covariance, &motion.inverse().rotation),
                motion,
                along,
            },
            _ => Self {
                nominal: moved.nominal,
                covariance: moved.covariance,
                motion: moved.motion,
                along,
            },
        }
    }
}
