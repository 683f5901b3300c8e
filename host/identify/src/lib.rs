//! Identification of a machine: geometry from measured poses, springs from forces and gauges, and
//! how well both predict.
//!
//! | module | contents |
//! |---|---|
//! | [`fit`] | least squares, goodness of fit, intervals |
//! | [`measurements`] | tables of poses and of campaigns |
//! | [`plan`] | plans of campaigns, and what they will show |
//! | [`experiment`] | a campaign on a machine, or on the simulated one |
//! | [`springs`] | compliances of links, axes and wrist |
//! | [`geometry`] | kinematic parameters |
//! | [`tool`] | mass and centre of the tool |
//! | [`verify`] | predictions against measurements at poses of their own |
//!
//! A calibration from poses in memory:
//!
#![doc = concat!("```\n", include_str!("../examples/calibrate.rs"), "```")]
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

pub mod experiment;
pub mod fit;
pub mod geometry;
pub mod measurements;
pub mod plan;
pub mod springs;
pub mod tool;
pub mod verify;
