//! The client's half of the protocol: T24, as one-step induction. A new dialogue is valid; a valid
//! dialogue and any message, answer or farewell, and it is valid again and keeps the rule.

use gantry_tau_core::Offsets;
use gantry_tau_core::control::client::{ClientError, Event};
use gantry_tau_core::control::message::{Mode, Phase, ServerMessage};
use gantry_tau_core::verification::control::{Dialogue, Stage};

/// T24: an answer is a command for the newest State, which no command has answered, with the next
/// sequence; its targets are the wanted ones, cut to the limits of the Welcome; it asks for Obtain
/// only after a command, and after a State in Submit or Obtain. There is one answer per State.
pub fn answer_is_right<const N: usize>(before: &Dialogue<N>, mode: Mode, targets: &[Offsets; N]) {
    let mut after = *before;
    let answer = after.answer(mode, targets);
    assert!(after.is_valid(), "the invariant is kept");
    let Some((command, saturated)) = answer else {
        assert!(after == *before, "without an answer nothing changes");
        return;
    };
    let Stage::Granted(session) = &before.stage else {
        panic!("T24: a command without a session");
    };
    assert!(
        session.unanswered && !session.ended && session.leaving.is_none(),
        "T24: a command answers a State that waits, before any Goodbye"
    );
    let Some(last) = session.last else {
        panic!("T24: a State waits")
    };
    assert!(
        command.echo == last.tick && command.epoch == session.welcome.epoch,
        "T24: never an old State"
    );
    assert!(
        command.sequence > session.sequence,
        "T24: the sequence rises"
    );
    if command.mode == Mode::Obtain {
        let submitted = matches!(last.phase, Phase::Submit | Phase::Obtain);
        assert!(
            mode == Mode::Obtain && session.sequence.0 > 0 && submitted,
            "T24: never begins with Obtain"
        );
    }
    for index in 0..N {
        let (limits, wanted) = (&session.welcome.limits[index], &targets[index]);
        let (target, flags) = (&command.targets[index], saturated[index]);
        assert!(
            limits.admits(target),
            "T24: never beyond the limits it was told"
        );
        // Not an array: a model checker would unwind the comparison of its bytes.
        let beyond = (
            !limits.position.admits(wanted.position),
            !limits.velocity.admits(wanted.velocity),
            !limits.torque.admits(wanted.torque),
        );
        assert!(
            beyond == (flags.position, flags.velocity, flags.torque),
            "T24: saturation is flagged, and nothing else"
        );
        assert!(
            flags.any() || target == wanted,
            "T24: targets within the limits are sent as they are"
        );
    }
    assert!(
        after.answer(mode, targets).is_none(),
        "T24: one answer per State"
    );
}

/// T24: a message makes a State wait only if it is a State of this session, in a live phase, newer
/// than every State before.
pub fn message_is_right<const N: usize>(before: &Dialogue<N>, message: ServerMessage<N>) {
    let mut after = *before;
    let result = after.receive(message);
    assert!(after.is_valid(), "the invariant is kept");
    match result {
        Ok(Some(Event::State(state))) => {
            let Some(welcome) = before.welcome() else {
                panic!("T24: a session")
            };
            assert!(
                state.epoch == welcome.epoch && state.tick >= welcome.tick,
                "T24: a State of this session"
            );
            let newer = before.last().is_none_or(|last| state.tick > last.tick);
            assert!(newer, "T24: newer than any before");
            assert!(
                !before.is_over() && after.has_unanswered(),
                "T24: a new State waits"
            );
        }
        Ok(Some(Event::Ended(_) | Event::Refused(_))) => {
            assert!(
                after.is_over() && !after.has_unanswered(),
                "T24: nothing is answered after the end"
            );
        }
        Ok(Some(_)) => {
            assert!(
                before.welcome().is_none() && !after.has_unanswered(),
                "T24: a Welcome begins the session"
            )
        }
        Err(ClientError::GoodbyeUnheard { .. }) => {
            assert!(!after.is_over(), "T24: the session goes on");
        }
        Ok(None) | Err(_) => assert!(
            after.stage == before.stage,
            "T24: what is ignored or refused changes nothing"
        ),
    }
}

/// T24: after a Goodbye no State is answered; it carries the epoch of the session, once per State.
pub fn goodbye_is_right<const N: usize>(before: &Dialogue<N>, mode: Mode, targets: &[Offsets; N]) {
    let mut after = *before;
    let goodbye = after.goodbye();
    assert!(after.is_valid(), "the invariant is kept");
    let Some(epoch) = goodbye else {
        assert!(after == *before, "without a Goodbye nothing changes");
        return;
    };
    let Some(welcome) = before.welcome() else {
        panic!("T24: a session")
    };
    assert!(
        epoch == welcome.epoch && !before.is_over(),
        "a Goodbye of the running session"
    );
    assert!(
        after.goodbye().is_none() && after.answer(mode, targets).is_none(),
        "T24: a State is answered once"
    );
}
