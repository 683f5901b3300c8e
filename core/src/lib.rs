//! The controller core of a Gantry-Tau parallel robot, after Holmstrand & Silverbåge, *Stiffness
//! Compensation and External Control of Gantry-Tau Robots* (Lund University, 2013), cited as `[T]`.
//!
//! No standard library, no allocation, no `unsafe`, no panic, no clock, no I/O: pure functions and
//! one step function.
//!
//! A whole server without clock, sockets and drives; those are the caller's:
//!
//! ```
//! use gantry_tau_core::{
//!     AxisConfig, Config, Endpoint, EpochRange, LimitValues, Limits, Parameters, PositionNm, Reading, Session, Start,
//!     TickInput, Transport, Travel, Write,
//! };
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // Offsets of at most 2 mm, 5 µm per tick, and 0.1 µm per tick on the way back to zero; all in nm.
//! let limits = Limits::new(LimitValues { max: 2_000_000, step: 5_000, accel: 10_000, ramp: 100 })?;
//! let axis = AxisConfig::position_only(limits, Travel::around_zero(1_000_000_000), 2_000_000);
//! let config = Config::new(Parameters::thesis([axis; 3]))?;
//! let nominal = [PositionNm(0); 3]; // as interpolated along the path
//! let session = Session::new(config, &Start::at_rest(nominal))?; // read back from the drives
//! let mut server = Endpoint::new(session, EpochRange::VOLATILE);
//! let client = server.open(Transport::Stream)?;
//! for _millisecond in 0..3 {
//!     server.feed(client, b""); // what the client's socket had
//!     let write = server.tick(&TickInput {
//!         elapsed_cycles: 1,
//!         reading: Some(Reading::unmeasured(nominal)),
//!         sensor: None,
//!         stop: false,
//!         quit: false,
//!         rearm: false,
//!     });
//!     match write {
//!         Write::Due(write) => {
//!             // Write them to the drives, before anything else, and say what became of them.
//!             assert_eq!(write.references()[0].position, PositionNm(0));
//!             write.accepted();
//!         }
//!         Write::Withheld(drives) => drives.unknown(), // or what was read back
//!     }
//!     while let Some((_to, _frame)) = server.poll_transmit() { /* send */ }
//!     while let Some(_connection) = server.poll_close() { /* close */ }
//! }
//! # Ok(())
//! # }
//! ```
//!
//! Three modules: [`units`] below, and two wings that do not know each other.
//!
//! | module | contents |
//! |---|---|
//! | [`units`] | integer newtypes of the reference path, SI newtypes, and the total crossing between them |
//! | [`control`] | integers only: channel, session, wire format, endpoint, client, monitor. What can reach a drive |
//! | [`model`] | floats (feature `model`, default): kinematics, statics, stiffness, force sensor, compensation |
#![no_std]
#![forbid(unsafe_code)]
#![cfg_attr(
    not(feature = "verification"),
    allow(
        unreachable_pub,
        dead_code,
        reason = "internals that only the module `verification` makes public"
    )
)]
#![cfg_attr(
    test,
    allow(
        clippy::arithmetic_side_effects,
        clippy::unreachable,
        reason = "a test that overflows or arrives where it should not must panic"
    )
)]

// A `no_std` crate must import Kani's library explicitly. Only `impl kani::Arbitrary` uses it here.
#[cfg(kani)]
extern crate kani;
#[cfg(test)]
extern crate std;

pub mod control;
#[cfg(feature = "model")]
pub mod model;
#[cfg(feature = "serde")]
mod serde_array;
pub mod units;
#[cfg(feature = "verification")]
pub mod verification;
mod zip;

pub use control::axis::{Actual, InForce, Offsets, Reference};
pub use control::channel::{LimitValues, Limits};
pub use control::client::Client;
pub use control::endpoint::{Endpoint, MotorMap, PendingReadBack, PendingWrite, Transport, Write};
pub use control::message::{AxisLimits, AxisState, Cause, Mode, Phase, Refusal, State};
pub use control::monitor::Monitor;
pub use control::session::config::{AxisConfig, Config, Parameters, Travel};
pub use control::session::{BlackBox, Connection, LastWrite, Reading, Session, Start, TickInput};
/// The bounded vectors of the public interface.
pub use heapless;
pub use units::{Epoch, EpochRange, OffsetNm, PositionNm, Tick};
