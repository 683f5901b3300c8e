//! A simulated Gantry-Tau machine: the first implementation of [`gantry_tau_server::plant::Plant`].
//!
//! It is deliberately *not* built from the compensator's model. The compensator linearises at the
//! nominal pose ([`gantry_tau_core::model::l2::Elastic`]); here springs, joints and motors find
//! their own nonlinear equilibrium ([`gantry_tau_machine::elastic`]), their true compliances differ
//! from the assumed ones, and a joint has backlash. The two share the description of the machine
//! ([`gantry_tau_core::model::robot`]) and the units.
//!
//! | module | contents |
//! |---|---|
//! | [`springs`] | the true compliances of one machine |
//! | [`drive`] | cascade of an axis `[T 4.1.7]` |
//! | [`load_generator`] | the load on the tool, set from another thread `[T 4.2.9]` |
//! | [`load_pattern`] | a tap, a milling cutter |
//! | [`load_profile`] | loads during Obtain |
//! | [`workpiece`] | an elastic workpiece that the tool presses on |
//! | [`force_sensor`] | six-axis force sensor `[T 4.2.5]` |
//! | [`parameters`] | parameters of a simulation, and their errors |
//! | [`remote`] | a machine in another process: any simulator |
//! | [`machine`] | all of it behind [`gantry_tau_server::plant::Plant`], with length gauges at the tool `[T 4.2.6]` |
//!
//! Everything is deterministic: equal parameters and equal calls give bit-equal readings.
//!
//! ```
//! use gantry_tau_machine::robot_file::RobotFile;
//! use gantry_tau_server::plant::{Plant, interpolator::Motion};
//! use gantry_tau_sim::load_generator::{Load, load_generator};
//! use gantry_tau_sim::machine::SimulatedMachine;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let robot = RobotFile::builtin_l2()?;
//! let (mut hand, tool) = load_generator();
//! let mut machine = SimulatedMachine::<3, 3>::from_robot(&robot, tool, Motion::Hold)?;
//! let pull = [0.0, 0.0, -300.0];
//! hand.set(&Load { force_n: pull, ..Load::default() })?;
//! for _ in 0..1_000 {
//!     machine.read(1)?;
//! }
//! let shown = machine.read(1)?.tool.map(|tool| tool.displacement_m[2]);
//! assert!(shown.is_some_and(|z_m| (-1e-3..-1e-6).contains(&z_m)), "{shown:?}");
//! # Ok(())
//! # }
//! ```
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
    clippy::as_conversions,
    reason = "off the reference path; `as` saturates where floats become integers"
)]
#![expect(
    clippy::arithmetic_side_effects,
    clippy::indexing_slicing,
    reason = "simulation, off the reference path: floats cannot panic, arrays have fixed lengths, release keeps overflow checks"
)]
#![cfg_attr(
    test,
    allow(
        clippy::float_cmp,
        clippy::needless_range_loop,
        reason = "the tests compare floats that must be bit-equal, and walk several arrays by one axis number"
    )
)]

mod accelerometer;
pub mod drive;
pub mod force_sensor;
pub mod load_generator;
pub mod load_pattern;
pub mod load_profile;
pub mod machine;
pub mod moving_platform;
pub mod parameters;
pub mod remote;
pub mod springs;
pub mod workpiece;

#[cfg(test)]
pub(crate) mod fixture;
