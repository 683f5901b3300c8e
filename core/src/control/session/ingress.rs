//! Classification of events, before the decision: accepted ones decide, others are refused or only
//! counted.
//!
//! Accepted are the owner's fresh valid commands, stops and endings, and the first acceptable
//! Hello; everything else leaves a count (T7).

use super::act::Axis;
use super::fsm::{FsmInput, FsmState};
use super::io::Connection;
use super::{Event, Refusals, ramp_ticks_left};
use crate::control::axis::Offsets;
use crate::control::message::{ClientMessage, Command, Counters, Hello, Mode, Phase, Refusal};
use crate::control::session::config::Parameters;
use crate::units::{Epoch, Sequence};
use crate::zip::zip;

/// Accepted events of a tick: everything from the network that can decide (T7).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Accepted<const N: usize> {
    /// Input of the decision, without the tick's own part.
    pub fsm: FsmInput,
    /// Targets of the highest fresh valid command; zero without one.
    pub targets: [Offsets; N],
}

impl<const N: usize> Accepted<N> {
    /// No event.
    #[must_use]
    pub fn nothing() -> Self {
        Self {
            fsm: FsmInput::default(),
            targets: [Offsets::default(); N],
        }
    }
}

/// Events of a tick that are counted or answered. They decide nothing.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Diagnostics {
    /// Counts since the session was granted.
    pub counters: Counters,
    /// Hellos that cannot be granted, independent of the decision.
    pub refusals: Refusals,
    /// The owner sent a late command.
    pub late: bool,
}

impl Diagnostics {
    /// Nothing since these counts.
    #[must_use]
    pub fn after(counters: &Counters) -> Self {
        Self {
            counters: *counters,
            ..Self::default()
        }
    }

    /// Counts frames that are not authentic.
    pub fn count_unauthentic(&mut self, frames: u16) {
        let count = &mut self.counters.non_owner;
        *count = count.saturating_add(u32::from(frames));
    }
}

/// Context of the classification: the session before the tick.
#[derive(Clone, Copy, Debug)]
pub struct Classifier<'a, const N: usize> {
    /// The discrete state.
    pub discrete: &'a FsmState,
    /// The validated configuration.
    pub parameters: &'a Parameters<N>,
    /// The axes; a refusal reports the ramp ticks left.
    pub axes: &'a [Axis; N],
    /// Epoch of the next session; `None` when the epochs are used up.
    pub next_epoch: Option<Epoch>,
}

impl<const N: usize> Classifier<'_, N> {
    /// Classifies one event, in order of arrival.
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
            self.non_owner(connection, event, accepted, diagnostics);
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
                        fsm.goodbye = true
                    }
                    ClientMessage::Stop(epoch) if *epoch == self.discrete.epoch => fsm.stop = true,
                    ClientMessage::Goodbye(_) | ClientMessage::Stop(_) => {
                        count(&mut counters.stale)
                    }
                    ClientMessage::Hello(_) => count(&mut counters.malformed),
                }
            }
        }
    }

    fn non_owner(
        &self,
        connection: Connection,
        event: &Event<N>,
        accepted: &mut Accepted<N>,
        diagnostics: &mut Diagnostics,
    ) {
        match event {
            Event::Message(ClientMessage::Hello(hello)) => {
                // Acceptable so far; [`super::fsm`] decides on the grant.
                match self.grant(hello, &accepted.fsm) {
                    Ok(epoch) => accepted.fsm.hello = Some((connection, epoch)),
                    Err(reason) => {
                        let refusal = (connection, reason);
                        // There is room: a tick has at most `EVENTS` events.
                        diagnostics.refusals.push(refusal).unwrap_or(());
                    }
                }
            }
            Event::Message(_)
            | Event::Malformed(_)
            | Event::Dropped(_)
            | Event::Broken(_)
            | Event::Flood => {
                count(&mut diagnostics.counters.non_owner);
            }
            Event::Closed => {}
        }
    }

    /// Returns the epoch to grant to a Hello.
    ///
    /// # Errors
    /// The reason to refuse it.
    fn grant(&self, hello: &Hello, fsm: &FsmInput) -> Result<Epoch, Refusal> {
        let ticks_left = ramp_ticks_left(self.parameters, self.axes);
        match self.discrete.phase {
            Phase::Handshake | Phase::Submit | Phase::Obtain => return Err(Refusal::Busy),
            Phase::SafeDisconnect => return Err(Refusal::Ramping { ticks_left }),
            Phase::Fault => return Err(Refusal::Faulted { ticks_left }),
            Phase::Listening => {}
        }
        let needed = self.parameters.capabilities;
        if fsm.hello.is_some() {
            Err(Refusal::Busy)
        } else if usize::from(hello.axes) != N {
            let expected = u8::try_from(N).unwrap_or(u8::MAX);
            Err(Refusal::Axes { expected })
        } else if !hello.capabilities.contains(needed) {
            Err(Refusal::Capability { needed })
        } else {
            self.next_epoch.ok_or(Refusal::Unavailable)
        }
    }

    /// Classifies a command of the owner: the highest fresh valid one acts, every other one is
    /// counted.
    fn command(
        &self,
        command: &Command<N>,
        accepted: &mut Accepted<N>,
        diagnostics: &mut Diagnostics,
    ) {
        let counters = &mut diagnostics.counters;
        match self.verdict(command) {
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

    /// Returns the verdict on a command of the owner, apart from the other commands of the tick.
    #[must_use]
    pub fn verdict(&self, command: &Command<N>) -> Verdict {
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
        // Content that the wire format cannot check: the mode in this phase, the targets'
        // magnitude.
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

/// Verdict on a command of the owner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Verdict {
    /// Has the session's epoch, is ahead in sequence, answers the last State, and is valid.
    Fresh,
    /// Has the sequence of the last accepted command.
    Duplicate,
    /// Has another epoch, is too far ahead, answers a State that was never sent, or comes without a
    /// session.
    Stale,
    /// Is behind the last accepted command, or answers an older State than the window allows.
    Late,
    /// Asks for a mode that the phase does not allow.
    Malformed,
    /// Has a target beyond its limit.
    OutOfRange,
}

/// Largest distance of a command ahead of the accepted sequence.
const SEQUENCE_WINDOW: u64 = 65_536;

/// Returns the distance of `sequence` ahead of `accepted`; `None` when it is behind.
const fn ahead(accepted: Sequence, sequence: Sequence) -> Option<u64> {
    sequence.0.checked_sub(accepted.0)
}

/// Counts one, saturating: a wrapped counter would report too little.
const fn count(counter: &mut u32) {
    *counter = counter.saturating_add(1);
}
