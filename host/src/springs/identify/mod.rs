//! `identify`: from measured forces and gauges, and a robot file, to the springs of this machine.

pub mod answer;
mod plausible;
mod report;

use std::path::PathBuf;

use gantry_tau_core::model::l2::AXES;
use gantry_tau_core::model::robot::LINKS;
use nalgebra::{DMatrix, Vector6};

use super::agreement::{Agreement, fit_agreeing};
use super::choice::Choice;
use super::compliances::Springs;
use super::fit::{SpringsError, fit, rounds};
use super::lines::{Question, State};
use super::play::{FoundPlay, with_play};
use super::setup::SetupConstants;
use crate::elastic::backlash::Backlash;
use crate::elastic::{ElasticMachine, Equilibrium};
use crate::experiment::prediction::Prediction;
use crate::experiment::raw;
use crate::fit::answer::{Parameter, Status, Unobservable};
use crate::fit::statistics::{chi_squared_above, float, students_t_95};
use crate::measurements::FileError;
use crate::measurements::springs::{self, Campaign};
use crate::model::MachineKind;
use crate::robot_file::edit::RobotText;
use crate::robot_file::{Identified, Play, RobotFile, RobotFileError};
use answer::{Answer, FORMAT, Outlier, PlayAnswer, SetupAnswer};

/// Smallest probability of the residuals at which a model is believed.
const LEAST_P: f64 = 1e-3;
/// Largest share of readings that may be left out.
const MOST_OUTLIERS: f64 = 0.1;
/// Standard deviations of its prior that a constant of the set-up may move by before it is named.
const MOST_MOVED_SD: f64 = 3.0;

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
    /// The half-width of the hysteresis of each gauge is fitted.
    pub has_hysteresis: bool,
    /// A drift of each gauge in each series is fitted.
    pub has_drift: bool,
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
        /// What is wrong.
        reason: SpringsError,
    },
    /// A spring runs away, and there are combinations of springs that the campaign does not show.
    #[error("{table}: {reason}; the campaign does not show {unseen}: add straps, gauges or poses (gantry-tau plan)")]
    Unseen {
        /// The table.
        table: String,
        /// What is wrong.
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
    /// What was found, in one line.
    pub summary: String,
    /// What a person should look at; empty where there is nothing.
    pub warnings: Vec<String>,
    /// Reasons not to trust it as it is; empty where there are none.
    pub doubts: Vec<String>,
}

/// A fit with all that was found out about it.
struct Found<'a, const N: usize> {
    question: Question<'a, N>,
    agreement: Agreement<N>,
    play: Option<FoundPlay>,
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
    let setup = SetupConstants::of(&campaign);
    let geometry = robot.model.geometry();
    let question = Question { geometry: &geometry, file: &file, campaign: &campaign, setup };
    plausible::check(&question)?;
    let found = find(question, options)?;
    let answer = found.answer(K::MODEL, options);
    let doubts = found.doubts(&answer);
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

/// Returns the answer of a campaign alone, from a robot file of `model`.
///
/// # Errors
/// [`IdentifyError`].
pub(super) fn answer_of<const N: usize>(
    question: Question<'_, N>,
    model: &'static str,
    options: &IdentifyOptions,
) -> Result<Answer, IdentifyError> {
    plausible::check(&question)?;
    Ok(find(question, options)?.answer(model, options))
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
        has_hysteresis: options.has_hysteresis,
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
    let start = first.state.clone();
    let without = if options.is_robust {
        fit_agreeing(&question, &choice, start).map_err(failed)?
    } else {
        Agreement {
            solved: fit(&question, &choice, start).map_err(failed)?,
            choice: choice.clone(),
            refused: Vec::new(),
        }
    };
    let (agreement, play) = match with_play(&question, &without, options.is_robust).map_err(failed)? {
        Some((agreement, play)) => (agreement, Some(play)),
        None => (without, None),
    };
    Ok(Found { question, agreement, play })
}

/// Names and units of the parameters.
fn names<const N: usize>(question: &Question<'_, N>, choice: &Choice, has_play: bool) -> Vec<(String, &'static str)> {
    let links = (0..LINKS).map(|link| (format!("c_link[{link}]"), "m/N"));
    let axes = (0..N).map(|axis| (format!("{}[{axis}]", axes_key::<N>()), "m/N"));
    let wrist = (0..question.file.wrist.joints()).map(|joint| (format!("c_wrist[{joint}]"), "rad/(N m)"));
    let play = has_play.then(|| ("play.gap_m".to_owned(), "m"));
    let gauges = question.campaign.gauges.iter().filter(|_| choice.has_hysteresis);
    let hysteresis = gauges.map(|gauge| (format!("hysteresis[{}]", gauge.name), "m"));
    links.chain(axes).chain(wrist).chain(play).chain(hysteresis).collect()
}

/// Key of the compliances of the axes.
pub(super) const fn axes_key<const N: usize>() -> &'static str {
    if N == AXES { "c_cart" } else { "c_act" }
}

impl<const N: usize> Found<'_, N> {
    fn answer(&self, model: &'static str, options: &IdentifyOptions) -> Answer {
        let Agreement { solved, choice, refused } = &self.agreement;
        let (mut values, mut covariance) = (solved.values(choice), solved.seen.covariance());
        if let Some(play) = &self.play {
            let index = self.question.file.count();
            values[index] *= play.sign;
            covariance.row_mut(index).scale_mut(play.sign);
            covariance.column_mut(index).scale_mut(play.sign);
        }
        let (chi2, dof) = (solved.rows.chi_squared(), solved.degrees());
        let is_scaled = options.is_scaled || !self.question.campaign.is_noise_stated;
        if is_scaled {
            covariance *= chi2 / float(dof);
        }
        let names = names(&self.question, choice, self.play.is_some());
        let mut parameters = Parameter::list(&names, &values, &covariance, |index| Status::of(&solved.seen, index));
        if is_scaled {
            parameters.iter_mut().for_each(|parameter| parameter.set_reach(students_t_95(dof)));
        }
        let mut unobservable = solved.seen.lost();
        unobservable.extend(solved.seen.weak());
        let campaign = self.question.campaign;
        let outlier = |series: usize, window: usize, gauge: usize| Outlier {
            series: campaign.series[series].clone(),
            window: campaign.windows[window].window.clone(),
            gauge: campaign.gauges[gauge].name.clone(),
        };
        let readings = refused.iter().map(|(window, gauge)| outlier(campaign.windows[*window].series, *window, *gauge));
        let shifts = choice.shifts.iter().map(|shift| outlier(shift.series, shift.window, shift.gauge));
        Answer {
            format: FORMAT,
            model,
            covariance: rows(&covariance),
            chi2,
            dof,
            // Scaled noise says nothing about the model.
            p: if is_scaled { 1.0 } else { chi_squared_above(chi2, dof) },
            outliers: readings.chain(shifts).collect(),
            unobservable: Unobservable::list(&names, &unobservable),
            play: self.play.as_ref().map(|play| PlayAnswer {
                gap_m: play.gap_m,
                sd_m: parameters[self.question.file.count()].sd,
                preload_rising_n: play.preload_n[0],
                preload_falling_n: play.preload_n[1],
            }),
            parameters,
            setup: self.setup(),
        }
    }

    fn setup(&self) -> Vec<SetupAnswer> {
        let Question { campaign, setup, .. } = &self.question;
        let constants = setup.list(campaign).into_iter().zip(self.agreement.solved.state.setup.iter());
        let answer = constants.map(|(constant, moved_sd)| SetupAnswer {
            estimate: moved_sd * constant.prior_sd,
            name: constant.name,
            prior_sd: constant.prior_sd,
            moved_sd: *moved_sd,
        });
        answer.collect()
    }

    fn summary(&self, answer: &Answer) -> String {
        let seen = &self.agreement.solved.seen;
        let lost = seen.lost().len();
        let readings = readings(self.question.campaign);
        let left_out = answer.outliers.len();
        let play = match &answer.play {
            None => String::new(),
            Some(play) => format!("; play of {:.1} +- {:.1} um", play.gap_m * 1e6, 1.96 * play.sd_m * 1e6),
        };
        let reduced = answer.chi2 / float(answer.dof);
        format!(
            "{} of {} parameters seen; chi2/dof {reduced:.2}, p {:.2}; {left_out} of {readings} readings left out{play}",
            answer.parameters.len() - lost,
            answer.parameters.len(),
            answer.p,
        )
    }

    fn warnings(&self, answer: &Answer) -> Vec<String> {
        let moved = answer.setup.iter().filter(|constant| constant.moved_sd.abs() > MOST_MOVED_SD).map(|constant| {
            format!("{} has moved by {:.1} of its standard deviations; look at it", constant.name, constant.moved_sd)
        });
        let inside = self.play.iter().flat_map(|play| &play.inside).map(|window| {
            let window = &self.question.campaign.windows[*window];
            let series = &self.question.campaign.series[window.series];
            format!("window {} of series {series} is inside the jump, and left out", window.window)
        });
        moved.chain(inside).collect()
    }

    fn doubts(&self, answer: &Answer) -> Vec<String> {
        let mut doubts = Vec::new();
        if answer.p < LEAST_P {
            let reduced = answer.chi2 / float(answer.dof);
            let largest = self.largest_contributors().join(", ");
            doubts.push(format!(
                "the model or the stated noise is wrong: chi2/dof is {reduced:.2} (p = {:.1e}), most of it from {largest}; another place on the cart may help [T 6.1]",
                answer.p
            ));
        }
        for direction in answer.unobservable.iter().filter(|direction| direction.relative_sd > 1.0) {
            doubts.push(format!("not observable, kept at the file's value: {direction}"));
        }
        let readings = readings(self.question.campaign);
        if float(answer.outliers.len()) > MOST_OUTLIERS * float(readings) {
            doubts.push(format!("{} of {readings} readings do not agree with the others", answer.outliers.len()));
        }
        doubts
    }

    /// Names of the three series and gauges with the largest residuals.
    fn largest_contributors(&self) -> Vec<String> {
        let campaign = self.question.campaign;
        let solved = &self.agreement.solved;
        let mut sums = DMatrix::zeros(campaign.series.len(), campaign.gauges.len());
        for (lines, left) in solved.lines.iter().zip(&solved.left) {
            for (row, gauge) in lines.gauges.iter().enumerate() {
                let weight = self.agreement.choice.weights[lines.window][*gauge];
                sums[(campaign.windows[lines.window].series, *gauge)] +=
                    weight * left[row].powi(2) / lines.variances[row];
            }
        }
        let mut all: Vec<(f64, usize, usize)> = (0..campaign.series.len())
            .flat_map(|series| (0..campaign.gauges.len()).map(move |gauge| (series, gauge)))
            .map(|(series, gauge)| (sums[(series, gauge)], series, gauge))
            .collect();
        all.sort_by(|(one, ..), (other, ..)| other.total_cmp(one));
        let named = |(_, series, gauge): &(f64, usize, usize)| {
            format!("gauge {} in series {}", campaign.gauges[*gauge].name, campaign.series[*series])
        };
        all.iter().take(3).map(named).collect()
    }

    /// Text of the changed robot file.
    fn robot_file<K: MachineKind<N>>(
        &self,
        robot: &RobotFile<K, N>,
        options: &IdentifyOptions,
        answer: &Answer,
        warnings: &mut Vec<String>,
    ) -> Result<String, IdentifyError> {
        let campaign = self.question.campaign;
        let said = |error: &dyn std::fmt::Display| IdentifyError::Edit(error.to_string());
        let text = crate::robot_file::text_of(&options.robot)?;
        let provenance = format!("IDENTIFIED with {} (CRC-32 {:08x})", campaign.table, campaign.crc);
        let mut text = RobotText::new(&text, &provenance).map_err(|error| said(&error))?;
        let values: Vec<f64> = answer.parameters.iter().map(|parameter| parameter.value).collect();
        let (links, axes) = values.split_at(LINKS);
        text.set_numbers("c_link", links);
        text.set_numbers(axes_key::<N>(), &axes[..N]);
        for (joint, value) in axes[N..].iter().take(robot.wrist.len()).enumerate() {
            text.set_number_of("wrist", joint, "c_rad_per_nm", *value);
        }
        let springs = self.question.file.count();
        let identified = Identified {
            measurements: campaign.table.clone(),
            crc: campaign.crc,
            windows: campaign.windows.len(),
            chi2: answer.chi2,
            dof: answer.dof,
            sd: answer.parameters.iter().take(springs).map(|parameter| parameter.sd).collect(),
            covariance: answer.covariance.iter().take(springs).map(|row| row[..springs].to_vec()).collect(),
        };
        text.set_serialized("identified", &identified).map_err(|error| said(&error))?;
        if let Some(PlayAnswer { gap_m, sd_m, preload_rising_n, preload_falling_n }) = answer.play {
            let play = Play { gap_m, sd_m, preload_rising_n, preload_falling_n };
            text.set_serialized("play", &play).map_err(|error| said(&error))?;
            match self.jump_force_n(robot, preload_rising_n) {
                Some(jump_force_n) => {
                    text.set_number_in("simulation", "jump_force_n", jump_force_n);
                    text.set_number_in("simulation", "jump_gap_m", gap_m);
                }
                None => warnings.push(
                    "the jump is not one that a force in +x opens at home; [simulation] keeps its own".to_owned(),
                ),
            }
        }
        Ok(text.text())
    }

    /// Force in x at home that takes the preload away, N; `None` if none in +x does.
    fn jump_force_n<K: MachineKind<N>>(&self, robot: &RobotFile<K, N>, preload_n: [f64; 2]) -> Option<f64> {
        let home = robot.home_m();
        let q = robot.model.axes_at(&home).ok()?;
        let compliances = self.agreement.solved.state.springs.machine;
        let machine = ElasticMachine::new(*self.question.geometry, compliances, Backlash::NONE);
        let probe_n = 100.0;
        let load = Vector6::new(probe_n, 0.0, 0.0, 0.0, 0.0, 0.0);
        let loaded = machine.equilibrium(&q, &load, &Equilibrium::at_home(home.into())).ok()?;
        let force = -f64::midpoint(preload_n[0], preload_n[1]) * probe_n / loaded.cluster_3_n();
        (1.0..1e5).contains(&force).then_some(force)
    }
}

fn readings<const N: usize>(campaign: &Campaign<N>) -> usize {
    campaign.windows.iter().flat_map(|window| &window.readings_m).flatten().count()
}

/// A matrix by rows.
fn rows(matrix: &DMatrix<f64>) -> Vec<Vec<f64>> {
    matrix.row_iter().map(|row| row.iter().copied().collect()).collect()
}
