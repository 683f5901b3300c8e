//! `gantry-tau workspace`.

use std::process::ExitCode;

use crate::terminal::{Progress, say};
use clap::Args;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_machine::workspace::{CELLS, Grid, survey};
use gantry_tau_report::workspace::page;
use gantry_tau_system::output::{Kind, Output, write_all};

use super::machine::MachineOption;
use super::outputs::file;
use super::{Failure, MachineCommand, Outcome};

/// Map reach, condition number and compliance of a machine, as a page with plots and a CSV table
///
/// Evaluates every place of a cubic grid, with an unturned platform: reachable or not, condition
/// number of the Jacobian (distance from singularities), and displacement of the tool per newton.
#[derive(Debug, Args)]
pub(crate) struct Workspace {
    #[command(flatten)]
    pub(super) machine: MachineOption,
    /// Steps along the longest side of the grid
    #[arg(long, value_name = "N", default_value_t = 80)]
    cells: u32,
    /// Path of the page with the maps
    #[arg(long, alias = "plot", value_name = "FILE.html", default_value = "workspace.html", value_parser = file(Kind::Page))]
    report: Output,
    /// Table to be written: place, code, condition, compliance and axes, one row per place
    #[arg(short, long, alias = "csv", value_name = "FILE.csv", default_value = "workspace.csv", value_parser = file(Kind::Map))]
    output: Output,
}

impl MachineCommand for Workspace {
    fn run_on<K: MachineKind<N>, const N: usize, const M: usize>(
        self,
        robot: RobotFile<K, N>,
    ) -> Outcome {
        check_cells(self.cells)?;
        // A path that cannot be written is found before the survey, not after it.
        self.report.check(false)?;
        self.output.check(false)?;
        let grid = Grid::of(&robot, self.cells);
        let progress = Progress::new(grid.count(), "places");
        let survey = survey(&robot, grid, |_| progress.step());
        drop(progress);
        let summary = survey.summary();
        write_all(&[
            (&self.output, &survey.table()),
            (&self.report, &page(&survey, &summary)),
        ])?;
        say(format_args!(
            "{}\n\n{summary}\nmaps: {}; table: {}",
            robot.name,
            self.report.path().display(),
            self.output.path().display()
        ));
        Ok(ExitCode::SUCCESS)
    }
}

/// Refuses a number of steps of a grid that is out of range.
pub(super) fn check_cells(cells: u32) -> Result<(), Failure> {
    if CELLS.contains(&cells) {
        return Ok(());
    }
    let (from, to) = (CELLS.start(), CELLS.end());
    Err(format!("--cells is {cells}; expected from {from} to {to}").into())
}
