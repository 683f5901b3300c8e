//! Properties of the core, each a plain function that panics when it does not hold (the text of a property does not say so again), with three
//! thin drivers: Kani harnesses (`harness`), property tests on stable Rust (`tests/`), and fuzz targets (`../fuzz`).
//!
//! `cargo run -p gantry-tau-proofs -- prove` runs the harnesses of `manifest.toml` and the mutants of `mutants.toml`.
//! One harness by hand, in this folder:
//!
//! ```sh
//! cargo kani --lib --no-default-features -Z stubbing --harness channel_ramp_is_exact
//! ```
//!
//! (and `--features capi` for one of the C interface, `--features labcomm` for one of LabComm, `--features position_loop` for one of the
//! position loop).
//!
//! The theorems, T1 to T26, are listed and explained in this folder's README.
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

pub mod axis;
pub mod blackbox;
#[cfg(feature = "capi")]
pub mod capi;
pub mod channel;
pub mod client;
pub mod compensation;
pub mod crossing;
pub mod drive;
pub mod endpoint;
pub mod fsm;
pub mod harness;
pub mod ingress;
pub mod kinematics;
#[cfg(not(kani))]
pub mod known_solution;
#[cfg(any(feature = "labcomm", feature = "labcomm_decoder"))]
pub mod labcomm;
pub mod monitor;
pub mod motors;
#[cfg(feature = "position_loop")]
pub mod position_loop;
#[cfg(not(kani))]
pub mod reference_model;
pub mod robots;
#[cfg(not(kani))]
pub mod scenario;
pub mod session;
pub mod six_link;
pub mod stand_in;
pub mod wire;
