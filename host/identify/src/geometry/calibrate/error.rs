//! Reasons why a calibration fails; each is one sentence.

use gantry_tau_machine::robot_file::RobotFileError;

use super::ColumnMistake;
use crate::measurements::FileError;

/// Reason why a calibration fails.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrateError {
    /// A file of measurements is wrong.
    #[error(transparent)]
    File(#[from] FileError),
    /// The robot file is wrong.
    #[error(transparent)]
    Robot(#[from] RobotFileError),
    /// Too few poses.
    #[error(
        "{table}: {poses} poses are too few; {least} are needed, and twice as many are a start"
    )]
    TooFew {
        /// The table.
        table: String,
        /// Number of poses.
        poses: usize,
        /// Smallest number.
        least: usize,
    },
    /// The poses have no orientations.
    #[error(
        "{table}: rot_w: an F1 needs orientations (rot_w, rot_x, rot_y, rot_z); places alone do not show its plates"
    )]
    NoOrientations {
        /// The table.
        table: String,
    },
    /// Columns are not what their names say.
    #[error("{table}: {mistake}")]
    Columns {
        /// The table.
        table: String,
        /// The mistake.
        mistake: ColumnMistake,
    },
    /// No start fits.
    #[error(
        "{table}: no machine fits these poses, begun neither from the robot file nor from the measurements alone: {reason}; check order, signs and units of the columns q_1 and on, x_m, y_m, z_m and rot_w to rot_z, and that the robot file is about this machine"
    )]
    NoStart {
        /// The table.
        table: String,
        /// Error of the better of them.
        reason: String,
    },
    /// A machine with parallel guideways was asked for, and does not reach each pose.
    #[error(
        "{table}: no machine with parallel guideways fits these poses: {reason}; calibrate with --guideways free"
    )]
    NotParallel {
        /// The table.
        table: String,
        /// Error of the fit.
        reason: String,
    },
    /// The places lie where they do not show a machine.
    #[error(
        "{table}: the places lie {shape}: {lost} of {all} combinations of parameters cannot be seen; spread them over the workspace"
    )]
    Shape {
        /// The table.
        table: String,
        /// Shape of the region.
        shape: String,
        /// Number of combinations that cannot be seen.
        lost: usize,
        /// Number of combinations that can be seen in good places.
        all: usize,
    },
    /// The places lie near a plane.
    #[error(
        "{table}: the places lie {shape}: a mirror image of the machine fits them as well; add places away from the plane"
    )]
    Mirror {
        /// The table.
        table: String,
        /// Shape of the region.
        shape: String,
    },
    /// The robot file's machine cannot stand where it was measured.
    #[error("{table}: {reason}")]
    Prediction {
        /// The table.
        table: String,
        /// Reason.
        reason: String,
    },
    /// Points of the base are not what their names say.
    #[error(
        "{file}: point: the points put the robot's frame {away_m:.2} m and {turned_deg:.0} degrees from where the robot file's machine is seen; are two of them in the place of each other? robot_m is in the frame of the robot file"
    )]
    Frame {
        /// File of the points.
        file: String,
        /// Distance between the two, m.
        away_m: f64,
        /// Turn from one to the other, degrees.
        turned_deg: f64,
    },
    /// An option that this machine does not have.
    #[error("{0}")]
    Option(&'static str),
    /// The robot file cannot be changed.
    #[error("the robot file cannot be changed: {0}")]
    Edit(String),
}
