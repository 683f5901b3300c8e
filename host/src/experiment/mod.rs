//! Campaigns of forces and gauges, measured `[T 4.2.9]`: a plan in, a table of windows out.
//!
//! | module | contents |
//! |---|---|
//! | [`windows`] | settle test and mean: windows from samples |
//! | [`prediction`] | load on the platform from the force sensor, which turns with the platform |
//! | [`table`] | the table, row by row; goes on where it ended |
//! | [`raw`] | the table of every tick, and windows made of it |
//! | [`simulated`] | the whole campaign on the simulated machine, without sockets |
//! | [`tracker`] | poses of a target, as a simulated device sees them, for `calibrate` |
//! | [`live`] | on a machine behind a server, window by window |
#![expect(clippy::indexing_slicing, reason = "plans are checked when they are read: their indices are in range")]

#[cfg(test)]
pub(crate) mod fixture;
pub mod live;
mod place;
pub mod prediction;
mod pull;
pub mod raw;
pub mod simulated;
pub mod table;
pub mod tracker;
pub mod windows;

use crate::elastic::ElasticError;
use crate::experiment::prediction::NotBorne;
use crate::measurements::FileError;
use crate::output::Name;

/// Reason why a campaign cannot be measured.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// The plan or the table.
    #[error(transparent)]
    File(#[from] FileError),
    /// The robot file.
    #[error(transparent)]
    Robot(#[from] crate::robot_file::RobotFileError),
    /// A pose of the plan cannot be taken.
    #[error("pose {pose}: {reason}")]
    Pose {
        /// Its name.
        pose: Name,
        /// The reason.
        reason: String,
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
    Output(#[from] crate::output::WriteError),
    /// The table cannot be written.
    #[error("cannot write {path}: {reason}")]
    Write {
        /// Path.
        path: String,
        /// The reason.
        reason: String,
    },
}
