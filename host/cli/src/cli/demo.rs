//! `gantry-tau demo`.

use std::process::ExitCode;

use crate::demo::{DemoOptions, PaceChoice};
use clap::Args;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_system::output::{Kind, Output};

use super::machine::client_of;
use super::outputs::{InputFile, NamedInput, file};
use super::recording::ClientRecording;
use super::{MachineCommand, Outcome, Pace};

/// Server, simulated machine and client in one: force steps, compensation, a pulled cable; ends
/// with a table and report.html
///
/// One session over loopback TCP: force steps in x without and with compensation, then the client's
/// cable is pulled at full offset. If this machine does not hold 1 kHz, the demo starts again in
/// lock-step.
///
/// Exit codes: 0 every result within its limits; 1 could not run; 2 usage; 3 a result outside its
/// limits.
#[derive(Debug, Args)]
pub(crate) struct Demo {
    /// The machine: l2 or f1 (built in), or a robot file
    #[arg(long, value_name = "l2|f1|FILE", default_value = "l2")]
    pub(super) robot: NamedInput,
    /// The machine as the client knows it, for instance with identified springs [default: that of
    /// --robot]
    #[arg(long, value_name = "l2|f1|FILE")]
    client: Option<NamedInput>,
    /// Largest force, N. Above 360 N the machine jumps, like the one of the thesis
    #[arg(
        long,
        value_name = "N",
        default_value_t = 300.0,
        allow_negative_numbers = true
    )]
    force_max: f64,
    /// Difference between two force steps, N
    #[arg(
        long,
        value_name = "N",
        default_value_t = 60.0,
        allow_negative_numbers = true
    )]
    force_step: f64,
    /// Length of each force step, s
    #[arg(
        long,
        value_name = "S",
        default_value_t = 1.0,
        allow_negative_numbers = true
    )]
    step_seconds: f64,
    /// Run the session under this key file: frames have tags
    #[arg(long, value_name = "FILE")]
    key: Option<InputFile>,
    /// Force the pace [default: real time if this machine holds it, else lock-step]
    #[arg(long)]
    pace: Option<Pace>,
    /// Path of the report
    #[arg(long, value_name = "FILE", default_value = "report.html", value_parser = file(Kind::Page))]
    report: Output,
    /// Write the numbers as JSON as well
    #[arg(long, value_name = "FILE", value_parser = file(Kind::Answer))]
    json: Option<Output>,
    #[command(flatten)]
    recording: ClientRecording,
    /// Write the server's black box of the pulled cable as well, for `gantry-tau replay`
    #[arg(long, value_name = "FILE.jsonl", value_parser = file(Kind::BlackBox))]
    black_box: Option<Output>,
}

impl MachineCommand for Demo {
    fn run_on<K: MachineKind<N>, const N: usize, const M: usize>(
        self,
        robot: RobotFile<K, N>,
    ) -> Outcome {
        let options = DemoOptions {
            client: client_of(&robot, self.client.as_ref())?,
            robot,
            key: self.key.map(Into::into),
            pace: self
                .pace
                .map_or(PaceChoice::Auto, |pace| PaceChoice::Only(pace.into())),
            force_max_n: self.force_max,
            force_step_n: self.force_step,
            step_seconds: self.step_seconds,
            report: self.report,
            json: self.json,
            record: self.recording.to(),
            black_box: self.black_box,
        };
        let results = crate::demo::run::<K, N, M>(&options)?;
        Ok(ExitCode::from(if results.complaints.is_empty() {
            0
        } else {
            3
        }))
    }
}
