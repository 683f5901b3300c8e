//! The invariant of a session, clause by clause: a state that breaks one is no session.

use super::*;
use crate::control::channel::Channel;
use crate::units::ChannelUnit;

/// A session in this phase, every channel at zero.
fn in_phase(phase: Phase) -> Session<2> {
    let mut bench = Bench::new(parameters());
    let moves: &[Move] = match phase {
        Listening => &[],
        Handshake => &[Hello],
        Submit => &[Hello, submit(0)],
        Obtain => &[Hello, submit(0), obtain(0)],
        SafeDisconnect => &[Hello, Goodbye],
        Fault => &[STOP],
    };
    for one in moves {
        bench.play(one);
    }
    assert_eq!(bench.session.phase(), phase);
    bench.session
}

/// A channel at `value` after `change`, under any limits.
fn channel<U: ChannelUnit>(value: i32, change: i32) -> Channel<U> {
    Channel::from_parts(
        U::saturating_from(value),
        change,
        &limits(i32::MAX, 1 << 30, i32::MAX, 1),
    )
    .unwrap()
}

/// One clause broken at a time, all others kept.
#[test]
fn every_clause_of_the_invariant_counts() {
    type Break = fn(&mut Parts<2>);
    let breaks: [(Phase, Break); 25] = [
        (Listening, |parts| parts.discrete.owner = Some(OWNER)),
        (Handshake, |parts| parts.discrete.owner = None),
        (Submit, |parts| parts.discrete.owner = None),
        (Obtain, |parts| parts.discrete.owner = None),
        (Obtain, |parts| parts.discrete.misses = 1),
        (Submit, |parts| parts.discrete.history = 1),
        (Submit, |parts| {
            (parts.discrete.misses, parts.discrete.history) = (2, 2)
        }),
        (Handshake, |parts| parts.discrete.misses = 1),
        (Handshake, |parts| parts.discrete.waited = 1_000),
        (Handshake, |parts| parts.discrete.history = 2),
        (Obtain, |parts| parts.discrete.waited = 1),
        (Listening, |parts| parts.discrete.rearm_released = true),
        (SafeDisconnect, |parts| parts.discrete.latched = true),
        (Obtain, |parts| parts.withheld = true),
        (Obtain, |parts| {
            parts.axes[0].channels.position = channel(1_000_001, 0)
        }),
        (Obtain, |parts| {
            parts.axes[1].channels.position = channel(0, 5_001)
        }),
        (Obtain, |parts| {
            parts.axes[1].channels.velocity = channel(1_001, 0)
        }),
        (Obtain, |parts| {
            parts.axes[1].channels.torque = channel(101, 0)
        }),
        (Submit, |parts| {
            parts.axes[1].shadow.position = channel(-1_000_001, 0)
        }),
        (Submit, |parts| {
            parts.axes[1].shadow.velocity = channel(0, 101)
        }),
        (Submit, |parts| {
            parts.axes[1].shadow.torque = channel(0, -11)
        }),
        (Submit, |parts| {
            parts.axes[1].channels.position = channel(1, 0)
        }),
        (Handshake, |parts| {
            parts.axes[1].channels.torque = channel(0, 1)
        }),
        (Obtain, |parts| {
            parts.axes[1].shadow.velocity = channel(1, 0)
        }),
        (Obtain, |parts| parts.axes[1].agitation = Agitation(1)),
    ];
    for (index, (phase, spoil)) in breaks.into_iter().enumerate() {
        let session = in_phase(phase);
        let mut parts = *session.parts();
        assert_eq!(Session::from_parts(*session.config(), parts), Some(session));
        spoil(&mut parts);
        assert_eq!(
            Session::from_parts(*session.config(), parts),
            None,
            "{index}, in {phase:?}"
        );
    }
}

#[test]
fn a_session_is_live_from_its_grant_to_its_end() {
    for phase in [Handshake, Submit, Obtain] {
        assert!(in_phase(phase).is_live(), "{phase:?}");
    }
    for phase in [Listening, SafeDisconnect, Fault] {
        assert!(!in_phase(phase).is_live(), "{phase:?}");
    }
}
