//! Any session in any valid state, anything that can have been accepted, any cycle.

use gantry_tau_core::control::message::Counters;
use gantry_tau_core::control::session::ingress::Diagnostics;

use crate::axis::Kind;
use crate::session::{self, StepInput};

/// Axes of the session where axes could get into each other's way.
const AXES: usize = 3;

/// Any counts; the refusals are written, never read.
fn any_diagnostics() -> Diagnostics {
    Diagnostics {
        counters: kani::any::<Counters>(),
        late: kani::any(),
        ..Diagnostics::default()
    }
}

/// Any input there can be, and more: what was accepted need not follow from any events.
fn any_input<const N: usize>() -> StepInput<N> {
    StepInput {
        session: kani::any(),
        cycle: kani::any(),
        accepted: kani::any(),
        diagnostics: any_diagnostics(),
    }
}

#[kani::proof]
#[kani::unwind(3)]
#[kani::solver(minisat)]
fn session_position_is_bounded() {
    session::channels_are_bounded(&any_input::<1>(), Kind::Position);
    kani::cover!(true, "the end is reached");
}

#[kani::proof]
#[kani::unwind(3)]
#[kani::solver(minisat)]
fn session_velocity_is_bounded() {
    session::channels_are_bounded(&any_input::<1>(), Kind::Velocity);
    kani::cover!(true, "the end is reached");
}

#[kani::proof]
#[kani::unwind(3)]
#[kani::solver(minisat)]
fn session_torque_is_bounded() {
    session::channels_are_bounded(&any_input::<1>(), Kind::Torque);
    kani::cover!(true, "the end is reached");
}

#[kani::proof]
#[kani::unwind(3)]
#[kani::solver(minisat)]
fn session_position_ramps() {
    session::channels_ramp(&any_input::<1>(), Kind::Position);
    kani::cover!(true, "the end is reached");
}

#[kani::proof]
#[kani::unwind(3)]
#[kani::solver(minisat)]
fn session_velocity_ramps() {
    session::channels_ramp(&any_input::<1>(), Kind::Velocity);
    kani::cover!(true, "the end is reached");
}

#[kani::proof]
#[kani::unwind(3)]
#[kani::solver(minisat)]
fn session_torque_ramps() {
    session::channels_ramp(&any_input::<1>(), Kind::Torque);
    kani::cover!(true, "the end is reached");
}

#[kani::proof]
#[kani::unwind(5)]
#[kani::solver(minisat)]
fn session_axes_stay_valid() {
    session::axes_stay_valid(&any_input::<AXES>());
    kani::cover!(true, "the end is reached");
}

#[kani::proof]
#[kani::unwind(5)]
#[kani::solver(minisat)]
fn session_discrete_stays_valid() {
    session::discrete_stays_valid(&any_input::<AXES>());
    kani::cover!(true, "the end is reached");
}

#[kani::proof]
#[kani::unwind(5)]
#[kani::solver(minisat)]
fn session_references_are_inside_travel() {
    session::references_are_inside_travel(&any_input::<AXES>());
    kani::cover!(true, "the end is reached");
}

#[kani::proof]
#[kani::unwind(5)]
#[kani::solver(minisat)]
fn session_authority_needs_zero() {
    session::authority_needs_zero(&any_input::<AXES>());
    kani::cover!(true, "the end is reached");
}

#[kani::proof]
#[kani::unwind(5)]
#[kani::solver(minisat)]
fn session_stop_ends_in_fault() {
    session::stop_ends_in_fault(&any_input::<AXES>());
    kani::cover!(true, "the end is reached");
}
