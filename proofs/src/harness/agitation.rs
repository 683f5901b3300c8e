//! Any sum, any changes of an offset, any budget that validation accepts; any axis under any
//! command; any decision.

use gantry_tau_core::control::agitation::{Agitation, AgitationBudget};
use gantry_tau_core::control::session::config::{AxisConfig, Config};
use gantry_tau_core::verification::control::{Axis, FsmInput, FsmState, Rules};

use super::kani;
use crate::properties::agitation::{self, Spent};

/// Any budget that validation accepts.
fn any_budget() -> AgitationBudget {
    let budget: AgitationBudget = kani::any();
    assume!(
        budget.is_valid(),
        budget.nm_per_tick.get() == AgitationBudget::MAX_NM_PER_TICK,
        "the largest budget is valid"
    );
    budget
}

/// Any axis that validation accepts.
fn any_axis() -> AxisConfig {
    let config: Config<1> = kani::any();
    let [axis] = config.parameters().axes;
    axis
}

/// Any axis whose channels and shadow are within their limits, without agitation if it has no
/// budget.
fn any_state(config: &AxisConfig) -> Axis {
    let axis: Axis = kani::any();
    let limits = &config.limits;
    let valid = axis.channels.is_valid(limits)
        && axis.shadow.is_valid(limits)
        && (config.agitation.is_some() || axis.agitation == Agitation::ZERO);
    assume!(
        valid,
        axis.is_agitated(config),
        "some axes are beyond their budget"
    );
    axis
}

harnesses! {
    agitation_is_bounded [minisat] {
        let (budget, before): (_, Agitation) = (any_budget(), kani::any());
        let spent = Spent(kani::any());
        assume!(
            spent.is_covered(before),
            spent.0 > 0,
            "more was spent than refilled"
        );
        let changes: (i32, i32) = kani::any();
        kani::cover!(!before.after(changes.0, changes.1, &budget).exceeds(&budget), "a tick within the budget");
        agitation::second_differences_are_bounded(before, spent, changes, &budget);
    }
    agitation_of_a_quiet_tick_is_not_counted [minisat] {
        let (budget, changes): (_, (i32, i32)) = (any_budget(), kani::any());
        assume!(
            changes.0.abs_diff(changes.1) <= budget.nm_per_tick.get(),
            changes.0 < 0 && changes.1 > 0,
            "a quiet reversal"
        );
        agitation::quiet_is_not_counted(kani::any(), changes, &budget);
    }
    agitation_of_an_axis_is_counted [minisat, unwind 3] {
        let config = any_axis();
        kani::cover!(config.agitation.is_some(), "some axes have a budget");
        agitation::axis_is_counted(&any_state(&config), &kani::any(), &config);
    }
    agitation_ends_a_session [minisat] {
        let (rules, state, fsm): (Rules, FsmState, FsmInput) = (kani::any(), kani::any(), kani::any());
        assume!(
            rules.handshake_ticks > 0 && state.is_valid(rules.handshake_ticks),
            state.is_live() && fsm.agitated && !fsm.stop,
            "a session that runs, agitated"
        );
        agitation::agitation_ends_the_session(&state, &fsm, &rules);
    }
}
