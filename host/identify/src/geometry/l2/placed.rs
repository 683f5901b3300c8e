//! A calibrated L2 in the frame that its robot file is written in `[T 3.11]`.

use gantry_tau_core::model::l2::Configuration;
use gantry_tau_core::model::linalg::cross_matrix;
use gantry_tau_core::model::robot::ARMS;
use nalgebra::{DMatrix, Isometry3, Matrix3x6, Matrix6, UnitQuaternion, Vector3};

use super::{Calibrated, Nominal, PARAMETERS, PER_ARM, Places, PredictionError};
use crate::fit::frames::rigid;

/// A calibrated machine moved into the robot's frame `[T 3.11]`.
#[derive(Clone, Debug, PartialEq)]
pub struct InRobotFrame {
    /// The device's frame as the robot's sees it, inverted: takes a place of the robot's frame to
    /// the device's.
    pub motion: Isometry3<f64>,
    /// The machine.
    pub nominal: Nominal,
    /// Covariance of its parameters. Of rank 15 where the motion was fitted: six combinations move
    /// the frame, and are not known apart.
    pub covariance: DMatrix<f64>,
}

impl Calibrated {
    /// Moves the machine to where the robot's file says it is: by the motion that takes the file's
    /// places at the measured positions best to those of the machine. What the file says of the
    /// robot's surroundings (home, travel, sensor) stays right, and its numbers change little.
    ///
    /// `covariance` is that of the 21 parameters; in the robot's frame it is `P C P^T`,
    /// `P = 1 - N (G^T G)^-1 G^T J`: `N` and `G` are the changes of parameters and of places by a
    /// small motion.
    ///
    /// # Errors
    /// [`PredictionError`]: the file's machine reaches fewer than three of the measured positions.
    pub fn in_frame_of(
        &self,
        file: &Nominal,
        places: &Places<'_>,
        covariance: &DMatrix<f64>,
    ) -> Result<InRobotFrame, PredictionError> {
        let [from, to] =
            [file, &self.fit.state].map(|nominal| nominal.kinematics(places.configuration));
        let (from, to) = (from?, to?);
        let used = self.used(places.poses.len());
        let at_q = used.iter().map(|index| &places.poses[*index].q);
        // Where the file is off, its machine may not reach each position of the real one.
        let pairs: Vec<_> = at_q
            .clone()
            .filter_map(|q| Some((from.forward(q).ok()?, to.forward(q).ok()?)))
            .collect();
        // Models both: nothing among them is wrong.
        let motion = rigid(&pairs).ok_or(PredictionError::FarOff)?;
        let nominal = self.fit.state.moved(&motion.inverse());
        let covariance = turned_covariance(covariance, &motion.inverse().rotation);
        let projection = nominal.without_motion(places.configuration, at_q)?;
        Ok(InRobotFrame {
            motion,
            nominal,
            covariance: &projection * covariance * projection.transpose(),
        })
    }
}

impl Nominal {
    /// Returns `P`, which takes off a change of the parameters what moves all places alike.
    fn without_motion<'a>(
        &self,
        configuration: Configuration,
        at_q: impl Iterator<Item = &'a [f64; ARMS]>,
    ) -> Result<DMatrix<f64>, PredictionError> {
        let kinematics = self.kinematics(configuration)?;
        let mut squares = Matrix6::zeros();
        let mut products = DMatrix::zeros(6, PARAMETERS);
        for (index, q) in at_q.enumerate() {
            let place_m = kinematics
                .forward(q)
                .map_err(|error| PredictionError::Unreachable { index, error })?;
            let motion = motion_of(&place_m);
            squares += motion.transpose() * motion;
            products += motion.transpose() * self.derivative(q, &place_m);
        }
        let mut by_motion = DMatrix::zeros(PARAMETERS, 6);
        for arm in 0..ARMS {
            by_motion
                .view_mut((PER_ARM * arm, 0), (3, 6))
                .copy_from(&motion_of(&self.origins_m[arm]));
            let turn = motion_of(&self.guideways[arm])
                .fixed_columns::<3>(3)
                .into_owned();
            by_motion
                .view_mut((PER_ARM * arm + 3, 3), (3, 3))
                .copy_from(&turn);
        }
        let inverse = squares
            .try_inverse()
            .unwrap_or_else(|| Matrix6::repeat(f64::NAN));
        Ok(DMatrix::identity(PARAMETERS, PARAMETERS) - by_motion * inverse * products)
    }
}

/// Returns the covariance of the parameters after a rotation of their frame.
pub(in crate::geometry) fn turned_covariance(
    covariance: &DMatrix<f64>,
    rotation: &UnitQuaternion<f64>,
) -> DMatrix<f64> {
    let block = rotation.to_rotation_matrix().into_inner();
    let mut turn = DMatrix::identity(PARAMETERS, PARAMETERS);
    for first in (0..ARMS).flat_map(|arm| [PER_ARM * arm, PER_ARM * arm + 3]) {
        turn.view_mut((first, first), (3, 3)).copy_from(&block);
    }
    &turn * covariance * turn.transpose()
}

/// Change of a place by a small motion `(t, w)`: `t + w x place`.
fn motion_of(place: &Vector3<f64>) -> Matrix3x6<f64> {
    let mut motion = Matrix3x6::zeros();
    motion.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
    motion
        .fixed_view_mut::<3, 3>(0, 3)
        .copy_from(&-cross_matrix(place));
    motion
}
