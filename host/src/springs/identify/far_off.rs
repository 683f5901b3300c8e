//! Springs that are far from the robot file's, one by one: of a stuck gauge, or one in another unit, the readings may agree among themselves.

use gantry_tau_core::model::robot::LINKS;

use super::{Found, names};
use crate::fit::answer::Status;

/// Factor between a compliance and the robot file's that needs no explanation.
const USUAL_FACTOR: f64 = 2.0;
/// Standard deviations by which it must be beyond: 95 % one sided.
const SURE_SD: f64 = 1.645;

impl<const N: usize> Found<'_, N> {
    /// Says which springs of links and axes are far off the robot file's for sure. Joints of a wrist begin with an estimate.
    pub(super) fn far_off(&self) -> Vec<String> {
        let Self { question, agreement, .. } = self;
        let uncertainty = self.uncertainty();
        let covariance = uncertainty.covariance();
        let is_seen = |spring: &usize| matches!(uncertainty.status(*spring), Status::Identified | Status::Weak);
        let (values, file) = (agreement.solved.values(&agreement.choice), question.file.vector());
        let names = names(question, &agreement.choice, self.play.is_some());
        let of_spring = |spring: usize| {
            let (factor, sd) =
                (values[spring] / file[spring], covariance[(spring, spring)].max(0.0).sqrt() / file[spring]);
            let is_far = factor + SURE_SD * sd < 1.0 / USUAL_FACTOR || factor - SURE_SD * sd > USUAL_FACTOR;
            is_far.then(|| {
                format!(
                    "{} is {factor:.2} +- {sd:.2} of the robot file's: look at contact and unit of the gauges that show it; if it is right, identify again with the written file as --robot",
                    names[spring].0
                )
            })
        };
        (0..LINKS + N).filter(is_seen).filter_map(of_spring).collect()
    }
}
