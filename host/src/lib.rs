//! The host of a Gantry-Tau controller: transport, cycle, simulated machine, client, demo, scripting.
//!
//! Everything that can reach a drive goes through [`gantry_tau_core`]; this crate brings clock, sockets and files.
#![forbid(unsafe_code)]
#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests write files of their own"))]
#![deny(clippy::print_stdout, clippy::print_stderr, reason = "they panic when the stream fails: use `terminal`")]
#![allow(
    clippy::arithmetic_side_effects,
    clippy::as_conversions,
    reason = "off the reference path; release builds keep their overflow checks, and `as` saturates where floats become integers"
)]

pub mod black_box;
pub mod client;
pub mod counts;
pub mod demo;
pub mod dial;
pub mod draw;
pub mod elastic;
#[cfg(all(feature = "ethercat", target_os = "linux"))]
pub mod ethercat;
pub mod experiment;
pub mod faults;
pub mod fit;
pub mod follow;
pub mod force_sensor;
pub mod gauge_link;
pub mod geometry;
pub mod header;
pub mod labcomm;
mod last_wait;
mod lines;
pub mod linuxcnc;
pub mod measurements;
pub mod model;
pub mod monitor;
pub mod output;
mod places;
pub mod plan;
pub mod plant;
pub mod plots;
pub mod privileges;
pub mod publication;
pub mod readers;
pub mod realtime;
pub mod record;
pub mod record_link;
pub mod replay;
pub mod robot_file;
pub mod sensor_link;
pub mod server;
pub mod signals;
pub mod sim;
pub mod solve;
pub mod springs;
pub mod state;
pub mod terminal;
pub mod tool;
pub mod verify;
pub mod workspace;
