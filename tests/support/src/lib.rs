//! Fixtures of the tests of several crates.
//!
//! | module | contents |
//! |---|---|
//! | [`vectors`] | machines and cases of `tests/data/tau_vectors.json`, computed by an independent implementation |
//! | [`black_boxes`] | black boxes of seeded sessions |
//! | [`campaigns`] | the plan of a campaign of forces and gauges |
//! | [`logged`] | the log of a test |
//! | [`seeds`] | numbers of seeds: a sample, or all |
//!
//! With the feature `sessions`:
//!
//! | module | contents |
//! |---|---|
//! | `labcomm_port` | a double of a server's LabComm port |
//! | `recordings` | samples of recordings, compared with the CSV recording of the same run |
//! | `sessions` | a whole session in lock-step, whose rows go to recordings |
#![forbid(unsafe_code)]
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::arithmetic_side_effects,
    clippy::indexing_slicing,
    clippy::missing_panics_doc,
    reason = "helpers of tests fail by panicking"
)]

pub mod black_boxes;
pub mod campaigns;
#[cfg(feature = "sessions")]
pub mod labcomm_port;
pub mod logged;
#[cfg(feature = "sessions")]
pub mod recordings;
pub mod seeds;
#[cfg(feature = "sessions")]
pub mod sessions;
pub mod vectors;
