//! Tests that cross the crates, in one binary: the server over sockets, recorded vectors, seeds of the fuzz targets, the documents.

mod bad_sensor;
mod black_box;
mod client_over_datagrams;
mod datagrams;
mod embedding;
mod fuzz_seeds;
mod hostile_traffic;
mod kill;
mod no_allocation;
mod oracle_vectors;
mod panic_free;
mod six_axes;
mod soak;
mod solve_vectors;
mod wire_page;
