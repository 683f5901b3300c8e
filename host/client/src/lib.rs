//! The compensating client `[T 5.1.2]`: measures the force on the tool, computes the deflection of
//! the springs, sends offsets.
//!
//! | item | contents |
//! |---|---|
//! | [`run`] | the compensating client: connects, tares, compensates, leaves |
//! | [`Connection`] | a session over TCP or UDP, for clients that compute offsets of their own |
//! | [`Controller`] | from a State to the mode and the targets of its answer, without sockets |
//! | [`Compensation`] | from a force and the positions of the axes to offsets |
//! | [`force_sensor`] | sources of the measured force |
//! | [`pace`] | a port for programs that are slower than the server |
//! | [`operator`] | commands that are typed while the client runs |
//!
//! A client of one's own:
//!
#![doc = concat!("```\n", include_str!("../examples/own_client.rs"), "```")]
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

mod accelerometer;
mod compensate;
mod connection;
mod controller;
mod feed_forward;
pub mod force_sensor;
mod notches;
pub mod operator;
mod oscillation;
pub mod pace;
mod run;
mod stability;

use std::fmt;
use std::io;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64};

use gantry_tau_core::control::client as protocol;
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::keys::Key;
use gantry_tau_core::control::message::{Cause, Notice, Refusal, State, Welcome};
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_record::recording::{RecordTo, Recorded};
use gantry_tau_system::dial::Addresses;

use crate::force_sensor::{Sample, SensorSource};
pub use accelerometer::AccelerometerError;
pub use compensate::{Compensation, Samples, SetupError};
pub use connection::Connection;
pub use connection::connected_datagrams;
pub use controller::{Controller, Counts};
pub use oscillation::Oscillation;
pub use run::{run, run_observed};
pub use stability::HomeMargin;

/// Options of a client.
#[derive(Clone, Debug)]
pub struct ClientOptions<K, const N: usize> {
    /// Addresses of the server, of which the first that answers is taken.
    pub server: Addresses,
    /// TCP or UDP.
    pub transport: Transport,
    /// Source of the force samples.
    pub sensor: SensorSource,
    /// Addresses of the accelerometer's link, for a machine that has one; without them the client
    /// takes it for one that has none.
    pub accelerometer: Option<Addresses>,
    /// The machine.
    pub robot: RobotFile<K, N>,
    /// Key of the server; `None` for a server without keys.
    pub key: Option<Key>,
    /// File of the recording, if any.
    pub record: Option<RecordTo>,
    /// Ask for Obtain once the sensor is tared.
    pub obtain: bool,
    /// Obtain even with a margin of stability below the required one.
    pub accept_unstable: bool,
}

impl<K: Clone, const N: usize> ClientOptions<K, N> {
    /// Returns the machine with the instruments that there are links for.
    fn usable_robot(&self) -> RobotFile<K, N> {
        let mut robot = self.robot.clone();
        if self.accelerometer.is_none() {
            robot.sensor.accelerometer = None;
        }
        robot
    }
}

/// Switches for other threads, and the progress of the client.
#[derive(Debug, Default)]
pub struct ClientControls {
    /// Leave with Goodbye.
    pub quit: AtomicBool,
    /// Ask for Obtain (once the sensor is tared); otherwise for Submit. The client clears it when it
    /// leaves Obtain because the targets oscillate.
    pub obtain: AtomicBool,
    /// Share of the correction to ask for from the next cycle on, 0 to 1, in place of
    /// `[client] gain`. Only targets change: the server approaches them within its limits.
    pub gain: Mutex<Option<f64>>,
    /// The sensor is tared.
    pub tared: AtomicBool,
    /// Commands sent.
    pub commands: AtomicU64,
}

/// Sees what passes through a client. It runs in the client's thread, after each answer, and has
/// the rest of the cycle.
pub trait Observer<const N: usize> {
    /// The session is granted.
    fn welcomed(&mut self, welcome: &Welcome<N>);

    /// A State was answered; `sample` is the force sensor's, if a new one came with it.
    ///
    /// # Errors
    /// The client leaves with Goodbye and returns the error.
    fn answered(&mut self, state: &State<N>, sample: Option<&Sample>) -> Result<(), ClientError>;
}

/// Sees nothing.
impl<const N: usize> Observer<N> for () {
    fn welcomed(&mut self, _: &Welcome<N>) {}

    fn answered(&mut self, _: &State<N>, _: Option<&Sample>) -> Result<(), ClientError> {
        Ok(())
    }
}

/// Summary of a client's session.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ClientReport {
    /// States received.
    pub states: u64,
    /// Cycles whose correction could not be computed; the last one was sent again.
    pub held: u64,
    /// Cycles whose correction was cut at the limit of an axis.
    pub saturated: u64,
    /// Departures from Obtain because the targets oscillated.
    pub oscillations: u64,
    /// Oscillation of the last of them.
    pub last_oscillation: Option<Oscillation>,
    /// The recording.
    pub recorded: Option<Recorded>,
}

/// Error of a client: every end of its session but its own Goodbye.
#[derive(Debug)]
pub enum ClientError {
    /// No answer at an address.
    Unreachable {
        /// The peer: "server", "force sensor" or "accelerometer".
        what: &'static str,
        /// Its addresses.
        address: Addresses,
        /// Error of the system.
        error: io::Error,
    },
    /// The server refused the session.
    Refused(Refusal),
    /// The server cannot read this client's frames, or has no room for it.
    Noticed(Notice),
    /// The server's cycle, machine or protocol is not the client's.
    Incompatible(String),
    /// The server ended the session.
    Ended(Cause),
    /// The server is silent, or its connection is gone.
    Vanished(String),
    /// The force sensor is silent, or its connection is gone.
    SensorSilent(String),
    /// The connection of the accelerometer is gone.
    AccelerometerSilent(String),
    /// The gauges of a campaign are gone.
    GaugesSilent(String),
    /// The machine's model or the recording cannot be used.
    Setup(String),
    /// The client was asked to leave before a session was granted.
    Quit,
}

impl From<protocol::ClientError> for ClientError {
    fn from(error: protocol::ClientError) -> Self {
        match error {
            protocol::ClientError::GoodbyeUnheard { states } => Self::Vanished(format!(
                "it has not acknowledged the Goodbye within {states} States"
            )),
            protocol::ClientError::Notice(notice) => Self::Noticed(notice),
            error @ protocol::ClientError::Checksum { .. } => Self::Incompatible(format!(
                "{error}: geometry or metres_per_q differ; give both the same robot file (--robot)"
            )),
            error => Self::Incompatible(error.to_string()),
        }
    }
}

impl ClientError {
    /// Returns the error of a peer to which no connection could be made, or the wish to leave that
    /// ended the attempt.
    pub fn unreachable(what: &'static str, address: &Addresses, error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::Interrupted => Self::Quit,
            _ => Self::Unreachable {
                what,
                address: address.clone(),
                error,
            },
        }
    }

    /// Returns the exit code of the command line.
    #[must_use]
    pub const fn exit_code(&self) -> u8 {
        match self {
            Self::Quit => 0,
            Self::Setup(_) => 1,
            Self::Unreachable { .. } => 3,
            Self::Refused(_) | Self::Noticed(_) => 4,
            Self::Incompatible(_) => 5,
            Self::Ended(_) => 6,
            Self::Vanished(_) => 7,
            Self::SensorSilent(_) | Self::AccelerometerSilent(_) => 8,
            Self::GaugesSilent(_) => 9,
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
            } => {
                write!(f, "the {what} at {address} cannot be reached: {error}")
            }
            Self::Refused(refusal @ Refusal::Faulted { .. }) => {
                write!(
                    f,
                    "refused: {refusal} (type `rearm` where `gantry-tau serve` runs)"
                )
            }
            Self::Refused(refusal) => write!(f, "refused: {refusal}"),
            Self::Noticed(notice) if *notice == Notice::suite(1) => {
                f.write_str("refused: the server needs a key (--key)")
            }
            Self::Noticed(notice) if *notice == Notice::suite(0) => f.write_str(
                "refused: the server has no key; without --key this client speaks to it",
            ),
            Self::Noticed(notice) => write!(f, "refused: {notice}"),
            Self::Incompatible(reason) => write!(f, "incompatible server: {reason}"),
            Self::Ended(cause) => write!(f, "the server ended the session: {cause}"),
            Self::Vanished(reason) => write!(f, "the server vanished: {reason}"),
            Self::SensorSilent(reason) => write!(f, "no force samples: {reason}"),
            Self::AccelerometerSilent(reason) => {
                write!(f, "no samples of the accelerometer: {reason}")
            }
            Self::GaugesSilent(reason) => write!(f, "no gauges: {reason}"),
            Self::Setup(reason) => f.write_str(reason),
            Self::Quit => f.write_str("left before a session was granted"),
        }
    }
}

impl std::error::Error for ClientError {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lost_goodbye_is_a_vanished_server_and_a_broken_protocol_an_incompatible_one() {
        let lost = ClientError::from(protocol::ClientError::GoodbyeUnheard { states: 100 });
        assert_eq!(lost.exit_code(), 7);
        assert!(lost.to_string().contains("within 100 States"), "{lost}");
        let (expected_us, received_us) = (1_000, 2_000);
        let broken = ClientError::from(protocol::ClientError::Cycle {
            expected_us,
            received_us,
        });
        assert_eq!(broken.exit_code(), 5);
        assert!(broken.to_string().contains("2000 us"), "{broken}");
    }
}
