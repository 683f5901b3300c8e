//! A machine with mass: its equations of motion, and its modes.
//!
//! The coordinates are those of a machine whose links and axes are springs: the platform's pose and
//! the axes behind their springs. Their rates are `nu = (v, omega, dq)`: velocity of the tool
//! centre point, angular velocity of the platform, world axes, and the rates of the axes, q-units.
//! The drives `theta` are in front of the springs of the axes.
//!
//! ```text
//! M(x) dnu/dt + h(x, nu) = Q_springs + Q_weight + Q_load
//! ```
//!
//! | module | contents |
//! |---|---|
//! | [`coordinates`] | vectors and symmetric matrices over platform and axes |
//! | [`equations`] | mass matrix, forces, accelerations, load on the sensor |
//! | [`modes`] | natural frequencies, modal damping |
//!
//! Its [`masses`](crate::masses): the platform, the tool, the carts and the plates are rigid; a link is a uniform thin rod, whose
//! velocity is linear between its ends, so that its mass matrix is exact in the velocities of both
//! ends. Bending of the rods and the frame are left out, and so is what moves in a wrist.
#![expect(
    clippy::indexing_slicing,
    reason = "off the reference path: floats cannot panic, arrays have fixed lengths"
)]

pub mod coordinates;
pub mod equations;
pub mod modes;

pub use coordinates::{CoordinateMatrix, Coordinates};
pub use equations::{Acceleration, MachineState, MassiveMachine};
pub use modes::Modes;

#[cfg(test)]
mod tests;
