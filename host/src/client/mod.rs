//! The compensating client `[T 5.1.2]`: measures the force on the tool, computes how far the springs give way, sends offsets.

mod compensate;
mod connection;
mod run;

use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::{Cause, Refusal};

use crate::record::Recorded;
use crate::robot_file::RobotFile;

pub use compensate::{Compensation, CompensationError};
pub use connection::Link;
pub use run::run;

/// What a client is told.
#[derive(Clone, Debug)]
pub struct ClientOptions<K, const N: usize> {
    /// The server.
    pub server: SocketAddr,
    /// TCP or UDP.
    pub transport: Transport,
    /// Where force samples come from.
    pub sensor: SocketAddr,
    /// The machine.
    pub robot: RobotFile<K, N>,
    /// Where to record, if at all.
    pub record: Option<PathBuf>,
    /// Go to Obtain by itself once the sensor is tared.
    pub obtain: bool,
}

/// Switches that other threads throw, and what the client last saw.
#[derive(Debug, Default)]
pub struct ClientControls {
    /// Leave with Goodbye.
    pub quit: AtomicBool,
    /// Ask for Obtain (once the sensor is tared); otherwise for Submit.
    pub obtain: AtomicBool,
    /// The sensor is tared.
    pub tared: AtomicBool,
    /// Commands sent.
    pub commands: AtomicU64,
}

impl ClientControls {
    fn wants_to_quit(&self) -> bool {
        self.quit.load(Ordering::Relaxed)
    }
}

/// How a client's session went.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ClientReport {
    /// States received.
    pub states: u64,
    /// Cycles whose correction could not be computed; the last one was sent again.
    pub held: u64,
    /// The recording.
    pub recorded: Option<Recorded>,
}

/// Why a client's session ended otherwise than by its own Goodbye.
#[derive(Debug)]
pub enum ClientError {
    /// Nobody answers at the address.
    Unreachable {
        /// What was tried.
        what: &'static str,
        /// Its address.
        address: SocketAddr,
        /// What the system said.
        error: io::Error,
    },
    /// The server refused the session.
    Refused(Refusal),
    /// The server's cycle, machine or protocol is not the client's.
    Incompatible(String),
    /// The server ended the session.
    Ended(Cause),
    /// The server is silent, or its connection is gone.
    Vanished(String),
    /// The force sensor is silent, or its connection is gone.
    SensorSilent(String),
    /// The machine's model or the recording cannot be used.
    Setup(String),
}

impl ClientError {
    /// The exit code of the command line.
    #[must_use]
    pub const fn exit_code(&self) -> u8 {
        match self {
            Self::Setup(_) => 1,
            Self::Unreachable { .. } => 3,
            Self::Refused(_) => 4,
            Self::Incompatible(_) => 5,
            Self::Ended(_) => 6,
            Self::Vanished(_) => 7,
            Self::SensorSilent(_) => 8,
        }
    }
}

impl fmt::Display for ClientError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unreachable {
                what,
                address,
                error,
            } => write!(f, "the {what} at {address} cannot be reached: {error}"),
            Self::Refused(refusal) => write!(f, "refused: {}", refusal_text(*refusal)),
            Self::Incompatible(reason) => write!(f, "incompatible server: {reason}"),
            Self::Ended(cause) => write!(f, "the server ended the session: {}", cause_text(*cause)),
            Self::Vanished(reason) => write!(f, "the server vanished: {reason}"),
            Self::SensorSilent(reason) => write!(f, "no force samples: {reason}"),
            Self::Setup(reason) => f.write_str(reason),
        }
    }
}

impl std::error::Error for ClientError {}

/// A refusal in a sentence.
#[must_use]
pub fn refusal_text(refusal: Refusal) -> String {
    match refusal {
        Refusal::Busy => "another client owns the session".to_owned(),
        Refusal::Ramping { ticks_left } => {
            format!(
                "offsets are still on their way to zero, {ticks_left} ticks left; try again then"
            )
        }
        Refusal::Faulted { ticks_left } => format!(
            "the server is stopped ({ticks_left} ticks of ramp left); somebody at the machine must re-arm it"
        ),
        Refusal::Version { supported } => {
            format!("the server speaks version {supported} of the protocol")
        }
        Refusal::Axes { expected } => format!("the server has {expected} axes"),
        Refusal::Capability { needed } => {
            format!("the server needs capabilities {:#06x}", needed.0)
        }
        Refusal::Unavailable => "no room for another connection, or no epoch to give".to_owned(),
    }
}

/// A cause in a sentence.
#[must_use]
pub const fn cause_text(cause: Cause) -> &'static str {
    match cause {
        Cause::None => "nothing has happened",
        Cause::ClientLate => "two deadlines in a row passed without a command",
        Cause::NetworkLate => "two deadlines in a row passed; commands came, but late",
        Cause::ServerLate => "the server overran its own cycle",
        Cause::Malformed => "a broken frame or checksum on the stream",
        Cause::Closed => "the connection was closed, or could not take a State",
        Cause::Goodbye => "the client said goodbye",
        Cause::Budget => "too many misses within the window",
        Cause::Stop => "stopped",
        Cause::Nominal => "the nominal reference stepped too far",
        Cause::Flood => "too many frames in one tick",
        Cause::HandshakeTimeout => "no command followed the welcome in time",
        Cause::Restart => "the server found offsets in force at its start",
    }
}
