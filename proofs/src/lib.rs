//! Properties of the core, each a plain function that panics when it does not hold, with three thin drivers:
//! Kani harnesses (`harness`, under `cfg(kani)`), property tests on stable Rust (`tests/`), and fuzz targets (`../fuzz`).
//!
//! The theorems T1 to T15 are listed in the repository's README. What is here so far: T1, T2, T3 and T5 for a single channel,
//! proved by the harnesses, T8's framing, tested and fuzzed, and the checks around the floats (T13, T14, T15), proved, with the floats tested.
#![forbid(unsafe_code)]
#![allow(
    clippy::arithmetic_side_effects,
    clippy::panic,
    clippy::indexing_slicing,
    reason = "a property that overflows, or finds what it looks for, must panic"
)]

#[cfg(kani)]
extern crate kani;

pub mod channel;
pub mod compensation;
pub mod crossing;
#[cfg(kani)]
mod harness;
pub mod kinematics;
pub mod machine;
pub mod wire;
