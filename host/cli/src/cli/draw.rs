//! `gantry-tau draw`.

use std::process::ExitCode;

use crate::terminal::say;
use clap::Args;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_report::wireframe::picture;
use gantry_tau_system::output::{Kind, Output};

use super::machine::MachineOption;
use super::outputs::file;
use super::{Failure, MachineCommand, Outcome};

/// Draw a machine at home: guideways, carts, links, platform and tool, as a wireframe in SVG
///
/// Parallel projection of the machine with its tool at home (`simulation.home_m`) and the platform
/// unturned.
#[derive(Debug, Args)]
pub(crate) struct Draw {
    #[command(flatten)]
    pub(super) machine: MachineOption,
    /// Picture to be written
    #[arg(short, long, alias = "svg", value_name = "FILE.svg", default_value = "machine.svg", value_parser = file(Kind::Picture))]
    output: Output,
    /// Direction to the viewer about the z axis, from +x towards +y, degrees
    #[arg(
        long,
        value_name = "DEG",
        default_value_t = 60.0,
        allow_negative_numbers = true
    )]
    azimuth: f64,
    /// Height of the viewer above the xy plane, degrees
    #[arg(
        long,
        value_name = "DEG",
        default_value_t = 30.0,
        allow_negative_numbers = true
    )]
    elevation: f64,
}

impl MachineCommand for Draw {
    fn run_on<K: MachineKind<N>, const N: usize, const M: usize>(
        self,
        robot: RobotFile<K, N>,
    ) -> Outcome {
        self.check()?;
        let (azimuth, elevation) = (self.azimuth.to_radians(), self.elevation.to_radians());
        let picture = picture(&robot, azimuth, elevation)?;
        self.output.write(picture.as_str())?;
        say(format_args!(
            "{}: drawn to {}",
            robot.name,
            self.output.path().display()
        ));
        Ok(ExitCode::SUCCESS)
    }
}

impl Draw {
    fn check(&self) -> Result<(), Failure> {
        let ranges = [
            ("--azimuth", self.azimuth, 360.0),
            ("--elevation", self.elevation, 90.0),
        ];
        for (option, angle, largest) in ranges {
            if !(-largest..=largest).contains(&angle) {
                return Err(format!(
                    "{option} is {angle}; expected from -{largest} to {largest} degrees"
                )
                .into());
            }
        }
        Ok(())
    }
}
