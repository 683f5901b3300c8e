//! Files, lines, addresses and privileges: what every program of gantry-tau does with the operating
//! system.
//!
//! | module | contents |
//! |---|---|
//! | [`output`] | files that commands write: one policy for all |
//! | [`lines`] | texts and lines that are read, of bounded length |
//! | [`dial`] | connections to a peer, within a deadline |
//! | [`privileges`] | capabilities that a server gives up |
//! | [`last_wait`] | bounded wait for a thread that writes |
//!
//! ```
//! use gantry_tau_system::output::{Name, NameError};
//!
//! let name: Name = "pose 7, tilted".parse()?;
//! assert_eq!(name.as_str(), "pose 7, tilted");
//! assert_eq!("=A1".parse::<Name>(), Err(NameError::Formula('=')));
//! # Ok::<(), NameError>(())
//! ```
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

pub mod dial;
pub mod last_wait;
pub mod lines;
pub mod output;
pub mod privileges;
