//! First half of a tick, a finite state machine: discrete state and events to the next discrete
//! state and one action.
//!
//! It sees no channel and no target. Precedence: stop, fault, framing (and flood), closed, goodbye,
//! agitation, second consecutive miss, budget; each of them takes its first ramp step in the tick
//! that sees it.

use super::config::MissBudget;
use super::io::Connection;
use crate::control::message::{Cause, Mode, Phase};
use crate::units::{Epoch, Sequence, Tick};

/// Discrete state of a session: everything but the references.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct FsmState {
    /// Phase.
    pub phase: Phase,
    /// Owner of the session; after its end, the connection that still receives States.
    pub owner: Option<Connection>,
    /// Epoch of the current or last session.
    pub epoch: Epoch,
    /// Sequence of the last accepted command.
    pub accepted: Sequence,
    /// Tick of the last State.
    pub tick: Tick,
    /// Consecutive misses so far: 0 or 1.
    pub misses: u8,
    /// One bit per deadline, the latest lowest; set if it was missed.
    pub history: u128,
    /// Ticks waited for the first command.
    pub waited: u32,
    /// In Fault: the re-arm was seen released, so that a stuck one leads nowhere.
    pub rearm_released: bool,
    /// In Fault: a stop was asserted, by other than a quit, and has not been re-armed. It outlives
    /// the process ([`may_end`]).
    pub latched: bool,
}

impl FsmState {
    /// The invariant, clause by clause: a listening server has no owner; a running session has one;
    /// misses are counted while commands are due, never reach two, and are what the history says of
    /// the last deadline; a session that still waits for its first command has no history; waiting
    /// is counted in the handshake only, and never reaches its limit; the release of the re-arm is
    /// diagnostics in Fault only; a stop is latched in Fault only.
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
        let fault = self.phase == Phase::Fault || !self.rearm_released && !self.latched;
        owner && misses && waited && fault
    }

    /// True if a session is running: granted, and not over.
    #[inline]
    #[must_use]
    pub const fn is_live(&self) -> bool {
        matches!(self.phase, Phase::Handshake | Phase::Submit | Phase::Obtain)
    }
}

/// Input of the decision: everything since the last tick that can change the discrete state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct FsmInput {
    /// A stop is asserted: at the machine, by the owner, or because the machine was not read or has
    /// not taken its references.
    pub stop: bool,
    /// The server is to end, which ramps as a stop does and latches nothing.
    pub quit: bool,
    /// The re-arm at the machine is pressed.
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
    /// The agitation of an axis is beyond its budget.
    pub agitated: bool,
    /// The highest fresh valid command: its sequence and mode.
    pub command: Option<(Sequence, Mode)>,
    /// First acceptable Hello: its connection, and the epoch to grant.
    pub hello: Option<(Connection, Epoch)>,
    /// Cycles that the server skipped before this one.
    pub skipped: u32,
    /// Every channel is at zero.
    pub all_zero: bool,
}

/// Action of every channel in one tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Action {
    /// Position channels keep their value. Velocity and torque channels take a ramp step: holding a
    /// push would not hold the machine.
    Hold,
    /// Channels approach the command's targets.
    Follow,
    /// Channels approach zero as fast as a follow: a fresh request for Submit in Obtain.
    FollowZero,
    /// Channels take one ramp step.
    Ramp,
}

/// Reason for the end of a session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum EndReason {
    /// A cause that the decision knows.
    Because(Cause),
    /// The second consecutive miss; the diagnostics tell whether client or network was late.
    Missed,
}

/// Decision of one tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Decision {
    /// The next discrete state.
    pub next: FsmState,
    /// Action of every channel.
    pub action: Action,
    /// Reason for the end of the session, if it ends.
    pub end: Option<EndReason>,
}

/// Rules from the configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Rules {
    /// Ticks a granted session may wait for its first command.
    pub handshake_ticks: u32,
    /// Budget of misses.
    pub budget: Option<MissBudget>,
}

/// Decides one tick.
#[must_use]
pub fn decide(state: &FsmState, input: &FsmInput, rules: &Rules) -> Decision {
    let ticks = u64::from(input.skipped).saturating_add(1);
    let now = FsmState {
        tick: Tick(state.tick.0.saturating_add(ticks)),
        owner: if input.closed || input.framing || input.flood {
            None
        } else {
            state.owner
        },
        ..*state
    };
    if input.stop || input.quit || input.nominal_fault || state.phase == Phase::Fault {
        return decide_fault(now, input);
    }
    match state.phase {
        Phase::Listening => decide_listening(now, input),
        Phase::Handshake => decide_handshake(now, input, rules),
        Phase::Submit | Phase::Obtain => decide_running(now, input, rules),
        // Fault was handled above; it shares the arm that can only ramp.
        Phase::SafeDisconnect | Phase::Fault => decide_ramping(now, input),
    }
}

/// Stopped, or to end, or a faulty nominal, or still in Fault. Only a re-arm that was released
/// since Fault began leads out: one that was pressed before, or is stuck, would make the stop pass
/// unnoticed. Every cause but a quit is latched, in the tick of the assertion: by the phase alone a
/// stop during a quit would look like the quit.
fn decide_fault(now: FsmState, input: &FsmInput) -> Decision {
    let asserted = input.stop || input.nominal_fault;
    let rearmed = input.rearm && now.rearm_released;
    if now.phase == Phase::Fault && rearmed && input.all_zero && !asserted && !input.quit {
        return listen(now);
    }
    let cause = if input.stop || input.quit {
        Cause::Stop
    } else {
        Cause::Nominal
    };
    let end = (now.phase != Phase::Fault).then_some(EndReason::Because(cause));
    Decision {
        next: FsmState {
            rearm_released: now.rearm_released || !input.rearm,
            latched: now.latched || asserted,
            ..end_session(now, Phase::Fault)
        },
        action: Action::Ramp,
        end,
    }
}

fn decide_listening(now: FsmState, input: &FsmInput) -> Decision {
    let next = match input.hello {
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

fn decide_handshake(now: FsmState, input: &FsmInput, rules: &Rules) -> Decision {
    if let Some(cause) = ending(input) {
        return disconnect(now, EndReason::Because(cause));
    }
    if let Some((sequence, _)) = input.command {
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
    let waited = now.waited.saturating_add(input.skipped).saturating_add(1);
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
fn decide_running(now: FsmState, input: &FsmInput, rules: &Rules) -> Decision {
    if let Some(cause) = ending(input) {
        return disconnect(now, EndReason::Because(cause));
    }
    let missed = input.command.is_none();
    let history = (shift_in_misses(now.history, input.skipped) << 1) | u128::from(missed);
    let now = FsmState { history, ..now };
    // Each skipped cycle was a deadline that no client could meet.
    let before = u32::from(now.misses).saturating_add(input.skipped);
    if before >= 2 {
        return disconnect(now, EndReason::Because(Cause::ServerLate));
    }
    if missed && before >= 1 {
        let end = if input.skipped > 0 {
            EndReason::Because(Cause::ServerLate)
        } else {
            EndReason::Missed
        };
        return disconnect(now, end);
    }
    if over_budget(history, rules.budget) {
        return disconnect(now, EndReason::Because(Cause::Budget));
    }
    match input.command {
        None => Decision {
            next: FsmState { misses: 1, ..now },
            action: Action::Hold,
            end: None,
        },
        Some((accepted, mode)) => follow_command(
            FsmState {
                misses: 0,
                accepted,
                ..now
            },
            mode,
            input.all_zero,
        ),
    }
}

/// Returns the history with a missed deadline for each skipped cycle.
fn shift_in_misses(history: u128, skipped: u32) -> u128 {
    // On-time deadlines are the zeros: they are shifted, and none comes in.
    !(!history).checked_shl(skipped).unwrap_or(0)
}

/// Follows a fresh command in Submit or Obtain.
fn follow_command(now: FsmState, mode: Mode, all_zero: bool) -> Decision {
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

fn decide_ramping(now: FsmState, input: &FsmInput) -> Decision {
    let done = input.all_zero;
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

/// Returns the cause that ends a session regardless of its commands, in the order of precedence.
const fn ending(input: &FsmInput) -> Option<Cause> {
    if input.framing {
        Some(Cause::Malformed)
    } else if input.flood {
        Some(Cause::Flood)
    } else if input.closed {
        Some(Cause::Closed)
    } else if input.goodbye {
        Some(Cause::Goodbye)
    } else if input.agitated {
        Some(Cause::Agitated)
    } else {
        None
    }
}

fn over_budget(history: u128, budget: Option<MissBudget>) -> bool {
    let Some(MissBudget { window, allowed }) = budget else {
        return false;
    };
    let outside = 128_u32.saturating_sub(u32::from(window));
    // The latest `window` deadlines are the lowest bits; a shift by 128 cannot occur, the window is
    // at least 1.
    let inside = history.checked_shl(outside).unwrap_or(0);
    inside.count_ones() > u32::from(allowed)
}

/// Ends the session; the ramp begins in this tick.
fn disconnect(now: FsmState, end: EndReason) -> Decision {
    Decision {
        next: end_session(now, Phase::SafeDisconnect),
        action: Action::Ramp,
        end: Some(end),
    }
}

/// Ends the session without a decision: references were not accepted by the drives.
pub(super) const fn interrupted(state: &FsmState) -> FsmState {
    end_session(*state, Phase::SafeDisconnect)
}

/// Clears the counts of a running session.
const fn end_session(now: FsmState, phase: Phase) -> FsmState {
    FsmState {
        phase,
        misses: 0,
        waited: 0,
        ..now
    }
}

/// Listens again: every channel is at zero.
const fn listen(now: FsmState) -> Decision {
    Decision {
        next: FsmState {
            owner: None,
            rearm_released: false,
            latched: false,
            ..end_session(now, Phase::Listening)
        },
        action: Action::Hold,
        end: None,
    }
}

/// True if a server that was asked to `quit` may end: references without offsets are in force
/// (`at_zero`), and what is `stored` of the latch, `None` if that is unknown, is what the state
/// says.
#[must_use]
pub fn may_end(quit: bool, at_zero: bool, latched: bool, stored: Option<bool>) -> bool {
    quit && at_zero && stored == Some(latched)
}
