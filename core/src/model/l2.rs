//! The L2: three axes, six links, a platform that does not turn `[T 3.1.1]`. Closed forms both
//! ways.
//!
//! Positions `q` are in q-units (metres for a guideway of unit length); the tool centre point is in
//! world axes, metres.
//!
//! | type | contents |
//! |---|---|
//! | [`Geometry`], [`Robot`] | parameters, as given and validated |
//! | [`Kinematics`] | inverse, forward, Jacobian in one orientation |
//! | [`Elastic`] | the machine with its springs: deflection and commands |
//! | [`Compensator`] | one call per cycle, from nominal positions and load to bounded offsets |

mod compensator;
mod elastic;
mod exact;
mod failure;
mod kinematics;
mod link_frame;
mod robot;
#[cfg(test)]
pub(crate) mod tests;

pub use compensator::Compensator;
pub use elastic::{Deflection, Elastic};
pub use exact::exact_command;
pub use kinematics::{Kinematics, OrientationError};
pub use link_frame::{LinkFrame, cart_loads_from_jacobian};
pub use robot::{Configuration, Geometry, Robot};

/// Number of axes: three carts.
pub const AXES: usize = 3;

const _: () = assert!(AXES == super::robot::ARMS, "one axis per arm");
