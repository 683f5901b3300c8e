//! Campaigns of forces and gauges, measured `[T 4.2.9]`: a plan in, a table of windows out.
//!
//! | module | contents |
//! |---|---|
//! | [`windows`] | settle test and mean: windows from samples |
//! | [`prediction`] | load on the platform from the force sensor, which turns with the platform |
//! | [`table`] | the table, row by row; goes on where it ended |
//! | [`ticks`] | the table of every tick, and windows made of it |
//! | [`simulated`] | the whole campaign on the simulated machine, without sockets |
//! | [`campaign_machine`] | the simulated machine in a campaign: poses, levels |
//! | [`gauges`] | its length gauges, with zeros, errors and drift |
//! | [`tracker`] | poses of a target, as a simulated device sees them, for `calibrate` |
//! | [`live`] | on a machine behind a server, window by window |
#![expect(
    clippy::indexing_slicing,
    reason = "plans are checked when they are read: their indices are in range"
)]

pub mod campaign_machine;
#[cfg(test)]
pub(crate) mod fixture;
pub mod gauges;
pub mod live;
mod noise;
mod plan_pose;
pub mod prediction;
mod pull;
pub mod simulated;
pub mod table;
pub mod ticks;
pub mod tracker;
pub mod windows;

use gantry_tau_core::model::kinematics::KinematicsError;
use gantry_tau_core::units::CrossingError;
use gantry_tau_machine::elastic::ElasticError;
use gantry_tau_system::output::Name;

use crate::experiment::prediction::NotBorne;
use crate::geometry::deviation::DeviationError;
use crate::measurements::FileError;

/// Reason why a machine does not take a pose.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PoseError {
    /// The axes do not reach it.
    #[error(transparent)]
    Kinematics(#[from] KinematicsError),
    /// A position of an axis is out of range.
    #[error(transparent)]
    Crossing(#[from] CrossingError),
    /// The unloaded machine has no equilibrium there.
    #[error(transparent)]
    Elastic(#[from] ElasticError),
    /// The machine that deviates from the robot file cannot be built.
    #[error(transparent)]
    Deviation(#[from] DeviationError),
    /// The pose has other axes.
    #[error("q has not {axes} entries")]
    Axes {
        /// Number of axes of the machine.
        axes: usize,
    },
}

/// Reason why a campaign cannot be measured.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// The plan or the table.
    #[error(transparent)]
    File(#[from] FileError),
    /// The robot file.
    #[error(transparent)]
    Robot(#[from] gantry_tau_machine::robot_file::RobotFileError),
    /// A pose of the plan cannot be taken.
    #[error("pose {pose}: {reason}")]
    Pose {
        /// Its name.
        pose: Name,
        /// The reason.
        reason: PoseError,
    },
    /// The sensor shows a load that the machine does not bear.
    #[error("series {series}, {level_n} N: {error}")]
    Sensor {
        /// Series.
        series: Name,
        /// Level, N.
        level_n: f64,
        /// Load that is shown, and why it is not borne.
        error: NotBorne,
    },
    /// The machine has no equilibrium under a load.
    #[error("series {series}, {level_n} N: {error}")]
    Load {
        /// Series.
        series: Name,
        /// Level, N.
        level_n: f64,
        /// The elastic model's error.
        error: ElasticError,
    },
    /// The table cannot be begun or continued.
    #[error(transparent)]
    Output(#[from] gantry_tau_system::output::WriteError),
    /// The table cannot be written.
    #[error("cannot write {path}: {reason}")]
    Write {
        /// Path.
        path: String,
        /// The reason.
        reason: String,
    },
}
