//! `identify`: from measured forces and gauges, and a robot file, to the springs of this machine.

#[cfg(test)]
mod accused;
pub mod answer;
mod common_factor;
mod doubts;
mod far_off;
mod hysteresis;
mod instrument_errors;
mod intervals;
mod levels;
mod measurable;
mod mistakes;
mod plausible;
mod profile;
mod regimes;
mod repeats;
mod report;
mod response;
mod robot_text;
#[cfg(test)]
mod weak;

use std::path::PathBuf;

use super::agreement::Agreement;
use super::choice::Choice;
use super::compliances::Springs;
use super::decision::{Decision, NotPositive};
use super::fit::{SpringsError, rounds};
use super::lines::{Question, State};
use super::play::{FoundPlay, with_play};
use crate::experiment::prediction::Prediction;
use crate::experiment::raw;
use crate::fit::answer::Unobservable;
use crate::measurements::FileError;
use crate::measurements::springs;
use crate::model::MachineKind;
use crate::robot_file::{RobotFile, RobotFileError};
pub(super) use answer::Answer;
use hysteresis::{Kept, drop_small};
use intervals::Intervals;
use profile::{Profiled, profiles};
use regimes::TwoRegimes;
use repeats::Repeats;

/// Decisions of what the campaign shows, after which the last one stands. One is usual, and three are many.
const MAX_DECISIONS: u32 = 20;

/// Options of an identification.
#[derive(Clone, Debug)]
pub struct IdentifyOptions {
    /// Set-up of the measurements.
    pub setup: PathBuf,
    /// Table of every tick that windows are made of; `None`: the set-up names the table of windows.
    pub raw: Option<PathBuf>,
    /// Name of the robot file to begin with, as of [`crate::robot_file::AnyRobotFile::named`].
    pub robot: String,
    /// Intervals by the residuals instead of the stated noise.
    pub is_scaled: bool,
    /// Readings that do not agree are left out.
    pub is_robust: bool,
    /// Compliances of the links of their own beyond the jump are compared with those before it.
    pub has_two_regimes: bool,
    /// The half-width of the hysteresis of each gauge is fitted, and dropped where it is too small to be seen.
    pub has_hysteresis: bool,
    /// A drift of each gauge in each series is fitted.
    pub has_drift: bool,
}

impl IdentifyOptions {
    /// Springs alone, by the stated noise, from readings that agree.
    #[must_use]
    pub fn new(setup: PathBuf, robot: &str) -> Self {
        Self {
            setup,
            raw: None,
            robot: robot.to_owned(),
            is_scaled: false,
            is_robust: true,
            has_two_regimes: false,
            has_hysteresis: false,
            has_drift: false,
        }
    }
}

/// Reason why there is no identification.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum IdentifyError {
    /// A file of measurements is wrong.
    #[error(transparent)]
    File(#[from] FileError),
    /// The robot file is wrong.
    #[error(transparent)]
    Robot(#[from] RobotFileError),
    /// The robot file has no springs to begin with.
    #[error("{robot}: c_link: compliances are missing; an identification begins with them")]
    NoCompliances {
        /// The robot file.
        robot: String,
    },
    /// A joint of the wrist has no compliance to begin with.
    #[error("{robot}: wrist[{index}].c_rad_per_nm is 0; an identification begins with an estimate, such as 1e-5")]
    RigidJoint {
        /// The robot file.
        robot: String,
        /// Index of the joint.
        index: usize,
    },
    /// There is no fit.
    #[error("{table}: {reason}")]
    Fit {
        /// The table.
        table: String,
        /// Reason.
        reason: SpringsError,
    },
    /// A spring runs away, and there are combinations of springs that the campaign does not show.
    #[error("{table}: {reason}; the campaign does not show {unseen}: add straps, gauges or poses (gantry-tau plan)")]
    Unseen {
        /// The table.
        table: String,
        /// Reason.
        reason: SpringsError,
        /// Combinations that are not seen.
        unseen: String,
    },
    /// The robot file cannot be changed.
    #[error("the robot file cannot be changed: {0}")]
    Edit(String),
}

/// Result of an identification.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identification {
    /// The answer for programs, JSON.
    pub json: String,
    /// Text of the robot file of this machine: that of the file that the identification began with, its compliances replaced.
    pub robot_file: String,
    /// Page with plots.
    pub report: String,
    /// Result in one line.
    pub summary: String,
    /// Warnings; empty if there are none.
    pub warnings: Vec<String>,
    /// Reasons not to trust it as it is; empty where there are none.
    pub doubts: Vec<String>,
}

/// A fit with all that was found out about it.
struct Found<'a, const N: usize> {
    question: Question<'a, N>,
    agreement: Agreement<N>,
    play: Option<FoundPlay>,
    intervals: Intervals,
    /// Gauges whose hysteresis was dropped, by index.
    dropped: Vec<usize>,
    /// The links before and beyond the jump, or why they are not compared; `None` if nobody asked.
    regimes: Option<Result<TwoRegimes, String>>,
    /// Springs whose best value is not positive, and which keep the file's.
    not_positive: Vec<NotPositive>,
    /// Intervals of the springs that are known badly.
    profiles: Vec<Profiled>,
    repeats: Option<Repeats>,
}

/// Identifies the springs of the machine of a robot file.
///
/// # Errors
/// [`IdentifyError`].
pub fn identify<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    options: &IdentifyOptions,
) -> Result<Identification, IdentifyError> {
    let file = starting_springs(robot)?;
    let (campaign, missed) = match &options.raw {
        None => (springs::read(&options.setup, K::MODEL, &robot.metres_per_q)?, Vec::new()),
        Some(table) => {
            let made = raw::read(table, &options.setup, robot, &Prediction::new(robot)?)?;
            (made.campaign, made.missed)
        }
    };
    campaign.check_wrist(&options.setup, robot.wrist.len())?;
    if let Some(window) = campaign.windows.iter().find(|window| options.has_drift && window.time_s.is_none()) {
        return Err(campaign.error(window, "time_s", "is missing; --drift needs the time of every window").into());
    }
    let geometry = robot.model.geometry();
    let question = Question::new(&geometry, &file, &campaign);
    let question = robot.identified.iter().fold(question, |question, identified| question.known(identified));
    let found = examined(&question, options)?;
    let answer = found.answer(K::MODEL);
    let mut doubts = found.doubts(&answer);
    doubts.extend(found.unexpected_play(robot));
    let mut warnings = found.warnings(&answer);
    warnings.extend(missed);
    let robot_file = found.robot_file(robot, options, &answer, &mut warnings)?;
    Ok(Identification {
        json: serde_json::to_string_pretty(&answer).map_err(|error| IdentifyError::Edit(error.to_string()))?,
        robot_file,
        report: found.report(&answer, options, &doubts, &warnings),
        summary: found.summary(&answer),
        warnings,
        doubts,
    })
}

/// Fits, and looks for mistakes in the campaign.
fn examined<'a, const N: usize>(
    question: &Question<'a, N>,
    options: &IdentifyOptions,
) -> Result<Found<'a, N>, IdentifyError> {
    plausible::check(question)?;
    mistakes::gross(question, options)?;
    mistakes::checked(find(question.clone(), options), question, options)
}

/// Returns the answer of a campaign alone, from a robot file of `model`, and the reasons not to trust it as it is.
///
/// # Errors
/// [`IdentifyError`].
pub(super) fn answer_of<const N: usize>(
    question: Question<'_, N>,
    model: &'static str,
    options: &IdentifyOptions,
) -> Result<(Answer, Vec<String>), IdentifyError> {
    plausible::check(&question)?;
    let found = find(question, options)?;
    let answer = found.answer(model);
    let doubts = found.doubts(&answer);
    Ok((answer, doubts))
}

/// Springs of a robot file, all of which can be scaled.
pub(super) fn starting_springs<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
) -> Result<Springs<N>, IdentifyError> {
    let name = || robot.name.clone();
    if let Some(index) = robot.wrist.iter().position(|joint| joint.c_rad_per_nm <= 0.0) {
        return Err(IdentifyError::RigidJoint { robot: name(), index });
    }
    Springs::of(robot).ok_or_else(|| IdentifyError::NoCompliances { robot: name() })
}

fn find<'a, const N: usize>(
    question: Question<'a, N>,
    options: &IdentifyOptions,
) -> Result<Found<'a, N>, IdentifyError> {
    let table = question.campaign.table.clone();
    let failed = |reason: SpringsError| IdentifyError::Fit { table: table.clone(), reason };
    let choice = Choice {
        hysteresis: if options.has_hysteresis { (0..question.campaign.gauges.len()).collect() } else { Vec::new() },
        has_drift: options.has_drift,
        ..Choice::all(question.campaign)
    };
    let first = rounds(&question, &choice, State::start(&question), 1).map_err(failed)?;
    plausible::gauges(&question, &first.lines)?;
    let failed = |reason: SpringsError| match (reason, first.seen.lost().as_slice()) {
        (reason @ (SpringsError::AtBound { .. } | SpringsError::NotConverged { .. }), [_, ..]) => {
            let unseen = Unobservable::list(&names(&question, &choice, false), &first.seen.lost());
            let unseen = unseen.iter().map(Unobservable::to_string).collect::<Vec<_>>().join("; ");
            IdentifyError::Unseen { table: table.clone(), reason, unseen }
        }
        (reason, _) => IdentifyError::Fit { table: table.clone(), reason },
    };
    let intervals = Intervals { is_scaled: options.is_scaled || !question.campaign.is_noise_stated };
    let mut decision = Decision::first(&question, &first);
    let mut decisions = 0;
    let Kept { agreement, play, dropped } = loop {
        decisions += 1;
        let choice = Choice { held: Some(decision.held.clone()), ..choice.clone() };
        let kept = match searched(&question, &choice, options, intervals) {
            Err(reason @ (SpringsError::NotConverged { .. } | SpringsError::AtBound { .. })) => {
                decision = decision.without_weakest(&question, &first).ok_or(reason).map_err(failed)?;
                continue;
            }
            kept => kept.map_err(failed)?,
        };
        let Agreement { solved, choice, .. } = &kept.agreement;
        match decision.next(&question, choice, solved).map_err(failed)? {
            Some(next) if decisions < MAX_DECISIONS => decision = next,
            _ => break kept,
        }
    };
    let not_positive = decision.not_positive;
    let regimes = options.has_two_regimes.then(|| {
        let play = play.as_ref().ok_or_else(|| "no jump was found".to_owned())?;
        let compared = regimes::compare(&question, &agreement, play, intervals, options.is_robust);
        compared.map_err(|error| error.to_string())
    });
    let profiles = profiles(&question, &agreement, intervals);
    let repeats = Repeats::of(&question, &agreement);
    Ok(Found { question, agreement, play, intervals, dropped, regimes, not_positive, profiles, repeats })
}

/// Fits from the robot file's springs, with the play and the hysteresis that are there.
fn searched<const N: usize>(
    question: &Question<'_, N>,
    choice: &Choice,
    options: &IdentifyOptions,
    intervals: Intervals,
) -> Result<Kept<N>, SpringsError> {
    let without = Agreement::find(question, choice, State::start(question), options.is_robust)?;
    let (agreement, play) = match with_play(question, &without, options.is_robust)? {
        Some((agreement, play)) => (agreement, Some(play)),
        None => (without, None),
    };
    drop_small(question, agreement, play, intervals, options.is_robust)
}

/// Names and units of the parameters.
fn names<const N: usize>(question: &Question<'_, N>, choice: &Choice, has_play: bool) -> Vec<(String, &'static str)> {
    let play = has_play.then(|| ("play.gap_m".to_owned(), "m"));
    let name = |gauge: &usize| format!("hysteresis[{}]", question.campaign.gauges[*gauge].name);
    let hysteresis = choice.hysteresis.iter().map(|gauge| (name(gauge), "m"));
    question.file.names().into_iter().chain(play).chain(hysteresis).collect()
}
