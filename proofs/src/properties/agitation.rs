//! The agitation budget, T33: one tick of the sum, of an axis, and of the decision.

use gantry_tau_core::control::agitation::{Agitation, AgitationBudget};
use gantry_tau_core::control::message::{AxisState, Cause, Phase};
use gantry_tau_core::control::session::config::AxisConfig;
use gantry_tau_core::verification::control::{
    Action, Axis, AxisCommand, EndReason, FsmInput, FsmState, Rules, decide,
};

/// `B`, by its definition: a thousand times `r`.
fn limit_nm(budget: &AgitationBudget) -> u64 {
    1_000 * u64::from(budget.nm_per_tick.get())
}

/// Agitation that an Obtain has spent up to a tick, nm: the sum of the magnitudes of its second differences, less
/// `r` for each tick. A number of the proof, which core does not have.
#[derive(Clone, Copy, Debug)]
pub struct Spent(pub i64);

impl Spent {
    /// The invariant: core's sum covers what was spent. It holds at the first tick of an Obtain, where
    /// both are zero.
    #[must_use]
    pub fn is_covered(self, agitation: Agitation) -> bool {
        self.0 <= agitation.0.into()
    }
}

/// T33, the bound: a tick that does not take core's sum above `B` keeps the invariant, and so no more
/// than `B` is spent: the second differences of `n` ticks sum up to at most `B + r n`.
pub fn second_differences_are_bounded(
    before: Agitation,
    spent: Spent,
    (from, to): (i32, i32),
    budget: &AgitationBudget,
) {
    let after = before.after(from, to, budget);
    let exceeds = after.exceeds(budget);
    let second_difference = i64::from(to.abs_diff(from));
    let spent_after = (spent.0)
        .checked_add(second_difference - i64::from(budget.nm_per_tick.get()))
        .map(Spent);
    // A check that fails ends the path, so the theorem stands before what implies it.
    if let (Some(spent_after), false, true) = (spent_after, exceeds, spent.is_covered(before)) {
        assert!(
            u64::try_from(spent_after.0).unwrap_or(0) <= limit_nm(budget),
            "T33: at most B + r n"
        );
        assert!(
            spent_after.is_covered(after),
            "T33: what is spent is counted, or was refilled"
        );
    }
    assert!(
        exceeds == (u64::from(after.0) > limit_nm(budget)),
        "T33: the limit is a thousand ticks of r"
    );
}

/// T33, the quiet client: a second difference of at most `r` does not raise the sum, so that it
/// stays at zero.
pub fn quiet_is_not_counted(before: Agitation, (from, to): (i32, i32), budget: &AgitationBudget) {
    let second_difference = (i64::from(to) - i64::from(from)).unsigned_abs();
    if second_difference > budget.nm_per_tick.get().into() {
        return;
    }
    let after = before.after(from, to, budget);
    assert!(
        before.exceeds(budget) || !after.exceeds(budget),
        "T33: a quiet client is not ended"
    );
    assert!(after.0 <= before.0, "T33: a quiet tick does not count");
}

/// T33, one axis under any command: in Obtain the second difference of its position offset counts,
/// and `r` is taken from the sum; elsewhere, and without a budget, there is none.
///
/// Composed as: `agitation_of_an_axis_is_counted`.
pub fn axis_is_counted(before: &Axis, command: &AxisCommand, config: &AxisConfig) {
    let mut after = *before;
    let _ = after.act(command, config, &mut AxisState::default());
    let changes = [before, &after].map(|axis| i64::from(axis.channels.position.change()));
    let [from, to] = changes;
    match config.agitation {
        Some(budget) if command.obtains => {
            let sum = u64::from(before.agitation.0) + (to - from).unsigned_abs();
            let sum = sum.min(u32::MAX.into());
            assert!(
                u64::from(after.agitation.0) == sum.saturating_sub(budget.nm_per_tick.get().into()),
                "T33: an axis counts its second difference"
            );
        }
        Some(_) => assert!(
            after.agitation == Agitation::ZERO,
            "T33: nothing counts outside Obtain"
        ),
        None => assert!(
            after.agitation == Agitation::ZERO,
            "T33: nothing counts without a budget"
        ),
    }
    let exceeds =
        (config.agitation).is_some_and(|budget| u64::from(before.agitation.0) > limit_nm(&budget));
    assert!(
        before.is_agitated(config) == exceeds,
        "T33: an axis is agitated beyond its own limit"
    );
}

/// T33, the decision: agitation ends a session that runs, in that tick, ramping; and without it no
/// session ends because of it.
///
/// Composed as: `agitation_ends_a_session`.
pub fn agitation_ends_the_session(state: &FsmState, fsm: &FsmInput, rules: &Rules) {
    let decision = decide(state, fsm, rules);
    if fsm.agitated && state.is_live() {
        assert!(
            matches!(decision.next.phase, Phase::SafeDisconnect | Phase::Fault)
                && decision.action == Action::Ramp,
            "T33: agitation ends the session"
        );
    }
    let because = decision.end == Some(EndReason::Because(Cause::Agitated));
    assert!(
        !because || fsm.agitated,
        "T33: only agitation ends it for agitation"
    );
}
