//! Recordings and black boxes of a server, as files.
//!
//! | module | contents |
//! |---|---|
//! | [`recording`] | recordings of every tick: CSV, LabComm, MCAP |
//! | [`black_box`] | black boxes as JSON lines |
//! | [`labcomm`] | LabComm streams from and to JSON |
//! | [`identity`] | the machine of a stream |
//!
//! A recording of a server:
//!
#![doc = concat!("```no_run\n", include_str!("../examples/recording.rs"), "```")]
//!
//! A black box, replayed:
//!
#![doc = concat!("```no_run\n", include_str!("../examples/replay.rs"), "```")]
#![forbid(unsafe_code)]
#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, reason = "tests write files of their own")
)]
#![deny(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "they panic when the stream fails"
)]
#![allow(
    clippy::arithmetic_side_effects,
    clippy::as_conversions,
    reason = "off the reference path; release builds keep their overflow checks, and `as` saturates where floats become integers"
)]

pub mod black_box;
pub mod identity;
pub mod labcomm;
pub mod recording;
