//! Options of a recording.

use clap::Args;
use gantry_tau::record::RecordTo;

use super::labcomm::LabcommVersion;

/// File of a recording by a client.
#[derive(Debug, Args)]
pub(crate) struct ClientRecording {
    /// Record what the client knows of every tick that it answers, as CSV, as a stream of LabComm or as MCAP
    ///
    /// CSV: one row per tick with references, actual values, targets and force. LabComm: the samples axes, state, tool and session_event.
    /// MCAP: the same samples as JSON, and the machine as a scene for Foxglove. In `tool` a client knows the load, tared and filtered, and the rest is not a number; of the events it knows the grant and the phases.
    #[arg(long, value_name = "FILE.csv|FILE.labcomm|FILE.mcap")]
    record: Option<RecordTo>,
    /// Version of LabComm in FILE.labcomm
    #[arg(long, value_name = "VERSION", default_value = "2014", requires = "record")]
    labcomm_version: LabcommVersion,
}

impl ClientRecording {
    /// The file, if one is wanted.
    pub(super) fn to(self) -> Option<RecordTo> {
        self.record.map(|to| to.with_version(self.labcomm_version.into()))
    }
}
