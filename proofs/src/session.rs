//! A whole tick of the session, over its whole state: one-step induction. Valid, and any input, one tick, valid, and the bounds.

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::message::{ClientMessage, Phase};
use gantry_tau_core::control::session::fsm::Action;
use gantry_tau_core::control::session::ingress::{Accepted, Classifier, Diagnostics};
use gantry_tau_core::control::session::{Cycle, Event, Input, Output, Session};

use crate::axis::Kind;

/// A session before a tick, and all that the tick depends on.
#[derive(Clone, Debug)]
pub struct Moment<const N: usize> {
    /// The session.
    pub session: Session<N>,
    /// What the host gives.
    pub cycle: Cycle<N>,
    /// What decides, of all that arrived.
    pub accepted: Accepted<N>,
    /// What only counts.
    pub diagnostics: Diagnostics,
}

impl<const N: usize> Moment<N> {
    /// What these events lead to.
    #[must_use]
    pub fn after_hearing(session: &Session<N>, input: &Input<N>) -> Self {
        let (accepted, diagnostics) = session.classify(&input.events, input.cycle.next_epoch);
        Self {
            session: *session,
            cycle: input.cycle,
            accepted,
            diagnostics,
        }
    }

    /// The tick: the session after it, and what it produced.
    #[must_use]
    pub fn step(&self) -> (Session<N>, Output<N>) {
        let mut after = self.session;
        let output = after.step(&self.cycle, self.accepted, self.diagnostics.clone());
        (after, output)
    }
}

/// T1, T2, T3 of one channel of every axis.
///
/// # Panics
/// When one of them does not hold.
pub fn channels_are_bounded<const N: usize>(moment: &Moment<N>, kind: Kind) {
    let (after, _) = moment.step();
    let before = &moment.session;
    for index in 0..N {
        let limits = kind.limits(&before.config().parameters().axes[index].limits);
        let old = kind.of(&before.parts().axes[index].channels);
        let new = kind.of(&after.parts().axes[index].channels);
        crate::channel::change_is_bounded(old, new, &limits);
    }
}

/// The invariant of every axis: channels and shadow within their limits, at rest where the phase says so.
///
/// # Panics
/// When it does not hold.
pub fn axes_stay_valid<const N: usize>(moment: &Moment<N>) {
    let (after, _) = moment.step();
    for index in 0..N {
        let limits = &after.config().parameters().axes[index].limits;
        assert!(
            after.parts().axes[index].is_valid(after.phase(), limits),
            "the invariant is kept"
        );
    }
}

/// T3: every drive's reference is inside the travel.
///
/// # Panics
/// When it does not hold.
pub fn references_are_inside_travel<const N: usize>(moment: &Moment<N>) {
    let (after, output) = moment.step();
    for index in 0..N {
        let travel = &after.config().parameters().axes[index].machine_travel;
        let reference = output.references[index].position;
        let inside = travel.lower <= reference && reference <= travel.upper;
        assert!(inside, "T3: the drive's reference is inside the travel");
    }
}

/// The rest of the invariant: the discrete state.
///
/// # Panics
/// When it does not hold.
pub fn discrete_stays_valid<const N: usize>(moment: &Moment<N>) {
    let (after, output) = moment.step();
    let ticks = after.config().parameters().handshake_ticks;
    assert!(
        after.parts().discrete.is_valid(ticks),
        "the discrete state stays valid"
    );
    assert!(output.state.phase == after.phase(), "the State says it");
}

/// T5: without a session, one channel of every axis moves by exactly `min(rho, |value|)` towards zero, whatever arrives.
///
/// # Panics
/// When it does not hold.
pub fn channels_ramp<const N: usize>(moment: &Moment<N>, kind: Kind) {
    let before = &moment.session;
    if !matches!(before.phase(), Phase::SafeDisconnect | Phase::Fault) {
        return;
    }
    let (after, _) = moment.step();
    for index in 0..N {
        let limits = kind.limits(&before.config().parameters().axes[index].limits);
        let old = kind.of(&before.parts().axes[index].channels);
        let new = kind.of(&after.parts().axes[index].channels);
        crate::channel::is_ramp_step(old, new, &limits);
    }
}

/// T6: whoever is welcomed finds every channel of every axis at zero, before and after.
///
/// # Panics
/// When it does not hold.
pub fn authority_needs_zero<const N: usize>(moment: &Moment<N>) {
    let before = &moment.session;
    let (after, output) = moment.step();
    let granted = output.welcome.is_some()
        || (after.parts().discrete.is_live() && !before.parts().discrete.is_live());
    if !granted {
        return;
    }
    for session in [before, &after] {
        for index in 0..N {
            let channels = &session.parts().axes[index].channels;
            assert!(channels.is_zero(), "T6: authority only at zero");
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
pub fn stop_ends_in_fault<const N: usize>(moment: &Moment<N>) {
    let before = &moment.session;
    if !moment.cycle.stop {
        return;
    }
    let (after, _) = moment.step();
    assert!(after.phase() == Phase::Fault, "T9: a stop ends in Fault");
    for index in 0..N {
        let limits = &before.config().parameters().axes[index].limits;
        let old = &before.parts().axes[index].channels;
        let ramped = old.act(Action::Ramp, &Offsets::default(), limits);
        let new = after.parts().axes[index].channels;
        assert!(new == ramped, "T9: every channel ramps");
    }
}

/// T7, for a whole tick: two inputs that are accepted alike lead to the same references and the same discrete state.
///
/// # Panics
/// When they do not.
pub fn counts_decide_nothing<const N: usize>(moment: &Moment<N>, diagnostics: &Diagnostics) {
    let (one, one_output) = moment.step();
    let diagnostics = diagnostics.clone();
    let (other, other_output) = Moment {
        diagnostics,
        ..moment.clone()
    }
    .step();
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

/// T12: a session goes on from any offsets that are within their limits, at rest and without an owner's targets, or refuses and
/// is what it was.
///
/// # Panics
/// When it does not hold.
pub fn resumes_or_refuses<const N: usize>(before: &Session<N>, in_force: &[Offsets; N]) {
    let mut after = *before;
    match after.resume(in_force) {
        Ok(()) => {
            assert!(after.is_valid(), "T12: a resumed session is valid");
            assert!(
                matches!(after.phase(), Phase::SafeDisconnect | Phase::Fault),
                "T12: a resumed session is over"
            );
        }
        Err(_) => assert!(after == *before, "T12: a refusal changes nothing"),
    }
    let welcome = after.welcome();
    assert!(
        welcome.tick == after.parts().discrete.tick,
        "T12: it can be welcomed to"
    );
}

/// Every property of a whole tick but T7's comparison of two inputs: T1 to T6 and T9.
///
/// # Panics
/// When one of them does not hold.
pub fn step_is_right<const N: usize>(moment: &Moment<N>) {
    for kind in Kind::ALL {
        channels_are_bounded(moment, kind);
        channels_ramp(moment, kind);
    }
    axes_stay_valid(moment);
    references_are_inside_travel(moment);
    discrete_stays_valid(moment);
    authority_needs_zero(moment);
    stop_ends_in_fault(moment);
    counts_decide_nothing(moment, &Diagnostics::default());
}

/// The input without what must not matter: strangers' events outside Listening, and the owner's commands that are not fresh.
#[must_use]
pub fn essential<const N: usize>(session: &Session<N>, input: &Input<N>) -> Input<N> {
    let classifier = Classifier {
        discrete: &session.parts().discrete,
        parameters: session.config().parameters(),
        axes: &session.parts().axes,
        next_epoch: input.cycle.next_epoch,
    };
    let mut without = input.clone();
    without.events.retain(|(from, event)| {
        if session.owner() != Some(*from) {
            return session.phase() == Phase::Listening;
        }
        match event {
            Event::Message(ClientMessage::Command(command)) => {
                crate::ingress::is_fresh(&classifier, command)
            }
            _ => true,
        }
    });
    without
}

/// T7, from the events on: an input without what does not come from the owner, or is not fresh, leads to the same references,
/// the same channels and the same discrete state.
///
/// # Panics
/// When it does not.
pub fn same_outcome<const N: usize>(session: &Session<N>, input: &Input<N>, essential: &Input<N>) {
    let (one, one_output) = Moment::after_hearing(session, input).step();
    let (other, other_output) = Moment::after_hearing(session, essential).step();
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
