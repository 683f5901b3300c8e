//! The properties on stable Rust, and the runner of the proofs.
#![allow(
    clippy::arithmetic_side_effects,
    clippy::indexing_slicing,
    clippy::unwrap_used,
    reason = "tests fail by panicking; clippy knows test functions, but not their helpers"
)]

mod any;
mod capi;
mod client_monitor;
mod endpoint;
mod floats;
mod keys;
mod known_solution;
mod labcomm;
mod pacer;
mod position_loop;
#[cfg(feature = "runner")]
mod runner;
mod scenario;
mod state_machine;
mod wire;
