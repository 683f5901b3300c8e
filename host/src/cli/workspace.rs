//! `gantry-tau workspace`.

use std::process::ExitCode;

use clap::Args;
use gantry_tau::model::MachineKind;
use gantry_tau::output::{Kind, Output};
use gantry_tau::robot_file::RobotFile;
use gantry_tau::terminal::say;
use gantry_tau::workspace::WorkspaceOptions;

use super::outputs::{NamedInput, file};
use super::{MachineCommand, Outcome};

/// Map reach, condition number and compliance of a machine, as a page with plots and a CSV table
///
/// Evaluates every place of a cubic grid, with an unturned platform: reachable or not, condition number of the Jacobian (distance
/// from singularities), and displacement of the tool per newton.
#[derive(Debug, Args)]
pub(crate) struct Workspace {
    /// The machine: l2 or f1 (built in), or a robot file
    #[arg(value_name = "l2|f1|FILE")]
    pub(super) robot: NamedInput,
    /// Steps along the longest side of the grid
    #[arg(long, value_name = "N", default_value_t = 80)]
    cells: u32,
    /// Path of the page with the maps
    #[arg(long, value_name = "FILE.html", default_value = "workspace.html", value_parser = file(Kind::Page))]
    plot: Output,
    /// Path of the table: place, code, condition, compliance and axes, one row per place
    #[arg(long, value_name = "FILE.csv", default_value = "workspace.csv", value_parser = file(Kind::Map))]
    csv: Output,
}

impl MachineCommand for Workspace {
    fn run_on<K: MachineKind<N>, const N: usize, const M: usize>(self, robot: RobotFile<K, N>) -> Outcome {
        let options = WorkspaceOptions { robot, cells: self.cells, plot: self.plot, csv: self.csv };
        let summary = gantry_tau::workspace::run(&options)?;
        let (plot, csv) = (options.plot.path().display(), options.csv.path().display());
        say(format_args!("{}\n\n{summary}\nmaps: {plot}; table: {csv}", options.robot.name));
        Ok(ExitCode::SUCCESS)
    }
}
