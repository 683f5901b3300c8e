//! Intervals of parameters that are known badly, by profile likelihood: the values that the
//! readings do not contradict, with everything else fitted at each.
//!
//! A true load that is known badly stands in the product of load and compliance: chi-squared is no
//! parabola, and `+- 1.96` standard deviations are too short above, too long below. (D. J. Venzon,
//! S. H. Moolgavkar, "A method for computing profile-likelihood-based confidence intervals",
//! Applied Statistics 37, 1988.)

use nalgebra::DVector;

use super::intervals::Intervals;
use crate::fit::held_directions::HeldDirections;
use crate::springs::active_set::ActiveSet;
use crate::springs::fit::{MAX_FACTOR, rounds};
use crate::springs::problem::SpringsProblem;
use crate::springs::robust_fit::RobustFit;
use crate::springs::state::FitState;

/// Standard deviation of a spring, in its value, above which its interval is profiled.
const MIN_SHARE: f64 = 0.2;
/// Rounds of one fit, and fits of one end.
const MAX_ROUNDS: u32 = 12;
const MAX_FITS: u32 = 20;
/// Distance to the end of an interval at which it is found, in standard deviations.
const CLOSE_SD: f64 = 1e-3;
/// The same, at which an end is accepted after [`MAX_FITS`].
const NEAR_SD: f64 = 0.02;

/// Interval of a spring.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ProfileInterval {
    /// Index of the spring.
    pub(super) parameter: usize,
    /// Ends of the 95 % interval. Where the readings contradict nothing down to a hundredth of the
    /// file's value the lower is 0; where they contradict nothing up to a hundred times it, the
    /// upper is there.
    pub(super) ends: [f64; 2],
}

/// Profiles the springs that are seen, and known badly. One whose fits do not settle keeps the
/// symmetric interval.
pub(super) fn profiles<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    robust_fit: &RobustFit<N>,
    intervals: Intervals,
) -> Vec<ProfileInterval> {
    let solution = &robust_fit.solution;
    let covariance = solution.seen.covariance() * intervals.variance(solution);
    let springs = solution.state.springs.vector();
    let held = robust_fit.active.held.as_ref();
    (0..springs.len())
        .filter(|index| covariance[(*index, *index)].sqrt() / springs[*index] >= MIN_SHARE)
        .filter(|index| held.is_none_or(|held| !held.is_kept(*index)))
        .filter_map(|index| profile(problem, robust_fit, intervals, index))
        .collect()
}

/// Profiles one spring.
pub(super) fn profile<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    robust_fit: &RobustFit<N>,
    intervals: Intervals,
    parameter: usize,
) -> Option<ProfileInterval> {
    let seen = &robust_fit.solution.seen;
    let count = seen.scales().len();
    let held = robust_fit
        .active
        .held
        .as_ref()
        .map_or_else(|| HeldDirections::none(count), |held| held.of_more(count));
    // The parameter changes, and what is not seen stays: the others of its lost directions go
    // along.
    let mut direction = DVector::zeros(count);
    direction[parameter] = 1.0;
    direction -= held.directions() * held.directions().row(parameter).transpose();
    let held = held.with(&direction);
    let direction = direction.component_mul(seen.scales());
    let mut profile = Profile {
        problem,
        active: ActiveSet {
            held: Some(held),
            ..robust_fit.active.clone()
        },
        state: robust_fit.solution.state.clone(),
        direction: &direction / direction[parameter],
        parameter,
        least: robust_fit.solution.rows.chi_squared(),
        variance: intervals.variance(&robust_fit.solution),
        reach: intervals.reach(&robust_fit.solution),
    };
    let value = profile.state.springs.vector()[parameter];
    let file = problem.file.vector()[parameter];
    let sd =
        (robust_fit.solution.seen.covariance()[(parameter, parameter)] * profile.variance).sqrt();
    let low = profile.end(value, -sd, file / MAX_FACTOR)?;
    profile.state = robust_fit.solution.state.clone();
    let high = profile.end(value, sd, file * MAX_FACTOR)?;
    Some(ProfileInterval {
        parameter,
        ends: [low.unwrap_or(0.0), high.unwrap_or(file * MAX_FACTOR)],
    })
}

/// Chi-squared as a function of one spring.
struct Profile<'a, const N: usize> {
    problem: &'a SpringsProblem<'a, N>,
    active: ActiveSet,
    /// Best fit at the last value within the interval: the next fit begins there.
    state: FitState<N>,
    /// Change of all parameters with that one, and without what is not seen.
    direction: DVector<f64>,
    parameter: usize,
    /// Chi-squared of the best fit.
    least: f64,
    variance: f64,
    reach: f64,
}

impl<const N: usize> Profile<'_, N> {
    /// Distance of the best fit at a value from the best of all, in standard deviations, less that
    /// of the interval's end.
    fn beyond(&mut self, value: f64) -> Option<f64> {
        let mut springs = self.state.springs.vector();
        springs += self.direction.rows(0, springs.len()) * (value - springs[self.parameter]);
        let start = FitState {
            springs: self.state.springs.with(&springs),
            ..self.state.clone()
        };
        let solution = rounds(self.problem, &self.active, start, MAX_ROUNDS).ok()?;
        let risen = (solution.rows.chi_squared() - self.least) / self.variance;
        let beyond = risen.max(0.0).sqrt() - self.reach;
        // Far beyond the end there may be other minima, which lead astray.
        if beyond < 0.0 {
            self.state = solution.state;
        }
        solution.is_settled.then_some(beyond)
    }

    /// Finds an end of the interval, `sd` with the sign of its side; `None` within where there is
    /// none before `bound`.
    fn end(&mut self, value: f64, sd: f64, bound: f64) -> Option<Option<f64>> {
        let mut inner = (value, -self.reach);
        let mut outer = within(bound, sd, value + self.reach * sd);
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
            let step = (-1.2 * last / slope)
                .abs()
                .clamp(0.05 * sd.abs(), 4.0 * sd.abs())
                .copysign(sd);
            inner = (outer, last);
            outer = within(bound, sd, outer + step);
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
                inner = found;
                weights = [found.1, 0.5 * far];
            } else {
                outer = found;
                weights = [0.5 * near, found.1];
            }
            if found.1.abs() < best.1.abs() {
                best = found;
            }
        }
        (best.1.abs() <= NEAR_SD).then_some(Some(best.0))
    }
}

/// The place, or the bound where the place is beyond it on the side of `sd`.
fn within(bound: f64, sd: f64, place: f64) -> f64 {
    if sd < 0.0 {
        place.max(bound)
    } else {
        place.min(bound)
    }
}

#[cfg(test)]
mod tests;
