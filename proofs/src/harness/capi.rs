//! Any address, any memory of a caller, any value of a struct of C.

use gantry_tau_capi::server::gt_in_force;
use gantry_tau_capi::server::{GT_MAX_AXES, GT_MAX_MOTORS};
use gantry_tau_capi::verification::Room;
use gantry_tau_core::control::axis::Reference;
use gantry_tau_core::control::channel::Limits;
use gantry_tau_core::control::session::config::{AxisConfig, Config, Parameters, Travel};
use gantry_tau_core::control::session::{Input, Output, Session, Start};
use gantry_tau_core::units::{EpochRange, PositionNm};

use super::kani;
use crate::properties::capi;

/// Any index below a bound.
fn any_index(bound: usize) -> usize {
    let index = kani::any();
    assume!(index < bound, index + 1 == bound, "the last index");
    index
}

/// Any input of a tick.
fn check_input<const N: usize>() {
    capi::input_arrives::<N>(&kani::any(), any_index(N));
}

/// Output of a first tick; `None` would leave the covers unreached.
fn first_output<const N: usize>() -> Option<Output<N>> {
    let axis = AxisConfig::position_only(Limits::DISABLED, Travel::around_zero(0), 0);
    let config = Config::new(Parameters::thesis([axis; N])).ok()?;
    let mut session = Session::new(config, &Start::at_rest([PositionNm(0); N])).ok()?;
    Some(session.tick(&Input::empty(EpochRange::VOLATILE)))
}

/// Any output of a tick, with the State of a first one, and none or one refusal.
fn check_output<const N: usize>() {
    let Some(mut output) = first_output::<N>() else {
        return;
    };
    (output.owner, output.welcome, output.ended) = (kani::any(), kani::any(), kani::any());
    let is_refused = kani::any();
    if is_refused {
        let refused = output.refusals.push(kani::any());
        kani::cover!(refused.is_ok(), "one refusal");
    }
    let references: Option<[Reference; GT_MAX_MOTORS]> = kani::any();
    kani::cover!(references.is_some(), "some references are written");
    capi::output_arrives::<N>(
        references.as_ref(),
        &output,
        any_index(GT_MAX_MOTORS + 1),
        any_index(GT_MAX_MOTORS),
    );
}

/// Anything that C says of references.
fn check_written<const N: usize>() {
    let session: Session<N> = kani::any();
    let in_force: Option<[gt_in_force; N]> = kani::any();
    kani::cover!(in_force.is_none(), "nothing at the pointer");
    let said = (kani::any(), in_force);
    capi::write_is_judged(&session, kani::any(), said, any_index(N));
}

harnesses! {
    capi_written_is_judged [minisat, unwind 5] { check_written::<1>(); }
    capi_pointer_is_judged [minisat] { capi::pointer_is_judged(kani::any()); }
    capi_object_is_made [minisat, unwind 10] { capi::object_is_made(&mut kani::any(), kani::any(), kani::any()); }
    capi_object_is_found [minisat, unwind 10] {
        let mut room: Room = kani::any();
        capi::object_is_found(&mut room, kani::any());
        kani::cover!(room.find(Some(0)).is_ok(), "an object at the beginning");
    }
    capi_bytes_are_borrowed [minisat] { capi::bytes_are_borrowed(&mut kani::any(), kani::any(), kani::any(), kani::any()); }
    capi_input_of_3_arrives [minisat, unwind 14] { check_input::<3>(); }
    capi_input_of_6_arrives [minisat, unwind 14] { check_input::<6>(); }
    capi_output_arrives [minisat, unwind 14] { check_output::<1>(); }
    capi_state_of_3_arrives [minisat, unwind 14] { capi::state_arrives::<3>(&kani::any(), any_index(GT_MAX_AXES)); }
    capi_state_of_6_arrives [minisat, unwind 14] { capi::state_arrives::<6>(&kani::any(), any_index(GT_MAX_AXES)); }
    capi_axis_arrives [minisat] { capi::axis_arrives(&kani::any()); }
    capi_start_of_3_arrives [minisat, unwind 8] { capi::start_arrives::<3>(kani::any(), &kani::any(), any_index(3)); }
    capi_start_of_6_arrives [minisat, unwind 8] { capi::start_arrives::<6>(kani::any(), &kani::any(), any_index(6)); }
}
