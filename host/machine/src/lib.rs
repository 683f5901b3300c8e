//! A Gantry-Tau machine as a file describes it, and as its springs give way.
//!
//! | module | contents |
//! |---|---|
//! | [`robot_file`] | robot files, read and checked |
//! | [`model`] | the kinds of machine: L2 with three axes, F1 with six |
//! | [`elastic`] | links and axes as springs: pose under load, readings of gauges |
//! | [`masses`], [`dynamics`] | masses, equations of motion, modes |
//! | [`sensor`] | mounting of the force sensor |
//! | [`accelerometer`] | an accelerometer, which takes the tool's inertia out of the measured load |
//! | [`workspace`] | reach, condition number, compliance over a grid |
//! | [`stability`] | stability of the compensation on a machine with mass |
//! | [`drive_cascade`] | gains and masses of the simulated drives |
//! | [`encoder_scale`] | counts of an encoder, and nanometres |
//! | [`figure`], [`scene`] | the machine as lines in space |
//!
//! ```
//! use gantry_tau_core::model::kinematics::Pose;
//! use gantry_tau_machine::model::MachineKind;
//! use gantry_tau_machine::robot_file::RobotFile;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let robot = RobotFile::builtin_l2()?; // `AnyRobotFile::load` reads a file
//! let home = Pose::at(robot.simulation.home_m.into());
//! assert_eq!(robot.model.axes_for(&home)?, robot.home_q()?);
//! # Ok(())
//! # }
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

pub mod accelerometer;
pub mod drive_cascade;
pub mod dynamics;
pub mod elastic;
pub mod encoder_scale;
pub mod figure;
mod halves;
pub mod masses;
pub mod model;
pub mod robot_file;
pub mod scene;
pub mod sensor;
pub mod stability;
pub mod workspace;
