//! Hysteresis of gauges: half-widths below two standard deviations are dropped, and everything is
//! fitted without them.

use nalgebra::{DMatrix, DVector};

use super::intervals::Intervals;
use crate::springs::fit::SpringsError;
use crate::springs::play::FoundPlay;
use crate::springs::problem::SpringsProblem;
use crate::springs::robust_fit::RobustFit;

/// Smallest half-width that is kept, in its standard deviations.
const MIN_SD: f64 = 2.0;

/// A fit without half-widths that are too small to be seen.
pub(super) struct SignificantFit<const N: usize> {
    pub(super) robust_fit: RobustFit<N>,
    pub(super) play: Option<FoundPlay>,
    /// Gauges whose half-width was dropped, by index.
    pub(super) dropped: Vec<usize>,
}

/// Drops the half-widths that are too small, and fits again until none is.
pub(super) fn drop_small<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    mut robust_fit: RobustFit<N>,
    mut play: Option<FoundPlay>,
    intervals: Intervals,
    is_robust: bool,
) -> Result<SignificantFit<N>, SpringsError> {
    let mut dropped = Vec::new();
    loop {
        let solution = &robust_fit.solution;
        let gauges = &robust_fit.active.hysteresis;
        let first = solution.rows.derivatives.ncols() - gauges.len();
        let covariance = solution
            .seen
            .covariance()
            .view((first, first), (gauges.len(), gauges.len()))
            .into_owned();
        let kept = significant(
            &solution.state.hysteresis_m,
            &(covariance * intervals.variance(solution)),
        );
        if kept.len() == gauges.len() {
            dropped.sort_unstable();
            return Ok(SignificantFit {
                robust_fit,
                play,
                dropped,
            });
        }
        let (kept, lost): (Vec<_>, Vec<_>) = gauges
            .iter()
            .enumerate()
            .partition(|(place, _)| kept.contains(place));
        dropped.extend(lost.into_iter().map(|(_, gauge)| *gauge));
        let inside = play.as_ref().map_or(&[][..], |play| &play.inside);
        let mut active = robust_fit
            .active
            .with_all_readings_but(problem.campaign, inside);
        active.hysteresis = kept.into_iter().map(|(_, gauge)| *gauge).collect();
        robust_fit = RobustFit::find(problem, &active, robust_fit.solution.state, is_robust)?;
        if let Some(play) = &mut play {
            play.gap_m = robust_fit.solution.state.elongation_m * play.sign;
        }
    }
}

/// Places of the values that stay, where the smallest in its standard deviations is taken as zero
/// until none is too small. The others change with it as their covariance says.
fn significant(values: &DVector<f64>, covariance: &DMatrix<f64>) -> Vec<usize> {
    let mut values = values.clone();
    let mut covariance = covariance.clone();
    let mut places: Vec<usize> = (0..values.len()).collect();
    loop {
        let smallest = places
            .iter()
            .map(|place| {
                let variance = covariance[(*place, *place)];
                (in_deviations(values[*place], variance), *place)
            })
            .min_by(|(one, _), (other, _)| one.total_cmp(other));
        let Some((_, smallest)) = smallest.filter(|(size, _)| *size < MIN_SD) else {
            return places;
        };
        places.retain(|place| *place != smallest);
        let variance = covariance[(smallest, smallest)];
        if variance > 0.0 {
            let shares = covariance.column(smallest) / variance;
            let value = values[smallest];
            values -= &shares * value;
            covariance -= &shares * shares.transpose() * variance;
        }
    }
}

/// Magnitude of a value, in its standard deviations; 0 without a variance, of a value that is not
/// seen at all.
fn in_deviations(value: f64, variance: f64) -> f64 {
    if variance > 0.0 {
        value.abs() / variance.sqrt()
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests;
