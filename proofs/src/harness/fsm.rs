//! The whole discrete state, anything that can have arrived, any rules; more than any configuration gives.

use gantry_tau_core::control::message::Phase;
use gantry_tau_core::control::session::fsm::{FsmInput, FsmState, Rules};

use crate::fsm;

/// Any rules whose handshake can last at all.
fn any_rules() -> Rules {
    let rules: Rules = kani::any();
    kani::assume(rules.handshake_ticks > 0);
    kani::cover!(rules.budget.is_some(), "some rules have a budget");
    rules
}

/// Any valid discrete state.
fn any_discrete(rules: &Rules) -> FsmState {
    let state: FsmState = kani::any();
    kani::assume(state.is_valid(rules.handshake_ticks));
    kani::cover!(state.phase == Phase::Obtain, "Obtain is a valid state");
    state
}

/// Any state, fsm and rules, checked against one property.
fn check(property: fn(&FsmState, &FsmInput, &Rules)) {
    let rules = any_rules();
    property(&any_discrete(&rules), &kani::any(), &rules);
    kani::cover!(true, "the end is reached");
}

#[kani::proof]
#[kani::solver(minisat)]
fn decide_keeps_the_invariant() {
    check(fsm::keeps_the_invariant);
}

#[kani::proof]
#[kani::solver(minisat)]
fn decide_second_miss_ends() {
    check(fsm::second_miss_ends);
}

#[kani::proof]
#[kani::solver(minisat)]
fn decide_authority_needs_zero() {
    check(fsm::authority_needs_zero);
}

#[kani::proof]
#[kani::solver(minisat)]
fn decide_stop_leads_to_fault() {
    check(fsm::stop_leads_to_fault);
}

#[kani::proof]
#[kani::solver(minisat)]
fn decide_no_session_ramps() {
    check(fsm::no_session_ramps);
}
