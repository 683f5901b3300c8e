//! Properties of the core ([`properties`]), each a plain function that panics when it does not hold
//! (the text of a property does not say so again), with three thin drivers: Kani harnesses
//! ([`harness`]), property tests on stable Rust (`tests/`), and fuzz targets (`../fuzz`).
//!
//! `cargo run -p gantry-tau-proofs -- prove` runs the harnesses of `manifest.toml` and the mutants
//! of `mutants.toml`. One harness by hand, in this folder:
//!
//! ```sh
//! cargo kani --lib --no-default-features -Z stubbing --harness channel_ramp_is_exact
//! ```
//!
//! (and `--features capi` for one of the C interface, `--features keys` for one of the keys,
//! `--features labcomm` for one of LabComm, `--features pacer` for one of the pacer, `--features
//! position_loop` for one of the position loop).
//!
//! The theorems, T1 to T33, are listed in this folder's RESULTS.md and explained in its
//! theorems.md.
#![forbid(unsafe_code)]
#![allow(
    clippy::arithmetic_side_effects,
    clippy::panic,
    clippy::indexing_slicing,
    reason = "a property that overflows, or finds what it looks for, must panic"
)]
#![allow(
    clippy::needless_range_loop,
    reason = "a model checker counts to a constant at once, and has to search for the end of an iterator"
)]

#[cfg(kani)]
extern crate kani;

pub mod harness;
#[cfg(not(kani))]
pub mod known_solution;
pub mod properties;
#[cfg(not(kani))]
pub mod reference_model;
pub mod robots;
#[cfg(not(kani))]
pub mod scenario;
pub mod stand_in;
