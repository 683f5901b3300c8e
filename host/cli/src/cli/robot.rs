//! `gantry-tau robot`.

mod summary;

use std::process::ExitCode;

use crate::terminal::{complain, say};
use clap::{Args, Subcommand};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{AnyRobotFile, RobotFile, text_of};

use super::outputs::NamedInput;
use super::{MachineCommand, Outcome, fail, run_on};
use summary::summary;

/// Judge a robot file
#[derive(Debug, Args)]
pub(crate) struct RobotCommand {
    #[command(subcommand)]
    task: Task,
}

#[derive(Debug, Subcommand)]
enum Task {
    Check(Check),
}

/// Find all errors of a robot file, each with its key and the reason; print a summary if there are
/// none
///
/// The summary has axes, travel, limits, springs, sensor and tool with their units, and at home:
/// how far the tool reaches, the condition number of the Jacobian and the compliance. Errors of
/// TOML's grammar hide all others; a section with a value that cannot be read is compared with the
/// other sections once it can.
///
/// Exit codes: 0 no errors; 1 errors, one per line; 2 usage.
#[derive(Debug, Args)]
struct Check {
    /// The robot file; l2 or f1 for one that is built in
    #[arg(value_name = "l2|f1|FILE")]
    file: NamedInput,
}

impl RobotCommand {
    pub(super) fn run(self) -> Outcome {
        let Task::Check(check) = self.task;
        check.run()
    }
}

impl Check {
    fn run(self) -> Outcome {
        let name = &*self.file;
        match AnyRobotFile::check(name, &text_of(name)?) {
            Ok(robot) => run_on(Ok(robot), Summary),
            Err(errors) => {
                errors.iter().for_each(complain);
                let count = errors.len();
                let noun = if count == 1 { "error" } else { "errors" };
                Ok(fail(1, format_args!("{name}: {count} {noun}")))
            }
        }
    }
}

/// Prints what a robot file says.
struct Summary;

impl MachineCommand for Summary {
    fn run_on<K: MachineKind<N>, const N: usize, const M: usize>(
        self,
        robot: RobotFile<K, N>,
    ) -> Outcome {
        say(summary(&robot)?);
        Ok(ExitCode::SUCCESS)
    }
}
