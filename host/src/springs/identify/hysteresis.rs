//! Hysteresis of gauges: half-widths below two standard deviations are dropped, and everything is fitted without them.

use nalgebra::{DMatrix, DVector};

use super::intervals::Intervals;
use crate::springs::agreement::Agreement;
use crate::springs::fit::SpringsError;
use crate::springs::lines::Question;
use crate::springs::play::FoundPlay;

/// Smallest half-width that is kept, in its standard deviations.
const LEAST_SD: f64 = 2.0;

/// A fit without half-widths that are too small to be seen.
pub(super) struct Kept<const N: usize> {
    pub(super) agreement: Agreement<N>,
    pub(super) play: Option<FoundPlay>,
    /// Gauges whose half-width was dropped, by index.
    pub(super) dropped: Vec<usize>,
}

/// Drops the half-widths that are too small, and fits again until none is.
pub(super) fn drop_small<const N: usize>(
    question: &Question<'_, N>,
    mut agreement: Agreement<N>,
    mut play: Option<FoundPlay>,
    intervals: Intervals,
    is_robust: bool,
) -> Result<Kept<N>, SpringsError> {
    let mut dropped = Vec::new();
    loop {
        let solved = &agreement.solved;
        let (gauges, first) = (&agreement.choice.hysteresis, solved.rows.derivatives.ncols());
        let first = first - gauges.len();
        let covariance = solved.seen.covariance().view((first, first), (gauges.len(), gauges.len())).into_owned();
        let kept = significant(&solved.state.hysteresis_m, &(covariance * intervals.variance(solved)));
        if kept.len() == gauges.len() {
            dropped.sort_unstable();
            return Ok(Kept { agreement, play, dropped });
        }
        let (kept, lost): (Vec<_>, Vec<_>) = gauges.iter().enumerate().partition(|(place, _)| kept.contains(place));
        dropped.extend(lost.into_iter().map(|(_, gauge)| *gauge));
        let inside = play.as_ref().map_or(&[][..], |play| &play.inside);
        let mut choice = agreement.choice.anew(question.campaign, inside);
        choice.hysteresis = kept.into_iter().map(|(_, gauge)| *gauge).collect();
        agreement = Agreement::find(question, &choice, agreement.solved.state, is_robust)?;
        if let Some(play) = &mut play {
            play.gap_m = agreement.solved.state.elongation_m * play.sign;
        }
    }
}

/// Places of the values that stay, where the smallest in its standard deviations is taken as zero until none is too small. The others change
/// with it as their covariance says.
fn significant(values: &DVector<f64>, covariance: &DMatrix<f64>) -> Vec<usize> {
    let (mut values, mut covariance) = (values.clone(), covariance.clone());
    let mut places: Vec<usize> = (0..values.len()).collect();
    loop {
        // A value without a covariance is not seen at all.
        let size = |place: &usize| match covariance[(*place, *place)] {
            variance if variance > 0.0 => values[*place].abs() / variance.sqrt(),
            _ => 0.0,
        };
        let smallest = places.iter().copied().min_by(|one, other| size(one).total_cmp(&size(other)));
        let Some(smallest) = smallest.filter(|place| size(place) < LEAST_SD) else {
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

#[cfg(test)]
mod tests;
