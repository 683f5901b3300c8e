//! `gantry-tau experiment`.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use gantry_tau::experiment::simulated::simulate;
use gantry_tau::experiment::table::Table;
use gantry_tau::measurements::plan;
use gantry_tau::model::MachineKind;
use gantry_tau::robot_file::RobotFile;
use gantry_tau::terminal::say;

use super::{MachineCommand, Outcome};

/// Measure a campaign of forces and gauges, window by window
///
/// Reads a plan, and writes the table of windows that `identify` takes: mean of forces, gauges and axes at each level.
#[derive(Debug, Args)]
pub(crate) struct Experiment {
    /// The plan: a set-up with [[series]], format = "gantry-tau springs 1"
    #[arg(value_name = "PLAN.toml")]
    plan: PathBuf,
    /// The machine: l2 or f1 (built in), or a robot file
    #[arg(long, value_name = "l2|f1|FILE", default_value = "l2")]
    pub(super) robot: String,
    /// Measure the simulated machine, without a server; SEED decides its springs and every error [default: the robot file's]
    #[arg(long, value_name = "SEED", num_args = 0..=1, required = true)]
    simulated: Option<Option<u64>>,
    /// Table to be written
    #[arg(short, value_name = "MEASURED.csv")]
    output: PathBuf,
}

impl MachineCommand for Experiment {
    fn run_on<K: MachineKind<N>, const N: usize, const M: usize>(self, robot: RobotFile<K, N>) -> Outcome {
        let plan = plan::read(&self.plan, K::NAME, &robot.metres_per_q)?;
        let mut robot = robot;
        if let Some(seed) = self.simulated.flatten() {
            robot.simulation.seed = seed;
        }
        let mut table = Table::open(&self.output, &plan, false)?;
        if !table.is_empty() {
            return Err(format!("{} has rows; remove it, or name another file", self.output.display()).into());
        }
        let rows = simulate(&robot, &plan)?.rows;
        for row in &rows {
            table.write(&plan, row)?;
        }
        say(format_args!("{}: {} windows", self.output.display(), rows.len()));
        if !is_named(&plan.table, &self.output) {
            tracing::warn!("the set-up names {} as its table; `identify` reads that", plan.table.display());
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// True if the set-up names this table.
fn is_named(named: &std::path::Path, written: &std::path::Path) -> bool {
    match (named.canonicalize(), written.canonicalize()) {
        (Ok(named), Ok(written)) => named == written,
        _ => false,
    }
}
