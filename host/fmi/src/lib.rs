//! Functional mock-up units (FMI 2.0, co-simulation) of a Gantry-Tau robot, without the interface in C:
//! that is the package in `library/`, which has all of the unsafe code.
//!
//! | module | contents |
//! |---|---|
//! | [`instance`] | one unit in use: order of the calls, values, steps, saved states |
//! | [`kind`] | server, machine, compensator |
//! | [`variable`] | variables: names, units, ranges, start values |
//! | [`resources`] | folder of a unit's files |
//!
//! A unit computes one cycle of the server per millisecond of the simulated time. The server is core's
//! [`Endpoint`](gantry_tau_core::Endpoint), its client the one of `gantry-tau client`, the machine the
//! simulated one of `gantry-tau serve`: coupled cycle by cycle they give the numbers of a server in
//! lock-step, to the bit.
//!
//! ```
//! use gantry_tau_fmi::instance::{Causality, Instance};
//! use gantry_tau_fmi::kind::Kind;
//! use gantry_tau_machine::robot_file::AnyRobotFile;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let mut machine = Instance::new(Kind::Machine, AnyRobotFile::named("l2")?)?;
//! machine.setup_experiment(0.0, None)?;
//! machine.enter_initialization()?;
//! machine.exit_initialization()?;
//! let force_x = machine.reference_of("load_force[1]").ok_or("no such variable")?;
//! machine.set(force_x, 100.0)?;
//! machine.step(0.0, 0.5)?;
//! let displaced = machine.reference_of("displacement[1]").ok_or("no such variable")?;
//! assert!((5e-5..1e-4).contains(&machine.get(displaced)?));
//! # let outputs = machine.variables().iter().filter(|v| v.causality == Causality::Output);
//! # assert!(outputs.count() > 20);
//! # Ok(())
//! # }
//! ```
#![forbid(unsafe_code)]
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

pub mod instance;
pub mod kind;
mod log;
pub mod resources;
mod units;
pub mod variable;
