//! `gantry-tau recover`.

use std::process::ExitCode;

use crate::terminal::say;
use clap::Args;
use gantry_tau_record::recording::recover;

use super::Outcome;
use super::outputs::InputFile;

/// Complete an MCAP recording whose program was killed
///
/// Writes all whole messages of FILE.mcap to FILE-recovered.mcap beside it, with the summary and
/// the end that readers need. FILE.mcap stays. Recordings as CSV and LabComm need no recovery: they
/// end with a whole row.
///
/// Exit codes: 0 done; 1 the file is complete, is not a recording of gantry-tau, or cannot be read;
/// 2 usage.
#[derive(Debug, Args)]
pub(crate) struct Recover {
    /// The recording
    #[arg(value_name = "FILE.mcap")]
    file: InputFile,
}

impl Recover {
    pub(super) fn run(self) -> Outcome {
        let recovered = recover(&self.file)?;
        say(format_args!(
            "{}: {} messages",
            recovered.path.display(),
            recovered.messages
        ));
        Ok(ExitCode::SUCCESS)
    }
}
