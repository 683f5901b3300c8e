//! The controller core of a Gantry-Tau parallel robot, after Holmstrand & Silverbåge,
//! *Stiffness Compensation and External Control of Gantry-Tau Robots* (Lund University, 2013), cited as `[T]`.
//!
//! No standard library, no allocation, no `unsafe`, no panic, no clock, no I/O: pure functions and one step function.
//! The modules are floors; each uses only those above it in this list.
//!
//! | module | what it holds |
//! |---|---|
//! | [`units`] | integer newtypes of the reference path, SI newtypes, and the total crossing between them |
//! | [`axis`] | what one axis is told and what it reports |
//! | [`linalg`] | the maths seam (`sqrt`, `sin`, `cos`) and small linear solves |
//! | [`robot`] | parameters of a machine, validated once |
//! | [`kinematics`] | nominal inverse and forward kinematics, Jacobian `[T 3.1]` |
//! | [`statics`] | line matrix, link forces, cart loads `[T 3.3.2, 3.3.3]` |
//! | [`stiffness`] | from compliances to displacement `[T 3.3.1]` |
//! | [`sensor`] | force sensor: tare, frame, low-pass `[T 4.2.5]` |
//! | [`compensation`] | wrench to bounded cart offsets `[T 5.2.3]` |
//! | [`channel`] | one bounded reference value |
//! | [`message`] | what client and server say to each other, as types |
//! | [`wire`] | messages as frames of bytes |
//! | [`session`] | the server's state machine `[T 5.1.1]` |
//! | [`endpoint`] | session, deframers and motors: bytes in, bytes and drive references out |
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

pub mod axis;
pub mod channel;
pub mod compensation;
pub mod endpoint;
pub mod kinematics;
pub mod linalg;
pub mod message;
pub mod robot;
mod rows;
pub mod sensor;
pub mod session;
pub mod statics;
pub mod stiffness;
pub mod units;
pub mod wire;
