//! Properties of the core, each a plain function that panics when it does not hold, with three thin drivers:
//! Kani harnesses (`harness`, under `cfg(kani)`), property tests on stable Rust (`tests/`), and fuzz targets (`../fuzz`).
//!
//! `cargo run -p gantry-tau-proofs -- prove` runs the harnesses of `manifest.toml`. By hand, in this folder, with or without a mutant:
//!
//! ```sh
//! cargo kani --lib --no-default-features -Z stubbing --harness channel_ramp_is_exact
//! RUSTFLAGS='--cfg=mutant="ramp_past_zero"' cargo kani --lib --no-default-features -Z stubbing --harness channel_ramp_is_exact
//! ```
//!
//! The theorems T1 to T15 are listed in the repository's README, and told in this folder's.
#![forbid(unsafe_code)]
#![allow(
    clippy::arithmetic_side_effects,
    clippy::panic,
    clippy::indexing_slicing,
    reason = "a property that overflows, or finds what it looks for, must panic"
)]

#[cfg(kani)]
extern crate kani;

pub mod axis;
pub mod blackbox;
pub mod channel;
pub mod client;
pub mod compensation;
pub mod crossing;
pub mod endpoint;
pub mod fsm;
#[cfg(kani)]
mod harness;
pub mod ingress;
pub mod kinematics;
pub mod machine;
#[cfg(not(kani))]
pub mod made;
pub mod monitor;
pub mod motors;
#[cfg(not(kani))]
pub mod oracle;
#[cfg(not(kani))]
pub mod play;
pub mod session;
pub mod six_link;
pub mod wire;
