//! The host of a Gantry-Tau controller: transport, cycle, simulated machine, client, demo, scripting.
//!
//! Everything that can reach a drive goes through [`gantry_tau_core`]; this crate brings clock, sockets and files.
#![forbid(unsafe_code)]

pub mod plant;
pub mod robot_file;
pub mod sim;
pub mod solve;
