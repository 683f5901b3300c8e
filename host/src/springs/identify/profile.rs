//! Intervals of parameters that are known badly, by profile likelihood: the values that the readings do not contradict, with everything else
//! fitted at each.
//!
//! A true load that is known badly stands in the product of load and compliance: chi-squared is no parabola, and `+- 1.96` standard deviations are
//! too short above, too long below. (D. J. Venzon, S. H. Moolgavkar, "A method for computing profile-likelihood-based confidence intervals",
//! Applied Statistics 37, 1988.)

use nalgebra::DVector;

use super::intervals::Intervals;
use crate::fit::held::Held;
use crate::springs::agreement::Agreement;
use crate::springs::choice::Choice;
use crate::springs::fit::{MOST_FACTOR, rounds};
use crate::springs::lines::{Question, State};

/// Standard deviation of a spring, in its value, above which its interval is profiled.
const LEAST_SHARE: f64 = 0.2;
/// Rounds of one fit, and fits of one end.
const MAX_ROUNDS: u32 = 12;
const MAX_FITS: u32 = 20;
/// Distance to the end of an interval at which it is found, in standard deviations.
const CLOSE_SD: f64 = 1e-3;
/// The same, at which an end is accepted after [`MAX_FITS`].
const NEAR_SD: f64 = 0.02;

/// Interval of a spring.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Profiled {
    /// Index of the spring.
    pub(super) parameter: usize,
    /// Ends of the 95 % interval. Where the readings contradict nothing down to a hundredth of the file's value the lower is 0; where they
    /// contradict nothing up to a hundred times it, the upper is there.
    pub(super) ends: [f64; 2],
}

/// Profiles the springs that are seen, and known badly. One whose fits do not settle keeps the symmetric interval.
pub(super) fn profiles<const N: usize>(
    question: &Question<'_, N>,
    agreement: &Agreement<N>,
    intervals: Intervals,
) -> Vec<Profiled> {
    let solved = &agreement.solved;
    let covariance = solved.seen.covariance() * intervals.variance(solved);
    let springs = solved.state.springs.vector();
    let is_kept = |index: usize| agreement.choice.held.as_ref().is_some_and(|held| held.is_kept(index));
    let is_weak =
        |index: &usize| covariance[(*index, *index)].sqrt() / springs[*index] >= LEAST_SHARE && !is_kept(*index);
    let weak = (0..springs.len()).filter(is_weak);
    weak.filter_map(|index| profile(question, agreement, intervals, index)).collect()
}

/// Profiles one spring.
pub(super) fn profile<const N: usize>(
    question: &Question<'_, N>,
    agreement: &Agreement<N>,
    intervals: Intervals,
    parameter: usize,
) -> Option<Profiled> {
    let seen = &agreement.solved.seen;
    let count = seen.scales().len();
    let held = agreement.choice.held.as_ref().map_or_else(|| Held::none(count), |held| held.of_more(count));
    // The parameter changes, and what is not seen stays: the others of its lost directions go along.
    let mut direction = DVector::zeros(count);
    direction[parameter] = 1.0;
    direction -= held.directions() * held.directions().row(parameter).transpose();
    let held = held.with(&direction);
    let direction = direction.component_mul(seen.scales());
    let mut profile = Profile {
        question,
        choice: Choice { held: Some(held), ..agreement.choice.clone() },
        state: agreement.solved.state.clone(),
        direction: &direction / direction[parameter],
        parameter,
        least: agreement.solved.rows.chi_squared(),
        variance: intervals.variance(&agreement.solved),
        reach: intervals.reach(&agreement.solved),
    };
    let value = profile.state.springs.vector()[parameter];
    let file = question.file.vector()[parameter];
    let sd = (agreement.solved.seen.covariance()[(parameter, parameter)] * profile.variance).sqrt();
    let low = profile.end(value, -sd, file / MOST_FACTOR)?;
    profile.state = agreement.solved.state.clone();
    let high = profile.end(value, sd, file * MOST_FACTOR)?;
    Some(Profiled { parameter, ends: [low.unwrap_or(0.0), high.unwrap_or(file * MOST_FACTOR)] })
}

/// Chi-squared as a function of one spring.
struct Profile<'a, const N: usize> {
    question: &'a Question<'a, N>,
    choice: Choice,
    /// Best fit at the last value within the interval: the next fit begins there.
    state: State<N>,
    /// Change of all parameters with that one, and without what is not seen.
    direction: DVector<f64>,
    parameter: usize,
    /// Chi-squared of the best fit.
    least: f64,
    variance: f64,
    reach: f64,
}

impl<const N: usize> Profile<'_, N> {
    /// Distance of the best fit at a value from the best of all, in standard deviations, less that of the interval's end.
    fn beyond(&mut self, value: f64) -> Option<f64> {
        let mut springs = self.state.springs.vector();
        springs += self.direction.rows(0, springs.len()) * (value - springs[self.parameter]);
        let start = State { springs: self.state.springs.with(&springs), ..self.state.clone() };
        let solved = rounds(self.question, &self.choice, start, MAX_ROUNDS).ok()?;
        let risen = (solved.rows.chi_squared() - self.least) / self.variance;
        let beyond = risen.max(0.0).sqrt() - self.reach;
        // Far beyond the end there may be other minima, which lead astray.
        if beyond < 0.0 {
            self.state = solved.state;
        }
        solved.is_settled.then_some(beyond)
    }

    /// Finds an end of the interval, `sd` with the sign of its side; `None` within where there is none before `bound`.
    fn end(&mut self, value: f64, sd: f64, bound: f64) -> Option<Option<f64>> {
        let within = |place: f64| if sd < 0.0 { place.max(bound) } else { place.min(bound) };
        let (mut inner, mut outer) = ((value, -self.reach), within(value + self.reach * sd));
        let mut last = self.beyond(outer)?;
        let mut fits = 1;
        while last < -CLOSE_SD {
            if (outer - bound).abs() <= f64::EPSILON * bound {
                return Some(None);
            }
            if fits >= MAX_FITS {
                return None;
            }
            let slope = (last - inner.1) / (outer - inner.0);
            // Not far beyond the end, and not before it either.
            let step = (-1.2 * last / slope).abs().clamp(0.05 * sd.abs(), 4.0 * sd.abs()).copysign(sd);
            inner = (outer, last);
            outer = within(outer + step);
            last = self.beyond(outer)?;
            fits += 1;
        }
        let mut outer = (outer, last);
        let mut best = outer;
        // (Illinois) The end that stays counts half, so that it moves.
        let mut weights = [inner.1, outer.1];
        while best.1.abs() > CLOSE_SD && fits < MAX_FITS {
            let [near, far] = weights;
            let between = inner.0 - near * (outer.0 - inner.0) / (far - near);
            let found = (between, self.beyond(between)?);
            fits += 1;
            if found.1 < 0.0 {
                (inner, weights) = (found, [found.1, 0.5 * far]);
            } else {
                (outer, weights) = (found, [0.5 * near, found.1]);
            }
            if found.1.abs() < best.1.abs() {
                best = found;
            }
        }
        (best.1.abs() <= NEAR_SD).then_some(Some(best.0))
    }
}

#[cfg(test)]
mod tests;
