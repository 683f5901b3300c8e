//! Before the first half of a tick: sifts what arrived into what decides, what answers, and what only counts.
//!
//! Nothing but the owner's fresh valid commands, stops and endings passes; everything else leaves a count (T7).

use super::act::Axis;
use super::fsm::{Connection, FsmInput, FsmState};
use super::{Event, Refusals, ramp_ticks_left};
use crate::control::axis::Offsets;
use crate::control::message::{ClientMessage, Command, Counters, Hello, Mode, Phase, Refusal};
use crate::control::session::config::Parameters;
use crate::units::{Epoch, Sequence};
use crate::zip::zip;

/// What a tick has accepted so far that decides. Nothing else that arrives changes it (T7).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Accepted<const N: usize> {
    /// What decides.
    pub fsm: FsmInput,
    /// Targets of the highest fresh valid command; zero without one.
    pub targets: [Offsets; N],
}

impl<const N: usize> Accepted<N> {
    /// Nothing yet.
    #[must_use]
    pub fn nothing() -> Self {
        Self {
            fsm: FsmInput::default(),
            targets: [Offsets::default(); N],
        }
    }
}

/// What a tick has accepted so far that only counts, or is to be answered. It decides nothing.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Diagnostics {
    /// Counts since the session was granted.
    pub counters: Counters,
    /// Hellos that cannot be granted, whatever is decided.
    pub refusals: Refusals,
    /// The owner sent a command that was not fresh because it was late.
    pub late: bool,
}

/// What events are judged against: all that a tick knows before it hears the first.
#[derive(Clone, Copy, Debug)]
pub struct Classifier<'a, const N: usize> {
    /// The discrete state.
    pub discrete: &'a FsmState,
    /// The validated configuration.
    pub parameters: &'a Parameters<N>,
    /// The axes; a refusal says how long they still ramp.
    pub axes: &'a [Axis; N],
    /// Epoch that a granted session would get.
    pub next_epoch: Epoch,
}

impl<const N: usize> Classifier<'_, N> {
    /// One event, in order of arrival.
    pub fn classify(
        &self,
        connection: Connection,
        event: &Event<N>,
        accepted: &mut Accepted<N>,
        diagnostics: &mut Diagnostics,
    ) {
        if self.discrete.owner == Some(connection) {
            self.owner(event, accepted, diagnostics);
        } else {
            self.stranger(connection, event, accepted, diagnostics);
        }
    }

    fn owner(&self, event: &Event<N>, accepted: &mut Accepted<N>, diagnostics: &mut Diagnostics) {
        let fsm = &mut accepted.fsm;
        let counters = &mut diagnostics.counters;
        match event {
            Event::Broken(_) => fsm.framing = true,
            Event::Flood => fsm.flood = true,
            Event::Closed => fsm.closed = true,
            Event::Malformed(_) | Event::Dropped(_) => {
                count(&mut counters.received);
                count(&mut counters.malformed);
            }
            Event::Message(message) => {
                count(&mut counters.received);
                match message {
                    ClientMessage::Command(command) => self.command(command, accepted, diagnostics),
                    ClientMessage::Goodbye(epoch) if *epoch == self.discrete.epoch => {
                        fsm.goodbye = true;
                    }
                    ClientMessage::Stop(epoch) if *epoch == self.discrete.epoch => {
                        fsm.stop = true;
                    }
                    ClientMessage::Goodbye(_) | ClientMessage::Stop(_) => {
                        count(&mut counters.stale);
                    }
                    // Well-framed, but without a place: it costs this frame and nothing else.
                    ClientMessage::Hello(_) => count(&mut counters.malformed),
                }
            }
        }
    }

    fn stranger(
        &self,
        connection: Connection,
        event: &Event<N>,
        accepted: &mut Accepted<N>,
        diagnostics: &mut Diagnostics,
    ) {
        match event {
            Event::Message(ClientMessage::Hello(hello)) => {
                // Grants or refuses; the final word on a grant is [`super::fsm`]'s.
                match self.refusal(hello, &accepted.fsm) {
                    None => accepted.fsm.hello = Some((connection, self.next_epoch)),
                    // There is room: a tick has at most `EVENTS` events.
                    Some(reason) => diagnostics
                        .refusals
                        .push((connection, reason))
                        .unwrap_or(()),
                }
            }
            Event::Message(_)
            | Event::Malformed(_)
            | Event::Dropped(_)
            | Event::Broken(_)
            | Event::Flood => {
                count(&mut diagnostics.counters.strangers);
            }
            Event::Closed => {}
        }
    }

    /// Why a Hello cannot be granted.
    fn refusal(&self, hello: &Hello, fsm: &FsmInput) -> Option<Refusal> {
        let ticks_left = ramp_ticks_left(self.parameters, self.axes);
        match self.discrete.phase {
            Phase::Handshake | Phase::Submit | Phase::Obtain => return Some(Refusal::Busy),
            Phase::SafeDisconnect => return Some(Refusal::Ramping { ticks_left }),
            Phase::Fault => return Some(Refusal::Faulted { ticks_left }),
            Phase::Listening => {}
        }
        let needed = self.parameters.capabilities;
        if fsm.hello.is_some() {
            Some(Refusal::Busy)
        } else if usize::from(hello.axes) != N {
            let expected = u8::try_from(N).unwrap_or(u8::MAX);
            Some(Refusal::Axes { expected })
        } else if !hello.capabilities.contains(needed) {
            Some(Refusal::Capability { needed })
        } else if self.next_epoch <= self.discrete.epoch {
            Some(Refusal::Unavailable)
        } else {
            None
        }
    }

    /// A command of the owner: the highest fresh valid one acts, every other one is counted.
    fn command(
        &self,
        command: &Command<N>,
        accepted: &mut Accepted<N>,
        diagnostics: &mut Diagnostics,
    ) {
        let counters = &mut diagnostics.counters;
        match self.judge(command) {
            Verdict::Fresh => {}
            Verdict::Duplicate => return count(&mut counters.duplicate),
            Verdict::Stale => return count(&mut counters.stale),
            Verdict::Malformed => return count(&mut counters.malformed),
            Verdict::OutOfRange => {
                count(&mut counters.malformed);
                return count(&mut counters.out_of_range);
            }
            Verdict::Late => {
                diagnostics.late = true;
                return count(&mut counters.late);
            }
        }
        match accepted.fsm.command {
            Some((best, _)) if command.sequence == best => return count(&mut counters.duplicate),
            Some((best, _)) if command.sequence < best => return count(&mut counters.late),
            Some(_) => count(&mut counters.late),
            None => {}
        }
        accepted.fsm.command = Some((command.sequence, command.mode));
        accepted.targets = command.targets;
    }

    /// Judges a command of the owner, beside what else arrived in this tick.
    #[must_use]
    pub fn judge(&self, command: &Command<N>) -> Verdict {
        let epoch = self.discrete.epoch;
        if !self.discrete.is_live() || command.epoch != epoch {
            return Verdict::Stale;
        }
        match ahead(self.discrete.accepted, command.sequence) {
            Some(0) => return Verdict::Duplicate,
            Some(1..=SEQUENCE_WINDOW) => {}
            Some(_) => return Verdict::Stale,
            None => return Verdict::Late,
        }
        match self.discrete.tick.0.checked_sub(command.echo.0) {
            None => return Verdict::Stale,
            Some(behind) if behind > u64::from(self.parameters.echo_window) => {
                return Verdict::Late;
            }
            Some(_) => {}
        }
        // Content that the wire cannot judge: the mode's place in the phase, the targets' magnitude.
        if self.discrete.phase == Phase::Handshake && command.mode == Mode::Obtain {
            return Verdict::Malformed;
        }
        let mut axes = zip(&self.parameters.axes, &command.targets);
        if axes.all(|(axis, target)| axis.limits.admits(target)) {
            Verdict::Fresh
        } else {
            Verdict::OutOfRange
        }
    }
}

/// What a command of the owner is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Verdict {
    /// Of this epoch, ahead in sequence, answering the last State, and valid.
    Fresh,
    /// With the sequence of the last accepted one.
    Duplicate,
    /// Of another epoch, too far ahead, answering a State that was never sent, or without a session.
    Stale,
    /// Behind the last accepted one, or answering an older State than the window allows.
    Late,
    /// Asks for a mode that has no place in the phase.
    Malformed,
    /// A target lies beyond its limit.
    OutOfRange,
}

/// How far ahead of the accepted sequence a command may be.
const SEQUENCE_WINDOW: u64 = 65_536;

/// How far `sequence` is ahead; `None` when it is behind.
const fn ahead(accepted: Sequence, sequence: Sequence) -> Option<u64> {
    sequence.0.checked_sub(accepted.0)
}

/// Counters saturate: a wrapped counter would be a lie.
const fn count(counter: &mut u32) {
    *counter = counter.saturating_add(1);
}
