//! Any session in any valid state, any accepted input, any cycle.

use gantry_tau_core::control::message::{Counters, Phase};
use gantry_tau_core::control::session::config::Config;
use gantry_tau_core::verification::control::{Axis, Diagnostics, FsmState, Rules};

use super::kani;
use crate::properties::axis::Kind;
use crate::properties::session::{self, StepInput};
use crate::stand_in;

/// Axes of a session whose axes could affect each other.
const AXES: usize = 3;

/// Any counts; the refusals are written, never read.
fn any_diagnostics() -> Diagnostics {
    Diagnostics {
        counters: kani::any::<Counters>(),
        late: kani::any(),
        ..Diagnostics::default()
    }
}

/// Any step, and more: the accepted input need not follow from any events.
fn any_input<const N: usize>() -> StepInput<N> {
    StepInput {
        session: kani::any(),
        tick: kani::any(),
        refused: kani::any(),
        accepted: kani::any(),
        diagnostics: any_diagnostics(),
    }
}

/// Checks a property with decision and axis as unknown functions.
fn with_unknown_parts(property: impl FnOnce()) {
    stand_in::choose_bit(kani::any());
    stand_in::choose_argument(kani::any(), kani::any());
    property();
    kani::cover!(true, "the property returns");
}

harnesses! {
    session_of_3_axes_acts_axis_by_axis [minisat, unwind 5] { session::axes_act_by_themselves(&any_input::<3>(), &kani::any(), &kani::any()); }
    session_of_6_axes_acts_axis_by_axis [minisat, unwind 8] { session::axes_act_by_themselves(&any_input::<6>(), &kani::any(), &kani::any()); }
    session_orders_what_is_decided [minisat, unwind 5, stub(gantry_tau_core::verification::control::nominal_stepped, crate::stand_in::nominal_stepped), stub(gantry_tau_core::verification::control::nominal_accelerated, crate::stand_in::nominal_accelerated)] {
        stand_in::choose_bit(kani::any());
        session::order_is_of_the_decision(&any_input::<AXES>());
    }
    session_of_6_axes_orders_what_is_decided [minisat, unwind 8, stub(gantry_tau_core::verification::control::nominal_stepped, crate::stand_in::nominal_stepped), stub(gantry_tau_core::verification::control::nominal_accelerated, crate::stand_in::nominal_accelerated)] {
        stand_in::choose_bit(kani::any());
        session::order_is_of_the_decision(&any_input::<6>());
    }
    session_decides_by_the_rules [minisat, unwind 14, stub(gantry_tau_core::verification::control::nominal_stepped, crate::stand_in::nominal_stepped), stub(gantry_tau_core::verification::control::nominal_accelerated, crate::stand_in::nominal_accelerated), stub(gantry_tau_core::verification::control::decide, crate::stand_in::decide), stub(gantry_tau_core::verification::control::Axis::act, crate::stand_in::act)] { with_unknown_parts(|| session::decides_by_the_rules(&any_input::<AXES>())); }
    session_of_6_axes_decides_by_the_rules [minisat, unwind 14, stub(gantry_tau_core::verification::control::nominal_stepped, crate::stand_in::nominal_stepped), stub(gantry_tau_core::verification::control::nominal_accelerated, crate::stand_in::nominal_accelerated), stub(gantry_tau_core::verification::control::decide, crate::stand_in::decide), stub(gantry_tau_core::verification::control::Axis::act, crate::stand_in::act)] { with_unknown_parts(|| session::decides_by_the_rules(&any_input::<6>())); }
    session_step_is_its_parts [minisat, unwind 14, stub(gantry_tau_core::verification::control::nominal_stepped, crate::stand_in::nominal_stepped), stub(gantry_tau_core::verification::control::nominal_accelerated, crate::stand_in::nominal_accelerated), stub(gantry_tau_core::verification::control::decide, crate::stand_in::decide), stub(gantry_tau_core::verification::control::Axis::act, crate::stand_in::act)] { with_unknown_parts(|| session::step_is_its_parts(&any_input::<AXES>())); }
    session_of_6_axes_step_is_its_parts [minisat, unwind 14, stub(gantry_tau_core::verification::control::nominal_stepped, crate::stand_in::nominal_stepped), stub(gantry_tau_core::verification::control::nominal_accelerated, crate::stand_in::nominal_accelerated), stub(gantry_tau_core::verification::control::decide, crate::stand_in::decide), stub(gantry_tau_core::verification::control::Axis::act, crate::stand_in::act)] { with_unknown_parts(|| session::step_is_its_parts(&any_input::<6>())); }
    session_axis_of_many_stays_valid [minisat, unwind 5] {
        let config: Config<1> = kani::any();
        let ([axis], discrete, rules) = (config.parameters().axes, kani::any::<FsmState>(), kani::any::<Rules>());
        assume!(discrete.is_valid(rules.handshake_ticks), discrete.phase == Phase::Obtain, "Obtain is a valid state");
        let state: Axis = kani::any();
        kani::cover!(!state.channels.is_zero(), "an axis that is not at zero");
        session::axis_of_many_stays_valid(&state, &axis, (&discrete, &kani::any(), &rules), &kani::any());
    }
    session_position_is_bounded [minisat, unwind 5] { session::channels_are_bounded(&any_input::<1>(), Kind::Position); }
    session_velocity_is_bounded [minisat, unwind 5] { session::channels_are_bounded(&any_input::<1>(), Kind::Velocity); }
    session_torque_is_bounded [minisat, unwind 5] { session::channels_are_bounded(&any_input::<1>(), Kind::Torque); }
    session_position_ramps [minisat, unwind 5] { session::channels_ramp(&any_input::<1>(), Kind::Position); }
    session_velocity_ramps [minisat, unwind 5] { session::channels_ramp(&any_input::<1>(), Kind::Velocity); }
    session_torque_ramps [minisat, unwind 5] { session::channels_ramp(&any_input::<1>(), Kind::Torque); }
    session_axes_stay_valid [minisat, unwind 5] { session::axes_stay_valid(&any_input::<AXES>()); }
    session_discrete_stays_valid [minisat, unwind 5] { session::discrete_stays_valid(&any_input::<AXES>()); }
    session_references_are_inside_travel [minisat, unwind 5] { session::references_are_inside_travel(&any_input::<AXES>()); }
    session_authority_needs_zero [minisat, unwind 5] { session::authority_needs_zero(&any_input::<AXES>()); }
    session_stop_ends_in_fault [minisat, unwind 5] { session::stop_ends_in_fault(&any_input::<AXES>()); }
    session_latch_holds [minisat, unwind 5] { session::latch_holds(&any_input::<AXES>()); }
    session_withheld_until_read_back [minisat, unwind 5] { session::withheld_until_read_back(&any_input::<AXES>()); }
}
