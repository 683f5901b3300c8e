//! The server of a Gantry-Tau controller: one cycle per millisecond around the checked core, for
//! any machine.
//!
//! | module | contents |
//! |---|---|
//! | [`plant`] | the machine as the cycle sees it: implement [`Plant`](plant::Plant) for a machine of your own |
//! | [`server`] | cycle, sockets, stop and re-arm |
//! | [`realtime`] | timer, priority, locked memory |
//! | [`state`] | epochs and the stop latch, which outlive a server |
//! | [`key_file`] | files of shared keys |
//! | [`record`] | what happened in a tick, and to sessions |
//! | [`black_box`] | the last ticks before an end, out of the cycle |
//! | [`publication`] | samples for programs that speak LabComm |
//! | [`links`] | force samples and lengths over TCP |
//!
//! A server for a machine of one's own:
//!
#![doc = concat!("```no_run\n", include_str!("../examples/own_machine.rs"), "```")]
//!
//! The same over UDP, and what a peer sends:
//!
#![doc = concat!("```no_run\n", include_str!("../examples/udp_server.rs"), "```")]
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

pub mod black_box;
pub mod key_file;
pub mod links;
pub mod plant;
pub mod publication;
pub mod realtime;
pub mod record;
pub mod server;
pub mod state;

pub use gantry_tau_core;
