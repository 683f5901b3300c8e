//! `gantry-tau draw`.

use std::process::ExitCode;

use clap::Args;
use gantry_tau::draw::DrawOptions;
use gantry_tau::model::MachineKind;
use gantry_tau::output::{Kind, Output};
use gantry_tau::robot_file::RobotFile;
use gantry_tau::terminal::say;

use super::outputs::{NamedInput, file};
use super::{MachineCommand, Outcome};

/// Draw a machine at home: guideways, carts, links, platform and tool, as a wireframe in SVG
///
/// Parallel projection of the machine with its tool at home (`simulation.home_m`) and the platform unturned.
#[derive(Debug, Args)]
pub(crate) struct Draw {
    /// The machine: l2 or f1 (built in), or a robot file
    #[arg(value_name = "l2|f1|FILE")]
    pub(super) robot: NamedInput,
    /// Output file
    #[arg(long, value_name = "FILE.svg", default_value = "machine.svg", value_parser = file(Kind::Picture))]
    svg: Output,
    /// Direction to the viewer about the z axis, from +x towards +y, degrees
    #[arg(long, value_name = "DEG", default_value_t = 60.0, allow_negative_numbers = true)]
    azimuth: f64,
    /// Height of the viewer above the xy plane, degrees
    #[arg(long, value_name = "DEG", default_value_t = 30.0, allow_negative_numbers = true)]
    elevation: f64,
}

impl MachineCommand for Draw {
    fn run_on<K: MachineKind<N>, const N: usize, const M: usize>(self, robot: RobotFile<K, N>) -> Outcome {
        let options = DrawOptions { robot, svg: self.svg, azimuth_deg: self.azimuth, elevation_deg: self.elevation };
        gantry_tau::draw::run(&options)?;
        say(format_args!("{}: drawn to {}", options.robot.name, options.svg.path().display()));
        Ok(ExitCode::SUCCESS)
    }
}
