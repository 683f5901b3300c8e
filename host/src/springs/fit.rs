//! Maximum likelihood of the compliances, where gauges *and* loads are measured (the Gauss-Helmert model), and what is known of the set-up
//! has a prior.
//!
//! Minimised is `sum |y - h(c, z, w*) - zero|^2 / sigma^2 + |w - S z - w*|^2 / Sigma_w + |z|^2` over the compliances `c`, the constants `z` of
//! the set-up, the true loads `w*` and the zero of each gauge in each series. (Weighted least squares at the measured loads is off by up to 0.8
//! standard deviations.) A round linearises at `w*`:
//!
//!     r = y - h(c, z, w*) - H (w - S z - w*),    Cov = diag(sigma^2) + H Sigma_w H^T
//!     w* <- w - S z + Sigma_w H^T Cov^-1 (r - J dc - B dz - zeros)
//!
//! with one block of `Cov` per window, whose gauges share the error of its load. Zeros and constants are eliminated first.

use gantry_tau_core::model::robot::RobotError;
use nalgebra::{DMatrix, DVector};

use super::blocks::{Blocks, Eliminated};
use super::choice::Choice;
use super::lines::{Lines, LinesError, Question, State};
use crate::fit::least_squares::{Rows, Seen};
use crate::fit::statistics::float;

/// Rounds after which a fit has failed; three to five are usual.
const MAX_ROUNDS: u32 = 30;
/// Longest step of a fit that has converged, in standard deviations; of a constant of the set-up, in those of its prior.
const CONVERGED_SD: f64 = 1e-4;
const CONVERGED_PRIOR_SD: f64 = 1e-3;
/// Longest step that rounding may leave, in standard deviations.
const ROUNDING_SD: f64 = 1e-3;
/// Largest factor that a compliance changes by in a round: none becomes negative.
const MOST_CHANGE: f64 = 20.0;
/// Change of a compliance, in file's values, that a result is refused at: it runs away to zero or to infinity.
pub(super) const MOST_FACTOR: f64 = 100.0;
/// Elongation that is a scale of the play before one is known, and hysteresis of a gauge that would matter; m.
const PLAY_SCALE_M: f64 = 20e-6;
const HYSTERESIS_SCALE_M: f64 = 10e-6;

/// Reason why there is no fit.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SpringsError {
    /// A window cannot be predicted.
    #[error(transparent)]
    Lines(#[from] LinesError),
    /// The compliances have left their range.
    #[error("the compliances leave their range: {0}")]
    Compliances(#[from] RobotError),
    /// A covariance is not positive.
    #[error("the noise of a window is not positive")]
    Noise,
    /// Fewer readings than unknowns.
    #[error(
        "{readings} readings besides the zeros of the gauges are too few for {parameters} springs; measure more windows"
    )]
    TooFew {
        /// Readings, less the zeros.
        readings: usize,
        /// Springs.
        parameters: usize,
    },
    /// A compliance at the end of its range: the model is wrong.
    #[error(
        "{name} is {factor:.1e} times that of the robot file: the model does not fit the readings; check signs and units of gauges and forces"
    )]
    AtBound {
        /// Key and index of the spring.
        name: String,
        /// Value, in file's values.
        factor: f64,
    },
    /// It still moves.
    #[error("no convergence after {MAX_ROUNDS} rounds: the last step is {step_sd:.1e} standard deviations long")]
    NotConverged {
        /// Length of the last step, in standard deviations.
        step_sd: f64,
    },
}

/// Springs that fit the readings of a choice.
#[derive(Clone, Debug)]
pub(super) struct Solved<const N: usize> {
    pub(super) state: State<N>,
    /// Half-widths of the hysteresis, m; of the gauges of the choice.
    pub(super) hysteresis_m: DVector<f64>,
    /// The campaign, linearised there.
    pub(super) lines: Vec<Lines>,
    /// Misclosures less the zeros, m; by window and row of its lines.
    pub(super) left: Vec<DVector<f64>>,
    /// Rows for the parameters: compliances, play, links beyond the jump, hysteresis.
    pub(super) rows: Rows,
    /// Directions that they see, in shares of the file's compliances.
    pub(super) seen: Seen,
    /// Rounds that it took.
    pub(super) rounds: u32,
    /// Longest step of a constant of the set-up that is next, in standard deviations of its prior.
    setup_step_sd: f64,
    /// The next step would be none.
    pub(super) is_settled: bool,
}

impl<const N: usize> Solved<N> {
    /// Values of the parameters: compliances, elongation by the play, links beyond the jump, hysteresis.
    pub(super) fn values(&self, choice: &Choice) -> DVector<f64> {
        let play = choice.has_play().then_some(self.state.elongation_m);
        let springs = self.state.springs.vector();
        let links = self.state.beyond.iter().take(choice.of_links());
        let all = springs.iter().copied().chain(play).chain(links.copied()).chain(self.hysteresis_m.iter().copied());
        DVector::from_vec(all.collect())
    }

    /// Degrees of freedom: readings that are used, less zeros and parameters.
    pub(super) fn degrees(&self) -> usize {
        self.rows.degrees().saturating_sub(self.seen.kept())
    }

    /// Covariance of the parameters if every constant of the set-up were exact.
    pub(super) fn covariance_of_noise(&self, question: &Question<'_, N>, choice: &Choice) -> Option<DMatrix<f64>> {
        let exact = Question { setup: question.setup.exact(), ..*question };
        let lines: Vec<Lines> = self.lines.iter().map(Lines::without_setup).collect();
        let blocks = Blocks::new(&exact, choice, &lines, &DVector::zeros(0), &[])?;
        Some(Seen::new(&blocks.rows, &scales(question, choice, &self.state)).covariance())
    }
}

/// Changes of the parameters that would matter.
fn scales<const N: usize>(question: &Question<'_, N>, choice: &Choice, state: &State<N>) -> DVector<f64> {
    let springs = question.file.vector();
    let play = choice.has_play().then(|| state.elongation_m.abs().max(PLAY_SCALE_M));
    let mut all: Vec<f64> = springs.iter().copied().chain(play).collect();
    if choice.has_play() {
        all.extend(choice.beyond.scales(PLAY_SCALE_M, springs.as_slice()));
    }
    all.resize(springs.len() + choice.besides_springs(), HYSTERESIS_SCALE_M);
    DVector::from_vec(all)
}

/// Fits the springs of a machine to the readings of a choice.
pub(super) fn fit<const N: usize>(
    question: &Question<'_, N>,
    choice: &Choice,
    start: State<N>,
) -> Result<Solved<N>, SpringsError> {
    let mut solved = rounds(question, choice, start, MAX_ROUNDS)?;
    let factors = solved.state.springs.vector().component_div(&question.file.vector());
    // A compliance that has left the file's by orders of magnitude is a model error, not a result.
    if let Some(index) = factors.iter().position(|factor| !(1.0 / MOST_FACTOR..=MOST_FACTOR).contains(factor)) {
        let (name, _) = question.file.names().swap_remove(index);
        return Err(SpringsError::AtBound { name, factor: factors[index] });
    }
    let step_sd = solved.seen.step_sd();
    // Rounding may be all that is left.
    solved.is_settled |= step_sd < ROUNDING_SD && solved.setup_step_sd < CONVERGED_PRIOR_SD;
    if solved.is_settled { Ok(solved) } else { Err(SpringsError::NotConverged { step_sd }) }
}

/// Steps towards the fit, at most so many, until it has settled.
pub(super) fn rounds<const N: usize>(
    question: &Question<'_, N>,
    choice: &Choice,
    start: State<N>,
    most: u32,
) -> Result<Solved<N>, SpringsError> {
    let springs = question.file.count();
    let mut state = start;
    let (of_links, hysteresis) = (choice.of_links(), choice.hysteresis.len());
    if state.beyond.len() != of_links {
        state.beyond = DVector::zeros(of_links);
    }
    let mut hysteresis_m = DVector::zeros(hysteresis);
    let mut rounds = 1;
    loop {
        let mut lines = question.lines(&state, &choice.is_crossed)?;
        take_off_hysteresis(question, choice, &mut lines, &hysteresis_m);
        let mut blocks = Blocks::new(question, choice, &lines, &state.setup, &[]).ok_or(SpringsError::Noise)?;
        let scales = scales(question, choice, &state);
        if blocks.rows.degrees() < scales.len() {
            return Err(SpringsError::TooFew { readings: blocks.rows.degrees(), parameters: scales.len() });
        }
        choice.held.iter().for_each(|held| hold(&mut blocks.rows.derivatives, &scales, held));
        let seen = Seen::new(&blocks.rows, &scales);
        let step = bounded(question, &state, seen.step(0.0));
        let Eliminated { setup, loads, left } = blocks.eliminated(question, &lines, &state, &step);
        let setup_step_sd = if setup.is_empty() { 0.0 } else { setup.amax() };
        let is_settled = seen.step_sd() < CONVERGED_SD && setup_step_sd < CONVERGED_PRIOR_SD;
        if is_settled || rounds == most {
            let rows = blocks.rows;
            return Ok(Solved { state, hysteresis_m, lines, left, rows, seen, rounds, setup_step_sd, is_settled });
        }
        state.springs = state.springs.with(&(state.springs.vector() + step.rows(0, springs)))?;
        state.elongation_m += if choice.has_play() { step[springs] } else { 0.0 };
        state.beyond += step.rows((springs + 1).min(step.len() - of_links), of_links);
        hysteresis_m += step.rows(step.len() - hysteresis, hysteresis);
        state.setup += setup;
        state.loads = loads;
        rounds += 1;
    }
}

/// Makes rows blind along directions, so that no step goes along them.
fn hold(derivatives: &mut DMatrix<f64>, scales: &DVector<f64>, directions: &DMatrix<f64>) {
    let along = &*derivatives * DMatrix::from_diagonal(scales) * directions;
    *derivatives -= along * directions.transpose() * DMatrix::from_diagonal(&scales.map(f64::recip));
}

/// Readings rise with the force by half the width of the hysteresis late, and fall by as much early.
fn take_off_hysteresis<const N: usize>(
    question: &Question<'_, N>,
    choice: &Choice,
    lines: &mut [Lines],
    half_widths_m: &DVector<f64>,
) {
    for lines in lines {
        let stroke = f64::from(question.campaign.windows[lines.window].stroke);
        for (gauge, half_width_m) in choice.hysteresis.iter().zip(half_widths_m) {
            if let Some(row) = lines.gauges.iter().position(|other| other == gauge) {
                lines.misclosures[row] -= stroke * half_width_m;
            }
        }
    }
}

/// Cuts a step, so that no compliance changes by more than [`MOST_CHANGE`] nor leaves the file's by more than [`MOST_FACTOR`], and a bit.
fn bounded<const N: usize>(question: &Question<'_, N>, state: &State<N>, mut step: DVector<f64>) -> DVector<f64> {
    let most = 1.1 * MOST_FACTOR;
    for ((step, from), file) in step.iter_mut().zip(&state.springs.vector()).zip(&question.file.vector()) {
        let to = (from + *step).clamp(from / MOST_CHANGE, from * MOST_CHANGE);
        *step = to.clamp(file / most, file * most) - from;
    }
    step
}

/// Mean squares of the errors of one series, in standard deviations, per reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SeriesErrors {
    /// Of the fit.
    pub(super) fitted: f64,
    /// Of the prediction by the other series; `None` if this one shows a parameter alone.
    pub(super) left_out: Option<f64>,
}

/// Errors of each series by the fit, and by the other series: exact, by block leverages `(I - H_bb)^-1 e_b`. The constants of the set-up are
/// taken as found.
pub(super) fn series_errors<const N: usize>(
    question: &Question<'_, N>,
    choice: &Choice,
    solved: &Solved<N>,
) -> Option<Vec<SeriesErrors>> {
    let exact = Question { setup: question.setup.exact(), ..*question };
    let lines: Vec<Lines> = solved.lines.iter().map(Lines::without_setup).collect();
    let scales = scales(question, choice, &solved.state);
    let blocks = Blocks::new(&exact, choice, &lines, &DVector::zeros(0), &[])?;
    let half = Seen::new(&blocks.rows, &scales).half_covariance();
    let errors = blocks.series_rows().into_iter().map(|rows| {
        let size = rows.degrees();
        let image = &rows.derivatives * &half;
        let remaining = DMatrix::identity(size, size) - &image * image.transpose();
        let least = remaining.clone().symmetric_eigenvalues().min();
        // Alone in showing a parameter: nothing is predicted.
        let solved = (least > ALONE).then(|| remaining.cholesky().map(|factor| factor.solve(&rows.residuals)));
        let mean = |squares: f64| squares / float(size.max(1));
        SeriesErrors {
            fitted: mean(rows.chi_squared()),
            left_out: solved.flatten().map(|errors| mean(errors.norm_squared())),
        }
    });
    Some(errors.collect())
}

/// Smallest share of a direction of a series' readings that the other series leave open.
const ALONE: f64 = 1e-6;

#[cfg(test)]
mod tests;
