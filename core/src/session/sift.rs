//! Before the first half of a tick: sifts what arrived into what decides, what answers, and what only counts.
//!
//! Nothing but the owner's fresh valid commands, stops and endings passes; everything else leaves a count (T7).

use heapless::Vec;

use super::act::AxisChannels;
use super::decide::{Arrivals, Connection, Discrete};
use super::{Event, Events, Refusals, ramp_ticks_left};
use crate::axis::Offsets;
use crate::message::{ClientMessage, Command, Counters, Hello, Mode, Phase, Refusal};
use crate::session::config::Parameters;
use crate::units::{Epoch, Sequence};

/// What one tick's events amount to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Sifted<const N: usize> {
    /// What decides.
    pub(super) arrivals: Arrivals,
    /// Targets of the highest fresh valid command; zero without one.
    pub(super) targets: [Offsets; N],
    /// Hellos that cannot be granted, whatever is decided.
    pub(super) refusals: Refusals,
    /// The owner sent a command that was not fresh because it was late.
    pub(super) late: bool,
}

/// One pass over the events, in order of arrival.
pub(super) struct Sieve<'a, const N: usize> {
    state: &'a Discrete,
    parameters: &'a Parameters<N>,
    channels: &'a [AxisChannels; N],
    counters: &'a mut Counters,
    next_epoch: Epoch,
    sifted: Sifted<N>,
}

impl<'a, const N: usize> Sieve<'a, N> {
    pub(super) fn new(
        state: &'a Discrete,
        parameters: &'a Parameters<N>,
        channels: &'a [AxisChannels; N],
        counters: &'a mut Counters,
        next_epoch: Epoch,
    ) -> Self {
        Self {
            state,
            parameters,
            channels,
            counters,
            next_epoch,
            sifted: Sifted {
                arrivals: Arrivals::default(),
                targets: [Offsets::default(); N],
                refusals: Vec::new(),
                late: false,
            },
        }
    }

    pub(super) fn sift(mut self, events: &Events<N>) -> Sifted<N> {
        for (connection, event) in events {
            if self.state.owner == Some(*connection) {
                self.owner(event);
            } else {
                self.stranger(*connection, event);
            }
        }
        self.sifted
    }

    fn owner(&mut self, event: &Event<N>) {
        let arrivals = &mut self.sifted.arrivals;
        match event {
            Event::Broken(_) => arrivals.framing = true,
            Event::Flood => arrivals.flood = true,
            Event::Closed => arrivals.closed = true,
            Event::Malformed(_) | Event::Dropped(_) => {
                count(&mut self.counters.received);
                count(&mut self.counters.malformed);
            }
            Event::Message(message) => {
                count(&mut self.counters.received);
                match message {
                    ClientMessage::Command(command) => self.command(command),
                    ClientMessage::Goodbye(epoch) if *epoch == self.state.epoch => {
                        arrivals.goodbye = true;
                    }
                    ClientMessage::Stop(epoch) if *epoch == self.state.epoch => {
                        arrivals.stop = true;
                    }
                    ClientMessage::Goodbye(_) | ClientMessage::Stop(_) => {
                        count(&mut self.counters.stale);
                    }
                    // Well-framed, but without a place: it costs this frame and nothing else.
                    ClientMessage::Hello(_) => count(&mut self.counters.malformed),
                }
            }
        }
    }

    fn stranger(&mut self, connection: Connection, event: &Event<N>) {
        match event {
            Event::Message(ClientMessage::Hello(hello)) => self.hello(connection, hello),
            Event::Message(_)
            | Event::Malformed(_)
            | Event::Dropped(_)
            | Event::Broken(_)
            | Event::Flood => {
                count(&mut self.counters.strangers);
            }
            Event::Closed => {}
        }
    }

    /// Grants or refuses; the final word on a grant is [`super::decide`]'s.
    fn hello(&mut self, connection: Connection, hello: &Hello) {
        let refusal = self.refusal(hello);
        match refusal {
            None => self.sifted.arrivals.hello = Some((connection, self.next_epoch)),
            // There is room: a tick has at most `EVENTS` events.
            Some(reason) => self
                .sifted
                .refusals
                .push((connection, reason))
                .unwrap_or(()),
        }
    }

    fn refusal(&self, hello: &Hello) -> Option<Refusal> {
        let ticks_left = ramp_ticks_left(self.parameters, self.channels);
        match self.state.phase {
            Phase::Handshake | Phase::Submit | Phase::Obtain => return Some(Refusal::Busy),
            Phase::SafeDisconnect => return Some(Refusal::Ramping { ticks_left }),
            Phase::Fault => return Some(Refusal::Faulted { ticks_left }),
            Phase::Listening => {}
        }
        let needed = self.parameters.capabilities;
        if self.sifted.arrivals.hello.is_some() {
            Some(Refusal::Busy)
        } else if usize::from(hello.axes) != N {
            let expected = u8::try_from(N).unwrap_or(u8::MAX);
            Some(Refusal::Axes { expected })
        } else if !hello.capabilities.contains(needed) {
            Some(Refusal::Capability { needed })
        } else if self.next_epoch <= self.state.epoch {
            Some(Refusal::Unavailable)
        } else {
            None
        }
    }

    /// A command of the owner: the highest fresh valid one acts, every other one is counted.
    fn command(&mut self, command: &Command<N>) {
        if !self.state.is_live() || command.epoch != self.state.epoch {
            return count(&mut self.counters.stale);
        }
        match ahead(self.state.accepted, command.sequence) {
            Some(0) => return count(&mut self.counters.duplicate),
            Some(1..=SEQUENCE_WINDOW) => {}
            Some(_) => return count(&mut self.counters.stale),
            None => return self.count_late(),
        }
        match self.state.tick.0.checked_sub(command.echo.0) {
            None => return count(&mut self.counters.stale),
            Some(behind) if behind > u64::from(self.parameters.echo_window) => {
                return self.count_late();
            }
            Some(_) => {}
        }
        if !self.admits(command) {
            return;
        }
        match self.sifted.arrivals.command {
            Some((best, _)) if command.sequence == best => {
                return count(&mut self.counters.duplicate);
            }
            Some((best, _)) if command.sequence < best => return count(&mut self.counters.late),
            Some(_) => count(&mut self.counters.late),
            None => {}
        }
        self.sifted.arrivals.command = Some((command.sequence, command.mode));
        self.sifted.targets = command.targets;
    }

    /// Content that the wire cannot judge: the mode's place in the phase, the targets' magnitude.
    fn admits(&mut self, command: &Command<N>) -> bool {
        if self.state.phase == Phase::Handshake && command.mode == Mode::Obtain {
            count(&mut self.counters.malformed);
            return false;
        }
        let mut axes = self.parameters.axes.iter().zip(&command.targets);
        if axes.all(|(axis, target)| axis.limits.admits(target)) {
            return true;
        }
        count(&mut self.counters.malformed);
        count(&mut self.counters.out_of_range);
        false
    }

    fn count_late(&mut self) {
        self.sifted.late = true;
        count(&mut self.counters.late);
    }
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
