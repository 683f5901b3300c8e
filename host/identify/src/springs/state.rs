//! Unknowns of a fit.

use gantry_tau_machine::elastic::springs::Springs;
use nalgebra::{DVector, Vector6};

use super::active_set::ActiveSet;
use super::blocks::EliminatedUnknowns;
use super::problem::SpringsProblem;

/// Unknowns of a fit.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct FitState<const N: usize> {
    pub(crate) springs: Springs<N>,
    /// Elongation of the links of cluster 3 in windows beyond the jump, m.
    pub(crate) elongation_m: f64,
    /// Further parameters of the links there, by
    /// [`PostJumpModel`](super::post_jump::PostJumpModel).
    pub(crate) post_jump: DVector<f64>,
    /// Half-widths of the hysteresis, m, of the gauges whose is fitted.
    pub(crate) hysteresis_m: DVector<f64>,
    /// Constants of the set-up, in standard deviations of their priors.
    pub(crate) setup: DVector<f64>,
    /// True load of each window.
    pub(crate) loads: Vec<Vector6<f64>>,
}

impl<const N: usize> FitState<N> {
    /// The robot file's springs, a set-up as assumed, and loads as measured.
    pub(crate) fn start(problem: &SpringsProblem<'_, N>) -> Self {
        Self {
            springs: problem.file.clone(),
            elongation_m: 0.0,
            post_jump: DVector::zeros(0),
            hysteresis_m: DVector::zeros(0),
            setup: DVector::zeros(problem.setup.count()),
            loads: problem
                .campaign
                .windows
                .iter()
                .map(|window| window.load)
                .collect(),
        }
    }

    /// The same with zeros for those unknowns of an active set that it does not have.
    pub(super) fn sized(mut self, active: &ActiveSet) -> Self {
        for (unknowns, count) in [
            (&mut self.post_jump, active.link_unknowns()),
            (&mut self.hysteresis_m, active.hysteresis.len()),
        ] {
            if unknowns.len() != count {
                *unknowns = DVector::zeros(count);
            }
        }
        self
    }

    /// The state after a step of the parameters, and with what was eliminated as it then is.
    pub(super) fn stepped(
        &self,
        active: &ActiveSet,
        step: &DVector<f64>,
        eliminated: EliminatedUnknowns,
    ) -> Self {
        let springs = self.springs.count();
        let of_links = self.post_jump.len();
        let hysteresis = self.hysteresis_m.len();
        let play = if active.has_play() {
            step[springs]
        } else {
            0.0
        };
        Self {
            springs: self
                .springs
                .with(&(self.springs.vector() + step.rows(0, springs))),
            elongation_m: self.elongation_m + play,
            post_jump: &self.post_jump
                + step.rows((springs + 1).min(step.len() - of_links), of_links),
            hysteresis_m: &self.hysteresis_m + step.rows(step.len() - hysteresis, hysteresis),
            setup: &self.setup + eliminated.setup,
            loads: eliminated.loads,
        }
    }
}
