//! Computations of the units.

mod compensator;
mod conversions;
mod machine;
mod ports;
mod server;

use gantry_tau_machine::model::{F1_MOTORS, L2_MOTORS, MachineKind};
use gantry_tau_machine::robot_file::{AnyRobotFile, RobotFile};

use crate::kind::Kind;
use crate::log::Log;
use crate::variable::{Declarations, Values, Variable};

/// A unit between two cycles.
pub(crate) trait Unit: Send {
    /// Begins with the values that are set, and sets the outputs of the beginning.
    ///
    /// # Errors
    /// A sentence: it cannot begin so.
    fn begin(&mut self, values: &mut Values) -> Result<(), String>;

    /// Computes a cycle from the inputs, and sets the outputs.
    ///
    /// # Errors
    /// A sentence: it cannot go on.
    fn cycle(&mut self, values: &mut Values, log: &mut Log) -> Result<(), String>;

    /// Returns a copy, which goes on from the same state and shares nothing with this one.
    fn copy(&self) -> Box<dyn Unit>;
}

/// A unit before its beginning, and its variables.
pub(crate) struct Model {
    pub(crate) unit: Box<dyn Unit>,
    pub(crate) variables: Vec<Variable>,
    pub(crate) guid: String,
}

impl Model {
    /// Creates the unit of a kind for a robot file.
    ///
    /// # Errors
    /// A sentence that names file and key.
    pub(crate) fn new(kind: Kind, robot: AnyRobotFile) -> Result<Self, String> {
        match robot {
            AnyRobotFile::L2(robot) => Self::of::<_, 3, L2_MOTORS>(kind, *robot),
            AnyRobotFile::F1(robot) => Self::of::<_, 6, F1_MOTORS>(kind, *robot),
        }
    }

    fn of<K: MachineKind<N>, const N: usize, const M: usize>(
        kind: Kind,
        mut robot: RobotFile<K, N>,
    ) -> Result<Self, String> {
        if robot.position_loops.is_some() && kind != Kind::Compensator {
            return Err(format!(
                "{}: drives.interface: is \"velocity\"; a unit takes \"position\"",
                robot.name
            ));
        }
        // A unit has no samples of one.
        robot.sensor.accelerometer = None;
        let mut declared = Declarations::default();
        let unit: Box<dyn Unit> = match kind {
            Kind::Server => Box::new(server::ServerUnit::new(robot, &mut declared)?),
            Kind::Machine => Box::new(machine::MachineUnit::<K, N, M>::new(robot, &mut declared)?),
            Kind::Compensator => Box::new(compensator::CompensatorUnit::new(robot, &mut declared)?),
        };
        let Declarations { variables } = declared;
        let guid = kind.guid(N, &variables);
        Ok(Self {
            unit,
            variables,
            guid,
        })
    }
}
