//! Any client in any valid state: any message, any answer, any farewell.

use gantry_tau_core::Offsets;
use gantry_tau_core::control::message::ServerMessage;
use gantry_tau_core::verification::control::Dialogue;

use super::kani;
use crate::properties::client;

/// Any dialogue in any valid state; some wait for an answer.
fn any_dialogue<const N: usize>() -> Dialogue<N> {
    let dialogue: Dialogue<N> = kani::any();
    kani::cover!(dialogue.has_unanswered(), "some States wait for an answer");
    dialogue
}

/// Any answer to any State.
fn check_answer<const N: usize>() {
    let mut dialogue = any_dialogue::<N>();
    let (mode, targets) = (kani::any(), kani::any::<[Offsets; N]>());
    client::answer_is_right(&dialogue, mode, &targets);
    if let Some((command, saturated)) = dialogue.answer(mode, &targets) {
        kani::cover!(command.mode != mode, "some ask for Obtain too early");
        kani::cover!(saturated[0].torque, "some targets are cut");
    }
}

harnesses! {
    client_answer_is_right [minisat, unwind 3] { check_answer::<1>(); }
    client_answer_is_right_3 [minisat, unwind 5] { check_answer::<3>(); }
    client_message_is_right [minisat, unwind 5] {
        let message: ServerMessage<1> = kani::any();
        let dialogue = any_dialogue();
        let mut after = dialogue;
        client::message_is_right(&dialogue, message);
        kani::cover!(after.receive(message).is_err(), "some messages are errors");
        kani::cover!(after.has_unanswered() && !dialogue.has_unanswered(), "some States are new");
    }
    client_goodbye_is_right [minisat, unwind 3] {
        let dialogue = any_dialogue::<1>();
        let targets: [Offsets; 1] = kani::any();
        client::goodbye_is_right(&dialogue, kani::any(), &targets);
        let mut after = dialogue;
        kani::cover!(after.goodbye().is_some(), "some sessions can be left");
    }
}
