//! Lack of fit: what repeats at one level leave is noise under any model; what the levels leave
//! beyond that is the model's.
//!
//! Within a level only the differences of deviations count, so that a load that was not quite the
//! same, and is known, does no harm.

use gantry_tau_system::output::Name;
use nalgebra::{DMatrix, DVector};

use super::levels::levels;
use crate::fit::goodness::MIN_P;
use crate::fit::least_squares::{Rows, eliminated};
use crate::fit::statistics::{f_above, float};
use crate::measurements::springs::Campaign;
use crate::springs::active_set::ActiveSet;
use crate::springs::blocks::Blocks;
use crate::springs::linearize::LinearizedWindow;
use crate::springs::problem::SpringsProblem;
use crate::springs::robust_fit::{RobustFit, deviations};

/// Chi-squared of a campaign, split by its repeats.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct LackOfFit {
    /// Of repeats about their level: pure error.
    pub(super) pure: SumOfSquares,
    /// Of the levels about the model: lack of fit.
    pub(super) lack: SumOfSquares,
    /// Gauges whose lack of fit stands out, the worst first.
    pub(super) standing_out: Vec<usize>,
}

/// A sum of squares, in stated standard deviations, with its degrees of freedom.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct SumOfSquares {
    pub(super) chi2: f64,
    pub(super) degrees: usize,
}

impl SumOfSquares {
    pub(super) fn mean(self) -> f64 {
        self.chi2 / float(self.degrees)
    }
}

impl LackOfFit {
    /// Splits chi-squared of a fit; `None` if nothing was repeated, or if levels are no more than
    /// unknowns.
    pub(super) fn of<const N: usize>(
        problem: &SpringsProblem<'_, N>,
        robust_fit: &RobustFit<N>,
    ) -> Option<Self> {
        let RobustFit {
            solution, active, ..
        } = robust_fit;
        let levels = crossed_apart(&levels(problem.campaign, solution), &active.is_crossed);
        let pure = pure_error(problem, robust_fit, &levels)?;
        let lack = SumOfSquares {
            chi2: solution.rows.chi_squared() - pure.chi2,
            degrees: solution.degrees().saturating_sub(pure.degrees),
        };
        if pure.degrees == 0 || lack.degrees == 0 {
            return None;
        }
        let standing_out = standing_out(problem, robust_fit, &levels, pure);
        Some(Self {
            pure,
            lack,
            standing_out,
        })
    }

    /// Ratio of lack of fit to pure error.
    pub(super) fn f(&self) -> f64 {
        self.lack.mean().max(0.0) / self.pure.mean()
    }

    /// Probability of such a ratio, or a larger one, if the model is right.
    pub(super) fn p(&self) -> f64 {
        f_above(self.f(), self.lack.degrees, self.pure.degrees)
    }
}

/// Levels on either side of the jump are not the same.
fn crossed_apart(levels: &[usize], is_crossed: &[bool]) -> Vec<usize> {
    levels
        .iter()
        .zip(is_crossed)
        .map(|(level, is_crossed)| 2 * level + usize::from(*is_crossed))
        .collect()
}

/// Deviations that remain if every gauge has a zero at every level, and its drift in every series
/// if that is fitted.
fn pure_error<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    robust_fit: &RobustFit<N>,
    levels: &[usize],
) -> Option<SumOfSquares> {
    let RobustFit {
        solution, active, ..
    } = robust_fit;
    let mut campaign = problem.campaign.clone();
    let mut names: Vec<usize> = levels.to_vec();
    names.sort_unstable();
    names.dedup();
    // Series of each level.
    let mut owners = vec![0; names.len()];
    for (window, level) in campaign.windows.iter_mut().zip(levels) {
        let index = names.binary_search(level).unwrap_or_default();
        owners[index] = window.series;
        window.series = index;
    }
    campaign.series = names.iter().map(Name::made).collect();
    let by_level = problem.with_campaign(&campaign).with_exact_setup();
    let active = ActiveSet {
        weights: active.weights.clone(),
        ..ActiveSet::all(&campaign)
    };
    let linearized = solution.linearized.iter().zip(&solution.left);
    // The columns of the drifts take the place of those of the springs.
    let linearized: Vec<LinearizedWindow> = linearized
        .map(|(linearized, left)| LinearizedWindow {
            misclosures: left.clone(),
            springs: drifts(problem, robust_fit, linearized),
            ..linearized.without_setup()
        })
        .collect();
    let of_levels =
        Blocks::new(&by_level, &active, &linearized, &DVector::zeros(0), &[])?.series_rows();
    let mut pure = SumOfSquares::default();
    for series in 0..problem.campaign.series.len() {
        let own = of_levels
            .iter()
            .zip(&owners)
            .filter(|(_, owner)| **owner == series)
            .map(|(rows, _)| rows);
        let Rows {
            residuals,
            derivatives,
        } = Rows::stacked(&own.collect::<Vec<_>>());
        let left = eliminated(derivatives, DMatrix::from_columns(&[residuals]));
        pure.chi2 += left.norm_squared();
        pure.degrees += left.nrows();
    }
    Some(pure)
}

/// Readings of a window by the drifts of the gauges, s; no column if none is fitted.
fn drifts<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    robust_fit: &RobustFit<N>,
    linearized: &LinearizedWindow,
) -> DMatrix<f64> {
    let gauges = if robust_fit.active.has_drift {
        problem.campaign.gauges.len()
    } else {
        0
    };
    let seconds = problem.campaign.windows[linearized.window]
        .time_s
        .unwrap_or_default();
    DMatrix::from_fn(linearized.gauges.len(), gauges, |row, gauge| {
        if linearized.gauges[row] == gauge {
            seconds
        } else {
            0.0
        }
    })
}

/// Gauges whose means at the levels deviate by more than the pure error of all explains, the worst
/// first.
fn standing_out<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    robust_fit: &RobustFit<N>,
    levels: &[usize],
    pure: SumOfSquares,
) -> Vec<usize> {
    let campaign = problem.campaign;
    let deviations = deviations(problem, &robust_fit.active, &robust_fit.solution);
    let gauges = campaign.gauges.len();
    let mut worst: Vec<(f64, usize)> = (0..gauges)
        .map(|gauge| {
            let lack = lack_of_gauge(campaign, &robust_fit.active, &deviations, levels, gauge);
            (lack, gauge)
        })
        .filter(|(lack, _)| lack.degrees > 0)
        .map(|(lack, gauge)| (lack.mean() / pure.mean(), lack.degrees, gauge))
        .filter(|(f, degrees, _)| f_above(*f, *degrees, pure.degrees) * float(gauges) < MIN_P)
        .map(|(f, _, gauge)| (f, gauge))
        .collect();
    worst.sort_by(|(one, _), (other, _)| other.total_cmp(one));
    worst.into_iter().map(|(_, gauge)| gauge).collect()
}

/// Squares of the mean deviations of a gauge at the levels; its zeros take degrees of freedom.
fn lack_of_gauge<const N: usize>(
    campaign: &Campaign<N>,
    active: &ActiveSet,
    deviations: &[Vec<f64>],
    levels: &[usize],
    gauge: usize,
) -> SumOfSquares {
    let count = levels.iter().max().map_or(0, |most| most + 1);
    // Per level: sum of the deviations and their number.
    let mut sums = DMatrix::<f64>::zeros(count, 2);
    let mut series = vec![false; campaign.series.len()];
    for (window, level) in levels.iter().enumerate() {
        let deviation = deviations[window][gauge];
        if active.weights[window][gauge] > 0.0 && !deviation.is_nan() {
            sums[(*level, 0)] += deviation;
            sums[(*level, 1)] += 1.0;
            series[campaign.windows[window].series] = true;
        }
    }
    let read = sums.row_iter().filter(|sum| sum[1] > 0.0);
    let chi2 = read.clone().map(|sum| sum[0] * sum[0] / sum[1]).sum();
    let zeros = series.iter().filter(|has_zero| **has_zero).count();
    SumOfSquares {
        chi2,
        degrees: read.count().saturating_sub(zeros),
    }
}

#[cfg(test)]
mod tests;
