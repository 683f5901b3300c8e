//! The whole discrete state, anything that can have arrived, any rules; more than any configuration gives.

use gantry_tau_core::message::Phase;
use gantry_tau_core::session::decide::{Arrivals, Discrete, Rules};

use crate::decide;

/// Any rules whose handshake can last at all.
fn any_rules() -> Rules {
    let rules: Rules = kani::any();
    kani::assume(rules.handshake_ticks > 0);
    kani::cover!(rules.budget.is_some(), "some rules have a budget");
    rules
}

/// Any valid discrete state.
fn any_discrete(rules: &Rules) -> Discrete {
    let state: Discrete = kani::any();
    kani::assume(state.is_valid(rules.handshake_ticks));
    kani::cover!(state.phase == Phase::Obtain, "Obtain is a valid state");
    state
}

/// Any state, arrivals and rules, checked against one property.
fn check(property: fn(&Discrete, &Arrivals, &Rules)) {
    let rules = any_rules();
    property(&any_discrete(&rules), &kani::any(), &rules);
    kani::cover!(true, "the end is reached");
}

#[kani::proof]
#[kani::solver(minisat)]
fn decide_keeps_the_invariant() {
    check(decide::keeps_the_invariant);
}

#[kani::proof]
#[kani::solver(minisat)]
fn decide_second_miss_ends() {
    check(decide::second_miss_ends);
}

#[kani::proof]
#[kani::solver(minisat)]
fn decide_authority_needs_zero() {
    check(decide::authority_needs_zero);
}

#[kani::proof]
#[kani::solver(minisat)]
fn decide_stop_leads_to_fault() {
    check(decide::stop_leads_to_fault);
}

#[kani::proof]
#[kani::solver(minisat)]
fn decide_no_session_ramps() {
    check(decide::no_session_ramps);
}
