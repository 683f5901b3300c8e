//! `linuxcnc-report`: a demonstration inside LinuxCNC (`host/linuxcnc/demo.py`), from its record to a table and a page.

mod record;
mod report;
mod results;
mod table;
#[cfg(test)]
mod tests;
mod tool;

use std::path::PathBuf;

use crate::model::MachineKind;
use crate::output::{Output, WriteError};
use crate::robot_file::{RobotFile, RobotFileError};
use crate::terminal::say;

pub use record::RecordError;
pub use results::{Ramp, Results, Session};
pub use tool::ToolError;

/// Options of the report.
#[derive(Clone, Debug)]
pub struct ReportOptions<K, const N: usize> {
    /// The machine.
    pub robot: RobotFile<K, N>,
    /// Folder of the demonstration: `joints.txt`, `server.txt`, and `said.txt` if it is there.
    pub folder: PathBuf,
    /// Path of the report.
    pub report: Output,
    /// Path of the numbers as JSON, if wanted.
    pub json: Option<Output>,
}

/// Failures of [`run`].
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The record cannot be read.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// The robot file has no springs, or cannot be simulated.
    #[error(transparent)]
    Robot(#[from] RobotFileError),
    /// The springs of the machine do not hold a pose of the record.
    #[error(transparent)]
    Tool(#[from] ToolError),
    /// The report or the numbers cannot be written.
    #[error(transparent)]
    File(#[from] WriteError),
}

/// Reads the record, prints the table, writes the report.
///
/// # Errors
/// [`ReportError`].
pub fn run<K: MachineKind<N>, const N: usize>(options: &ReportOptions<K, N>) -> Result<Results, ReportError> {
    let periods = record::read::<N>(&options.folder)?;
    let moments = tool::moments(&options.robot, &periods)?;
    let results = Results::of(&options.robot, &moments);
    let said = std::fs::read_to_string(options.folder.join("said.txt")).unwrap_or_default();
    say(table::render(&results));
    options.report.write(&report::render(&results, &moments, &said))?;
    say(format_args!("report: {}", options.report.path().display()));
    if let Some(output) = &options.json {
        // Numbers and strings: nothing that JSON cannot hold.
        output.write(&serde_json::to_string_pretty(&results).unwrap_or_default())?;
    }
    Ok(results)
}
