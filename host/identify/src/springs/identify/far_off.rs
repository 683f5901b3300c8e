//! Springs that are far from the robot file's, one by one: of a stuck gauge, or one in another
//! unit, the readings may agree among themselves.

use gantry_tau_core::model::robot::LINKS;

use super::{IdentifiedSprings, names};
use crate::fit::answer::Status;

/// Factor between a compliance and the robot file's that needs no explanation.
const USUAL_FACTOR: f64 = 2.0;
/// Standard deviations by which it must be beyond: 95 % one sided.
const SURE_SD: f64 = 1.645;

impl<const N: usize> IdentifiedSprings<'_, N> {
    /// Says which springs of links and axes are far off the robot file's for sure. Joints of a
    /// wrist begin with an estimate.
    pub(super) fn far_off(&self) -> Vec<String> {
        let Self {
            problem,
            robust_fit,
            ..
        } = self;
        let uncertainty = self.uncertainty();
        let covariance = uncertainty.covariance();
        let values = robust_fit.solution.values(&robust_fit.active);
        let file = problem.file.vector();
        let names = names(problem, &robust_fit.active, self.play.is_some());
        let mut sentences = Vec::new();
        for spring in 0..LINKS + N {
            let status = uncertainty.status(spring);
            let factor = values[spring] / file[spring];
            let sd = covariance[(spring, spring)].max(0.0).sqrt() / file[spring];
            let is_far =
                factor + SURE_SD * sd < 1.0 / USUAL_FACTOR || factor - SURE_SD * sd > USUAL_FACTOR;
            if is_far && matches!(status, Status::Identified | Status::Weak) {
                sentences.push(format!(
                    "{} is {factor:.2} +- {sd:.2} of the robot file's: look at contact and unit of the gauges that show it; if it is right, identify again with the written file as --robot",
                    names[spring].0
                ));
            }
        }
        sentences
    }
}
