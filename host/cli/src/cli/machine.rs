//! Options that name a machine.

use clap::Args;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{AnyRobotFile, RobotFile, RobotFileError};

use super::outputs::NamedInput;

/// The machine of a command that has no default.
#[derive(Debug, Args)]
pub(super) struct MachineOption {
    /// The machine: l2 or f1 (built in), or a robot file
    #[arg(
        long,
        value_name = "l2|f1|FILE",
        required_unless_present = "robot_file"
    )]
    robot: Option<NamedInput>,
    /// Former place of --robot, before version 0.1
    #[arg(value_name = "l2|f1|FILE", hide = true, conflicts_with = "robot")]
    robot_file: Option<NamedInput>,
}

impl MachineOption {
    /// Name as it was typed.
    pub(super) fn name(&self) -> &str {
        let named = self.robot.as_ref().or(self.robot_file.as_ref());
        named.map_or("", |name| name)
    }

    /// Reads the robot file.
    pub(super) fn read(&self) -> Result<AnyRobotFile, RobotFileError> {
        AnyRobotFile::named(self.name())
    }
}

/// The robot file of a client, for the same geometry as the machine's, as a server would demand;
/// the machine's own without one.
pub(super) fn client_of<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    client: Option<&NamedInput>,
) -> Result<RobotFile<K, N>, Box<dyn std::error::Error>> {
    let Some(name) = client else {
        return Ok(robot.clone());
    };
    let client = RobotFile::<K, N>::named(name)?;
    if client.checksum() != robot.checksum() {
        let machine = &robot.name;
        return Err(format!(
            "{}: its geometry or metres_per_q is not that of {machine}; a client needs the machine's",
            client.name
        )
        .into());
    }
    Ok(client)
}
