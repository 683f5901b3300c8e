//! Parallel guideways of an L2.

use nalgebra::DVector;

use super::super::GuidewaysOption;
use crate::fit::least_squares::{Fit, FitError, fit};
use crate::fit::statistics::{f_above, float};
use crate::geometry::l2::{Calibrated, Nominal, PARAMETERS, Places, PredictionError};
use crate::geometry::parallel::{PARALLEL_PARAMETERS, Parallel, with_parallel_guideways};
use crate::geometry::robust_fit::Model;

/// Smallest probability at which guideways are taken as parallel.
const MIN_PARALLEL_P: f64 = 0.01;

/// Parallel guideways against free ones, on the places that agree with the latter.
pub(super) struct Guideways {
    /// Error: a machine with parallel guideways cannot reach each of the places.
    pub(super) parallel: Result<Calibrated, FitError<PredictionError>>,
    /// Probability of so much more left with parallel guideways, if they are parallel; 0 where they
    /// do not fit at all.
    p: f64,
}

impl Guideways {
    pub(super) fn of(free: &Calibrated, places: &Places<'_>) -> Self {
        let used = free.used(places.poses.len());
        let parallel = fit_parallel(&free.fit.state, &Parallel(*places), &used);
        let p = parallel.as_ref().map_or(0.0, |parallel| {
            let freed = PARAMETERS - PARALLEL_PARAMETERS;
            let more = (parallel.chi_squared() - free.fit.chi_squared()).max(0.0) / float(freed);
            f_above(
                more / free.fit.reduced_chi_squared(),
                freed,
                free.fit.degrees(),
            )
        });
        Self {
            parallel: parallel.map(|fit| Calibrated {
                fit,
                outliers: free.outliers.clone(),
            }),
            p,
        }
    }

    /// Says what the measurements want, where it is not what was asked for and does no harm.
    pub(super) fn remark(&self, asked: GuidewaysOption) -> Option<String> {
        (asked == GuidewaysOption::Free && self.p > MIN_PARALLEL_P).then(|| {
            format!("parallel guideways would do as well (p = {:.2}): --guideways parallel knows them better", self.p)
        })
    }

    pub(super) fn doubt(&self, asked: GuidewaysOption) -> Option<String> {
        (asked == GuidewaysOption::Parallel && self.p < MIN_PARALLEL_P).then(|| {
            format!(
                "the guideways are not parallel (p = {:.1e}): calibrate with --guideways free",
                self.p
            )
        })
    }
}

/// Fits to the places that the start reaches, and from there to all that are used.
fn fit_parallel(
    free: &Nominal,
    model: &Parallel<'_>,
    used: &[usize],
) -> Result<Fit<Nominal>, FitError<PredictionError>> {
    let start = with_parallel_guideways(free);
    let reached: Vec<usize> = used
        .iter()
        .copied()
        .filter(|index| model.length_sd(&start, *index).is_finite())
        .collect();
    let scales = model.scales(&start);
    let near = fit(
        start,
        &scales,
        |state| model.rows(state, &reached),
        Parallel::stepped,
    )?;
    fit(
        near.state,
        &scales,
        |state| model.rows(state, used),
        Parallel::stepped,
    )
}

/// Names of the parameters of a machine with parallel guideways, and their units.
pub(super) fn names() -> Vec<(String, &'static str)> {
    (0..3)
        .flat_map(|arm| {
            let origin = ["x", "y", "z"].map(|axis| (format!("A_s[{arm}].{axis}"), "m"));
            origin.into_iter().chain([(format!("L[{arm}]"), "m")])
        })
        .chain(["x", "y", "z"].map(|axis| (format!("V.{axis}"), "m")))
        .collect()
}

/// Values of the parameters of a machine with parallel guideways.
pub(super) fn values(state: &Nominal) -> DVector<f64> {
    let arms = state.origins_m.iter().zip(state.lengths_m);
    let own = arms.flat_map(|(origin, length)| [origin.x, origin.y, origin.z, length]);
    DVector::from_iterator(
        PARALLEL_PARAMETERS,
        own.chain(state.guideways[0].iter().copied()),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parallel_guideways_are_proposed_or_doubted_by_what_was_asked() {
        for (p, is_proposed) in [(0.5, true), (0.02, true), (0.005, false), (0.0, false)] {
            let guideways = Guideways {
                parallel: Err(FitError::NotFinite),
                p,
            };
            for (asked, said) in [
                (GuidewaysOption::Free, [is_proposed, false]),
                (GuidewaysOption::Parallel, [false, !is_proposed]),
            ] {
                let remark = guideways.remark(asked);
                let doubt = guideways.doubt(asked);
                assert_eq!([remark.is_some(), doubt.is_some()], said, "{p}");
            }
        }
    }
}
