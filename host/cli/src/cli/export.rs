//! `gantry-tau export`.

use std::process::ExitCode;

use crate::mjcf::mjcf;
use crate::terminal::say;
use clap::Args;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_system::output::{Kind, Output};

use super::machine::MachineOption;
use super::outputs::file;
use super::{MachineCommand, Outcome};

/// Write a machine as a model of MuJoCo: carts, plates, links, platform and tool at home, with
/// springs, masses and damping
///
/// The model is MJCF. Its actuators `axis1` to `axis6` are the springs of the axes: their controls
/// are where the drives are, m. Force and torque of the site `sensor` are those of the platform on
/// the tool. Damping is that of the robot file for the lowest mode, and more for those above it;
/// play, travel and the masses of motors are left out. docs/simulators.md has it as the machine of a
/// server.
#[derive(Debug, Args)]
pub(crate) struct Export {
    #[command(flatten)]
    pub(super) machine: MachineOption,
    /// Model to be written; an existing one is replaced
    #[arg(long, value_name = "FILE.xml", default_value = "machine.xml", value_parser = file(Kind::Model))]
    mjcf: Output,
}

impl MachineCommand for Export {
    fn run_on<K: MachineKind<N>, const N: usize, const M: usize>(
        self,
        robot: RobotFile<K, N>,
    ) -> Outcome {
        self.mjcf.write(&mjcf(&robot)?)?;
        say(format_args!(
            "{}: written to {}",
            robot.name,
            self.mjcf.path().display()
        ));
        Ok(ExitCode::SUCCESS)
    }
}
