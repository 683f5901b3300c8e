//! The first half of a tick: what the server decides. T4, T6, T9, and what T5 needs of it, as
//! one-step induction over the whole discrete state.

use gantry_tau_core::control::message::{Cause, Mode, Phase};
use gantry_tau_core::control::session::may_end;
use gantry_tau_core::verification::control::{
    Action, Decision, EndReason, FsmInput, FsmState, Rules, decide,
};

/// True if something of higher precedence than a miss arrived.
fn outranks_a_miss(fsm: &FsmInput) -> bool {
    fsm.stop
        || fsm.quit
        || fsm.nominal_fault
        || fsm.framing
        || fsm.flood
        || fsm.closed
        || fsm.goodbye
        || fsm.agitated
}

/// The invariant of the discrete state is kept, and the tick advances by one for each cycle.
///
/// Composed as: `decide_keeps_the_invariant`.
pub fn keeps_the_invariant(state: &FsmState, fsm: &FsmInput, rules: &Rules) {
    let next = decide(state, fsm, rules).next;
    assert!(
        next.is_valid(rules.handshake_ticks),
        "the invariant is kept"
    );
    let cycles = u64::from(fsm.skipped) + 1;
    let expected = state.tick.0.saturating_add(cycles);
    assert!(next.tick.0 == expected, "every cycle is a tick");
}

/// T4, both ways: with nothing of higher precedence, Submit and Obtain survive a single miss and
/// end with the second consecutive one, in that tick. A cycle that the server skipped is a miss
/// like any other.
///
/// Composed as: `decide_second_miss_ends`.
pub fn second_miss_ends(state: &FsmState, fsm: &FsmInput, rules: &Rules) {
    let running = matches!(state.phase, Phase::Submit | Phase::Obtain);
    if !running || outranks_a_miss(fsm) {
        return;
    }
    let decision = decide(state, fsm, rules);
    let run = u64::from(state.misses) + u64::from(fsm.skipped);
    let missed_now = fsm.command.is_none();
    let two = run >= 2 || (run == 1 && missed_now);
    if two {
        assert!(
            decision.next.phase == Phase::SafeDisconnect,
            "T4: the second consecutive miss ends the session"
        );
        assert!(decision.action == Action::Ramp, "T4: in that tick");
    } else if decision.end == Some(EndReason::Because(Cause::Budget)) {
        assert!(
            rules.budget.is_some(),
            "T4: a budget only where there is one"
        );
    } else {
        let stays = matches!(decision.next.phase, Phase::Submit | Phase::Obtain);
        assert!(stays, "T4: one miss never ends a session");
        assert!(
            decision.next.misses == u8::from(missed_now),
            "T4: a miss is remembered for one deadline"
        );
        let obtains = decision.next.phase == Phase::Obtain;
        if missed_now {
            assert!(
                decision.next.phase == state.phase,
                "T4: one miss never leaves Obtain"
            );
            assert!(decision.action == Action::Hold, "T4: one miss holds");
        } else if let Some((_, Mode::Obtain)) = fsm.command {
            assert!(obtains, "a request to obtain is granted");
        }
    }
}

/// T6, the half that decides: a session is granted only to a Hello that arrives in Listening, and
/// Listening and Submit are entered only when every channel is zero.
///
/// Composed as: `decide_authority_needs_zero`.
pub fn authority_needs_zero(state: &FsmState, fsm: &FsmInput, rules: &Rules) {
    let next = decide(state, fsm, rules).next;
    if next.is_live() && !state.is_live() {
        assert!(
            state.phase == Phase::Listening && next.phase == Phase::Handshake,
            "T6: a session begins in Listening"
        );
        assert!(
            fsm.hello.map(|(owner, epoch)| (Some(owner), epoch)) == Some((next.owner, next.epoch)),
            "T6: it is granted to who asked"
        );
    }
    if next.phase == Phase::Listening && state.phase != Phase::Listening {
        assert!(fsm.all_zero, "T6: Listening begins at zero");
    }
    if next.phase == Phase::Submit && state.phase == Phase::Obtain {
        assert!(fsm.all_zero, "T6: Submit is entered at zero");
    }
}

/// T9: a stop, or a path that is at fault, leads to Fault from everywhere, and takes the first ramp
/// step at once; nothing leads out of Fault but a re-arm that was seen released in it, with the stop
/// gone and every channel at zero; until then nothing follows a target.
///
/// Composed as: `decide_stop_leads_to_fault`.
pub fn stop_leads_to_fault(state: &FsmState, fsm: &FsmInput, rules: &Rules) {
    let decision = decide(state, fsm, rules);
    let next = &decision.next;
    if fsm.stop || fsm.quit || fsm.nominal_fault {
        assert!(next.phase == Phase::Fault, "T9: a stop ends in Fault");
        assert!(decision.action == Action::Ramp, "T9: a stop ramps");
    }
    let released = next.phase == Phase::Fault && (state.rearm_released || !fsm.rearm);
    assert!(
        next.rearm_released == released,
        "T9: a re-arm is seen released in Fault"
    );
    if state.phase != Phase::Fault {
        return;
    }
    let rearmed = fsm.rearm && state.rearm_released && fsm.all_zero;
    if rearmed && !fsm.stop && !fsm.quit && !fsm.nominal_fault {
        assert!(
            decision.next.phase == Phase::Listening && decision.action == Action::Hold,
            "T9: a re-arm leads to Listening"
        );
    } else {
        assert!(
            decision.next.phase == Phase::Fault && decision.action == Action::Ramp,
            "T9: nothing else leads out of Fault"
        );
    }
}

/// T9, the latch: every stop but that of a quit is latched, in the tick of its assertion, during a
/// quit too; a latched stop holds Fault, and only leaving Fault releases it
/// ([`stop_leads_to_fault`]: by a re-arm); a quit alone latches nothing. A server that is asked to
/// quit ends with zero in force and the latch stored, and not otherwise.
pub fn latch_keeps_every_stop(
    state: &FsmState,
    fsm: &FsmInput,
    rules: &Rules,
    at_zero: bool,
    stored: Option<bool>,
) {
    let next = decide(state, fsm, rules).next;
    let asserted = fsm.stop || fsm.nominal_fault;
    assert!(
        !asserted || next.latched,
        "T9: a stop is latched in its tick"
    );
    assert!(
        !next.latched || next.phase == Phase::Fault,
        "T9: a latched stop holds Fault"
    );
    assert!(
        !next.latched || state.latched || asserted,
        "T9: a quit latches nothing"
    );
    let released = state.latched && !next.latched;
    let rearmed = fsm.rearm && state.rearm_released && fsm.all_zero && !fsm.quit;
    assert!(
        !released || (rearmed && next.phase == Phase::Listening),
        "T9: a re-arm releases the latch"
    );
    let ends = may_end(fsm.quit, at_zero, next.latched, stored);
    assert!(
        ends == (fsm.quit && at_zero && stored == Some(next.latched)),
        "T9: no end before the latch is stored"
    );
}

/// T5, the half that decides: without a session, and with a channel that is not zero, every tick is
/// a ramp step.
///
/// Composed as: `decide_no_session_ramps`.
pub fn no_session_ramps(state: &FsmState, fsm: &FsmInput, rules: &Rules) {
    let decision = decide(state, fsm, rules);
    let ramping = matches!(state.phase, Phase::SafeDisconnect | Phase::Fault);
    if ramping && !fsm.all_zero {
        assert!(decision.action == Action::Ramp, "T5: every tick ramps");
        assert!(!decision.next.is_live(), "T5: no session meanwhile");
    }
    let ends = state.is_live() && !decision.next.is_live();
    assert!(
        !ends || decision.action == Action::Ramp,
        "T5: the ramp begins in the tick that ends the session"
    );
    let follows = matches!(decision.action, Action::Follow | Action::FollowZero);
    assert!(
        !follows || (decision.next.phase == Phase::Obtain && fsm.command.is_some()),
        "targets act in Obtain only, and only fresh ones"
    );
}

/// T22, the half that decides: in silence a session that runs ends with the second tick, ramping in
/// it; a ramp goes on while a channel is not zero, and the first tick that begins at zero listens.
/// A handshake counts to its end; only Fault waits, for a re-arm.
///
/// Composed as: `decide_silence_leads_to_listening`.
pub fn silence_leads_to_listening(state: &FsmState, fsm: &FsmInput, rules: &Rules) {
    let silence = FsmInput {
        all_zero: fsm.all_zero,
        agitated: fsm.agitated,
        ..FsmInput::default()
    };
    let Decision { next, action, .. } = decide(state, &silence, rules);
    let is_over = next.phase == Phase::SafeDisconnect && action == Action::Ramp;
    match state.phase {
        Phase::Listening => assert!(
            next.phase == Phase::Listening,
            "T22: a server that listens goes on"
        ),
        Phase::Handshake => {
            let waits = next.phase == Phase::Handshake && next.waited == state.waited + 1;
            assert!(waits || is_over, "T22: a handshake counts to its end");
        }
        Phase::Submit | Phase::Obtain => {
            let first = state.misses == 0 && next.misses == 1 && next.phase == state.phase;
            assert!(
                first || is_over,
                "T22: the second tick of silence ends the session"
            );
        }
        Phase::SafeDisconnect if fsm.all_zero => {
            assert!(next.phase == Phase::Listening, "T22: at zero it listens")
        }
        Phase::SafeDisconnect => assert!(is_over, "T22: the ramp goes on"),
        Phase::Fault => assert!(
            next.phase == Phase::Fault && action == Action::Ramp,
            "T22: Fault waits for a re-arm"
        ),
    }
}

/// T23, the half that decides: a grant raises the epoch, and nothing else changes it; within an
/// epoch the accepted sequence never falls, and rises with every command that acts: a command acts
/// once. The classification lets only new ones arrive
/// ([`crate::properties::ingress::accepts_only_what_is_new`]).
///
/// Composed as: `decide_epochs_and_sequences_rise`.
pub fn epochs_and_sequences_rise(state: &FsmState, fsm: &FsmInput, rules: &Rules) {
    if !is_new(state, fsm) {
        return;
    }
    let decision = decide(state, fsm, rules);
    let next = &decision.next;
    if next.epoch != state.epoch {
        assert!(
            next.epoch > state.epoch,
            "T23: an epoch is never given twice"
        );
        assert!(
            state.phase == Phase::Listening && next.phase == Phase::Handshake,
            "T23: a grant changes the epoch"
        );
        return;
    }
    assert!(
        next.phase != Phase::Handshake || state.phase == Phase::Handshake,
        "T23: a grant raises the epoch"
    );
    assert!(
        next.accepted >= state.accepted,
        "T23: the accepted sequence never falls"
    );
    let acts = matches!(decision.action, Action::Follow | Action::FollowZero);
    assert!(
        !acts || next.accepted > state.accepted,
        "T23: a command acts once"
    );
}

/// True if epoch and sequence of an input are above those of the state.
#[must_use]
pub fn is_new(state: &FsmState, fsm: &FsmInput) -> bool {
    fsm.hello.is_none_or(|(_, epoch)| epoch > state.epoch)
        && fsm
            .command
            .is_none_or(|(sequence, _)| sequence > state.accepted)
}

/// Every property of a decision.
pub fn decision_is_right(state: &FsmState, fsm: &FsmInput, rules: &Rules) {
    keeps_the_invariant(state, fsm, rules);
    second_miss_ends(state, fsm, rules);
    authority_needs_zero(state, fsm, rules);
    stop_leads_to_fault(state, fsm, rules);
    no_session_ramps(state, fsm, rules);
    epochs_and_sequences_rise(state, fsm, rules);
    silence_leads_to_listening(state, fsm, rules);
    for stored in [None, Some(false), Some(true)] {
        latch_keeps_every_stop(state, fsm, rules, fsm.all_zero, stored);
    }
}
