//! Drives on an emulated bus, cycle by cycle: no clock, no socket.
#![cfg(target_os = "linux")]
#![allow(
    clippy::arithmetic_side_effects,
    clippy::as_conversions,
    clippy::indexing_slicing,
    clippy::panic,
    clippy::unwrap_used,
    reason = "tests"
)]

mod bench;
mod beside_drives;
mod clocks;
mod faults;
mod force;
mod gauges;
mod operation;
mod refused;
mod scan;
mod strict;
