#![doc = include_str!("../README.md")]
#![cfg(target_os = "linux")]
#![forbid(unsafe_code)]
#![deny(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "they panic when the stream fails"
)]
#![allow(
    clippy::arithmetic_side_effects,
    clippy::as_conversions,
    reason = "off the reference path; release builds keep their overflow checks"
)]

mod bring_up;
mod cia402;
mod claim;
mod clock;
mod discovery;
mod drives;
#[cfg(feature = "emulation")]
pub mod emulation;
mod fault;
pub mod gauges;
mod instruments;
mod main_device;

mod pump;
mod raw_socket;
pub mod scan;
mod steered_cycle;
pub mod steering;
mod wire;

pub use bring_up::{BringUpError, ClockSettings, DriveConfig, Extras, Initial, Settings};
pub use cia402::{Input, Offset, PowerState, Target};
pub use discovery::{BusError, DevicePlace};
pub use drives::{Condition, Drives};
pub use fault::Fault;
pub use instruments::encoder::{CounterMap, GaugeConfig};
pub use instruments::force::ForceSensorConfig;
pub use instruments::{InstrumentRefusal, NoReading};
pub use raw_socket::{RawSocket, RawSocketError, check_link};
pub use wire::{Wire, WireError};
