//! Any session in any valid state, anything that can have been heard, any cycle.

use gantry_tau_core::message::Counters;
use gantry_tau_core::session::sift::Noted;

use crate::session::{self, Kind, Moment};

/// Axes of the session.
const AXES: usize = 3;

/// Any counts; the refusals are written, never read.
fn any_noted() -> Noted {
    Noted {
        counters: kani::any::<Counters>(),
        late: kani::any(),
        ..Noted::default()
    }
}

/// Any moment there can be, and more: what was heard need not follow from any events.
fn any_moment() -> Moment<AXES> {
    Moment {
        session: kani::any(),
        cycle: kani::any(),
        heard: kani::any(),
        noted: any_noted(),
    }
}

/// Any axis.
fn any_index() -> usize {
    let index = kani::any();
    kani::assume(index < AXES);
    kani::cover!(index == AXES - 1, "the last axis");
    index
}

/// Any of its channels.
fn any_kind() -> Kind {
    match kani::any() {
        0_u8 => Kind::Position,
        1 => Kind::Velocity,
        _ => Kind::Torque,
    }
}

#[kani::proof]
#[kani::unwind(5)]
#[kani::solver(minisat)]
fn session_discrete_stays_valid() {
    session::discrete_stays_valid(&any_moment());
    kani::cover!(true, "the end is reached");
}

#[kani::proof]
#[kani::unwind(5)]
#[kani::solver(minisat)]
fn session_authority_needs_zero() {
    session::authority_needs_zero(&any_moment());
    kani::cover!(true, "the end is reached");
}

#[kani::proof]
#[kani::unwind(5)]
#[kani::solver(minisat)]
fn session_stop_ends_in_fault() {
    session::stop_ends_in_fault(&any_moment());
    kani::cover!(true, "the end is reached");
}

#[kani::proof]
#[kani::unwind(5)]
#[kani::solver(minisat)]
fn session_channel_is_bounded() {
    session::channel_is_bounded(&any_moment(), any_index(), any_kind());
    kani::cover!(true, "the end is reached");
}

#[kani::proof]
#[kani::unwind(5)]
#[kani::solver(minisat)]
fn session_axis_stays_valid() {
    session::axis_stays_valid(&any_moment(), any_index());
    kani::cover!(true, "the end is reached");
}

#[kani::proof]
#[kani::unwind(5)]
#[kani::solver(minisat)]
fn session_channel_ramps() {
    session::channel_ramps(&any_moment(), any_index(), any_kind());
    kani::cover!(true, "the end is reached");
}

#[kani::proof]
#[kani::unwind(5)]
#[kani::solver(minisat)]
fn session_reference_is_inside_travel() {
    session::reference_is_inside_travel(&any_moment(), any_index());
    kani::cover!(true, "the end is reached");
}

#[kani::proof]
#[kani::unwind(5)]
#[kani::solver(minisat)]
fn session_counts_decide_nothing() {
    session::counts_decide_nothing(&any_moment(), &any_noted());
    kani::cover!(true, "the end is reached");
}
