//! Any samples of any channel, any two States of a channel, any two references. (No alarm on a
//! session is tested, not proved.)

use gantry_tau_core::control::channel::Limits;
use gantry_tau_core::control::message::{AxisLimits, State};
use gantry_tau_core::control::monitor::ChannelKind;
use gantry_tau_core::units::OffsetNm;
use gantry_tau_core::verification::control::Trace;
use gantry_tau_core::{Offsets, PositionNm, Reference, Travel};

use super::kani;
use crate::properties::monitor;

/// Any last sample of a channel: its change is the difference of two values.
fn any_trace() -> Trace {
    let (earlier, value): (i32, i32) = (kani::any(), kani::any());
    let is_known: bool = kani::any();
    Trace {
        value: value.into(),
        change: is_known.then_some(i64::from(value) - i64::from(earlier)),
    }
}

/// Any State whose axis has offsets and shadow in one channel only.
fn any_state(kind: ChannelKind) -> State<1> {
    let mut state: State<1> = kani::any();
    let axis = &mut state.axes[0];
    (axis.offsets, axis.shadow) = (only(axis.offsets, kind), only(axis.shadow, kind));
    state
}

/// The offset of one channel; the others at zero.
fn only(offsets: Offsets, kind: ChannelKind) -> Offsets {
    match kind {
        ChannelKind::Position => Offsets::position(offsets.position),
        ChannelKind::Velocity => Offsets {
            velocity: offsets.velocity,
            ..Offsets::ZERO
        },
        ChannelKind::Torque => Offsets {
            torque: offsets.torque,
            ..Offsets::ZERO
        },
    }
}

/// Any two States that follow each other, in one channel.
fn check_states(kind: ChannelKind) {
    let limits: [AxisLimits; 1] = kani::any();
    let (before, state) = (any_state(kind), any_state(kind));
    monitor::state_is_flagged_exactly(&limits, &before, &state);
    kani::cover!(
        state.axes[0].offsets != Offsets::ZERO,
        "some offsets are not zero"
    );
}

harnesses! {
    monitor_sample_is_flagged_exactly [minisat] {
        let limits: Limits<OffsetNm> = kani::any();
        let is_first: bool = kani::any();
        let before = (!is_first).then(any_trace);
        monitor::sample_is_flagged_exactly(before, kani::any(), 1, kani::any(), &limits);
        kani::cover!(is_first, "some samples are the first");
        kani::cover!(!is_first, "some samples follow another");
    }
    monitor_gap_is_flagged_exactly [minisat] {
        let limits: Limits<OffsetNm> = kani::any();
        // A literal: a product of two unknowns is beyond the solver.
        let (before, motion) = (any_trace(), kani::any());
        monitor::sample_is_flagged_exactly(Some(before), kani::any(), 2, motion, &limits);
        kani::cover!(before.change.is_none(), "some gaps follow a gap");
    }
    monitor_duplicate_is_flagged_exactly [minisat] {
        let limits: Limits<OffsetNm> = kani::any();
        let (before, motion) = (any_trace(), kani::any());
        monitor::sample_is_flagged_exactly(Some(before), kani::any(), 0, motion, &limits);
        kani::cover!(before.change.is_some(), "some changes are known");
    }
    monitor_position_is_flagged_exactly [minisat, unwind 4] { check_states(ChannelKind::Position); }
    monitor_velocity_is_flagged_exactly [minisat, unwind 4] { check_states(ChannelKind::Velocity); }
    monitor_torque_is_flagged_exactly [minisat, unwind 4] { check_states(ChannelKind::Torque); }
    monitor_accepted_references_are_bounded [minisat, unwind 4] {
        let limits: [AxisLimits; 1] = kani::any();
        let travel: [Travel; 1] = kani::any();
        let nominal: [[PositionNm; 1]; 2] = kani::any();
        let references: [[Reference; 1]; 2] = kani::any();
        let (first, second) = ((&nominal[0], &references[0]), (&nominal[1], &references[1]));
        monitor::accepted_references_are_bounded(&limits, &travel, first, second);
    }
}
