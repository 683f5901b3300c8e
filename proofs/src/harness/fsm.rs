//! Any valid discrete state, any input, any rules; more than a configuration gives.

use gantry_tau_core::control::message::Phase;
use gantry_tau_core::verification::control::{FsmInput, FsmState, Rules};

use super::kani;
use crate::properties::fsm;

/// Any rules with a handshake of at least one tick.
fn any_rules() -> Rules {
    let rules: Rules = kani::any();
    assume!(
        rules.handshake_ticks > 0,
        rules.budget.is_some(),
        "some rules have a budget"
    );
    rules
}

/// Any valid discrete state.
fn any_discrete(rules: &Rules) -> FsmState {
    let state: FsmState = kani::any();
    assume!(
        state.is_valid(rules.handshake_ticks),
        state.phase == Phase::Obtain,
        "Obtain is a valid state"
    );
    state
}

/// Checks one property of any state, input and rules.
fn check(property: fn(&FsmState, &FsmInput, &Rules)) {
    let rules = any_rules();
    property(&any_discrete(&rules), &kani::any(), &rules);
}

/// Any fate of the latch in storage.
fn latch_keeps_every_stop(state: &FsmState, fsm: &FsmInput, rules: &Rules) {
    fsm::latch_keeps_every_stop(state, fsm, rules, kani::any(), kani::any());
}

harnesses! {
    decide_keeps_the_invariant [minisat] { check(fsm::keeps_the_invariant); }
    decide_second_miss_ends [minisat] { check(fsm::second_miss_ends); }
    decide_authority_needs_zero [minisat] { check(fsm::authority_needs_zero); }
    decide_stop_leads_to_fault [minisat] { check(fsm::stop_leads_to_fault); }
    decide_latch_keeps_every_stop [minisat] { check(latch_keeps_every_stop); }
    decide_silence_leads_to_listening [minisat] { check(fsm::silence_leads_to_listening); }
    decide_epochs_and_sequences_rise [minisat] { check(fsm::epochs_and_sequences_rise); }
    decide_no_session_ramps [minisat] { check(fsm::no_session_ramps); }
}
