//! `gantry-tau linuxcnc-report`.

use std::process::ExitCode;

use clap::Args;
use gantry_tau::linuxcnc::ReportOptions;
use gantry_tau::model::MachineKind;
use gantry_tau::output::{Kind, Output};
use gantry_tau::robot_file::RobotFile;

use super::outputs::{Input, NamedInput, file};
use super::{MachineCommand, Outcome};

/// Report on a demonstration in LinuxCNC, from its record: a table and report.html
///
/// `host/linuxcnc` runs the demonstration, records every servo period, and calls this command (`make demo`). Displacements are computed
/// from the recorded references and the springs of the robot file's simulation.
///
/// Exit codes: 0 every result within its limits; 1 the record cannot be read, or the report not written; 2 usage; 3 a result outside its limits.
#[derive(Debug, Args)]
pub(crate) struct LinuxcncReport {
    /// Folder of the demonstration: joints.txt, server.txt, and said.txt if it is there
    #[arg(value_name = "FOLDER")]
    folder: Input,
    /// The machine: l2 or f1 (built in), or a robot file
    #[arg(long, value_name = "l2|f1|FILE", default_value = "l2")]
    pub(super) robot: NamedInput,
    /// Path of the report
    #[arg(long, value_name = "FILE", default_value = "report.html", value_parser = file(Kind::Page))]
    report: Output,
    /// Write the numbers as JSON as well
    #[arg(long, value_name = "FILE", value_parser = file(Kind::Answer))]
    json: Option<Output>,
}

impl MachineCommand for LinuxcncReport {
    fn run_on<K: MachineKind<N>, const N: usize, const M: usize>(self, robot: RobotFile<K, N>) -> Outcome {
        let options = ReportOptions { robot, folder: self.folder.into(), report: self.report, json: self.json };
        let results = gantry_tau::linuxcnc::run(&options)?;
        Ok(ExitCode::from(if results.complaints.is_empty() { 0 } else { 3 }))
    }
}
