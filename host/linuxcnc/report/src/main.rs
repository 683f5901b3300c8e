//! Report on a demonstration in LinuxCNC (`host/linuxcnc/demo.py`), from its record: a table on the
//! terminal, and a page.
#![forbid(unsafe_code)]
#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, reason = "tests write files of their own")
)]
#![deny(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "they panic when the stream fails"
)]
#![allow(
    clippy::arithmetic_side_effects,
    clippy::as_conversions,
    reason = "off the reference path; release builds keep their overflow checks, and `as` saturates where floats become integers"
)]

mod page;
mod record;
mod results;
mod table;
#[cfg(test)]
mod tests;
mod tool;

use std::error::Error;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{AnyRobotFile, RobotFile};
use gantry_tau_system::output::{Kind, Output, escaped, write_all};

use results::Results;

/// Report on a demonstration in LinuxCNC, from its record: a table, FOLDER/report.html and
/// FOLDER/report.json
///
/// `make demo` records every servo period, and calls this program. Displacements are computed from
/// the recorded references and the springs of the robot file's simulation.
///
/// Exit codes: 0 every result within its limits; 1 the record cannot be read, or the report not
/// written; 2 usage; 3 a result outside its limits.
#[derive(Debug, Parser)]
#[command(name = "gantry-tau-linuxcnc-report", max_term_width = 100)]
struct Arguments {
    /// Folder of the demonstration: joints.txt, server.txt, and said.txt if it is there
    #[arg(value_name = "FOLDER")]
    folder: PathBuf,
    /// The machine: l2 or f1 (built in), or a robot file
    #[arg(long, value_name = "l2|f1|FILE", default_value = "l2")]
    robot: String,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match run(&arguments) {
        Ok(results) if results.complaints.is_empty() => ExitCode::SUCCESS,
        Ok(_) => ExitCode::from(3),
        Err(error) => {
            // Nothing is left to be done where stderr fails.
            let _ = writeln!(io::stderr(), "gantry-tau-linuxcnc-report: {error}");
            ExitCode::from(1)
        }
    }
}

fn run(arguments: &Arguments) -> Result<Results, Box<dyn Error>> {
    match AnyRobotFile::named(&arguments.robot)? {
        AnyRobotFile::L2(robot) => report(&robot, &arguments.folder),
        AnyRobotFile::F1(robot) => report(&robot, &arguments.folder),
    }
}

/// Reads the record of a folder, prints the table, and writes the report beside the record.
fn report<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    folder: &Path,
) -> Result<Results, Box<dyn Error>> {
    let periods = record::read::<N>(folder)?;
    let moments = tool::moments(robot, &periods)?;
    let results = Results::of(robot, &moments);
    let said = std::fs::read_to_string(folder.join("said.txt")).unwrap_or_default();
    let page = Output::new(folder.join("report.html"), Kind::Page);
    let answer = Output::new(folder.join("report.json"), Kind::Answer);
    write_all(&[
        (&page, &page::render(&results, &moments, &said)),
        (&answer, &serde_json::to_string_pretty(&results)?),
    ])?;
    say(&format!(
        "{}\nreport: {}",
        table::render(&results),
        page.path().display()
    ))?;
    Ok(results)
}

/// Prints lines. What would command a terminal is escaped.
fn say(text: &str) -> io::Result<()> {
    let text = escaped(text, |letter| {
        !letter.is_control() || matches!(letter, '\n' | '\t')
    });
    writeln!(io::stdout(), "{text}")
}
