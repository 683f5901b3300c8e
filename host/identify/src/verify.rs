//! `verify`: what remains of the displacement with compensation, measured in pairs of windows and
//! predicted with its uncertainty.
#![expect(
    clippy::indexing_slicing,
    reason = "windows and gauges are counted by the campaign itself"
)]

mod algebra;
mod margin;
mod measured;
mod model;
mod page;
mod pairs;
mod predict;
mod prediction_summary;
mod summary;

use gantry_tau_machine::elastic::ElasticError;
use gantry_tau_machine::robot_file::RobotFileError;

use crate::measurements::FileError;
pub use measured::{PairResult, verify};
pub use page::{prediction_page, verification_page};
pub use pairs::UNLOADED_SD;
pub use predict::{PlacePrediction, PredictOptions, Prediction, Remainder, directions, predict};
pub use prediction_summary::PredictionSummary;
pub use summary::{Statistics, Verification};

/// Reason why there is no verification.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum VerifyError {
    /// A file of measurements is wrong.
    #[error(transparent)]
    File(#[from] FileError),
    /// The robot file is wrong.
    #[error(transparent)]
    Robot(#[from] RobotFileError),
    /// The springs of the robot file find no equilibrium at home.
    #[error("the springs of the robot file at home: {0}")]
    Home(ElasticError),
    /// A row is not part of a pair.
    #[error("{table}:{line}: {reason}")]
    Pair {
        /// The table.
        table: String,
        /// Its line, counted from 1.
        line: u64,
        /// Reason.
        reason: String,
    },
    /// There is no pair.
    #[error(
        "{table}: there is no pair of windows; two rows with the same window and a load are one, with compensation off and on, of one series or of \"NAME off\" and \"NAME on\""
    )]
    NoPairs {
        /// The table.
        table: String,
    },
    /// The file carries no covariance.
    #[error(
        "{file}: has no [identified] with a covariance, so there is no uncertainty to predict with; identify writes one"
    )]
    NotIdentified {
        /// The robot file.
        file: String,
    },
}

#[cfg(test)]
mod tests;
