//! Planning: straps, gauges and poses that make every spring or geometric parameter observable, and
//! the standard deviations to expect.
//!
//! Everything here is known before anything is measured: the information of a measurement follows
//! from the robot file (Cramer-Rao). A plan is chosen from candidates by exchange, within the
//! limits of machine, strap and gauges.
//!
//! | module | contents |
//! |---|---|
//! | [`exchange`] | choice among candidates, criteria I and D |
//! | [`expected`] | standard deviations, lost directions, observability indices |
//! | `information` | what a strap shows of the springs, one series at a time |
//! | `limits` | poses away from singular ones |
//! | [`springs`] | plan of a campaign of straps and gauges; judgement of any |
//! | [`geometry`] | plan of poses for a calibration; judgement of any |
//! | [`verify`] | plan of straps at poses and in directions that identification did not use |
//! | `time` | time that a plan takes |
//! | `sheet` | page with pictures and steps to follow at the machine |
#![expect(
    clippy::indexing_slicing,
    reason = "candidates, links and parameters are counted by the arrays themselves"
)]

pub mod exchange;
pub mod expected;
pub mod geometry;
mod information;
mod limits;
mod sheet;
pub mod springs;
mod time;
pub mod verify;

use std::path::Path;

use gantry_tau_core::model::l2;
use gantry_tau_machine::elastic::ElasticError;
use gantry_tau_machine::robot_file::{RobotFile, RobotFileError};
use gantry_tau_system::output::Name;

use crate::measurements::{self, FileError};
pub use exchange::Criterion;
pub use expected::Expected;

/// Reason why planning fails.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// An option is out of range.
    #[error("{0}")]
    Option(String),
    /// The robot file has no compliances.
    #[error(
        "{robot}: c_link is missing; a plan of springs starts from estimates, which may be a factor of two off"
    )]
    NoCompliances {
        /// The robot file.
        robot: String,
    },
    /// Nothing can be measured within the limits.
    #[error("{robot}: {reason}")]
    NoCandidate {
        /// The robot file.
        robot: String,
        /// The limits that nothing meets, and what to do.
        reason: String,
    },
    /// The machine has no equilibrium under a load of the plan.
    #[error("{plan}: series {series}: {error}")]
    Series {
        /// The plan, or the robot file.
        plan: String,
        /// Name of the series.
        series: Name,
        /// Error of the elastic model.
        error: ElasticError,
    },
    /// A file of the plan.
    #[error(transparent)]
    File(#[from] FileError),
    /// The machine cannot reach its home.
    #[error(transparent)]
    Robot(#[from] RobotFileError),
    /// The text of the plan cannot be written.
    #[error("the plan cannot be written: {0}")]
    Text(String),
}

/// A plan, judged: what is written, and what it will show.
#[derive(Clone, Debug, PartialEq)]
pub struct Written {
    /// Text of the plan.
    pub plan: String,
    /// Header of its table.
    pub header: String,
    /// The sheet, HTML.
    pub sheet: String,
    /// Expected result, for the terminal.
    pub summary: String,
    /// Reasons not to measure it as it is.
    pub doubts: Vec<String>,
}

/// Judges a plan of any origin: what to expect, and reasons not to measure it as it is.
/// With `is_links_only` the springs of the axes are taken as known: compensation holds the carts.
///
/// # Errors
/// [`PlanError`].
pub fn check<K: geometry::PlannedMachine<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    path: &Path,
    is_links_only: bool,
) -> Result<(String, Vec<String>), PlanError> {
    if measurements::format_of(path)? == measurements::poses::FORMAT {
        return geometry::check(robot, path);
    }
    let setup = measurements::springs::read_setup(path, model_name::<N>(), &robot.metres_per_q)?;
    measurements::plan::of(path, setup.clone(), &robot.metres_per_q)?
        .check_wrist(path, robot.wrist.len())?;
    let judgement = springs::judge(robot, &setup, is_links_only, &path.display().to_string())?;
    let mut doubts = judgement.doubts.clone();
    doubts.extend(springs::lost(&judgement.expected));
    let poses = setup.poses.iter();
    doubts.extend(limits::doubtful(
        robot,
        poses.filter_map(|(name, pose)| Some((name, *pose, robot.model.axes_in(pose).ok()?))),
    ));
    Ok((judgement.to_string(), doubts))
}

/// Name of the kind of a machine with `N` axes, as of the key `model`.
const fn model_name<const N: usize>() -> &'static str {
    if N == l2::AXES { "l2" } else { "f1" }
}

fn check_range(option: &str, value: f64, least: f64, most: f64) -> Result<(), PlanError> {
    if (least..=most).contains(&value) {
        Ok(())
    } else {
        Err(PlanError::Option(format!(
            "{option} is {value}; expected from {least} to {most}"
        )))
    }
}
