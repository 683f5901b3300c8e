//! Springs that a campaign measures, decided once, for the state at the end.

use nalgebra::{DMatrix, DVector};

use super::active_set::ActiveSet;
use super::fit::{Solution, SpringsError, scales};
use super::problem::SpringsProblem;
use crate::fit::answer::Uncertainty;
use crate::fit::held_directions::HeldDirections;
use crate::fit::least_squares::{Direction, LOST, Observability, WEAK};

/// Smallest part of a lost direction that lies in springs, of a direction that is one of springs.
const MIN_OF_SPRINGS: f64 = 0.1;
/// Smallest length of the held part of a unit direction that counts as held.
const MIN_HELD_PART: f64 = 0.8;
/// Standard deviations below zero at which a compliance is a model error, and not one that was not
/// measured.
const MAX_NEGATIVE_SD: f64 = 3.0;

/// Springs that keep the file's values.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Decision {
    /// Directions of the springs that are held.
    pub(super) held: HeldDirections,
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
    pub(super) fn first<const N: usize>(
        problem: &SpringsProblem<'_, N>,
        solution: &Solution<N>,
    ) -> Self {
        let springs = problem.file.count();
        Self {
            held: HeldDirections::of(&of_springs(&solution.seen, springs)),
            not_positive: Vec::new(),
            count: 0,
        }
    }

    /// The same, and of what the springs of the robot file show the weakest combination, if it is
    /// weak: the readings of this campaign need not have a minimum along it. `solution` is linearized
    /// there.
    pub(super) fn without_weakest<const N: usize>(
        &self,
        problem: &SpringsProblem<'_, N>,
        solution: &Solution<N>,
    ) -> Option<Self> {
        let scales = solution.seen.scales();
        let seen =
            Observability::holding(&solution.shown, scales, &self.held.of_more(scales.len()));
        let weakest = seen
            .weak()
            .into_iter()
            .next()?
            .components
            .rows(0, problem.file.count())
            .into_owned();
        let held = self.held.with(&weakest.normalize());
        Some(Self {
            held: HeldDirections::of(held.directions()),
            not_positive: self.not_positive.clone(),
            count: u32::MAX,
        })
    }

    /// By the state at the end of a fit that held this decision; `None` if it is the same.
    ///
    /// # Errors
    /// A compliance is negative by more than its uncertainty.
    pub(super) fn next<const N: usize>(
        &self,
        problem: &SpringsProblem<'_, N>,
        active: &ActiveSet,
        solution: &Solution<N>,
    ) -> Result<Option<Self>, SpringsError> {
        let mut not_positive = self.not_positive.clone();
        not_positive.extend(most_negative(problem, &self.held, solution)?);
        let lost = of_springs(&unheld(problem, active, solution), problem.file.count());
        let held = not_positive
            .iter()
            .fold(self.held.decided(&lost, self.count), |held, spring| {
                held.with_kept(spring.spring)
            });
        let is_same = not_positive.len() == self.not_positive.len() && held.agrees(&self.held);
        Ok((!is_same).then_some(Self {
            held,
            not_positive,
            count: self.count.saturating_add(1),
        }))
    }
}

/// Observability of the parameters where nothing is held.
pub(super) fn unheld<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    active: &ActiveSet,
    solution: &Solution<N>,
) -> Observability {
    Observability::new(&solution.shown, &scales(problem, active, &solution.state))
}

/// Uncertainty of the parameters where what is held is as uncertain as the file says: by its
/// covariance, or all of the value.
pub(super) fn uncertainty<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    active: &ActiveSet,
    solution: &Solution<N>,
) -> Uncertainty {
    let held = active
        .held
        .as_ref()
        .map(|held| held.of_more(solution.seen.scales().len()));
    let held = held.unwrap_or_else(|| HeldDirections::of(&solution.seen.lost_directions()));
    let uncertainty = Uncertainty::new(&solution.shown, &solution.seen, &held);
    if held.count() == 0 {
        return uncertainty;
    }
    let directions = held.directions().rows(0, problem.file.count()).into_owned();
    let variance = directions.tr_mul(&problem.prior) * &directions;
    // A variance that is rounding of nothing has no root.
    let decomposed = variance.symmetric_eigen();
    let roots = decomposed.eigenvalues.map(|value| value.max(0.0).sqrt());
    let factor = &decomposed.eigenvectors
        * DMatrix::from_diagonal(&roots)
        * decomposed.eigenvectors.transpose();
    uncertainty.with_prior(&factor)
}

/// Combinations of parameters that are not seen, and those that are seen badly. What was lost on
/// the way to a state from which it would be seen is not seen: whether it is depends on its own
/// value.
pub(super) fn unobservable<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    active: &ActiveSet,
    solution: &Solution<N>,
) -> [Vec<Direction>; 2] {
    let (lost, seen): (Vec<_>, Vec<_>) = unheld(problem, active, solution)
        .all()
        .into_iter()
        .partition(|direction| direction.relative_sd > LOST || is_held(active, direction));
    [
        lost,
        seen.into_iter()
            .filter(|direction| direction.relative_sd > WEAK)
            .collect(),
    ]
}

/// True if most of a direction is held.
fn is_held(active: &ActiveSet, direction: &Direction) -> bool {
    active.held.as_ref().is_some_and(|held| {
        let held = held.of_more(direction.components.len());
        held.directions().tr_mul(&direction.components).norm() > MIN_HELD_PART
    })
}

/// Lost directions of the springs, orthonormal.
fn of_springs(seen: &Observability, springs: usize) -> DMatrix<f64> {
    let mut found: Vec<DVector<f64>> = Vec::new();
    for Direction { components, .. } in seen.lost() {
        let mut own = components.rows(0, springs).into_owned();
        for other in &found {
            own -= other * other.dot(&own);
        }
        if own.norm() > MIN_OF_SPRINGS {
            found.push(own.normalize());
        }
    }
    if found.is_empty() {
        DMatrix::zeros(springs, 0)
    } else {
        DMatrix::from_columns(&found)
    }
}

/// Checks that no compliance is negative by more than its uncertainty.
///
/// # Errors
/// [`SpringsError::Negative`].
pub(super) fn check_positive<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    solution: &Solution<N>,
) -> Result<(), SpringsError> {
    most_negative(
        problem,
        &HeldDirections::none(problem.file.count()),
        solution,
    )
    .map(|_| ())
}

/// The spring that is farthest below zero in its standard deviations, of those that are not held.
fn most_negative<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    held: &HeldDirections,
    solution: &Solution<N>,
) -> Result<Option<NotPositive>, SpringsError> {
    let factors = solution
        .state
        .springs
        .vector()
        .component_div(&problem.file.vector());
    let covariance = solution.seen.covariance();
    let negative =
        (0..factors.len()).filter(|spring| factors[*spring] <= 0.0 && !held.is_kept(*spring));
    let found = negative.map(|spring| NotPositive {
        spring,
        factor: factors[spring],
        sd: covariance[(spring, spring)].sqrt() / problem.file.vector()[spring],
    });
    let Some(found) =
        found.min_by(|one, other| (one.factor / one.sd).total_cmp(&(other.factor / other.sd)))
    else {
        return Ok(None);
    };
    if found.factor < -MAX_NEGATIVE_SD * found.sd {
        let (name, _) = problem.file.names().swap_remove(found.spring);
        let gauge = contradicting(problem, solution, found.spring);
        return Err(SpringsError::Negative {
            name,
            factor: found.factor,
            sd: found.sd,
            gauge,
        });
    }
    Ok(Some(found))
}

/// Name of the gauge whose readings, with the other springs as found, contradict a positive
/// compliance most, in their standard deviations.
fn contradicting<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    solution: &Solution<N>,
    spring: usize,
) -> String {
    let compliance = solution.state.springs.vector()[spring];
    let mut sums = vec![(0.0, 0.0); problem.campaign.gauges.len()];
    for (linearized, left) in solution.linearized.iter().zip(&solution.left) {
        for (row, gauge) in linearized.gauges.iter().enumerate() {
            let shown = linearized.springs_shown[(row, spring)];
            let (product, squares) = &mut sums[*gauge];
            *product += shown * (left[row] + shown * compliance) / linearized.variances[row];
            *squares += shown * shown / linearized.variances[row];
        }
    }
    let alone = sums
        .iter()
        .zip(&problem.campaign.gauges)
        .filter(|((_, squares), _)| *squares > 0.0);
    let in_sd = alone.map(|((product, squares), gauge)| (product / squares.sqrt(), gauge));
    let worst = in_sd.min_by(|(one, _), (other, _)| one.total_cmp(other));
    worst.map_or_else(String::new, |(_, gauge)| gauge.name.to_string())
}
