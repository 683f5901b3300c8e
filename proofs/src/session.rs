//! A whole tick of the session, over its whole state: one-step induction. Valid, and any input, one tick, valid, and the bounds.

use gantry_tau_core::channel::{Channel, Limits};
use gantry_tau_core::message::{AxisLimits, Phase};
use gantry_tau_core::session::channels::AxisChannels;
use gantry_tau_core::session::{Input, Output, Session};

/// One tick of a copy.
#[must_use]
pub fn tick<const N: usize>(before: &Session<N>, input: &Input<N>) -> (Session<N>, Output<N>) {
    let mut after = *before;
    let output = after.tick(input);
    (after, output)
}

/// The three channels of an axis before and after, each with its limits.
fn steps(
    before: &AxisChannels,
    after: &AxisChannels,
    limits: &AxisLimits,
) -> [(Channel, Channel, Limits); 3] {
    [
        (before.position, after.position, limits.position),
        (before.velocity, after.velocity, limits.velocity),
        (before.torque, after.torque, limits.torque),
    ]
}

/// T1, T2, T3 and the invariant of one axis of the session, for its channels in force and for its shadow.
///
/// # Panics
/// When one of them does not hold.
pub fn axis_is_bounded<const N: usize>(before: &Session<N>, input: &Input<N>, index: usize) {
    let (after, output) = tick(before, input);
    let (old, new) = (&before.parts().axes[index], &after.parts().axes[index]);
    let config = &before.config().parameters().axes[index];
    assert!(
        new.is_valid(after.phase(), &config.limits),
        "the invariant is kept"
    );
    for (a, b, limits) in steps(&old.channels, &new.channels, &config.limits) {
        crate::channel::change_is_bounded(a, b, &limits);
    }
    let travel = &config.machine_travel;
    let reference = output.references[index].position;
    let inside = travel.lower <= reference && reference <= travel.upper;
    assert!(inside, "T3: the drive's reference is inside the travel");
}

/// The rest of the invariant: the discrete state.
///
/// # Panics
/// When it does not hold.
pub fn discrete_stays_valid<const N: usize>(before: &Session<N>, input: &Input<N>) {
    let (after, output) = tick(before, input);
    let ticks = after.config().parameters().handshake_ticks;
    assert!(
        after.parts().discrete.is_valid(ticks),
        "the discrete state stays valid"
    );
    assert!(output.state.phase == after.phase(), "the State says it");
}

/// T5: without a session, each channel of an axis moves by exactly `min(rho, |value|)` towards zero, whatever arrives.
///
/// # Panics
/// When it does not hold.
pub fn axis_ramps<const N: usize>(before: &Session<N>, input: &Input<N>, index: usize) {
    if !matches!(before.phase(), Phase::SafeDisconnect | Phase::Fault) {
        return;
    }
    let (after, _) = tick(before, input);
    let (old, new) = (&before.parts().axes[index], &after.parts().axes[index]);
    let limits = &before.config().parameters().axes[index].limits;
    for (a, b, limits) in steps(&old.channels, &new.channels, limits) {
        crate::channel::is_ramp_step(a, b, &limits);
    }
}

/// T6: whoever is welcomed finds every channel of every axis at zero, before and after.
///
/// # Panics
/// When it does not hold.
pub fn authority_needs_zero<const N: usize>(before: &Session<N>, input: &Input<N>) {
    let (after, output) = tick(before, input);
    let granted = output.welcome.is_some()
        || (after.parts().discrete.is_live() && !before.parts().discrete.is_live());
    if !granted {
        return;
    }
    for session in [before, &after] {
        for axis in &session.parts().axes {
            assert!(axis.channels.is_zero(), "T6: authority only at zero");
        }
    }
    assert!(
        output.welcome == after.owner() && after.phase() == Phase::Handshake,
        "T6: who is welcomed owns the session"
    );
}

/// T9: a step with the stop asserted ends in Fault, and every channel ramps.
///
/// # Panics
/// When it does not hold.
pub fn stop_ends_in_fault<const N: usize>(before: &Session<N>, input: &Input<N>) {
    if !input.cycle.stop {
        return;
    }
    let (after, _) = tick(before, input);
    assert!(after.phase() == Phase::Fault, "T9: a stop ends in Fault");
    let axes = before.parts().axes.iter().zip(&after.parts().axes);
    for ((old, new), config) in axes.zip(&before.config().parameters().axes) {
        for (a, b, limits) in steps(&old.channels, &new.channels, &config.limits) {
            assert!(b == a.ramp(&limits), "T9: every channel ramps");
        }
    }
}

/// T7, for a whole tick: without the events of the given positions the references and the discrete state are the same.
///
/// # Panics
/// When they are not.
pub fn same_outcome<const N: usize>(before: &Session<N>, input: &Input<N>, without: &Input<N>) {
    let (one, one_output) = tick(before, input);
    let (other, other_output) = tick(before, without);
    assert!(
        one_output.references == other_output.references,
        "T7: the same references"
    );
    assert!(
        one.parts().discrete == other.parts().discrete,
        "T7: the same discrete state"
    );
    assert!(
        one.parts().axes == other.parts().axes,
        "T7: the same channels"
    );
}
