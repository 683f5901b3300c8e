//! Classification of events: T7, one event at a time. Any sequence of events follows by induction:
//! what has been accepted before is arbitrary, and depends on nothing that only counts.

use gantry_tau_core::control::message::{ClientMessage, Command, Mode, Phase};
use gantry_tau_core::control::session::{Connection, Event, Session};
use gantry_tau_core::units::{Epoch, EpochRange};
use gantry_tau_core::verification::control::{
    Accepted, Classifier, Diagnostics, Internals, Verdict,
};

use crate::properties::fsm;

/// Returns the classifier of a session before a tick.
#[must_use]
pub fn classifier<const N: usize>(
    session: &Session<N>,
    next_epoch: Option<Epoch>,
) -> Classifier<'_, N> {
    Classifier {
        discrete: &session.parts().discrete,
        parameters: session.config().parameters(),
        axes: &session.parts().axes,
        next_epoch,
    }
}

/// T7: an event of a non-owner, or of the owner without freshness, decides nothing.
/// The one exception is a Hello, and only in Listening, which has no owner.
///
/// Composed as: `sift_only_the_owner_decides`.
pub fn only_the_owner_decides<const N: usize>(
    classifier: &Classifier<'_, N>,
    connection: Connection,
    event: &Event<N>,
    accepted: &Accepted<N>,
    diagnostics: &mut Diagnostics,
) {
    let mut after = *accepted;
    classifier.classify(connection, event, &mut after, diagnostics);
    if classifier.discrete.owner == Some(connection) {
        if !owner_may_decide(classifier, event) {
            assert!(after == *accepted, "T7: what is not fresh decides nothing");
        }
        return;
    }
    if classifier.discrete.phase != Phase::Listening {
        assert!(after == *accepted, "T7: a non-owner decides nothing");
    }
    let hello = after.fsm.hello;
    after.fsm.hello = accepted.fsm.hello;
    assert!(after == *accepted, "T7: a non-owner can only ask");
    assert!(
        hello == accepted.fsm.hello
            || hello == classifier.next_epoch.map(|epoch| (connection, epoch)),
        "T7: and only for itself"
    );
}

/// True if this event of the owner may decide.
fn owner_may_decide<const N: usize>(classifier: &Classifier<'_, N>, event: &Event<N>) -> bool {
    match event {
        Event::Broken(_) | Event::Flood | Event::Closed => true,
        Event::Malformed(_) | Event::Dropped(_) => false,
        Event::Message(message) => match message {
            ClientMessage::Command(command) => is_fresh(classifier, command),
            ClientMessage::Goodbye(epoch) | ClientMessage::Stop(epoch) => {
                *epoch == classifier.discrete.epoch
            }
            ClientMessage::Hello(_) => false,
        },
    }
}

/// T7, the other way: an event of the owner decides what it says, and nothing else. The highest
/// fresh command of a tick stands, with its mode and its targets.
pub fn owner_decides_what_it_says<const N: usize>(
    classifier: &Classifier<'_, N>,
    event: &Event<N>,
    accepted: &Accepted<N>,
    diagnostics: &mut Diagnostics,
) {
    let Some(owner) = classifier.discrete.owner else {
        return;
    };
    let mut after = *accepted;
    classifier.classify(owner, event, &mut after, diagnostics);
    let mut expected = *accepted;
    let session = classifier.discrete.epoch;
    match event {
        Event::Broken(_) => expected.fsm.framing = true,
        Event::Flood => expected.fsm.flood = true,
        Event::Closed => expected.fsm.closed = true,
        Event::Message(ClientMessage::Goodbye(epoch)) if *epoch == session => {
            expected.fsm.goodbye = true
        }
        Event::Message(ClientMessage::Stop(epoch)) if *epoch == session => expected.fsm.stop = true,
        Event::Message(ClientMessage::Command(command)) if is_fresh(classifier, command) => {
            if accepted
                .fsm
                .command
                .is_none_or(|(best, _)| best < command.sequence)
            {
                expected.fsm.command = Some((command.sequence, command.mode));
                expected.targets = command.targets;
            }
        }
        Event::Message(_) | Event::Malformed(_) | Event::Dropped(_) => {}
    }
    assert!(
        after == expected,
        "T7: an event of the owner decides what it says"
    );
}

/// The definition of fresh (docs/design.md), for a command of the owner, in integers that cannot
/// overflow.
#[must_use]
pub fn is_fresh<const N: usize>(classifier: &Classifier<'_, N>, command: &Command<N>) -> bool {
    let discrete = classifier.discrete;
    let ahead = i128::from(command.sequence.0) - i128::from(discrete.accepted.0);
    let behind = i128::from(discrete.tick.0) - i128::from(command.echo.0);
    let mode_has_its_place = discrete.phase != Phase::Handshake || command.mode == Mode::Submit;
    let are_admitted = (0..N).all(|axis| {
        let limits = &classifier.parameters.axes[axis].limits;
        limits.admits(&command.targets[axis])
    });
    discrete.is_live()
        && command.epoch == discrete.epoch
        && (1..=65_536).contains(&ahead)
        && (0..=i128::from(classifier.parameters.echo_window)).contains(&behind)
        && mode_has_its_place
        && are_admitted
}

/// Fresh is what the definition says, both ways.
pub fn fresh_is_as_defined<const N: usize>(classifier: &Classifier<'_, N>, command: &Command<N>) {
    let fresh = classifier.verdict(command) == Verdict::Fresh;
    assert!(
        fresh == is_fresh(classifier, command),
        "T7: fresh as defined"
    );
}

/// T23, one event after any others: what is accepted has an epoch above every one before, and a
/// sequence above the last.
///
/// Composed as: `sift_accepts_only_what_is_new`.
pub fn accepts_only_what_is_new<const N: usize>(
    session: &Session<N>,
    epochs: &EpochRange,
    (connection, event): (Connection, &Event<N>),
    accepted: &Accepted<N>,
    diagnostics: &mut Diagnostics,
) {
    let classifier = classifier(session, epochs.after(session.epoch()));
    if !fsm::is_new(classifier.discrete, &accepted.fsm) {
        return;
    }
    let mut after = *accepted;
    classifier.classify(connection, event, &mut after, diagnostics);
    assert!(
        fsm::is_new(classifier.discrete, &after.fsm),
        "T23: only new epochs and sequences are accepted"
    );
}

/// T7's induction: diagnostics do not decide, now or later.
pub fn counts_decide_nothing<const N: usize>(
    classifier: &Classifier<'_, N>,
    connection: Connection,
    event: &Event<N>,
    accepted: &Accepted<N>,
    (one, other): (&mut Diagnostics, &mut Diagnostics),
) {
    let (mut a, mut b) = (*accepted, *accepted);
    classifier.classify(connection, event, &mut a, one);
    classifier.classify(connection, event, &mut b, other);
    assert!(a == b, "T7: what counts decides nothing");
}
