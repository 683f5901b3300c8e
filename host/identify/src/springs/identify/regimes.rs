//! Compliances of the links of their own beyond the jump `[T 5.2.3]`: an F-test of whether they
//! differ, and by how much.
//!
//! Beyond the jump each link follows a line of its own: an offset and a compliance. The offsets are
//! free with and without compliances of their own, so that a platform that jumps in another
//! direction than the play's is not taken for a change of compliance.

use gantry_tau_core::model::robot::LINKS;

use super::intervals::Intervals;
use crate::fit::statistics::{f_above, float};
use crate::springs::active_set::ActiveSet;
use crate::springs::decision::unheld;
use crate::springs::fit::{SpringsError, fit};
use crate::springs::play::FoundPlay;
use crate::springs::post_jump::{CHANGES, PostJumpModel};
use crate::springs::problem::SpringsProblem;
use crate::springs::robust_fit::RobustFit;

/// Probability of the F-test below which the compliances differ.
const MIN_P: f64 = 0.01;

/// Links before and beyond the jump.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct TwoRegimes {
    /// By link.
    pub(super) links: [LinkRatio; LINKS],
    /// Decrease of chi-squared by compliances of their own, per unknown, in those of the residuals
    /// that remain.
    pub(super) f: f64,
    /// Degrees of freedom of both.
    pub(super) degrees: [usize; 2],
    /// Probability of such a ratio, or a larger one, if the compliances are the same.
    pub(super) p: f64,
}

/// Compliance of a link beyond the jump, in those before.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LinkRatio {
    /// Compliance before the jump, m/N.
    pub(super) before: f64,
    /// That beyond it over that before.
    pub(super) ratio: f64,
    /// Ends of the 95 % interval of the ratio.
    pub(super) ends: [f64; 2],
    /// False if the windows beyond the jump do not show it.
    pub(super) is_seen: bool,
}

impl TwoRegimes {
    /// True if the compliances differ.
    pub(super) fn differs(&self) -> bool {
        self.p < MIN_P
    }
}

/// Reason why two regimes are not compared.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(super) enum RegimesError {
    /// The campaign shows no jump.
    #[error("no jump was found")]
    NoJump,
    /// The fit of the links beyond the jump has failed.
    #[error(transparent)]
    Fit(#[from] SpringsError),
}

/// Fits the links beyond the jump on their own, and compares.
pub(super) fn compare<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    robust_fit: &RobustFit<N>,
    play: &FoundPlay,
    intervals: Intervals,
    is_robust: bool,
) -> Result<TwoRegimes, SpringsError> {
    // Readings that the play alone does not explain may only have another compliance.
    let active = ActiveSet {
        post_jump: PostJumpModel::Lines,
        ..robust_fit
            .active
            .with_all_readings_but(problem.campaign, &play.inside)
    };
    let with = RobustFit::find(
        problem,
        &active,
        robust_fit.solution.state.clone(),
        is_robust,
    )?;
    let same = ActiveSet {
        post_jump: PostJumpModel::Offsets,
        ..with.active.clone()
    };
    let without = fit(problem, &same, robust_fit.solution.state.clone())?;
    let solution = &with.solution;
    let rest = solution.degrees();
    let unknowns = without.degrees().saturating_sub(rest);
    let gain = without.rows.chi_squared() - solution.rows.chi_squared();
    let f = (gain / float(unknowns)) / (solution.rows.chi_squared() / float(rest));
    let compliances = solution.state.springs.vector();
    let first = compliances.len() + 1 + CHANGES;
    let covariance = solution.seen.covariance() * intervals.variance(solution);
    let unseen = unheld(problem, &with.active, solution).lost_directions();
    let links = std::array::from_fn(|link| {
        let before = compliances[link];
        let change = solution.state.post_jump[CHANGES + link];
        let at = first + link;
        let share = change / before;
        let variance = covariance[(at, at)] - 2.0 * share * covariance[(at, link)]
            + share * share * covariance[(link, link)];
        let reach = intervals.reach(solution) * variance.max(0.0).sqrt() / before;
        let ratio = 1.0 + share;
        let is_seen = unseen.row(at).norm_squared() <= 0.5;
        LinkRatio {
            before,
            ratio,
            ends: [ratio - reach, ratio + reach],
            is_seen,
        }
    });
    Ok(TwoRegimes {
        links,
        f,
        degrees: [unknowns, rest],
        p: f_above(f, unknowns, rest),
    })
}

#[cfg(test)]
mod tests;
