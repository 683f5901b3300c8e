//! Fits to the poses that agree with each other.

use nalgebra::{DMatrix, DVector};

use crate::fit::least_squares::{Fit, FitError, Observability, Rows, fit};
use crate::fit::statistics::{chi_squared_above, chi_squared_quantile, float, median};

/// Length of a residual of three components, in standard deviations, beyond which a pose is an
/// outlier; of other numbers of components the length that is as rare.
const OUTLIER_SD: f64 = 4.5;
/// Rounds of leaving out what does not agree.
const MAX_TRIMS: u32 = 20;

/// Measured poses, and the model that they are fitted with.
pub trait Model {
    /// The machine.
    type State: Clone;
    /// Reason why a machine predicts no pose.
    type Error;
    /// Number of components of a pose.
    const COMPONENTS: usize;

    /// Number of poses.
    fn count(&self) -> usize;

    /// Rows of the poses that are `used`, at a machine.
    ///
    /// # Errors
    /// A pose cannot be predicted.
    fn rows(&self, state: &Self::State, used: &[usize]) -> Result<Rows, Self::Error>;

    /// Length of the residual of one pose, in standard deviations; infinite where it cannot be
    /// predicted.
    fn length_sd(&self, state: &Self::State, index: usize) -> f64;

    /// Distance between a measured place and the one that a machine predicts, m; `None` where it
    /// predicts none.
    fn away_m(&self, state: &Self::State, index: usize) -> Option<f64>;

    /// Change of each parameter that would matter.
    fn scales(&self, state: &Self::State) -> DVector<f64>;

    /// Returns a machine changed by a step of its parameters.
    fn stepped(state: &Self::State, step: &DVector<f64>) -> Self::State;
}

/// A fit, and what it leaves out.
#[derive(Clone, Debug, PartialEq)]
pub struct RobustFit<S> {
    /// The fit to the poses that agree.
    pub fit: Fit<S>,
    /// Indices of the poses that do not.
    pub outliers: Vec<usize>,
}

impl<S> RobustFit<S> {
    /// Indices of the poses that agree, of `count`.
    #[must_use]
    pub fn used(&self, count: usize) -> Vec<usize> {
        (0..count)
            .filter(|index| !self.outliers.contains(index))
            .collect()
    }
}

/// Fits a machine from `start`. Poses that do not agree are left out, until nothing changes; so
/// are, to begin with, those that the start cannot stand in.
///
/// # Errors
/// [`FitError`].
pub fn fit_agreeing<M: Model>(
    model: &M,
    start: M::State,
) -> Result<RobustFit<M::State>, FitError<M::Error>> {
    let used = (0..model.count())
        .filter(|index| model.length_sd(&start, *index).is_finite())
        .collect();
    fit_from(model, start, used)
}

/// As [`fit_agreeing`], begun without the poses that `start` leaves farther off than most: for a
/// start that is better than a few wrong poses.
///
/// # Errors
/// [`FitError`].
pub fn fit_agreeing_first<M: Model>(
    model: &M,
    start: M::State,
) -> Result<RobustFit<M::State>, FitError<M::Error>> {
    let used = agreeing(model, &start);
    fit_from(model, start, used)
}

fn fit_from<M: Model>(
    model: &M,
    start: M::State,
    mut used: Vec<usize>,
) -> Result<RobustFit<M::State>, FitError<M::Error>> {
    let mut state = start;
    let mut rounds = 0;
    loop {
        let scales = model.scales(&state);
        let fit = fit(state, &scales, |state| model.rows(state, &used), M::stepped)?;
        let agreeing = agreeing_with(model, &fit, &used);
        rounds += 1;
        // It may also turn in a circle.
        if agreeing == used || rounds == MAX_TRIMS {
            let outliers = (0..model.count())
                .filter(|index| !used.contains(index))
                .collect();
            return Ok(RobustFit {
                fit: polished(model, fit, &used),
                outliers,
            });
        }
        state = fit.state;
        used = agreeing;
    }
}

/// Takes the step that a converged fit has left: of an F1 a millionth of a standard deviation is
/// some nanometres of its weakest combination.
fn polished<M: Model>(model: &M, fit: Fit<M::State>, used: &[usize]) -> Fit<M::State> {
    let state = M::stepped(&fit.state, &fit.seen.step(0.0));
    match model.rows(&state, used) {
        Ok(rows) if rows.chi_squared() <= fit.chi_squared() => {
            let seen = Observability::holding(&rows, &model.scales(&state), &fit.held);
            Fit {
                state,
                rows,
                seen,
                held: fit.held,
                rounds: fit.rounds + 1,
            }
        }
        _ => fit,
    }
}

/// Root mean square of the distances that a machine leaves at these poses, m; NaN where it predicts
/// none of them.
#[must_use]
pub fn rms_m<M: Model>(model: &M, state: &M::State, poses: impl Iterator<Item = usize>) -> f64 {
    root_mean_square(poses.filter_map(|index| model.away_m(state, index)))
}

/// Root mean square of the distances at poses that take no part in the fit, m: each fifth of the
/// poses that agree is left out in turn. NaN where what is left does not lead to a machine.
#[must_use]
pub fn left_out_rms_m<M: Model>(model: &M, robust_fit: &RobustFit<M::State>) -> f64 {
    let used = robust_fit.used(model.count());
    let state = &robust_fit.fit.state;
    let scales = model.scales(state);
    let mut away_m = Vec::with_capacity(used.len());
    for fold in 0..FOLDS {
        let (left_out, kept): (Vec<usize>, Vec<usize>) =
            (0..used.len()).partition(|place| place % FOLDS == fold);
        let kept: Vec<usize> = kept.into_iter().map(|place| used[place]).collect();
        let fitted = fit(
            state.clone(),
            &scales,
            |state| model.rows(state, &kept),
            M::stepped,
        );
        let Ok(fitted) = fitted else { return f64::NAN };
        away_m.extend(
            left_out
                .into_iter()
                .filter_map(|place| model.away_m(&fitted.state, used[place])),
        );
    }
    root_mean_square(away_m.into_iter())
}

fn root_mean_square(values: impl Iterator<Item = f64>) -> f64 {
    let squares: Vec<f64> = values.map(|value| value * value).collect();
    (squares.iter().sum::<f64>() / float(squares.len())).sqrt()
}

/// Parts that poses are left out in.
const FOLDS: usize = 5;

/// Indices of the poses that agree with a fit to those that are `used`.
pub(super) fn agreeing_with<M: Model>(
    model: &M,
    fit: &Fit<M::State>,
    used: &[usize],
) -> Vec<usize> {
    let half = fit.seen.half_covariance();
    let lengths: Vec<f64> = (0..model.count())
        .map(|index| {
            if used.contains(&index) {
                model.length_sd(&fit.state, index)
            } else {
                unused_length_sd(model, &fit.state, &half, index)
            }
        })
        .collect();
    within::<M>(&lengths)
}

/// Length of the residual of a pose that had no part in a fit, in standard deviations. It has the
/// uncertainty of the prediction too, `half` of whose covariance is given: several standard
/// deviations where few poses are near by.
fn unused_length_sd<M: Model>(
    model: &M,
    state: &M::State,
    half: &DMatrix<f64>,
    index: usize,
) -> f64 {
    let Ok(rows) = model.rows(state, &[index]) else {
        return f64::INFINITY;
    };
    let residual = rows.residuals.rows(0, M::COMPONENTS).into_owned();
    let moved = rows.derivatives.rows(0, M::COMPONENTS) * half;
    let spread = DMatrix::identity(M::COMPONENTS, M::COMPONENTS) + &moved * moved.transpose();
    spread.cholesky().map_or(f64::INFINITY, |factor| {
        residual.dot(&factor.solve(&residual)).sqrt()
    })
}

/// Indices of the poses that agree with a machine.
pub(super) fn agreeing<M: Model>(model: &M, state: &M::State) -> Vec<usize> {
    within::<M>(
        &(0..model.count())
            .map(|index| model.length_sd(state, index))
            .collect::<Vec<_>>(),
    )
}

/// Indices of the lengths, in standard deviations, that are not rare. Where the stated noise is too
/// small for most of them, it is what most of them say.
fn within<M: Model>(lengths: &[f64]) -> Vec<usize> {
    let usual = chi_squared_quantile(0.5, M::COMPONENTS).sqrt();
    let scale = (median(lengths.to_vec()) / usual).max(1.0);
    let limit = squared_limit::<M>().sqrt();
    (0..lengths.len())
        .filter(|index| lengths[*index] <= limit * scale)
        .collect()
}

/// Square of the length, in standard deviations, beyond which a pose does not agree: as rare as
/// [`OUTLIER_SD`] in three components.
fn squared_limit<M: Model>() -> f64 {
    let rare = chi_squared_above(OUTLIER_SD * OUTLIER_SD, 3);
    chi_squared_quantile(1.0 - rare, M::COMPONENTS)
}

/// Returns what a fit costs: chi-squared, and for each pose that is left out what it would add if
/// it just agreed. A fit that went astray, and leaves nothing out because its scale grew, costs
/// more than one that leaves out what is wrong.
pub(super) fn cost<M: Model>(found: &RobustFit<M::State>) -> f64 {
    found.fit.chi_squared() + float(found.outliers.len()) * squared_limit::<M>()
}
