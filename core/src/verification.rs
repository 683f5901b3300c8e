//! Internals for proofs, fuzzing and tests. Not part of the public interface: anything here may
//! change in any version.

pub mod control;
#[cfg(feature = "model")]
pub mod model;
#[cfg(feature = "position-loop")]
pub mod position_loop;
