//! Readings that agree with each other.
//!
//! Each reading is compared with what the others of its window, with which it shares the error of
//! the load, predict. Readings that are far off are found with weights that forgive them (Huber
//! once, then Tukey's biweight); the estimate is then made without them, and with the full weight
//! of all others, so that it is the maximum likelihood of what is left and its intervals are right.
//! A gauge that stays shifted from a window on was moved: it gets another zero from there, and is
//! one event.

use nalgebra::{DMatrix, DVector};

use super::active_set::{ActiveSet, Shift};
use super::fit::{Solution, SpringsError, fit, rounds};
use super::linearize::LinearizedWindow;
use super::problem::SpringsProblem;
use super::state::FitState;
use crate::fit::statistics::{float, median};

/// Deviations beyond which Huber's weights fall; beyond which Tukey's are zero, and a reading is
/// refused. Usual constants: 95 % efficiency.
const HUBER: f64 = 1.345;
pub(super) const TUKEY: f64 = 4.685;
/// Median of the magnitudes to standard deviation, of normal deviations.
const MAD: f64 = 1.4826;
/// Rounds of weights, steps of the fit before the first, and between two.
const MAX_ROUNDS: u32 = 12;
const FIRST_STEPS: u32 = 4;
const STEPS: u32 = 2;
/// Smallest step of a gauge that was moved, in standard deviations, and smallest number of readings
/// on either side of it.
const MIN_SHIFT: f64 = 6.0;
const MIN_READINGS: usize = 4;
/// Share of the readings beside a step that agree with their own side.
const AGREEING: f64 = 0.9;
/// Largest number of gauges that were moved.
const MAX_SHIFTS: usize = 20;

/// A fit, and what it leaves out.
#[derive(Clone, Debug)]
pub(super) struct RobustFit<const N: usize> {
    pub(super) solution: Solution<N>,
    pub(super) active: ActiveSet,
    /// Readings that do not agree: window and gauge.
    pub(super) refused: Vec<(usize, usize)>,
}

impl<const N: usize> RobustFit<N> {
    /// Fits; leaves out what does not agree only if `is_robust`.
    pub(super) fn find(
        problem: &SpringsProblem<'_, N>,
        active: &ActiveSet,
        start: FitState<N>,
        is_robust: bool,
    ) -> Result<Self, SpringsError> {
        if is_robust {
            return fit_agreeing(problem, active, start);
        }
        Ok(Self {
            solution: fit(problem, active, start)?,
            active: active.clone(),
            refused: Vec::new(),
        })
    }

    /// Chi-squared, with every refused reading and every moved gauge at the limit: what fits with
    /// different choices are compared by.
    pub(super) fn cost(&self) -> f64 {
        let events = self.refused.len() + self.active.shifts.len();
        self.solution.rows.chi_squared() + TUKEY * TUKEY * float(events)
    }
}

/// Fits, and leaves out what does not agree. `active`: readings with weight 0 take no part, neither
/// now nor later.
pub(super) fn fit_agreeing<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    active: &ActiveSet,
    start: FitState<N>,
) -> Result<RobustFit<N>, SpringsError> {
    let mut active = active.clone();
    let possible = active.weights.clone();
    let mut solution = forgiving(problem, &mut active, &possible, start)?;
    while active.shifts.len() < MAX_SHIFTS {
        let deviations = deviations(problem, &active, &solution);
        let scale = scale(&deviations, &possible);
        let Some(shift) = largest_shift(problem, &active, &possible, &deviations, scale) else {
            break;
        };
        active.shifts.push(shift);
        active.weights.clone_from(&possible);
        solution = forgiving(problem, &mut active, &possible, solution.state)?;
    }
    for _ in 0..MAX_ROUNDS {
        let deviations = deviations(problem, &active, &solution);
        let scale = scale(&deviations, &possible);
        let weights = weighted(&possible, &deviations, |deviation| {
            if deviation.abs() <= TUKEY * scale {
                1.0
            } else {
                0.0
            }
        });
        let is_settled = weights == active.weights && solution.is_settled;
        active.weights = weights;
        if is_settled {
            break;
        }
        solution = fit(problem, &active, solution.state)?;
    }
    let refused = (active.weights.iter().zip(&possible).enumerate())
        .flat_map(|(window, (used, possible))| {
            let pairs = used.iter().zip(possible).enumerate();
            pairs
                .filter(|(_, (used, possible))| **used <= 0.0 && **possible > 0.0)
                .map(move |(gauge, _)| (window, gauge))
        })
        .filter(|(window, gauge)| problem.campaign.windows[*window].readings_m[*gauge].is_some())
        .collect();
    Ok(RobustFit {
        solution,
        active,
        refused,
    })
}

/// Fits with weights that forgive readings that are far off, and leaves these weights in the active
/// set.
fn forgiving<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    active: &mut ActiveSet,
    possible: &[Vec<f64>],
    start: FitState<N>,
) -> Result<Solution<N>, SpringsError> {
    // Nothing need settle while the weights change.
    let mut solution = rounds(problem, active, start, FIRST_STEPS)?;
    for round in 0..MAX_ROUNDS {
        let deviations = deviations(problem, active, &solution);
        let scale = scale(&deviations, possible);
        let weight: fn(f64) -> f64 = if round == 0 { huber } else { tukey };
        let weights = weighted(possible, &deviations, |deviation| weight(deviation / scale));
        let is_settled = round > 1 && zeros(&weights) == zeros(&active.weights);
        active.weights = weights;
        if is_settled {
            break;
        }
        solution = rounds(problem, active, solution.state, STEPS)?;
    }
    Ok(solution)
}

fn huber(deviation: f64) -> f64 {
    (HUBER / deviation.abs()).min(1.0)
}

fn tukey(deviation: f64) -> f64 {
    (1.0 - (deviation / TUKEY).powi(2)).max(0.0).powi(2)
}

fn zeros(weights: &[Vec<f64>]) -> Vec<bool> {
    weights
        .iter()
        .flatten()
        .map(|weight| *weight <= 0.0)
        .collect()
}

/// Weights of the deviations; those that are not possible stay zero.
fn weighted(
    possible: &[Vec<f64>],
    deviations: &[Vec<f64>],
    weight: impl Fn(f64) -> f64,
) -> Vec<Vec<f64>> {
    let windows = possible.iter().zip(deviations);
    windows
        .map(|(possible, deviations)| {
            let readings = possible.iter().zip(deviations);
            readings
                .map(|(possible, deviation)| possible * weight(*deviation))
                .collect()
        })
        .collect()
}

/// Standard deviation that most of the deviations say, at least that of the stated noise.
fn scale(deviations: &[Vec<f64>], possible: &[Vec<f64>]) -> f64 {
    let pairs = deviations.iter().flatten().zip(possible.iter().flatten());
    let all = pairs.filter(|(deviation, possible)| **possible > 0.0 && !deviation.is_nan());
    (MAD * median(all.map(|(deviation, _)| deviation.abs()).collect())).max(1.0)
}

/// Deviation of each reading from what the other readings of its window predict, in standard
/// deviations; by window and gauge, NaN without a reading.
pub(super) fn deviations<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    active: &ActiveSet,
    solution: &Solution<N>,
) -> Vec<Vec<f64>> {
    let load_variances = DMatrix::from_diagonal(&DVector::from_column_slice(
        problem.load_variances().as_slice(),
    ));
    let gauges = problem.campaign.gauges.len();
    let windows = solution.linearized.iter().zip(&solution.left);
    windows
        .map(|(linearized, left)| {
            let shared = &linearized.load * &load_variances * linearized.load.transpose();
            let weights = &active.weights[linearized.window];
            let mut deviations = vec![f64::NAN; gauges];
            for (row, gauge) in linearized.gauges.iter().enumerate() {
                deviations[*gauge] = deviation(linearized, left, &shared, weights, row);
            }
            deviations
        })
        .collect()
}

/// Deviation of one reading. `shared`: covariance of the readings by the error of the load;
/// `weights`: those of the window's gauges.
fn deviation(
    linearized: &LinearizedWindow,
    left: &DVector<f64>,
    shared: &DMatrix<f64>,
    weights: &[f64],
    row: usize,
) -> f64 {
    let others: Vec<usize> = (0..linearized.gauges.len())
        .filter(|other| *other != row && weights[linearized.gauges[*other]] > 0.0)
        .collect();
    let mut covariance = shared.select_rows(&others).select_columns(&others);
    for (place, other) in others.iter().enumerate() {
        covariance[(place, place)] +=
            linearized.variances[*other] / weights[linearized.gauges[*other]];
    }
    let with_others = shared.column(row).select_rows(&others);
    let mut expected = 0.0;
    let mut variance = shared[(row, row)] + linearized.variances[row];
    if let Some(factor) = covariance.cholesky() {
        let shares = factor.solve(&with_others);
        expected = shares.dot(&left.select_rows(&others));
        variance -= shares.dot(&with_others);
    }
    (left[row] - expected) / variance.sqrt()
}

/// Returns the largest step of a gauge within a series that stays to the end of the series.
fn largest_shift<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    active: &ActiveSet,
    possible: &[Vec<f64>],
    deviations: &[Vec<f64>],
    scale: f64,
) -> Option<Shift> {
    let campaign = problem.campaign;
    let mut largest: Option<(f64, Shift)> = None;
    for series in 0..campaign.series.len() {
        let windows: Vec<usize> = (0..campaign.windows.len())
            .filter(|window| campaign.windows[*window].series == series)
            .collect();
        for gauge in 0..campaign.gauges.len() {
            if active
                .shifts
                .iter()
                .any(|shift| (shift.series, shift.gauge) == (series, gauge))
            {
                continue;
            }
            let read: Vec<usize> = windows
                .iter()
                .copied()
                .filter(|window| {
                    possible[*window][gauge] > 0.0 && !deviations[*window][gauge].is_nan()
                })
                .collect();
            let values: Vec<f64> = read
                .iter()
                .map(|window| deviations[*window][gauge] / scale)
                .collect();
            let Some((first, size)) = step(&values) else {
                continue;
            };
            if largest.is_none_or(|(other, _)| size > other) {
                largest = Some((
                    size,
                    Shift {
                        series,
                        gauge,
                        window: read[first],
                    },
                ));
            }
        }
    }
    largest.map(|(_, shift)| shift)
}

/// Finds a step in a sequence: index of the first value behind it, and its size.
fn step(values: &[f64]) -> Option<(usize, f64)> {
    let count = values.len();
    let best = (MIN_READINGS..count.saturating_sub(MIN_READINGS - 1)).filter_map(|first| {
        let (before, behind) = values.split_at_checked(first)?;
        let [low, high] = [median(before.to_vec()), median(behind.to_vec())];
        let size = (high - low).abs();
        let is_step = is_agreeing(before, low) && is_agreeing(behind, high);
        (is_step && size > MIN_SHIFT)
            .then(|| (spread(before, low) + spread(behind, high), first, size))
    });
    best.min_by(|(one, ..), (other, ..)| one.total_cmp(other))
        .map(|(_, first, size)| (first, size))
}

/// Sum of the distances of values from their middle.
fn spread(side: &[f64], middle: f64) -> f64 {
    side.iter().map(|value| (value - middle).abs()).sum()
}

/// True if most of the values agree with their middle.
fn is_agreeing(side: &[f64], middle: f64) -> bool {
    let agreeing = side
        .iter()
        .filter(|value| (**value - middle).abs() <= TUKEY)
        .count();
    float(agreeing) >= AGREEING * float(side.len())
}

#[cfg(test)]
mod tests;
