//! Sources of a client's force samples: the States of the server, or a LabComm stream.

mod labcomm;

use std::fmt;
use std::io;
use std::sync::atomic::AtomicBool;

use gantry_tau_core::control::message::State;
use gantry_tau_system::dial::Addresses;

use crate::ClientError;
use labcomm::LabcommSensor;

/// Name of the sample in the thesis' file.
pub const DEFAULT_NAME: &str = "forcesensor";

/// Reason of a source that is silent.
const SILENCE: &str = "none has come for too long";

/// States to wait for the first sample of a stream: one whose places are taken by readers that read
/// nothing has dropped them by then.
const FIRST_OF_STREAM: u64 = 3_000;
/// The same for the samples in the States themselves.
const FIRST_OF_STATES: u64 = 1_000;

/// One sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Tick of the server in which it was taken.
    pub tick: u64,
    /// Force (N) then moment (N m), sensor axes.
    pub wrench: [f64; 6],
    /// A component is beyond the range of a State: not a measurement.
    pub is_cut: bool,
}

/// Source of a client's force samples.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum SensorSource {
    /// The States of the server.
    #[default]
    States,
    /// A LabComm stream of either generation, with a sample of six floats or doubles.
    Labcomm {
        /// Addresses, of which the first that answers is taken.
        address: Addresses,
        /// Name of the sample.
        name: String,
    },
}

impl fmt::Display for SensorSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::States => f.write_str("the States of the server"),
            Self::Labcomm { address, name } => write!(f, "labcomm:{address}/{name}"),
        }
    }
}

/// A source in use.
#[derive(Debug)]
pub enum SensorConnection {
    /// The States.
    States,
    /// Of LabComm samples.
    Labcomm(LabcommSensor),
}

impl SensorConnection {
    /// Connects to a source that has an address of its own.
    ///
    /// # Errors
    /// [`ClientError::Unreachable`]: nothing listens there. [`ClientError::Quit`] if `quit` was set
    /// meanwhile.
    pub fn connect(source: &SensorSource, quit: &AtomicBool) -> Result<Self, ClientError> {
        match source {
            SensorSource::States => Ok(Self::States),
            SensorSource::Labcomm { address, name } => LabcommSensor::connect(address, name, quit)
                .map(Self::Labcomm)
                .map_err(|error| ClientError::unreachable("force sensor", address, error)),
        }
    }

    /// Returns the latest sample: that of a State, or of what has arrived, as far as a visit reads. A
    /// LabComm sample has no tick: it gets that of the State with which it comes.
    ///
    /// # Errors
    /// [`io::ErrorKind::InvalidData`]: the stream is not understood. Others: the sensor is gone.
    pub fn latest<const N: usize>(&mut self, state: &State<N>) -> io::Result<Option<Sample>> {
        match self {
            Self::States => Ok(state.sensor.map(|sample| Sample {
                tick: state.tick.0.saturating_sub(sample.age.into()),
                wrench: sample.to_si(),
                is_cut: sample.is_cut,
            })),
            Self::Labcomm(sensor) => sensor.latest(state.tick.0),
        }
    }

    /// Returns the number of States to wait for the first sample.
    #[must_use]
    pub const fn patience(&self) -> u64 {
        match self {
            Self::States => FIRST_OF_STATES,
            Self::Labcomm(_) => FIRST_OF_STREAM,
        }
    }

    /// Returns the reason for which no new sample has come.
    #[must_use]
    pub fn silence(&self) -> String {
        match self {
            Self::States => format!("{SILENCE} with the States of the server"),
            Self::Labcomm(sensor) => sensor.silence(),
        }
    }
}
