//! `identify`: from measured forces and gauges, and a robot file, to the springs of this machine.

pub mod answer;
mod common_factor;
mod doubts;
mod far_off;
mod hysteresis;
mod instrument_errors;
mod intervals;
mod lack_of_fit;
mod levels;
mod measurable;
#[cfg(test)]
mod mistake_tests;
mod mistakes;
mod plausible;
mod profile;
mod quiet;
mod regimes;
mod report;
mod response;
mod robot_text;
#[cfg(test)]
mod weak_campaigns;

use std::path::PathBuf;

use gantry_tau_machine::elastic::springs::Springs;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{RobotFile, RobotFileError};

use super::active_set::ActiveSet;
use super::decision::{Decision, NotPositive};
use super::fit::{Solution, SpringsError, rounds};
use super::play::{FoundPlay, with_play};
use super::problem::SpringsProblem;
use super::robust_fit::RobustFit;
use super::state::FitState;
use crate::experiment::prediction::Prediction;
use crate::experiment::ticks;
use crate::fit::answer::Unobservable;
use crate::measurements::FileError;
use crate::measurements::springs;
pub(super) use answer::SpringsAnswer;
use hysteresis::{SignificantFit, drop_small};
use intervals::Intervals;
use lack_of_fit::LackOfFit;
use profile::{ProfileInterval, profiles};
use regimes::{RegimesError, TwoRegimes};

/// Decisions of what the campaign shows, after which the last one stands. One is usual, and three
/// are many.
const MAX_DECISIONS: u32 = 20;

/// Options of an identification.
#[derive(Clone, Debug)]
pub struct IdentifyOptions {
    /// Set-up of the measurements.
    pub setup: PathBuf,
    /// Table of every tick that windows are made of; `None`: the set-up names the table of windows.
    pub raw: Option<PathBuf>,
    /// Name of the robot file to begin with, as of
    /// [`gantry_tau_machine::robot_file::AnyRobotFile::named`].
    pub robot: String,
    /// Intervals by the residuals instead of the stated noise.
    pub is_scaled: bool,
    /// Readings that do not agree are left out.
    pub is_robust: bool,
    /// Compliances of the links of their own beyond the jump are compared with those before it.
    pub has_two_regimes: bool,
    /// The half-width of the hysteresis of each gauge is fitted, and dropped where it is too small
    /// to be seen.
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

/// Reason why an identification has failed.
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
    #[error(
        "{robot}: wrist[{index}].c_rad_per_nm is 0; an identification begins with an estimate, such as 1e-5"
    )]
    RigidJoint {
        /// The robot file.
        robot: String,
        /// Index of the joint.
        index: usize,
    },
    /// The fit has failed.
    #[error("{table}: {reason}")]
    Fit {
        /// The table.
        table: String,
        /// Reason.
        reason: SpringsError,
    },
    /// A spring runs away, and there are combinations of springs that the campaign does not show.
    #[error(
        "{table}: {reason}; the campaign does not show {unseen}: add straps, gauges or poses (gantry-tau plan)"
    )]
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
    /// Text of the robot file of this machine: that of the file that the identification began with,
    /// its compliances replaced.
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
struct IdentifiedSprings<'a, const N: usize> {
    problem: SpringsProblem<'a, N>,
    robust_fit: RobustFit<N>,
    play: Option<FoundPlay>,
    intervals: Intervals,
    /// Gauges whose hysteresis was dropped, by index.
    dropped: Vec<usize>,
    /// The links before and beyond the jump, or why they are not compared; `None` without
    /// [`IdentifyOptions::has_two_regimes`].
    regimes: Option<Result<TwoRegimes, RegimesError>>,
    /// Springs whose best value is not positive, and which keep the file's.
    not_positive: Vec<NotPositive>,
    /// Intervals of the springs that are known badly.
    profiles: Vec<ProfileInterval>,
    /// Lack of fit; `None` if nothing was repeated.
    lack_of_fit: Option<LackOfFit>,
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
        None => (
            springs::read(&options.setup, K::MODEL, &robot.metres_per_q)?,
            Vec::new(),
        ),
        Some(table) => {
            let made = ticks::read(table, &options.setup, robot, &Prediction::new(robot)?)?;
            (made.campaign, made.missed)
        }
    };
    campaign.check_wrist(&options.setup, robot.wrist.len())?;
    if let Some(window) = campaign
        .windows
        .iter()
        .find(|window| options.has_drift && window.time_s.is_none())
    {
        return Err(campaign
            .error(
                window,
                "time_s",
                "is missing; --drift needs the time of every window",
            )
            .into());
    }
    let geometry = robot.model.geometry();
    let problem = SpringsProblem::new(&geometry, &file, &campaign);
    let problem = robot
        .identified
        .iter()
        .fold(problem, |problem, identified| {
            problem.with_prior(identified)
        });
    let found = examine(&problem, options)?;
    let answer = found.answer(K::MODEL);
    let mut doubts = found.doubts(&answer);
    doubts.extend(found.unexpected_play(robot));
    let mut warnings = found.warnings(&answer);
    warnings.extend(missed);
    let robot_file = found.robot_file(robot, options, &answer, &mut warnings)?;
    Ok(Identification {
        json: serde_json::to_string_pretty(&answer)
            .map_err(|error| IdentifyError::Edit(error.to_string()))?,
        robot_file,
        report: found.report(&answer, options, &doubts, &warnings),
        summary: found.summary(&answer),
        warnings,
        doubts,
    })
}

/// Fits, and looks for mistakes in the campaign.
fn examine<'a, const N: usize>(
    problem: &SpringsProblem<'a, N>,
    options: &IdentifyOptions,
) -> Result<IdentifiedSprings<'a, N>, IdentifyError> {
    plausible::check(problem)?;
    mistakes::check_gross(problem, options)?;
    mistakes::check(find(problem.clone(), options), problem, options)
}

/// Returns the answer of a campaign alone, from a robot file of `model`, and the reasons not to
/// trust it as it is.
///
/// # Errors
/// [`IdentifyError`].
pub(super) fn answer_of<const N: usize>(
    problem: SpringsProblem<'_, N>,
    model: &'static str,
    options: &IdentifyOptions,
) -> Result<(SpringsAnswer, Vec<String>), IdentifyError> {
    plausible::check(&problem)?;
    let found = find(problem, options)?;
    let answer = found.answer(model);
    let doubts = found.doubts(&answer);
    Ok((answer, doubts))
}

/// Springs of a robot file, all of which can be scaled.
pub(super) fn starting_springs<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
) -> Result<Springs<N>, IdentifyError> {
    if let Some(index) = robot
        .wrist
        .iter()
        .position(|joint| joint.c_rad_per_nm <= 0.0)
    {
        return Err(IdentifyError::RigidJoint {
            robot: robot.name.clone(),
            index,
        });
    }
    Springs::of(robot).ok_or_else(|| IdentifyError::NoCompliances {
        robot: robot.name.clone(),
    })
}

fn find<'a, const N: usize>(
    problem: SpringsProblem<'a, N>,
    options: &IdentifyOptions,
) -> Result<IdentifiedSprings<'a, N>, IdentifyError> {
    let active = ActiveSet {
        hysteresis: if options.has_hysteresis {
            (0..problem.campaign.gauges.len()).collect()
        } else {
            Vec::new()
        },
        has_drift: options.has_drift,
        ..ActiveSet::all(problem.campaign)
    };
    let first = rounds(&problem, &active, FitState::start(&problem), 1).map_err(|reason| {
        IdentifyError::Fit {
            table: problem.campaign.table.clone(),
            reason,
        }
    })?;
    plausible::gauges(&problem, &first.linearized)?;
    let intervals = Intervals {
        is_scaled: options.is_scaled || !problem.campaign.is_noise_stated,
    };
    let (kept, decision) = decide(&problem, &active, &first, options, intervals)
        .map_err(|reason| failed(&problem, &active, &first, reason))?;
    let SignificantFit {
        robust_fit,
        play,
        dropped,
    } = kept;
    let regimes = options.has_two_regimes.then(|| {
        let play = play.as_ref().ok_or(RegimesError::NoJump)?;
        let compared = regimes::compare(&problem, &robust_fit, play, intervals, options.is_robust);
        Ok(compared?)
    });
    let profiles = profiles(&problem, &robust_fit, intervals);
    let lack_of_fit = LackOfFit::of(&problem, &robust_fit);
    Ok(IdentifiedSprings {
        problem,
        robust_fit,
        play,
        intervals,
        dropped,
        regimes,
        not_positive: decision.not_positive,
        profiles,
        lack_of_fit,
    })
}

/// Decides what the campaign measures, and fits that, until the fit's end agrees. `first`: the
/// campaign, linearized at the robot file's springs.
fn decide<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    active: &ActiveSet,
    first: &Solution<N>,
    options: &IdentifyOptions,
    intervals: Intervals,
) -> Result<(SignificantFit<N>, Decision), SpringsError> {
    let mut decision = Decision::first(problem, first);
    let mut decisions = 0;
    loop {
        decisions += 1;
        let active = ActiveSet {
            held: Some(decision.held.clone()),
            ..active.clone()
        };
        let kept = match search(problem, &active, options, intervals) {
            Err(reason @ (SpringsError::NotConverged { .. } | SpringsError::AtBound { .. })) => {
                decision = decision.without_weakest(problem, first).ok_or(reason)?;
                continue;
            }
            kept => kept?,
        };
        let RobustFit {
            solution, active, ..
        } = &kept.robust_fit;
        match decision.next(problem, active, solution)? {
            Some(next) if decisions < MAX_DECISIONS => decision = next,
            _ => return Ok((kept, decision)),
        }
    }
}

/// Reason why a fit has failed, with the combinations that are not seen where it runs away.
fn failed<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    active: &ActiveSet,
    first: &Solution<N>,
    reason: SpringsError,
) -> IdentifyError {
    let table = problem.campaign.table.clone();
    let runs_away = matches!(
        reason,
        SpringsError::AtBound { .. } | SpringsError::NotConverged { .. }
    );
    let lost = first.seen.lost();
    if !runs_away || lost.is_empty() {
        return IdentifyError::Fit { table, reason };
    }
    let unseen: Vec<String> = Unobservable::list(&names(problem, active, false), &lost)
        .iter()
        .map(Unobservable::to_string)
        .collect();
    IdentifyError::Unseen {
        table,
        reason,
        unseen: unseen.join("; "),
    }
}

/// Fits from the robot file's springs, with the play and the hysteresis that are there.
fn search<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    active: &ActiveSet,
    options: &IdentifyOptions,
    intervals: Intervals,
) -> Result<SignificantFit<N>, SpringsError> {
    let without = RobustFit::find(problem, active, FitState::start(problem), options.is_robust)?;
    let (robust_fit, play) = match with_play(problem, &without, options.is_robust)? {
        Some((robust_fit, play)) => (robust_fit, Some(play)),
        None => (without, None),
    };
    drop_small(problem, robust_fit, play, intervals, options.is_robust)
}

/// Names and units of the parameters.
fn names<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    active: &ActiveSet,
    has_play: bool,
) -> Vec<(String, &'static str)> {
    let play = has_play.then(|| ("play.gap_m".to_owned(), "m"));
    let hysteresis = active.hysteresis.iter().map(|gauge| {
        let name = &problem.campaign.gauges[*gauge].name;
        (format!("hysteresis[{name}]"), "m")
    });
    problem
        .file
        .names()
        .into_iter()
        .chain(play)
        .chain(hysteresis)
        .collect()
}
