//! Tests that cross the crates, in one binary: the server over sockets, recorded vectors, seeds of
//! the fuzz targets, the documents.
#![allow(
    clippy::arithmetic_side_effects,
    clippy::indexing_slicing,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests fail by panicking; clippy knows test functions, but not their helpers"
)]

mod agitation;
mod bad_accelerometer;
mod bad_sensor;
mod black_box;
mod calibration;
mod campaigns;
mod client_cases;
mod client_deadlines;
mod client_over_datagrams;
mod datagrams;
mod drive_theorem;
mod embedding;
#[cfg(target_os = "linux")]
mod ethercat;
mod feed_forward;
mod fuzz_seeds;
mod hostile_traffic;
mod keys;
mod kill;
mod labcomm;
mod labcomm_page;
mod no_allocation;
mod oracle_vectors;
mod oscillation;
mod pace;
mod panic_free;
mod places;
mod planner;
mod quit;
mod settling;
mod simulators;
mod six_axes;
mod soak;
mod solve_vectors;
mod stable_as_computed;
mod stops_and_ends;
mod turned_platform;
mod velocity_drives;
mod wire_page;
