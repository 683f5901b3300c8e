//! Options of recordings.

use clap::Args;
use gantry_tau_record::recording::RecordTo;

use super::labcomm::LabcommVersion;

/// Size of a recording.
#[derive(Debug, Args)]
pub(crate) struct RecordLimit {
    /// End the recording at this size, bytes, or with the unit k, M or G (10^3, 10^6, 10^9)
    #[arg(long, value_name = "SIZE", requires = "record", value_parser = size)]
    record_limit: Option<u64>,
}

impl RecordLimit {
    /// The recording, with the limit.
    pub(super) fn of(&self, to: RecordTo) -> RecordTo {
        to.with_limit(self.record_limit)
    }
}

/// A size in bytes.
fn size(text: &str) -> Result<u64, &'static str> {
    let units = [("k", 1_000), ("M", 1_000_000), ("G", 1_000_000_000)];
    let (number, unit) = units
        .into_iter()
        .find_map(|(unit, bytes)| Some((text.strip_suffix(unit)?, bytes)))
        .unwrap_or((text, 1));
    let size = number
        .parse::<u64>()
        .ok()
        .and_then(|number| number.checked_mul(unit));
    size.filter(|size| *size > 0)
        .ok_or("expected a number of bytes above 0, such as 500M or 2G")
}

/// File of a recording by a client.
#[derive(Debug, Args)]
pub(crate) struct ClientRecording {
    /// Record what the client knows of every tick that it answers, as CSV, as a stream of LabComm
    /// or as MCAP
    ///
    /// CSV: one row per tick with references, actual values, targets and force. LabComm: the
    /// samples axes, state, tool and session_event. MCAP: the same samples as JSON, and the machine
    /// as a scene for Foxglove. In `tool` a client knows the load, tared and filtered, and the rest
    /// is not a number; of the events it knows the grant and the phases.
    #[arg(long, value_name = "FILE.csv|FILE.labcomm|FILE.mcap")]
    record: Option<RecordTo>,
    #[command(flatten)]
    limit: RecordLimit,
    /// Version of LabComm in FILE.labcomm
    #[arg(
        long,
        value_name = "VERSION",
        default_value = "2014",
        requires = "record"
    )]
    labcomm_version: LabcommVersion,
}

impl ClientRecording {
    /// The file, if one is wanted.
    pub(super) fn to(self) -> Option<RecordTo> {
        self.record
            .map(|to| self.limit.of(to).with_version(self.labcomm_version.into()))
    }
}
