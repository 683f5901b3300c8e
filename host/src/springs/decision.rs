//! Springs that a campaign measures, decided once, for the state at the end.

use nalgebra::{DMatrix, DVector};

use super::choice::Choice;
use super::fit::{Solved, SpringsError, scales};
use super::lines::Question;
use crate::fit::answer::Uncertainty;
use crate::fit::held::Held;
use crate::fit::least_squares::{Direction, LOST, Seen, WEAK};

/// Smallest part of a lost direction that lies in springs, of a direction that is one of springs.
const LEAST_OF_SPRINGS: f64 = 0.1;
/// Length of the held part of a unit direction that is held.
const MOSTLY: f64 = 0.8;
/// Standard deviations below zero at which a compliance is a model error, and not one that was not measured.
const MOST_NEGATIVE_SD: f64 = 3.0;

/// Springs that keep the file's values.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Decision {
    /// What is held of the springs.
    pub(super) held: Held,
    /// Springs whose best value is not positive, and which are therefore kept.
    pub(super) not_positive: Vec<NotPositive>,
    count: u32,
}

/// A spring whose best value is not positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct NotPositive {
    /// Its index.
    pub(super) spring: usize,
    /// Its best value, in file's values.
    pub(super) factor: f64,
    /// Standard deviation of that.
    pub(super) sd: f64,
}

impl Decision {
    /// By the robot file's springs.
    pub(super) fn first<const N: usize>(question: &Question<'_, N>, solved: &Solved<N>) -> Self {
        let springs = question.file.count();
        Self { held: Held::of(&of_springs(&solved.seen, springs)), not_positive: Vec::new(), count: 0 }
    }

    /// The same, and of what the springs of the robot file show the weakest combination, if it is weak: the readings of this campaign need not have a
    /// minimum along it. `solved` is linearised there.
    pub(super) fn without_weakest<const N: usize>(
        &self,
        question: &Question<'_, N>,
        solved: &Solved<N>,
    ) -> Option<Self> {
        let scales = solved.seen.scales();
        let seen = Seen::holding(&solved.shown, scales, &self.held.of_more(scales.len()));
        let weakest = seen.weak().into_iter().next()?.components.rows(0, question.file.count()).into_owned();
        let held = self.held.with(&weakest.normalize());
        Some(Self { held: Held::of(held.directions()), not_positive: self.not_positive.clone(), count: u32::MAX })
    }

    /// By the state at the end of a fit that held this decision; `None` if it is the same.
    ///
    /// # Errors
    /// A compliance is negative by more than its uncertainty.
    pub(super) fn next<const N: usize>(
        &self,
        question: &Question<'_, N>,
        choice: &Choice,
        solved: &Solved<N>,
    ) -> Result<Option<Self>, SpringsError> {
        let mut not_positive = self.not_positive.clone();
        not_positive.extend(most_negative(question, &self.held, solved)?);
        let lost = of_springs(&unheld(question, choice, solved), question.file.count());
        let held = not_positive
            .iter()
            .fold(self.held.decided(&lost, self.count), |held, spring| held.with_kept(spring.spring));
        let is_same = not_positive.len() == self.not_positive.len() && held.agrees(&self.held);
        Ok((!is_same).then_some(Self { held, not_positive, count: self.count.saturating_add(1) }))
    }
}

/// What the readings see of the parameters where nothing is held.
pub(super) fn unheld<const N: usize>(question: &Question<'_, N>, choice: &Choice, solved: &Solved<N>) -> Seen {
    Seen::new(&solved.shown, &scales(question, choice, &solved.state))
}

/// Uncertainty of the parameters where what is held is as uncertain as the file says: by its covariance, or all of the value.
pub(super) fn uncertainty<const N: usize>(
    question: &Question<'_, N>,
    choice: &Choice,
    solved: &Solved<N>,
) -> Uncertainty {
    let held = choice.held.as_ref().map(|held| held.of_more(solved.seen.scales().len()));
    let held = held.unwrap_or_else(|| Held::of(&solved.seen.lost_directions()));
    let uncertainty = Uncertainty::new(&solved.shown, &solved.seen, &held);
    if held.count() == 0 {
        return uncertainty;
    }
    let directions = held.directions().rows(0, question.file.count()).into_owned();
    let variance = directions.tr_mul(&question.prior) * &directions;
    // A variance that is rounding of nothing has no root.
    let decomposed = variance.symmetric_eigen();
    let roots = decomposed.eigenvalues.map(|value| value.max(0.0).sqrt());
    let factor = &decomposed.eigenvectors * DMatrix::from_diagonal(&roots) * decomposed.eigenvectors.transpose();
    uncertainty.with_prior(&factor)
}

/// Combinations of parameters that are not seen, and those that are seen badly. What was lost on the way to a state from which it would be seen
/// is not seen: whether it is depends on its own value.
pub(super) fn unobservable<const N: usize>(
    question: &Question<'_, N>,
    choice: &Choice,
    solved: &Solved<N>,
) -> [Vec<Direction>; 2] {
    let all = unheld(question, choice, solved).all();
    let is_held = |direction: &Direction| {
        let directions = choice.held.as_ref().map(|held| held.of_more(direction.components.len()));
        directions.is_some_and(|held| held.directions().tr_mul(&direction.components).norm() > MOSTLY)
    };
    let (lost, seen): (Vec<_>, Vec<_>) =
        all.into_iter().partition(|direction| direction.relative_sd > LOST || is_held(direction));
    [lost, seen.into_iter().filter(|direction| direction.relative_sd > WEAK).collect()]
}

/// Lost directions of the springs, orthonormal.
fn of_springs(seen: &Seen, springs: usize) -> DMatrix<f64> {
    let mut found: Vec<DVector<f64>> = Vec::new();
    for Direction { components, .. } in seen.lost() {
        let mut own = components.rows(0, springs).into_owned();
        for other in &found {
            own -= other * other.dot(&own);
        }
        if own.norm() > LEAST_OF_SPRINGS {
            found.push(own.normalize());
        }
    }
    if found.is_empty() { DMatrix::zeros(springs, 0) } else { DMatrix::from_columns(&found) }
}

/// Checks that no compliance is negative by more than its uncertainty.
///
/// # Errors
/// [`SpringsError::Negative`].
pub(super) fn check_positive<const N: usize>(
    question: &Question<'_, N>,
    solved: &Solved<N>,
) -> Result<(), SpringsError> {
    most_negative(question, &Held::none(question.file.count()), solved).map(|_| ())
}

/// The spring that is farthest below zero in its standard deviations, of those that are not held.
fn most_negative<const N: usize>(
    question: &Question<'_, N>,
    held: &Held,
    solved: &Solved<N>,
) -> Result<Option<NotPositive>, SpringsError> {
    let factors = solved.state.springs.vector().component_div(&question.file.vector());
    let covariance = solved.seen.covariance();
    let sd = |spring: usize| covariance[(spring, spring)].sqrt() / question.file.vector()[spring];
    let negative = (0..factors.len()).filter(|spring| factors[*spring] <= 0.0 && !held.is_kept(*spring));
    let found = negative.map(|spring| NotPositive { spring, factor: factors[spring], sd: sd(spring) });
    let Some(found) = found.min_by(|one, other| (one.factor / one.sd).total_cmp(&(other.factor / other.sd))) else {
        return Ok(None);
    };
    if found.factor < -MOST_NEGATIVE_SD * found.sd {
        let (name, _) = question.file.names().swap_remove(found.spring);
        let gauge = contradicting(question, solved, found.spring);
        return Err(SpringsError::Negative { name, factor: found.factor, sd: found.sd, gauge });
    }
    Ok(Some(found))
}

/// Name of the gauge whose readings, with the other springs as found, contradict a positive compliance most, in their standard deviations.
fn contradicting<const N: usize>(question: &Question<'_, N>, solved: &Solved<N>, spring: usize) -> String {
    let compliance = solved.state.springs.vector()[spring];
    let mut sums = vec![(0.0, 0.0); question.campaign.gauges.len()];
    for (lines, left) in solved.lines.iter().zip(&solved.left) {
        for (row, gauge) in lines.gauges.iter().enumerate() {
            let shown = lines.springs_shown[(row, spring)];
            let (product, squares) = &mut sums[*gauge];
            *product += shown * (left[row] + shown * compliance) / lines.variances[row];
            *squares += shown * shown / lines.variances[row];
        }
    }
    let alone = sums.iter().zip(&question.campaign.gauges).filter(|((_, squares), _)| *squares > 0.0);
    let in_sd = alone.map(|((product, squares), gauge)| (product / squares.sqrt(), gauge));
    let worst = in_sd.min_by(|(one, _), (other, _)| one.total_cmp(other));
    worst.map_or_else(String::new, |(_, gauge)| gauge.name.to_string())
}
