//! The first half of a tick: from the discrete state and what arrived to the next discrete state and one action.
//!
//! No channel, no target, no arithmetic to speak of. Precedence: stop, fault, framing (and flood), closed, goodbye,
//! second consecutive miss, budget; each of them takes its first ramp step in the tick that sees it.

use super::config::MissBudget;
use crate::control::message::{Cause, Mode, Phase};
use crate::units::{Epoch, Sequence, Tick};

/// Names a connection; the endpoint never gives a number twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Connection(pub u64);

/// The part of the session's state that is not a reference.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct FsmState {
    /// Phase.
    pub phase: Phase,
    /// Whose session it is; after the session's end, who is still told about it.
    pub owner: Option<Connection>,
    /// Epoch of the current or last session.
    pub epoch: Epoch,
    /// Sequence of the last accepted command.
    pub accepted: Sequence,
    /// Tick of the last State.
    pub tick: Tick,
    /// Consecutive misses so far: 0 or 1.
    pub misses: u8,
    /// One bit per deadline, the latest lowest; set where it was missed.
    pub history: u128,
    /// Ticks waited for the first command.
    pub waited: u32,
    /// In Fault: the re-arm was seen released, so that a stuck one leads nowhere.
    pub rearm_released: bool,
}

impl FsmState {
    /// The invariant, clause by clause:
    /// nobody owns a listening server; a running session has an owner;
    /// misses are counted while commands are due, never reach two, and are what the history says of the last deadline;
    /// a session that still waits for its first command has no history;
    /// waiting is counted in the handshake only, and never reaches its limit;
    /// the release of the re-arm is diagnostics in Fault only.
    #[must_use]
    pub fn is_valid(&self, handshake_ticks: u32) -> bool {
        let owner = match self.phase {
            Phase::Listening => self.owner.is_none(),
            Phase::Handshake | Phase::Submit | Phase::Obtain => self.owner.is_some(),
            Phase::SafeDisconnect | Phase::Fault => true,
        };
        let commands_due = matches!(self.phase, Phase::Submit | Phase::Obtain);
        let misses = if commands_due {
            u128::from(self.misses) == self.history & 1
        } else {
            self.misses == 0
        };
        let waited = if self.phase == Phase::Handshake {
            self.waited < handshake_ticks && self.history == 0
        } else {
            self.waited == 0
        };
        let rearm = self.phase == Phase::Fault || !self.rearm_released;
        owner && misses && waited && rearm
    }

    /// Whether a session is running: granted, and not over.
    #[inline]
    #[must_use]
    pub const fn is_live(&self) -> bool {
        matches!(self.phase, Phase::Handshake | Phase::Submit | Phase::Obtain)
    }
}

/// What arrived since the last tick, reduced to what decides.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct FsmInput {
    /// A stop is asserted, at the machine or by the owner.
    pub stop: bool,
    /// Somebody at the machine re-arms.
    pub rearm: bool,
    /// The nominal reference stepped above its limit.
    pub nominal_fault: bool,
    /// The owner's stream is broken.
    pub framing: bool,
    /// The owner sent more frames than are read per tick.
    pub flood: bool,
    /// The owner's connection is gone.
    pub closed: bool,
    /// The owner said goodbye.
    pub goodbye: bool,
    /// The highest fresh valid command: its sequence and mode.
    pub command: Option<(Sequence, Mode)>,
    /// Who asked for a session first, acceptably, and the epoch to give.
    pub hello: Option<(Connection, Epoch)>,
    /// Cycles that the server skipped before this one.
    pub skipped: u32,
    /// Every channel is at zero.
    pub all_zero: bool,
}

/// What every channel does in this tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Action {
    /// Position channels keep their value; velocity and torque channels take a ramp step, for a held push is not a hold.
    Hold,
    /// Channels approach the command's targets.
    Follow,
    /// Channels approach zero at the speed of a follow: a fresh request for Submit in Obtain.
    FollowZero,
    /// Channels take one ramp step.
    Ramp,
}

/// Why a session ends in this tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum EndReason {
    /// A cause that is known by itself.
    Because(Cause),
    /// The second consecutive miss; the evidence tells who was late.
    Missed,
}

/// What one tick decides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Decision {
    /// The next discrete state.
    pub next: FsmState,
    /// What every channel does.
    pub action: Action,
    /// Why the session ends, where it does.
    pub end: Option<EndReason>,
}

/// Rules that come from the configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Rules {
    /// Ticks a granted session may wait for its first command.
    pub handshake_ticks: u32,
    /// Budget of misses.
    pub budget: Option<MissBudget>,
}

/// One tick's decision.
#[must_use]
pub fn decide(state: &FsmState, fsm: &FsmInput, rules: &Rules) -> Decision {
    let ticks = u64::from(fsm.skipped).saturating_add(1);
    let now = FsmState {
        tick: Tick(state.tick.0.saturating_add(ticks)),
        owner: if fsm.closed || fsm.framing || fsm.flood {
            None
        } else {
            state.owner
        },
        ..*state
    };
    if fsm.stop || fsm.nominal_fault || state.phase == Phase::Fault {
        return decide_fault(now, fsm);
    }
    match state.phase {
        Phase::Listening => decide_listening(now, fsm),
        Phase::Handshake => decide_handshake(now, fsm, rules),
        Phase::Submit | Phase::Obtain => decide_running(now, fsm, rules),
        // Fault was handled above; it shares the arm that can only ramp.
        Phase::SafeDisconnect | Phase::Fault => decide_ramping(now, fsm),
    }
}

/// Stopped, or a faulty nominal, or still in Fault. What leads out is a re-arm that was released since Fault began:
/// one that was pressed before, or is stuck, would make the stop pass unnoticed.
fn decide_fault(now: FsmState, fsm: &FsmInput) -> Decision {
    let asserted = fsm.stop || fsm.nominal_fault;
    let rearmed = fsm.rearm && now.rearm_released;
    if now.phase == Phase::Fault && rearmed && fsm.all_zero && !asserted {
        return listen(now);
    }
    let cause = if fsm.stop {
        Cause::Stop
    } else {
        Cause::Nominal
    };
    let end = (now.phase != Phase::Fault).then_some(EndReason::Because(cause));
    Decision {
        next: FsmState {
            rearm_released: now.rearm_released || !fsm.rearm,
            ..retire(now, Phase::Fault)
        },
        action: Action::Ramp,
        end,
    }
}

fn decide_listening(now: FsmState, fsm: &FsmInput) -> Decision {
    let next = match fsm.hello {
        Some((owner, epoch)) => FsmState {
            phase: Phase::Handshake,
            owner: Some(owner),
            epoch,
            accepted: Sequence(0),
            misses: 0,
            history: 0,
            waited: 0,
            ..now
        },
        None => now,
    };
    Decision {
        next,
        action: Action::Hold,
        end: None,
    }
}

fn decide_handshake(now: FsmState, fsm: &FsmInput, rules: &Rules) -> Decision {
    if let Some(cause) = ending(fsm) {
        return disconnect(now, EndReason::Because(cause));
    }
    if let Some((sequence, _)) = fsm.command {
        return Decision {
            next: FsmState {
                phase: Phase::Submit,
                accepted: sequence,
                waited: 0,
                ..now
            },
            action: Action::Hold,
            end: None,
        };
    }
    let waited = now.waited.saturating_add(fsm.skipped).saturating_add(1);
    if waited >= rules.handshake_ticks {
        return disconnect(now, EndReason::Because(Cause::HandshakeTimeout));
    }
    Decision {
        next: FsmState { waited, ..now },
        action: Action::Hold,
        end: None,
    }
}

/// Submit and Obtain: commands are due.
fn decide_running(now: FsmState, fsm: &FsmInput, rules: &Rules) -> Decision {
    if let Some(cause) = ending(fsm) {
        return disconnect(now, EndReason::Because(cause));
    }
    let missed = fsm.command.is_none();
    let history = (pushed(now.history, fsm.skipped) << 1) | u128::from(missed);
    let now = FsmState { history, ..now };
    // Each skipped cycle was a deadline that nobody could meet.
    let before = u32::from(now.misses).saturating_add(fsm.skipped);
    if before >= 2 {
        return disconnect(now, EndReason::Because(Cause::ServerLate));
    }
    if missed && before >= 1 {
        let end = if fsm.skipped > 0 {
            EndReason::Because(Cause::ServerLate)
        } else {
            EndReason::Missed
        };
        return disconnect(now, end);
    }
    if over_budget(history, rules.budget) {
        return disconnect(now, EndReason::Because(Cause::Budget));
    }
    match fsm.command {
        None => Decision {
            next: FsmState { misses: 1, ..now },
            action: Action::Hold,
            end: None,
        },
        Some((accepted, mode)) => obey(
            FsmState {
                misses: 0,
                accepted,
                ..now
            },
            mode,
            fsm.all_zero,
        ),
    }
}

/// The history with a missed deadline for each skipped cycle.
fn pushed(history: u128, skipped: u32) -> u128 {
    let all = u128::MAX;
    match (history.checked_shl(skipped), all.checked_shl(skipped)) {
        (Some(shifted), Some(kept)) => shifted | !kept,
        _ => all,
    }
}

/// A fresh command in Submit or Obtain.
fn obey(now: FsmState, mode: Mode, all_zero: bool) -> Decision {
    let (phase, action) = match (now.phase, mode) {
        (_, Mode::Obtain) => (Phase::Obtain, Action::Follow),
        (Phase::Obtain, Mode::Submit) if !all_zero => (Phase::Obtain, Action::FollowZero),
        (_, Mode::Submit) => (Phase::Submit, Action::Hold),
    };
    Decision {
        next: FsmState { phase, ..now },
        action,
        end: None,
    }
}

fn decide_ramping(now: FsmState, fsm: &FsmInput) -> Decision {
    let done = fsm.all_zero;
    if done {
        listen(now)
    } else {
        Decision {
            next: now,
            action: Action::Ramp,
            end: None,
        }
    }
}

/// Events that end a session whatever its commands say, in their order of precedence.
const fn ending(fsm: &FsmInput) -> Option<Cause> {
    if fsm.framing {
        Some(Cause::Malformed)
    } else if fsm.flood {
        Some(Cause::Flood)
    } else if fsm.closed {
        Some(Cause::Closed)
    } else if fsm.goodbye {
        Some(Cause::Goodbye)
    } else {
        None
    }
}

fn over_budget(history: u128, budget: Option<MissBudget>) -> bool {
    let Some(MissBudget { window, allowed }) = budget else {
        return false;
    };
    let outside = 128_u32.saturating_sub(u32::from(window));
    // The latest `window` deadlines are the lowest bits; a shift by 128 cannot occur, the window is at least 1.
    let inside = history.checked_shl(outside).unwrap_or(0);
    inside.count_ones() > u32::from(allowed)
}

/// Ends the session; the ramp begins in this tick.
fn disconnect(now: FsmState, end: EndReason) -> Decision {
    Decision {
        next: retire(now, Phase::SafeDisconnect),
        action: Action::Ramp,
        end: Some(end),
    }
}

/// No session: nothing is due any more.
const fn retire(now: FsmState, phase: Phase) -> FsmState {
    FsmState {
        phase,
        misses: 0,
        waited: 0,
        ..now
    }
}

/// Every channel is at zero: ready for the next session.
const fn listen(now: FsmState) -> Decision {
    Decision {
        next: FsmState {
            owner: None,
            rearm_released: false,
            ..retire(now, Phase::Listening)
        },
        action: Action::Hold,
        end: None,
    }
}
