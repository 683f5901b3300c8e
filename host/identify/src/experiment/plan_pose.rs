//! Poses of a plan, as the machine takes them.

use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::units::{Metres, PositionNm};
use gantry_tau_machine::elastic::Equilibrium;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;

use super::PoseError;
use super::prediction::Prediction;

/// Largest distance of a nominal position from the plan's, nm.
const IN_PLACE_NM: u64 = 100_000;

/// A pose of a plan.
#[derive(Clone, Debug)]
pub(crate) struct PlanPose<const N: usize> {
    /// Nominal positions.
    pub(crate) nominal: [PositionNm; N],
    /// The machine in it, unloaded.
    pub(crate) unloaded: Equilibrium<N>,
}

impl<const N: usize> PlanPose<N> {
    /// Returns a pose of the machine of a robot file, or the reason why it cannot be taken.
    pub(crate) fn of<K: MachineKind<N>>(
        robot: &RobotFile<K, N>,
        prediction: &Prediction<N>,
        pose: &Pose,
    ) -> Result<Self, PoseError> {
        let q = robot.model.axes_for(pose)?;
        let mut nominal = [PositionNm(0); N];
        for ((nominal, q), metres) in nominal.iter_mut().zip(q).zip(robot.metres_per_q) {
            *nominal = PositionNm::from_metres(Metres(q * metres))?;
        }
        let unloaded = prediction.unloaded(&q, pose)?;
        Ok(Self { nominal, unloaded })
    }

    /// True if the nominal positions are those of the pose.
    pub(crate) fn has(&self, nominal: &[PositionNm; N]) -> bool {
        nominal
            .iter()
            .zip(&self.nominal)
            .all(|(is, planned)| is.0.abs_diff(planned.0) <= IN_PLACE_NM)
    }
}
