//! Notches of a compensation for the places of a machine.

use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::load_filter::{MAX_NOTCHES, Notch};

use super::{DriveKind, FilterKind, LinearMachine, LoopResponse, TickMap};
use crate::dynamics::MassiveMachine;
use crate::model::MachineKind;
use crate::robot_file::RobotFile;

/// Notches of a filter, each in its place.
pub type Notches = [Option<Notch>; MAX_NOTCHES];

/// A machine with mass, with its drives and the filter of its compensation.
#[derive(Clone, Copy, Debug)]
pub struct NotchFinder<const N: usize> {
    /// The machine.
    pub machine: MassiveMachine<N>,
    /// Its drives.
    pub drives: DriveKind<N>,
    /// Filter of the load.
    pub filter: FilterKind,
}

impl<const N: usize> NotchFinder<N> {
    /// Machine of a robot file. `None` without compliances or masses.
    #[must_use]
    pub fn of<K: MachineKind<N>>(robot: &RobotFile<K, N>) -> Option<Self> {
        Some(Self {
            machine: MassiveMachine::of(robot)?,
            drives: DriveKind::cascade(robot, robot.position_gain_per_s())?,
            filter: FilterKind::of(robot),
        })
    }

    /// Returns the notches for a place, lowest first. `None` where the machine has no natural
    /// frequencies.
    #[must_use]
    pub fn at(&self, pose: &Pose, axes: &[f64; N]) -> Option<Notches> {
        let machine = LinearMachine::at(&self.machine, &pose.into(), axes)?;
        let response = LoopResponse::of(&machine, &TickMap::of(&machine, &self.drives))?;
        let found = self.filter.notches(&machine, &response)?;
        Some(std::array::from_fn(|place| found.get(place).copied()))
    }
}
