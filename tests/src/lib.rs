//! Helpers shared by the tests of this folder: a server stepped by hand over a real loopback
//! socket; and what fuzz targets do.
//!
//! | module | what it holds |
//! |---|---|
//! | [`fake_plant`] | a machine that records every reference it is written |
//! | [`server_fixture`] | the server's cycle around it, with the bounds of `docs/design.md` 6 asserted in every tick |
//! | [`client`] | a client that speaks frames, and anything else |
//! | [`client_session`] | the real client and a real server in lock-step |
//! | [`client_cases`] | what a client makes of the frames that answer its Hello, for both clients |
//! | [`session_fixture`] | both together: one session, tick by tick |
//! | [`pacing`] | a server, and the port for programs that are slower |
//! | [`simulator`] | the other side of a machine in another process |
//! | [`short_demo`] | the demo with two force steps, on any machine |
//! | [`fuzzed`] | what each target of `../fuzz` does with its bytes; the same bytes are replayed by `cargo test` |
//! | [`labcomm`] | streams decoded twice: by the crate, and by a decoder written from the format's page alone |
//! | [`soak`] | clients that come and go over links that do harm, for a long time |
#![forbid(unsafe_code)]
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::arithmetic_side_effects,
    clippy::missing_panics_doc,
    reason = "helpers of tests fail by panicking"
)]

pub mod client;
pub mod client_cases;
pub mod client_session;
pub mod fake_plant;
pub mod fuzzed;
pub mod labcomm;
pub mod liar;
pub mod pacing;
pub mod server_fixture;
pub mod session_fixture;
pub mod short_demo;
pub mod simulator;
pub mod soak;

use std::time::{Duration, Instant};

/// Longest wait for anything before a test fails. No test depends on speed.
pub const DEADLINE: Duration = Duration::from_secs(20);

/// Tries until `done`; fails after [`DEADLINE`].
pub fn wait_for(what: &str, mut done: impl FnMut() -> bool) {
    let since = Instant::now();
    while !done() {
        assert!(since.elapsed() < DEADLINE, "waited too long for {what}");
        std::thread::sleep(Duration::from_micros(20));
    }
}

/// The examples of `docs/verification.md`, each of which must not compile.
#[cfg(doctest)]
#[doc = include_str!("../../docs/verification.md")]
struct Verification;
