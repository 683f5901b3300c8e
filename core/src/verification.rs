//! Items that proofs, fuzzing and the tests of other crates need; not part of the public API, and without any promise of stability.

#[cfg(feature = "model")]
pub mod model;
