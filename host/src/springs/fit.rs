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
//!
//! A step goes down the gradient of these rows, by the curvature of the same rows at the loads without their noise (Fisher's scoring), which also say
//! what the campaign shows: noise of a load moves every link, and shows none.

use nalgebra::{DMatrix, DVector};

use super::blocks::Blocks;
use super::choice::Choice;
use super::lines::{Lines, LinesError, Question, State};
use crate::fit::least_squares::{Rows, Seen};
use crate::fit::statistics::float;

/// Rounds after which a fit has failed; three to five are usual.
const MAX_ROUNDS: u32 = 100;
/// Longest step of a fit that has converged, in standard deviations; of a constant of the set-up, in those of its prior.
const CONVERGED_SD: f64 = 1e-4;
const CONVERGED_PRIOR_SD: f64 = 1e-3;
/// Longest step that rounding may leave, in standard deviations.
const ROUNDING_SD: f64 = 1e-3;
/// Largest change of a compliance in a round, in file's values.
const MOST_CHANGE: f64 = 20.0;
/// Compliance, in file's values, that a result is refused at: it runs away.
pub(super) const MOST_FACTOR: f64 = 100.0;
/// Smallest share of a step, least factor from one share to the next, and largest share.
const LEAST_SHARE: f64 = 1e-3;
const LEAST_DECREASE: f64 = 0.2;
const MOST_SHARE: f64 = 1.0;
/// Difference of shares that does not matter.
const ABOUT: f64 = 0.25;
/// Rise of chi-squared at which a step is too long: less may come from the loads, which follow a step to first order.
const SURE_RISE: f64 = 0.01;
/// Elongation that is a scale of the play before one is known, and hysteresis of a gauge that would matter; m.
const PLAY_SCALE_M: f64 = 20e-6;
const HYSTERESIS_SCALE_M: f64 = 10e-6;

/// Reason why there is no fit.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SpringsError {
    /// A window cannot be predicted.
    #[error(transparent)]
    Lines(#[from] LinesError),
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
    /// A compliance that runs away: the model is wrong.
    #[error(
        "{name} is {factor:.1e} times that of the robot file: the model does not fit the readings; check signs and units of gauges and forces"
    )]
    AtBound {
        /// Key and index of the spring.
        name: String,
        /// Value, in file's values.
        factor: f64,
    },
    /// A compliance that is negative by more than its uncertainty: the model is wrong.
    #[error(
        "the best value of {name} would be negative, {factor:.2} +- {sd:.2} of the robot file's: the model does not fit the readings; check signs and units of gauges and forces, of gauge {gauge} first"
    )]
    Negative {
        /// Key and index of the spring.
        name: String,
        /// Value, in file's values.
        factor: f64,
        /// Its standard deviation, in file's values.
        sd: f64,
        /// The gauge that contradicts a positive one most.
        gauge: String,
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
    /// The campaign, linearised there.
    pub(super) lines: Vec<Lines>,
    /// Misclosures less the zeros, m; by window and row of its lines.
    pub(super) left: Vec<DVector<f64>>,
    /// Rows for the parameters: compliances, play, links beyond the jump, hysteresis.
    pub(super) rows: Rows,
    /// The same at the loads without their noise: what the campaign shows.
    pub(super) shown: Rows,
    /// Directions that they see, in shares of the file's compliances, those of the choice held.
    pub(super) seen: Seen,
    /// Rounds that it took.
    pub(super) rounds: u32,
    /// Length of the step that is next, in standard deviations.
    step_sd: f64,
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
        let all =
            springs.iter().copied().chain(play).chain(links.copied()).chain(self.state.hysteresis_m.iter().copied());
        DVector::from_vec(all.collect())
    }

    /// Degrees of freedom: readings that are used, less zeros and parameters.
    pub(super) fn degrees(&self) -> usize {
        self.rows.degrees().saturating_sub(self.seen.kept())
    }

    /// Covariance of the parameters if every constant of the set-up were exact.
    pub(super) fn covariance_of_noise(&self, question: &Question<'_, N>, choice: &Choice) -> Option<DMatrix<f64>> {
        Some(self.seen_exactly(question, choice)?.1.covariance())
    }

    /// The campaign and what it would see if every constant of the set-up were exact.
    fn seen_exactly(&self, question: &Question<'_, N>, choice: &Choice) -> Option<(Blocks, Seen)> {
        let lines: Vec<Lines> = self.lines.iter().map(|lines| lines.shown().without_setup()).collect();
        let blocks = Blocks::new(&question.exact(), choice, &lines, &DVector::zeros(0), &[])?;
        let seen = Seen::but_held(&blocks.rows, &scales(question, choice, &self.state), choice.held.as_ref());
        Some((blocks, seen))
    }
}

/// Changes of the parameters that would matter.
pub(super) fn scales<const N: usize>(question: &Question<'_, N>, choice: &Choice, state: &State<N>) -> DVector<f64> {
    let springs = &question.relative_to;
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
    if let Some(index) = factors.iter().position(|factor| factor.abs() > MOST_FACTOR) {
        let (name, _) = question.file.names().swap_remove(index);
        return Err(SpringsError::AtBound { name, factor: factors[index] });
    }
    // Rounding may be all that is left.
    solved.is_settled |= solved.step_sd < ROUNDING_SD && solved.setup_step_sd < CONVERGED_PRIOR_SD;
    if solved.is_settled { Ok(solved) } else { Err(SpringsError::NotConverged { step_sd: solved.step_sd }) }
}

/// Steps towards the fit, at most so many linearisations, until it has settled.
pub(super) fn rounds<const N: usize>(
    question: &Question<'_, N>,
    choice: &Choice,
    start: State<N>,
    most: u32,
) -> Result<Solved<N>, SpringsError> {
    let mut here = Linearised::new(question, choice, start.sized(choice))?;
    let (mut rounds, mut share) = (1, 1.0);
    loop {
        let step = bounded(question, &here.state, here.seen.scored_step(&here.blocks.rows));
        let eliminated = here.blocks.eliminated(question, &here.lines, &here.state, &step);
        let setup_step_sd = if eliminated.setup.is_empty() { 0.0 } else { eliminated.setup.amax() };
        let step_sd = here.seen.scored_step_sd(&here.blocks.rows);
        let is_settled = step_sd < CONVERGED_SD && setup_step_sd < CONVERGED_PRIOR_SD;
        if is_settled || rounds == most {
            let Linearised { state, lines, blocks, shown, seen } = here;
            let (rows, left) = (blocks.rows, eliminated.left);
            return Ok(Solved { state, lines, left, rows, shown, seen, rounds, step_sd, setup_step_sd, is_settled });
        }
        (here, share) = forward(question, choice, &here, &step, share)?;
        rounds += 1;
    }
}

/// A campaign at a state.
struct Linearised<const N: usize> {
    state: State<N>,
    lines: Vec<Lines>,
    blocks: Blocks,
    shown: Rows,
    seen: Seen,
}

impl<const N: usize> Linearised<N> {
    fn new(question: &Question<'_, N>, choice: &Choice, state: State<N>) -> Result<Self, SpringsError> {
        let mut lines = question.lines(&state, &choice.is_crossed)?;
        take_off_hysteresis(question, choice, &mut lines, &state.hysteresis_m);
        let blocks = Blocks::new(question, choice, &lines, &state.setup, &[]).ok_or(SpringsError::Noise)?;
        let scales = scales(question, choice, &state);
        if blocks.rows.degrees() < scales.len() {
            return Err(SpringsError::TooFew { readings: blocks.rows.degrees(), parameters: scales.len() });
        }
        // Links beyond the jump have lines of their own under large forces only, which their noise does not matter to.
        let shown = if choice.of_links() > 0 {
            blocks.rows.clone()
        } else {
            let shown: Vec<Lines> = lines.iter().map(Lines::shown).collect();
            Blocks::new(question, choice, &shown, &state.setup, &[]).ok_or(SpringsError::Noise)?.rows
        };
        let seen = Seen::but_held(&shown, &scales, choice.held.as_ref());
        Ok(Self { state, lines, blocks, shown, seen })
    }

    /// The state after a share of a step.
    fn stepped(&self, question: &Question<'_, N>, choice: &Choice, step: &DVector<f64>, share: f64) -> State<N> {
        let step = step * share;
        let eliminated = self.blocks.eliminated(question, &self.lines, &self.state, &step);
        self.state.stepped(choice, &step, eliminated)
    }

    fn chi_squared(&self) -> f64 {
        self.blocks.rows.chi_squared()
    }

    /// Slope of half of chi-squared along a step, downwards.
    fn slope(&self, step: &DVector<f64>) -> f64 {
        let rows = &self.blocks.rows;
        (&rows.derivatives * step).dot(&rows.residuals)
    }
}

/// Goes a share of a whole step, or a smaller one if that one leads upwards or where a window has no equilibrium. Returns the share that would have
/// been best, too, for the next step: noise of loads that is known badly makes whole steps too long, or too short, round after round.
fn forward<const N: usize>(
    question: &Question<'_, N>,
    choice: &Choice,
    here: &Linearised<N>,
    step: &DVector<f64>,
    mut share: f64,
) -> Result<(Linearised<N>, f64), SpringsError> {
    loop {
        let there = Linearised::new(question, choice, here.stepped(question, choice, step, share));
        let is_last = share < LEAST_SHARE;
        let there = match there {
            Err(_) if !is_last => {
                share *= LEAST_DECREASE;
                continue;
            }
            there => there?,
        };
        // The slope along the step changes in proportion to the way.
        let left = there.slope(step) / here.slope(step);
        let best = if left < 1.0 { (share / (1.0 - left)).min(MOST_SHARE) } else { MOST_SHARE };
        if there.chi_squared() <= here.chi_squared() + SURE_RISE || is_last {
            let next = best.max(LEAST_DECREASE * share);
            return Ok((there, if (next - 1.0).abs() < ABOUT { 1.0 } else { next }));
        }
        share *= (best / share).clamp(LEAST_DECREASE, 0.5);
    }
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
        let to = from + step.clamp(-MOST_CHANGE * file, MOST_CHANGE * file);
        *step = to.clamp(-most * file, most * file) - from;
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
    let (blocks, seen) = solved.seen_exactly(question, choice)?;
    let half = seen.half_covariance();
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
