//! Maximum likelihood of the compliances, where gauges *and* loads are measured (the Gauss-Helmert
//! model), and what is known of the set-up has a prior.
//!
//! Minimised is `sum |y - h(c, z, w*) - zero|^2 / sigma^2 + |w - S z - w*|^2 / Sigma_w + |z|^2`
//! over the compliances `c`, the constants `z` of the set-up, the true loads `w*` and the zero of
//! each gauge in each series. (Weighted least squares at the measured loads is off by up to 0.8
//! standard deviations.) A round linearizes at `w*`:
//!
//! ```text
//! r = y - h(c, z, w*) - H (w - S z - w*),    Cov = diag(sigma^2) + H Sigma_w H^T
//! w* <- w - S z + Sigma_w H^T Cov^-1 (r - J dc - B dz - zeros)
//! ```
//!
//! with one block of `Cov` per window, whose gauges share the error of its load. Zeros and
//! constants are eliminated first.
//!
//! A step goes down the gradient of these rows, by the curvature of the same rows at the loads
//! without their noise (Fisher's scoring), which also say what the campaign shows: noise of a load
//! moves every link, and shows none.

use nalgebra::{DMatrix, DVector};

use super::active_set::ActiveSet;
use super::blocks::Blocks;
use super::linearize::{LinearizationError, LinearizedWindow};
use super::problem::SpringsProblem;
use super::state::FitState;
use crate::fit::least_squares::{Observability, Rows};
use crate::fit::statistics::float;

/// Rounds after which a fit has failed; three to five are usual.
const MAX_ROUNDS: u32 = 100;
/// Longest step of a fit that has converged, in standard deviations; of a constant of the set-up,
/// in those of its prior.
const CONVERGED_SD: f64 = 1e-4;
const CONVERGED_PRIOR_SD: f64 = 1e-3;
/// Longest step that rounding may leave, in standard deviations.
const ROUNDING_SD: f64 = 1e-3;
/// Largest change of a compliance in a round, in file's values.
const MAX_CHANGE: f64 = 20.0;
/// Compliance, in file's values, that a result is refused at: it runs away.
pub(super) const MAX_FACTOR: f64 = 100.0;
/// Smallest share of a step, least factor from one share to the next, and largest share.
const MIN_SHARE: f64 = 1e-3;
const MIN_DECREASE: f64 = 0.2;
const MAX_SHARE: f64 = 1.0;
/// Difference of shares that does not matter.
const ABOUT: f64 = 0.25;
/// Rise of chi-squared at which a step is too long: less may come from the loads, which follow a
/// step to first order.
const SURE_RISE: f64 = 0.01;
/// Elongation that is a scale of the play before one is known, and hysteresis of a gauge that would
/// matter; m.
const PLAY_SCALE_M: f64 = 20e-6;
const HYSTERESIS_SCALE_M: f64 = 10e-6;

/// Reason why a fit has failed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SpringsError {
    /// A window cannot be predicted.
    #[error(transparent)]
    Linearization(#[from] LinearizationError),
    /// A covariance is not positive.
    #[error("the noise of a window is not positive")]
    Noise,
    /// Fewer readings than unknowns.
    #[error(
        "{readings} readings, less the zeros of the gauges, are too few for {parameters} springs; measure more windows"
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
    #[error(
        "no convergence after {MAX_ROUNDS} rounds: the last step is {step_sd:.1e} standard deviations long"
    )]
    NotConverged {
        /// Length of the last step, in standard deviations.
        step_sd: f64,
    },
}

/// Springs that fit the readings of an active set.
#[derive(Clone, Debug)]
pub(super) struct Solution<const N: usize> {
    pub(super) state: FitState<N>,
    /// The campaign, linearized there.
    pub(super) linearized: Vec<LinearizedWindow>,
    /// Misclosures less the zeros, m; by window and reading.
    pub(super) left: Vec<DVector<f64>>,
    /// Rows for the parameters: compliances, play, links beyond the jump, hysteresis.
    pub(super) rows: Rows,
    /// The same at the loads without their noise: what the campaign shows.
    pub(super) shown: Rows,
    /// Directions that they see, in shares of the file's compliances, those of the active set held.
    pub(super) seen: Observability,
    /// Rounds that it took.
    pub(super) rounds: u32,
    /// Length of the step that is next, in standard deviations.
    step_sd: f64,
    /// Longest step of a constant of the set-up that is next, in standard deviations of its prior.
    setup_step_sd: f64,
    /// The next step would be none.
    pub(super) is_settled: bool,
}

impl<const N: usize> Solution<N> {
    /// Values of the parameters: compliances, elongation by the play, links beyond the jump,
    /// hysteresis.
    pub(super) fn values(&self, active: &ActiveSet) -> DVector<f64> {
        let play = active.has_play().then_some(self.state.elongation_m);
        let springs = self.state.springs.vector();
        let links = self.state.post_jump.iter().take(active.link_unknowns());
        let all = springs
            .iter()
            .copied()
            .chain(play)
            .chain(links.copied())
            .chain(self.state.hysteresis_m.iter().copied());
        DVector::from_vec(all.collect())
    }

    /// Degrees of freedom: readings that are used, less zeros and parameters.
    pub(super) fn degrees(&self) -> usize {
        self.rows.degrees().saturating_sub(self.seen.kept())
    }

    /// Covariance of the parameters if every constant of the set-up were exact.
    pub(super) fn covariance_of_noise(
        &self,
        problem: &SpringsProblem<'_, N>,
        active: &ActiveSet,
    ) -> Option<DMatrix<f64>> {
        Some(self.seen_exactly(problem, active)?.1.covariance())
    }

    /// The campaign and what it would see if every constant of the set-up were exact.
    fn seen_exactly(
        &self,
        problem: &SpringsProblem<'_, N>,
        active: &ActiveSet,
    ) -> Option<(Blocks, Observability)> {
        let linearized: Vec<LinearizedWindow> = self
            .linearized
            .iter()
            .map(|linearized| linearized.shown().without_setup())
            .collect();
        let blocks = Blocks::new(
            &problem.with_exact_setup(),
            active,
            &linearized,
            &DVector::zeros(0),
            &[],
        )?;
        let seen = Observability::but_held(
            &blocks.rows,
            &scales(problem, active, &self.state),
            active.held.as_ref(),
        );
        Some((blocks, seen))
    }
}

/// Changes of the parameters that would matter.
pub(super) fn scales<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    active: &ActiveSet,
    state: &FitState<N>,
) -> DVector<f64> {
    let springs = &problem.relative_to;
    let play = active
        .has_play()
        .then(|| state.elongation_m.abs().max(PLAY_SCALE_M));
    let mut all: Vec<f64> = springs.iter().copied().chain(play).collect();
    if active.has_play() {
        all.extend(active.post_jump.scales(PLAY_SCALE_M, springs.as_slice()));
    }
    all.resize(
        springs.len() + active.further_unknowns(),
        HYSTERESIS_SCALE_M,
    );
    DVector::from_vec(all)
}

/// Fits the springs of a machine to the readings of an active set.
pub(super) fn fit<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    active: &ActiveSet,
    start: FitState<N>,
) -> Result<Solution<N>, SpringsError> {
    let mut solution = rounds(problem, active, start, MAX_ROUNDS)?;
    let factors = solution
        .state
        .springs
        .vector()
        .component_div(&problem.file.vector());
    // A compliance that has left the file's by orders of magnitude is a model error, not a result.
    if let Some(index) = factors.iter().position(|factor| factor.abs() > MAX_FACTOR) {
        let (name, _) = problem.file.names().swap_remove(index);
        return Err(SpringsError::AtBound {
            name,
            factor: factors[index],
        });
    }
    // Rounding may be all that is left.
    solution.is_settled |=
        solution.step_sd < ROUNDING_SD && solution.setup_step_sd < CONVERGED_PRIOR_SD;
    if solution.is_settled {
        Ok(solution)
    } else {
        Err(SpringsError::NotConverged {
            step_sd: solution.step_sd,
        })
    }
}

/// Steps towards the fit, at most so many linearizations, until it has settled.
pub(super) fn rounds<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    active: &ActiveSet,
    start: FitState<N>,
    most: u32,
) -> Result<Solution<N>, SpringsError> {
    let mut here = LinearizedCampaign::new(problem, active, start.sized(active))?;
    let mut rounds = 1;
    let mut share = 1.0;
    loop {
        let step = bounded(
            problem,
            &here.state,
            here.seen.scored_step(&here.blocks.rows),
        );
        let eliminated = here
            .blocks
            .eliminated(problem, &here.linearized, &here.state, &step);
        let setup_step_sd = if eliminated.setup.is_empty() {
            0.0
        } else {
            eliminated.setup.amax()
        };
        let step_sd = here.seen.scored_step_sd(&here.blocks.rows);
        let is_settled = step_sd < CONVERGED_SD && setup_step_sd < CONVERGED_PRIOR_SD;
        if is_settled || rounds == most {
            let LinearizedCampaign {
                state,
                linearized,
                blocks,
                shown,
                seen,
            } = here;
            return Ok(Solution {
                state,
                linearized,
                left: eliminated.left,
                rows: blocks.rows,
                shown,
                seen,
                rounds,
                step_sd,
                setup_step_sd,
                is_settled,
            });
        }
        (here, share) = forward(problem, active, &here, &step, share)?;
        rounds += 1;
    }
}

/// A campaign at a state.
struct LinearizedCampaign<const N: usize> {
    state: FitState<N>,
    linearized: Vec<LinearizedWindow>,
    blocks: Blocks,
    shown: Rows,
    seen: Observability,
}

impl<const N: usize> LinearizedCampaign<N> {
    fn new(
        problem: &SpringsProblem<'_, N>,
        active: &ActiveSet,
        state: FitState<N>,
    ) -> Result<Self, SpringsError> {
        let mut linearized = problem.linearize(&state, &active.is_crossed)?;
        take_off_hysteresis(problem, active, &mut linearized, &state.hysteresis_m);
        // Links beyond the jump have lines of their own under large forces only, which their noise
        // does not matter to. Elsewhere the derivatives at the loads without their noise are
        // carried along.
        let without_noise: Vec<DMatrix<f64>> = if active.link_unknowns() > 0 {
            Vec::new()
        } else {
            let windows = linearized.iter();
            windows.map(|window| window.springs_shown.clone()).collect()
        };
        let blocks = Blocks::new(problem, active, &linearized, &state.setup, &without_noise)
            .ok_or(SpringsError::Noise)?;
        let scales = scales(problem, active, &state);
        if blocks.rows.degrees() < scales.len() {
            return Err(SpringsError::TooFew {
                readings: blocks.rows.degrees(),
                parameters: scales.len(),
            });
        }
        let mut shown = blocks.rows.clone();
        shown
            .derivatives
            .columns_mut(0, blocks.extras.ncols())
            .copy_from(&blocks.extras);
        let seen = Observability::but_held(&shown, &scales, active.held.as_ref());
        Ok(Self {
            state,
            linearized,
            blocks,
            shown,
            seen,
        })
    }

    /// The state after a share of a step.
    fn stepped(
        &self,
        problem: &SpringsProblem<'_, N>,
        active: &ActiveSet,
        step: &DVector<f64>,
        share: f64,
    ) -> FitState<N> {
        let step = step * share;
        let eliminated = self
            .blocks
            .eliminated(problem, &self.linearized, &self.state, &step);
        self.state.stepped(active, &step, eliminated)
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

/// Goes a share of a whole step, or a smaller one if that one leads upwards or where a window has
/// no equilibrium. Returns the share that would have been best, too, for the next step: noise of
/// loads that is known badly makes whole steps too long, or too short, round after round.
fn forward<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    active: &ActiveSet,
    here: &LinearizedCampaign<N>,
    step: &DVector<f64>,
    mut share: f64,
) -> Result<(LinearizedCampaign<N>, f64), SpringsError> {
    loop {
        let there =
            LinearizedCampaign::new(problem, active, here.stepped(problem, active, step, share));
        let is_last = share < MIN_SHARE;
        let there = match there {
            Err(_) if !is_last => {
                share *= MIN_DECREASE;
                continue;
            }
            there => there?,
        };
        // The slope along the step changes in proportion to the way.
        let left = there.slope(step) / here.slope(step);
        let best = if left < 1.0 {
            (share / (1.0 - left)).min(MAX_SHARE)
        } else {
            MAX_SHARE
        };
        if there.chi_squared() <= here.chi_squared() + SURE_RISE || is_last {
            let next = best.max(MIN_DECREASE * share);
            return Ok((
                there,
                if (next - 1.0).abs() < ABOUT {
                    1.0
                } else {
                    next
                },
            ));
        }
        share *= (best / share).clamp(MIN_DECREASE, 0.5);
    }
}

/// Readings rise with the force by half the width of the hysteresis late, and fall by as much
/// early.
fn take_off_hysteresis<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    active: &ActiveSet,
    linearized: &mut [LinearizedWindow],
    half_widths_m: &DVector<f64>,
) {
    for linearized in linearized {
        let stroke = f64::from(problem.campaign.windows[linearized.window].stroke);
        for (gauge, half_width_m) in active.hysteresis.iter().zip(half_widths_m) {
            if let Some(row) = linearized.row_of(*gauge) {
                linearized.misclosures[row] -= stroke * half_width_m;
            }
        }
    }
}

/// Cuts a step, so that no compliance changes by more than [`MAX_CHANGE`] nor leaves the file's by
/// more than [`MAX_FACTOR`], and a bit.
fn bounded<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    state: &FitState<N>,
    mut step: DVector<f64>,
) -> DVector<f64> {
    let most = 1.1 * MAX_FACTOR;
    for ((step, from), file) in step
        .iter_mut()
        .zip(&state.springs.vector())
        .zip(&problem.file.vector())
    {
        let to = from + step.clamp(-MAX_CHANGE * file, MAX_CHANGE * file);
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

/// Errors of each series by the fit, and by the other series: exact, by block leverages
/// `(I - H_bb)^-1 e_b`. The constants of the set-up are taken as found.
pub(super) fn series_errors<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    active: &ActiveSet,
    solution: &Solution<N>,
) -> Option<Vec<SeriesErrors>> {
    let (blocks, seen) = solution.seen_exactly(problem, active)?;
    let half = seen.half_covariance();
    let errors = blocks.series_rows().into_iter().map(|rows| {
        let size = rows.degrees();
        let image = &rows.derivatives * &half;
        let remaining = DMatrix::identity(size, size) - &image * image.transpose();
        let least = remaining.clone().symmetric_eigenvalues().min();
        // Alone in showing a parameter: nothing is predicted.
        let solution = (least > ALONE).then(|| {
            remaining
                .cholesky()
                .map(|factor| factor.solve(&rows.residuals))
        });
        let readings = float(size.max(1));
        SeriesErrors {
            fitted: rows.chi_squared() / readings,
            left_out: solution
                .flatten()
                .map(|errors| errors.norm_squared() / readings),
        }
    });
    Some(errors.collect())
}

/// Smallest share of a direction of a series' readings that the other series leave open.
const ALONE: f64 = 1e-6;

#[cfg(test)]
mod tests;
