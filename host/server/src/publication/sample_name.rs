//! Names of the samples that a port can carry.

use std::fmt;
use std::str::FromStr;

/// A sample of the server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleName {
    /// Gauges, counts of their resolution.
    Data,
    /// Force sensor, N and N m.
    ForceSensor,
    /// Phase, cause, counters.
    State,
    /// References, offsets, actual values.
    Axes,
    /// The simulation's truth at the tool.
    Tool,
    /// Events of sessions.
    SessionEvent,
    /// States of the drives.
    Drives,
    /// Name and kinematics checksum of the machine, once.
    Machine,
}

impl SampleName {
    /// All samples, in the order in which they are listed to users.
    pub const ALL: [Self; 8] = [
        Self::Data,
        Self::ForceSensor,
        Self::State,
        Self::Axes,
        Self::Tool,
        Self::SessionEvent,
        Self::Drives,
        Self::Machine,
    ];

    /// Name on the wire.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Data => "data",
            Self::ForceSensor => "forcesensor",
            Self::State => "state",
            Self::Axes => "axes",
            Self::Tool => "tool",
            Self::SessionEvent => "session_event",
            Self::Drives => "drives",
            Self::Machine => "machine",
        }
    }

    /// True for the samples of the thesis' measuring programs.
    #[must_use]
    pub const fn is_of_sensors(self) -> bool {
        matches!(self, Self::Data | Self::ForceSensor)
    }
}

impl fmt::Display for SampleName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A name that no sample has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "there is no sample {name:?}; expected data, forcesensor, state, axes, tool, session_event, drives or machine"
)]
pub struct ParseSampleNameError {
    name: String,
}

impl FromStr for SampleName {
    type Err = ParseSampleNameError;

    fn from_str(text: &str) -> Result<Self, ParseSampleNameError> {
        let found = Self::ALL.into_iter().find(|sample| sample.name() == text);
        found.ok_or_else(|| ParseSampleNameError {
            name: text.to_owned(),
        })
    }
}
