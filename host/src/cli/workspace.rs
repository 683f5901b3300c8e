//! `gantry-tau workspace`.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use gantry_tau::model::MachineKind;
use gantry_tau::robot_file::{AnyRobotFile, RobotFile};
use gantry_tau::terminal::say;
use gantry_tau::workspace::WorkspaceOptions;

use super::{fail, robot};

/// Map where a machine reaches, its condition number and its compliance, to a page with plots and a CSV table
///
/// Asks the machine at every place of a cubic grid, platform unturned: does it reach, how near is a singularity (condition number
/// of the Jacobian), how far does the tool give way per newton.
#[derive(Debug, Args)]
pub(crate) struct Workspace {
    /// The machine: l2 or f1 (built in), or a robot file
    #[arg(value_name = "l2|f1|FILE")]
    robot: String,
    /// Steps along the longest side of the grid
    #[arg(long, value_name = "N", default_value_t = 80)]
    cells: u32,
    /// Where the page with the maps goes
    #[arg(long, value_name = "FILE.html", default_value = "workspace.html")]
    plot: PathBuf,
    /// Where the table goes: place, code, condition, compliance and axes, one row per place
    #[arg(long, value_name = "FILE.csv", default_value = "workspace.csv")]
    csv: PathBuf,
}

impl Workspace {
    pub(crate) fn run(self) -> ExitCode {
        match robot(&self.robot) {
            Ok(AnyRobotFile::L2(robot)) => self.run_with(*robot),
            Ok(AnyRobotFile::F1(robot)) => self.run_with(*robot),
            Err(error) => fail(1, error),
        }
    }

    fn run_with<K: MachineKind<N>, const N: usize>(self, robot: RobotFile<K, N>) -> ExitCode {
        let options = WorkspaceOptions {
            robot,
            cells: self.cells,
            plot: self.plot,
            csv: self.csv,
        };
        match gantry_tau::workspace::run(&options) {
            Ok(summary) => {
                let (plot, csv) = (options.plot.display(), options.csv.display());
                say(format_args!("{}\n\n{summary}", options.robot.name));
                say(format_args!("maps: {plot}; table: {csv}"));
                ExitCode::SUCCESS
            }
            Err(error) => fail(1, error),
        }
    }
}
