//! Damped Gauss-Newton (Levenberg and Marquardt) on whitened rows, without the directions that the
//! rows cannot see.
//!
//! A round solves `J y = r` in scaled parameters `y` through the singular values of `J`. A
//! direction whose standard deviation is above its scale is *lost*: no step has a component along
//! it ([`HeldDirections`]), so that the start's value stays. Nothing else is regularised.

use nalgebra::{ColPivQR, DMatrix, DVector, Dyn};

use super::held_directions::HeldDirections;
use super::statistics::float;
use super::svd::Svd;

/// Rounds, damped ones included, after which a fit has failed.
pub const MAX_ROUNDS: u32 = 200;
/// Longest step of a fit that has converged, in standard deviations.
pub const CONVERGED_SD: f64 = 1e-6;
/// Relative standard deviation above which a direction is weak: known, but to one digit at most.
pub const WEAK: f64 = 0.1;
/// Relative standard deviation above which a direction is lost.
pub const LOST: f64 = 1.0;
/// Relative standard deviation above which a direction that is not held is rounding, and is not
/// stepped along either.
const SINGULAR: f64 = 1e4;

/// Damping of the first step, in squares of the largest singular value, and damping at which no
/// step is left.
const FIRST_DAMPING: f64 = 1e-6;
const MAX_DAMPING: f64 = 1e12;
/// Growth of the damping after a step that is not taken, itself growing; and its least factor after
/// one that gained what it promised. (H. B. Nielsen, "Damping parameter in Marquardt's method",
/// IMM-REP-1999-05, Technical University of Denmark.)
const GROWTH: f64 = 2.0;
const MIN_DECREASE: f64 = 0.1;

/// Whitened rows at a state.
#[derive(Clone, Debug, PartialEq)]
pub struct Rows {
    /// Measurements less predictions, in standard deviations.
    pub residuals: DVector<f64>,
    /// `J`: derivatives of the predictions by the parameters, column per parameter, in standard
    /// deviations per unit of the parameter.
    pub derivatives: DMatrix<f64>,
}

impl Rows {
    /// Rows of independent readings.
    #[must_use]
    pub const fn new(residuals: DVector<f64>, derivatives: DMatrix<f64>) -> Self {
        Self {
            residuals,
            derivatives,
        }
    }

    /// Number of independent readings, less that of the unknowns that were eliminated.
    #[must_use]
    pub fn degrees(&self) -> usize {
        self.residuals.len()
    }

    /// Sum of the squares of the residuals.
    #[must_use]
    pub fn chi_squared(&self) -> f64 {
        self.residuals.norm_squared()
    }

    /// Eliminates nuisance parameters, exactly: what is left is orthogonal to their columns, as if
    /// they had been estimated along.
    #[must_use]
    pub fn without(self, unknowns: DMatrix<f64>) -> Self {
        let columns = self.derivatives.ncols();
        let mut rows = self.derivatives.insert_column(columns, 0.0);
        rows.set_column(columns, &self.residuals);
        let left = eliminated(unknowns, rows);
        Self::new(
            left.column(columns).into_owned(),
            left.columns(0, columns).into_owned(),
        )
    }

    /// Rows of several parts, for the same parameters, one below the other.
    #[must_use]
    pub fn stacked(parts: &[&Self]) -> Self {
        let columns = parts.first().map_or(0, |part| part.derivatives.ncols());
        let height = parts.iter().map(|part| part.degrees()).sum();
        let mut residuals = DVector::zeros(height);
        let mut derivatives = DMatrix::zeros(height, columns);
        let mut first = 0;
        for part in parts {
            residuals
                .rows_mut(first, part.degrees())
                .copy_from(&part.residuals);
            derivatives
                .rows_mut(first, part.degrees())
                .copy_from(&part.derivatives);
            first += part.degrees();
        }
        Self::new(residuals, derivatives)
    }

    fn is_finite(&self) -> bool {
        self.residuals
            .iter()
            .chain(self.derivatives.iter())
            .all(|number| number.is_finite())
    }
}

/// Reason why a fit has failed. `E` is that of the model.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FitError<E> {
    /// The model has no prediction at the start.
    #[error("the start has no prediction: {0}")]
    Start(E),
    /// A prediction or a derivative is not finite.
    #[error("a prediction is not finite")]
    NotFinite,
    /// Fewer readings than parameters.
    #[error("{readings} readings are too few for {parameters} parameters")]
    TooFew {
        /// Readings, less the unknowns that were projected out.
        readings: usize,
        /// Parameters.
        parameters: usize,
    },
    /// It still moves after [`MAX_ROUNDS`].
    #[error(
        "no convergence after {MAX_ROUNDS} rounds: the last step is {step_sd:.1e} standard deviations long"
    )]
    NotConverged {
        /// Length of the last step, in standard deviations.
        step_sd: f64,
    },
}

/// The answer of a fit.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit<S> {
    /// State that fits best.
    pub state: S,
    /// Rows there.
    pub rows: Rows,
    /// Decomposition of the derivatives, in scaled parameters, but for what is held.
    pub seen: Observability,
    /// Directions that are not seen there, along which the start's values stay.
    pub held: HeldDirections,
    /// Rounds that it took.
    pub rounds: u32,
}

impl<S> Fit<S> {
    /// Sum of the squares of the residuals, in standard deviations.
    #[must_use]
    pub fn chi_squared(&self) -> f64 {
        self.rows.chi_squared()
    }

    /// A fit that has not made a step, with `rows` at `state`.
    fn begun(state: &S, rows: &Rows, scales: &DVector<f64>, held: Option<&HeldDirections>) -> Self
    where
        S: Clone,
    {
        Self {
            state: state.clone(),
            rows: rows.clone(),
            seen: Observability::but_held(rows, scales, held),
            held: held
                .cloned()
                .unwrap_or_else(|| HeldDirections::none(scales.len())),
            rounds: 0,
        }
    }

    /// Degrees of freedom: readings less estimated unknowns.
    #[must_use]
    pub fn degrees(&self) -> usize {
        self.rows.degrees().saturating_sub(self.seen.kept())
    }

    /// Chi-squared per degree of freedom; NaN without one.
    #[must_use]
    pub fn reduced_chi_squared(&self) -> f64 {
        self.chi_squared() / float(self.degrees())
    }
}

/// Decomposition of `J diag(scales)`: the combinations of parameters that rows observe, and those
/// they do not.
#[derive(Clone, Debug, PartialEq)]
pub struct Observability {
    svd: Svd,
    scales: DVector<f64>,
    /// Shares of the residuals along the images, per singular value.
    shares: DVector<f64>,
    /// Number of directions that are not lost, the first ones.
    kept: usize,
}

/// A combination of parameters, in scales.
#[derive(Clone, Debug, PartialEq)]
pub struct Direction {
    /// Its standard deviation, in scales.
    pub relative_sd: f64,
    /// Unit vector, one component per parameter.
    pub components: DVector<f64>,
}

impl Observability {
    /// Decomposes rows, with the parameters in these scales. Directions with a relative standard
    /// deviation above [`LOST`] are lost.
    #[must_use]
    pub fn new(rows: &Rows, scales: &DVector<f64>) -> Self {
        let mut seen = Self::whole(rows, scales);
        seen.kept = seen
            .svd
            .values
            .iter()
            .filter(|value| 1.0 / **value <= LOST)
            .count();
        seen
    }

    /// Decomposes rows that do not see what is `held`, and nothing else is lost.
    #[must_use]
    pub fn holding(rows: &Rows, scales: &DVector<f64>, held: &HeldDirections) -> Self {
        let mut seen = Self::whole(&held.blinded(rows, scales), scales);
        let shown = seen
            .svd
            .values
            .iter()
            .filter(|value| 1.0 / **value <= SINGULAR)
            .count();
        seen.kept = scales.len().saturating_sub(held.count()).min(shown);
        seen
    }

    /// [`holding`](Self::holding) what is held; [`new`](Self::new) where that is not decided.
    pub(crate) fn but_held(
        rows: &Rows,
        scales: &DVector<f64>,
        held: Option<&HeldDirections>,
    ) -> Self {
        held.map_or_else(
            || Self::new(rows, scales),
            |held| Self::holding(rows, scales, &held.of_more(scales.len())),
        )
    }

    fn whole(rows: &Rows, scales: &DVector<f64>) -> Self {
        let scaled = with_columns_scaled(&rows.derivatives, scales);
        // The decomposition and its images then have the size of the parameters.
        let factors = scaled.qr();
        let mut explained = rows.residuals.clone();
        factors.q_tr_mul(&mut explained);
        let triangle = factors.r();
        let svd = Svd::new(triangle);
        let explained = explained.rows(0, svd.images.nrows());
        let shares = DVector::from_iterator(
            svd.values.len(),
            svd.values
                .iter()
                .zip(svd.images.column_iter())
                .map(|(value, image)| image.dot(&explained) / value),
        );
        let kept = svd.values.len();
        Self {
            svd,
            scales: scales.clone(),
            shares,
            kept,
        }
    }

    /// Singular values of the rows in scaled parameters, the largest first.
    #[must_use]
    pub fn singular_values(&self) -> &DVector<f64> {
        &self.svd.values
    }

    /// Changes of the parameters that would matter.
    pub(crate) const fn scales(&self) -> &DVector<f64> {
        &self.scales
    }

    /// Number of directions that are not lost.
    #[must_use]
    pub const fn kept(&self) -> usize {
        self.kept
    }

    /// All directions, the worst first.
    #[must_use]
    pub fn all(&self) -> Vec<Direction> {
        let pairs = self
            .svd
            .values
            .iter()
            .zip(self.svd.directions.column_iter());
        let mut found: Vec<Direction> = pairs
            .map(|(value, direction)| Direction {
                relative_sd: 1.0 / value,
                components: direction.into_owned(),
            })
            .collect();
        found.reverse();
        found
    }

    /// Directions that cannot be seen.
    #[must_use]
    pub fn lost(&self) -> Vec<Direction> {
        let mut found = self.all();
        found.truncate(found.len() - self.kept);
        found
    }

    /// Directions that cannot be seen, orthonormal columns in scales.
    #[must_use]
    pub fn lost_directions(&self) -> DMatrix<f64> {
        self.svd.directions.columns_range(self.kept..).into_owned()
    }

    /// Directions that are seen badly.
    #[must_use]
    pub fn weak(&self) -> Vec<Direction> {
        let found = self.all();
        found[found.len() - self.kept..]
            .iter()
            .filter(|direction| direction.relative_sd > WEAK)
            .cloned()
            .collect()
    }

    /// Covariance of the parameters along the directions that are seen.
    #[must_use]
    pub fn covariance(&self) -> DMatrix<f64> {
        let half = self.half_covariance();
        &half * half.transpose()
    }

    /// `X` of the covariance `X X^T`.
    #[must_use]
    pub fn half_covariance(&self) -> DMatrix<f64> {
        let mut half = self.svd.directions.columns(0, self.kept()).into_owned();
        for (mut column, value) in half.column_iter_mut().zip(&self.svd.values) {
            column /= *value;
        }
        for (mut row, scale) in half.row_iter_mut().zip(&self.scales) {
            row *= *scale;
        }
        half
    }

    /// Length of the whole step, in standard deviations.
    pub(crate) fn step_sd(&self) -> f64 {
        self.shares.rows(0, self.kept()).norm()
    }

    /// Decrease of chi-squared that a damped step promises.
    fn promised(&self, damping: f64) -> f64 {
        let largest = self.svd.values.get(0).copied().unwrap_or(0.0);
        let pairs = self.svd.values.iter().zip(&self.shares).take(self.kept());
        pairs
            .map(|(value, share)| {
                let left =
                    damping * largest * largest / (value * value + damping * largest * largest);
                share * share * (1.0 - left * left)
            })
            .sum()
    }

    /// Gradient of half of chi-squared of other rows, downwards, along the directions that are
    /// seen, in standard deviations.
    fn score(&self, rows: &Rows) -> DVector<f64> {
        self.half_covariance()
            .tr_mul(&rows.derivatives.tr_mul(&rows.residuals))
    }

    /// Step of the parameters towards the minimum of chi-squared of other rows, where these say how
    /// it bends (Fisher's scoring).
    pub(crate) fn scored_step(&self, rows: &Rows) -> DVector<f64> {
        self.half_covariance() * self.score(rows)
    }

    /// Length of that step, in standard deviations.
    pub(crate) fn scored_step_sd(&self, rows: &Rows) -> f64 {
        self.score(rows).norm()
    }

    /// Step of the parameters, damped.
    pub(crate) fn step(&self, damping: f64) -> DVector<f64> {
        let mut step = DVector::zeros(self.scales.len());
        let largest = self.svd.values.get(0).copied().unwrap_or(0.0);
        for (index, (value, share)) in self
            .svd
            .values
            .iter()
            .zip(&self.shares)
            .take(self.kept())
            .enumerate()
        {
            let damped = value * share / (value * value + damping * largest * largest);
            step += self.svd.directions.column(index) * damped;
        }
        step.component_mul(&self.scales)
    }
}

/// Fits a state to measurements: `evaluate` predicts them at a state, `moved` changes a state by a
/// step of its parameters. `scales`: change of each parameter that would matter.
///
/// # Errors
/// [`FitError`].
pub fn fit<S: Clone, E>(
    start: S,
    scales: &DVector<f64>,
    mut evaluate: impl FnMut(&S) -> Result<Rows, E>,
    moved: impl Fn(&S, &DVector<f64>) -> S,
) -> Result<Fit<S>, FitError<E>> {
    let rows = evaluate(&start).map_err(FitError::Start)?;
    if !rows.is_finite() {
        return Err(FitError::NotFinite);
    }
    if rows.degrees() < scales.len() {
        return Err(FitError::TooFew {
            readings: rows.degrees(),
            parameters: scales.len(),
        });
    }
    // A start may be so far off that it does not show what the end does: at first what is lost is
    // decided step by step.
    let begun = Fit::begun(&start, &rows, scales, None);
    let mut found = fit_holding(begun, scales, None, &mut evaluate, &moved)?;
    let mut decisions = 0;
    loop {
        let lost = Observability::new(&found.rows, scales).lost_directions();
        let next = found.held.decided(&lost, decisions);
        if next.agrees(&found.held) {
            return Ok(found);
        }
        let begun = Fit::begun(&start, &rows, scales, Some(&next));
        let Ok(fit) = fit_holding(begun, scales, Some(&next), &mut evaluate, &moved) else {
            // From here the start is out of reach, as where measurements contradict each other. No
            // parameter has kept its value.
            let seen = Observability::holding(&found.rows, scales, &next);
            return Ok(Fit {
                seen,
                held: next.without_kept(),
                ..found
            });
        };
        found = fit;
        decisions += 1;
    }
}

/// Fits a state with what is held.
fn fit_holding<S, E>(
    begun: Fit<S>,
    scales: &DVector<f64>,
    held: Option<&HeldDirections>,
    mut evaluate: impl FnMut(&S) -> Result<Rows, E>,
    moved: impl Fn(&S, &DVector<f64>) -> S,
) -> Result<Fit<S>, FitError<E>> {
    let mut best = begun;
    let mut damping = FIRST_DAMPING;
    let mut growth = GROWTH;
    while best.rounds < MAX_ROUNDS && damping < MAX_DAMPING {
        if best.seen.step_sd() < CONVERGED_SD {
            return Ok(best);
        }
        best.rounds += 1;
        let state = moved(&best.state, &best.seen.step(damping));
        // A state without a prediction is a step too far.
        let tried = evaluate(&state).ok().filter(Rows::is_finite);
        let gained = tried.map(|rows| (best.rows.chi_squared() - rows.chi_squared(), rows));
        match gained.filter(|(gained, _)| *gained >= 0.0) {
            Some((gained, rows)) => {
                let ratio = gained / best.seen.promised(damping);
                damping *= (1.0 - (2.0 * ratio - 1.0).powi(3)).clamp(MIN_DECREASE, GROWTH);
                growth = GROWTH;
                let seen = Observability::but_held(&rows, scales, held);
                best = Fit {
                    state,
                    rows,
                    seen,
                    ..best
                };
            }
            None => {
                damping *= growth;
                growth *= GROWTH;
            }
        }
    }
    let step_sd = best.seen.step_sd();
    // Rounding may be all that is left: of residuals, whose squares no step makes smaller.
    if step_sd < ROUNDING_SD {
        Ok(best)
    } else {
        Err(FitError::NotConverged { step_sd })
    }
}

/// Returns `matrix * diag(scales)`.
pub(super) fn with_columns_scaled(matrix: &DMatrix<f64>, scales: &DVector<f64>) -> DMatrix<f64> {
    let mut scaled = matrix.clone();
    for (mut column, scale) in scaled.column_iter_mut().zip(scales) {
        column *= *scale;
    }
    scaled
}

/// Returns `rows` without what the columns of `unknowns` explain: an orthogonal complement, in as
/// many rows less as the columns are independent.
#[must_use]
pub fn eliminated(unknowns: DMatrix<f64>, rows: DMatrix<f64>) -> DMatrix<f64> {
    Factors::new(unknowns).eliminated(rows)
}

/// Returns a least squares solution of linear equations, zero in unknowns that the others can stand
/// for, and the number of independent ones.
#[must_use]
pub fn solve(rows: DMatrix<f64>, right: DVector<f64>) -> (DVector<f64>, usize) {
    Factors::new(rows).solve(right)
}

/// Orthogonal and triangular factors of columns, for [`eliminated`] and [`solve`].
pub(crate) struct Factors {
    columns: usize,
    /// `None` of an empty matrix.
    pivoted: Option<PivotedFactors>,
}

struct PivotedFactors {
    factors: ColPivQR<f64, Dyn, Dyn>,
    triangle: DMatrix<f64>,
    /// Number of independent columns.
    rank: usize,
}

impl Factors {
    pub(crate) fn new(columns: DMatrix<f64>) -> Self {
        Self {
            columns: columns.ncols(),
            pivoted: (!columns.is_empty()).then(|| {
                let factors = columns.col_piv_qr();
                let triangle = factors.r();
                PivotedFactors {
                    rank: rank(&triangle),
                    factors,
                    triangle,
                }
            }),
        }
    }

    /// As [`eliminated`].
    pub(crate) fn eliminated(&self, mut rows: DMatrix<f64>) -> DMatrix<f64> {
        let Some(pivoted) = &self.pivoted else {
            return rows;
        };
        pivoted.factors.q_tr_mul(&mut rows);
        rows.remove_rows(0, pivoted.rank)
    }

    /// As [`solve`].
    pub(crate) fn solve(&self, mut right: DVector<f64>) -> (DVector<f64>, usize) {
        let mut solution = DVector::zeros(self.columns);
        let Some(pivoted) = &self.pivoted else {
            return (solution, 0);
        };
        let rank = pivoted.rank;
        pivoted.factors.q_tr_mul(&mut right);
        let top = pivoted
            .triangle
            .view((0, 0), (rank, rank))
            .solve_upper_triangular(&right.rows(0, rank));
        if let Some(top) = top {
            solution.rows_mut(0, rank).copy_from(&top);
        }
        pivoted.factors.p().inv_permute_rows(&mut solution);
        (solution, rank)
    }
}

/// Returns the least squares solution of linear equations; `None` where it is not unique.
#[must_use]
pub fn solve_linear(rows: DMatrix<f64>, right: DVector<f64>) -> Option<DVector<f64>> {
    let unknowns = rows.ncols();
    if rows.nrows() < unknowns {
        return None;
    }
    let (solution, rank) = solve(rows, right);
    (rank == unknowns && solution.iter().all(|number| number.is_finite())).then_some(solution)
}

/// Number of independent columns behind a pivoted triangle.
fn rank(triangle: &DMatrix<f64>) -> usize {
    // Of fewer rows than columns too.
    let pivots = triangle.columns(0, triangle.nrows()).diagonal();
    let floor = INDEPENDENT * pivots.amax();
    pivots.iter().filter(|pivot| pivot.abs() > floor).count()
}

/// Smallest pivot of an independent column, in largest pivots.
const INDEPENDENT: f64 = 1e-12;

/// Length of a step, in standard deviations, that rounding may leave where readings are known to
/// many more digits than they are good for.
const ROUNDING_SD: f64 = 1e-3;

#[cfg(test)]
mod tests;
