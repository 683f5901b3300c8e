//! `gantry-tau export`.

use std::process::ExitCode;

use crate::export::{mjcf, urdf};
use crate::terminal::say;
use clap::Args;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_system::output::{Kind, Output, write_all};

use super::machine::MachineOption;
use super::outputs::file;
use super::{MachineCommand, Outcome};

/// Write a machine at home as a model of MuJoCo, or as a description for viewers
///
/// The model has carts, plates, links, platform and tool with springs, masses and damping. Its
/// actuators `axis1` to `axis6` are the springs of the axes: their controls are where the drives
/// are, m. Force and torque of the site `sensor` are those of the platform on the tool. Damping is
/// that of the robot file for the lowest mode, and more for those above it; play, travel and the
/// masses of motors are left out. docs/simulators.md has it as the machine of a server.
///
/// The description is a tree, as URDF must be: carts and plates move, links and platform stay as
/// they stand at home.
#[derive(Debug, Args)]
pub(crate) struct Export {
    #[command(flatten)]
    pub(super) machine: MachineOption,
    /// Model of MuJoCo to be written
    #[arg(long, value_name = "FILE.xml", required_unless_present = "urdf", value_parser = file(Kind::Model))]
    mjcf: Option<Output>,
    /// Description for viewers to be written
    #[arg(long, value_name = "FILE.urdf", value_parser = file(Kind::Model))]
    urdf: Option<Output>,
}

impl MachineCommand for Export {
    fn run_on<K: MachineKind<N>, const N: usize, const M: usize>(
        self,
        robot: RobotFile<K, N>,
    ) -> Outcome {
        let mut made = Vec::new();
        if let Some(output) = &self.mjcf {
            made.push((output, mjcf(&robot)?));
        }
        if let Some(output) = &self.urdf {
            made.push((output, urdf(&robot)?));
        }
        let files = made.iter().map(|(output, text)| (*output, text.as_str()));
        write_all(&files.collect::<Vec<_>>())?;
        for (output, _) in made {
            let path = output.path().display();
            say(format_args!("{}: written to {path}", robot.name));
        }
        Ok(ExitCode::SUCCESS)
    }
}
