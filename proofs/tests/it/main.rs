//! The properties on stable Rust, and the runner of the proofs.

mod any;
mod channel;
mod endpoint;
mod floats;
mod known_solution;
#[cfg(feature = "runner")]
mod runner;
mod scenario;
mod state_machine;
mod wire;
