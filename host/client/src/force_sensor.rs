//! Sources of a client's force samples: the link of `serve`, or a LabComm stream.

mod labcomm;

use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::sync::atomic::AtomicBool;

use gantry_tau_server::links::sensor::{Sample, SensorReader};
use gantry_tau_system::dial::Addresses;

use labcomm::LabcommSensor;

/// Name of the sample in the thesis' file.
pub const DEFAULT_NAME: &str = "forcesensor";

/// Reason of a source that is silent.
const SILENCE: &str = "none has come for too long";

/// Address of a force sensor, and what it speaks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SensorSource {
    /// Records of [`gantry_tau_server::links::sensor`], with the server's ticks.
    Records(Addresses),
    /// A LabComm stream of either generation, with a sample of six floats or doubles.
    Labcomm {
        /// Addresses, of which the first that answers is taken.
        address: Addresses,
        /// Name of the sample.
        name: String,
    },
}

impl SensorSource {
    /// Addresses.
    #[must_use]
    pub const fn address(&self) -> &Addresses {
        match self {
            Self::Records(address) | Self::Labcomm { address, .. } => address,
        }
    }
}

impl From<SocketAddr> for SensorSource {
    fn from(address: SocketAddr) -> Self {
        Self::Records(address.into())
    }
}

impl fmt::Display for SensorSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Records(address) => address.fmt(f),
            Self::Labcomm { address, name } => write!(f, "labcomm:{address}/{name}"),
        }
    }
}

/// A connected source.
#[derive(Debug)]
pub enum SensorConnection {
    /// Of records.
    Records(SensorReader),
    /// Of LabComm samples.
    Labcomm(LabcommSensor),
}

impl SensorConnection {
    /// Connects.
    ///
    /// # Errors
    /// Nothing listens there; [`io::ErrorKind::Interrupted`] if `quit` was set meanwhile.
    pub fn connect(source: &SensorSource, quit: &AtomicBool) -> io::Result<Self> {
        match source {
            SensorSource::Records(address) => {
                SensorReader::connect(address.clone(), quit).map(Self::Records)
            }
            SensorSource::Labcomm { address, name } => {
                LabcommSensor::connect(address, name, quit).map(Self::Labcomm)
            }
        }
    }

    /// Takes what has arrived, as far as a visit reads, and returns the latest sample. A LabComm
    /// sample has no tick: it gets `tick`, that of the last State, when it comes.
    ///
    /// # Errors
    /// [`io::ErrorKind::InvalidData`]: the stream is not understood. Others: the sensor is gone.
    pub fn latest(&mut self, tick: u64) -> io::Result<Option<Sample>> {
        match self {
            Self::Records(reader) => reader.latest(),
            Self::Labcomm(sensor) => sensor.latest(tick),
        }
    }

    /// Returns the reason for which no new sample has come.
    #[must_use]
    pub fn silence(&self) -> String {
        match self {
            Self::Records(_) => SILENCE.to_owned(),
            Self::Labcomm(sensor) => sensor.silence(),
        }
    }
}
