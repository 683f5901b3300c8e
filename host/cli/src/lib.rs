//! The program `gantry-tau`: its command line, and what no other crate of the host has.
//!
//! Everything that can reach a drive goes through [`gantry_tau_core`]. A machine, server or client
//! of one's own is built on the crates below this one: `gantry-tau-machine`, `gantry-tau-server`,
//! `gantry-tau-client`.
//!
//! | module | contents |
//! |---|---|
//! | [`compensated_machine`] | a simulated machine and its client without a server |
//! | [`demo`] | server, simulated machine and client in one process |
//! | `ethercat` | drives over EtherCAT as the machine of a server (feature `ethercat`, Linux) |
//! | [`export`] | a robot file as a model of MuJoCo, and for viewers |
//! | [`faults`] | faults of a network: lost, damaged, late frames |
//! | [`header`] | a robot file as a C header |
//! | [`monitor`] | what a server publishes, for people |
//! | [`replay`] | what a black box shows |
//! | [`solve`] | kinematics, statics and compensation, JSON line by JSON line |
#![forbid(unsafe_code)]
#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, reason = "tests write files of their own")
)]
#![deny(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "they panic when the stream fails: use `terminal`"
)]
#![allow(
    clippy::arithmetic_side_effects,
    clippy::as_conversions,
    reason = "off the reference path; release builds keep their overflow checks, and `as` saturates where floats become integers"
)]

mod cli;
pub mod compensated_machine;
pub mod demo;
#[cfg(all(feature = "ethercat", target_os = "linux"))]
pub mod ethercat;
pub mod export;
pub mod faults;
pub mod fmu;
pub mod header;
pub mod monitor;
pub mod replay;
mod signals;
pub mod solve;
mod terminal;
mod xml;

pub use cli::main;
