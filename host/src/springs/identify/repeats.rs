//! Lack of fit: what repeats at one level leave is noise, whatever the model; what the levels leave besides is the model's.
//!
//! Within a level only the differences of deviations count, so that a load that was not quite the same, and is known, does no harm.

use nalgebra::{DMatrix, DVector};

use super::levels::levels;
use crate::fit::goodness::LEAST_P;
use crate::fit::least_squares::{Rows, eliminated};
use crate::fit::statistics::{f_above, float};
use crate::output::Name;
use crate::springs::agreement::{Agreement, deviations};
use crate::springs::blocks::Blocks;
use crate::springs::choice::Choice;
use crate::springs::lines::{Lines, Question};

/// Chi-squared of a campaign, split by its repeats.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Repeats {
    /// Of repeats about their level: pure error.
    pub(super) pure: Share,
    /// Of the levels about the model: lack of fit.
    pub(super) lack: Share,
    /// Gauges whose lack of fit stands out, the worst first.
    pub(super) standing_out: Vec<usize>,
}

/// A sum of squares, in stated standard deviations, with its degrees of freedom.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Share {
    pub(super) chi2: f64,
    pub(super) degrees: usize,
}

impl Share {
    pub(super) fn mean(self) -> f64 {
        self.chi2 / float(self.degrees)
    }
}

impl Repeats {
    /// Splits chi-squared of a fit; `None` if nothing was repeated, or if levels are no more than unknowns.
    pub(super) fn of<const N: usize>(question: &Question<'_, N>, agreement: &Agreement<N>) -> Option<Self> {
        let Agreement { solved, choice, .. } = agreement;
        let levels = crossed_apart(&levels(question.campaign, solved), &choice.is_crossed);
        let pure = pure_error(question, agreement, &levels)?;
        let lack = Share {
            chi2: solved.rows.chi_squared() - pure.chi2,
            degrees: solved.degrees().saturating_sub(pure.degrees),
        };
        if pure.degrees == 0 || lack.degrees == 0 {
            return None;
        }
        let standing_out = standing_out(question, agreement, &levels, pure);
        Some(Self { pure, lack, standing_out })
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
    levels.iter().zip(is_crossed).map(|(level, is_crossed)| 2 * level + usize::from(*is_crossed)).collect()
}

/// Deviations that remain if every gauge has a zero at every level, and its drift in every series if that is fitted.
fn pure_error<const N: usize>(question: &Question<'_, N>, agreement: &Agreement<N>, levels: &[usize]) -> Option<Share> {
    let Agreement { solved, choice, .. } = agreement;
    let mut campaign = question.campaign.clone();
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
    let by_level = question.on(&campaign).exact();
    let choice = Choice { weights: choice.weights.clone(), ..Choice::all(&campaign) };
    let lines = solved.lines.iter().zip(&solved.left);
    // The columns of the drifts take the place of those of the springs.
    let lines: Vec<Lines> = lines
        .map(|(lines, left)| Lines {
            misclosures: left.clone(),
            springs: drifts(question, agreement, lines),
            ..lines.without_setup()
        })
        .collect();
    let of_levels = Blocks::new(&by_level, &choice, &lines, &DVector::zeros(0), &[])?.series_rows();
    let mut pure = Share::default();
    for series in 0..question.campaign.series.len() {
        let own = of_levels.iter().zip(&owners).filter(|(_, owner)| **owner == series).map(|(rows, _)| rows);
        let Rows { residuals, derivatives } = Rows::stacked(&own.collect::<Vec<_>>());
        let left = eliminated(derivatives, DMatrix::from_columns(&[residuals]));
        pure.chi2 += left.norm_squared();
        pure.degrees += left.nrows();
    }
    Some(pure)
}

/// Readings of a window by the drifts of the gauges, s; no column if none is fitted.
fn drifts<const N: usize>(question: &Question<'_, N>, agreement: &Agreement<N>, lines: &Lines) -> DMatrix<f64> {
    let gauges = if agreement.choice.has_drift { question.campaign.gauges.len() } else { 0 };
    let seconds = question.campaign.windows[lines.window].time_s.unwrap_or_default();
    DMatrix::from_fn(lines.gauges.len(), gauges, |row, gauge| if lines.gauges[row] == gauge { seconds } else { 0.0 })
}

/// Gauges whose means at the levels deviate by more than the pure error of all lets expect, the worst first.
fn standing_out<const N: usize>(
    question: &Question<'_, N>,
    agreement: &Agreement<N>,
    levels: &[usize],
    pure: Share,
) -> Vec<usize> {
    let campaign = question.campaign;
    let deviations = deviations(question, &agreement.choice, &agreement.solved);
    let count = levels.iter().max().map_or(0, |most| most + 1);
    let of_gauge = |gauge: usize| {
        // Per level: sum of the deviations and their number.
        let mut sums = DMatrix::<f64>::zeros(count, 2);
        let mut series = vec![false; campaign.series.len()];
        for (window, level) in levels.iter().enumerate() {
            let deviation = deviations[window][gauge];
            if agreement.choice.weights[window][gauge] > 0.0 && !deviation.is_nan() {
                sums[(*level, 0)] += deviation;
                sums[(*level, 1)] += 1.0;
                series[campaign.windows[window].series] = true;
            }
        }
        let read = sums.row_iter().filter(|sum| sum[1] > 0.0);
        let chi2 = read.clone().map(|sum| sum[0] * sum[0] / sum[1]).sum();
        let zeros = series.iter().filter(|has_zero| **has_zero).count();
        Share { chi2, degrees: read.count().saturating_sub(zeros) }
    };
    let gauges = campaign.gauges.len();
    let mut worst: Vec<(f64, usize)> = (0..gauges)
        .map(|gauge| (of_gauge(gauge), gauge))
        .filter(|(lack, _)| lack.degrees > 0)
        .map(|(lack, gauge)| (lack.mean() / pure.mean(), lack.degrees, gauge))
        .filter(|(f, degrees, _)| f_above(*f, *degrees, pure.degrees) * float(gauges) < LEAST_P)
        .map(|(f, _, gauge)| (f, gauge))
        .collect();
    worst.sort_by(|(one, _), (other, _)| other.total_cmp(one));
    worst.into_iter().map(|(_, gauge)| gauge).collect()
}

#[cfg(test)]
mod tests;
