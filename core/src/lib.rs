//! The controller core of a Gantry-Tau parallel robot, after Holmstrand & Silverbåge,
//! *Stiffness Compensation and External Control of Gantry-Tau Robots* (Lund University, 2013), cited as `[T]`.
//!
//! No standard library, no allocation, no `unsafe`, no panic, no clock, no I/O: pure functions and one step function.
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
    test,
    allow(
        clippy::arithmetic_side_effects,
        clippy::unreachable,
        reason = "a test that overflows or arrives where it should not must panic"
    )
)]

// Kani's library is in reach of a `no_std` crate only by name. Nothing but `impl kani::Arbitrary` uses it here.
#[cfg(kani)]
extern crate kani;
#[cfg(test)]
extern crate std;

pub mod control;
#[cfg(feature = "model")]
pub mod model;
pub mod units;
#[cfg(feature = "verification")]
pub mod verification;
mod zip;
