//! Inputs and outputs of a tick.

use heapless::Vec;

use crate::control::axis::{Actual, InForce, Reference};
use crate::control::message::{
    AxisState, Cause, ClientMessage, ContentError, Counters, FrameError, Phase, Refusal, State,
};
use crate::units::{Epoch, EpochRange, PositionNm, Sequence, Tick, WrenchSample};

/// Events that one tick can take: 8 frames of the owner, its flood or broken stream, a Stop behind
/// a flood, its closing, and 5 events of non-owners.
pub const EVENTS: usize = 16;
/// Frames of the owner that are read per tick (`K`); one more ends the session.
pub const OWNER_FRAMES: u8 = 8;

/// Name of a network connection; an endpoint never gives a number twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Connection(pub u64);

/// Something that happened on a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Event<const N: usize> {
    /// A message.
    Message(ClientMessage<N>),
    /// A valid frame with bad content. The frame is lost.
    Malformed(ContentError),
    /// A datagram without a valid frame. The datagram is lost.
    Dropped(FrameError),
    /// The stream lost its frame boundary.
    Broken(FrameError),
    /// More frames than are read per tick.
    Flood,
    /// The connection is gone.
    Closed,
}

/// Events of one tick, in order of arrival.
pub type Events<const N: usize> = Vec<(Connection, Event<N>), EVENTS>;
/// Hellos refused in one tick.
pub type Refusals = Vec<(Connection, Refusal), EVENTS>;

/// Fate of the references of the last tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum LastWrite<const N: usize> {
    /// The drives took them. Also the input of the first tick.
    Accepted,
    /// The drives did not take them, which stops; they were read back and have these values in
    /// force.
    Refused {
        /// Values in force, axis order.
        #[cfg_attr(feature = "serde", serde(with = "crate::serde_array"))]
        in_force: [InForce; N],
    },
    /// The drives did not take them, which stops, and cannot be read back. No references are
    /// written until they can.
    Unknown,
}

/// Reading of the machine in one cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Reading<const N: usize> {
    /// Nominal references of this cycle.
    #[cfg_attr(feature = "serde", serde(with = "crate::serde_array"))]
    pub nominal: [PositionNm; N],
    /// Measurements of the drives.
    #[cfg_attr(feature = "serde", serde(with = "crate::serde_array"))]
    pub actual: [Actual; N],
}

impl<const N: usize> Reading<N> {
    /// A machine that measures nothing: its actual values are reported as zero.
    #[must_use]
    pub const fn unmeasured(nominal: [PositionNm; N]) -> Self {
        Self {
            nominal,
            actual: [Actual::ZERO; N],
        }
    }
}

/// Inputs of one tick from the machine. Every field must be given: a stop has no default.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct TickInput<const N: usize> {
    /// Cycles since the last tick: 1 when on time; 0 counts as 1. Each further cycle is a missed
    /// deadline.
    pub elapsed_cycles: u32,
    /// Nominal references and measurements; `None` when the machine could not be read, which stops:
    /// the last nominal references stand, and count as in force until the machine is read again.
    pub reading: Option<Reading<N>>,
    /// Sample of the force sensor, which the State carries to the client; `None` without one.
    pub sensor: Option<WrenchSample>,
    /// The stop at the machine is asserted. It is latched until a re-arm ([`Output::latched`]).
    pub stop: bool,
    /// The program is to end: ramps as a stop does, and latches nothing. Held until the program
    /// ends.
    pub quit: bool,
    /// The re-arm at the machine is pressed. It counts only after it was seen released in the
    /// fault: a stuck one re-arms nothing.
    pub rearm: bool,
}

impl<const N: usize> TickInput<N> {
    /// Returns the cycles since the last tick, at least 1.
    #[inline]
    #[must_use]
    pub const fn cycles(&self) -> u32 {
        if self.elapsed_cycles == 0 {
            1
        } else {
            self.elapsed_cycles
        }
    }
}

/// Complete input of one tick: the session after it depends on this and on the session before it
/// only.
#[derive(Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Input<const N: usize> {
    /// Input from the machine.
    pub tick: TickInput<N>,
    /// Fate of the references of the last tick.
    pub last_write: LastWrite<N>,
    /// Time from the departure of the last State to the arrival of the last command, µs; recorded
    /// only. 0 without a measurement.
    pub arrival_us: u16,
    /// Frames without the tag of their sender, or seen before; counted only.
    pub unauthentic: u16,
    /// Epochs that may be granted.
    pub epochs: EpochRange,
    /// Events from the network.
    pub events: Events<N>,
}

impl<const N: usize> Input<N> {
    /// An input without events, at position zero, on time.
    #[must_use]
    pub const fn empty(epochs: EpochRange) -> Self {
        Self {
            tick: TickInput {
                elapsed_cycles: 1,
                reading: Some(Reading::unmeasured([PositionNm(0); N])),
                sensor: None,
                stop: false,
                quit: false,
                rearm: false,
            },
            last_write: LastWrite::Accepted,
            arrival_us: 0,
            unauthentic: 0,
            epochs,
            events: Vec::new(),
        }
    }
}

impl<const N: usize> Clone for Input<N> {
    fn clone(&self) -> Self {
        Self {
            tick: self.tick,
            last_write: self.last_write,
            arrival_us: self.arrival_us,
            unauthentic: self.unauthentic,
            epochs: self.epochs,
            events: self.events.clone(),
        }
    }

    /// Copies `other` into this place: only the events in use, not the capacity.
    fn clone_from(&mut self, other: &Self) {
        self.tick = other.tick;
        self.last_write = other.last_write;
        self.arrival_us = other.arrival_us;
        self.unauthentic = other.unauthentic;
        self.epochs = other.epochs;
        self.events.clear();
        // There is room: both have the same capacity.
        self.events.extend_from_slice(&other.events).unwrap_or(());
    }
}

/// Complete output of one tick.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Output<const N: usize> {
    /// References of the axes. Not to be written if `withheld`.
    #[cfg_attr(feature = "serde", serde(with = "crate::serde_array"))]
    pub references: [Reference; N],
    /// The values in force at the drives are unknown or beyond their limits: nothing may be written
    /// in this cycle.
    pub withheld: bool,
    /// State of this tick.
    pub state: State<N>,
    /// Recipient of the State.
    pub owner: Option<Connection>,
    /// Recipient of a Welcome, before the State; [`super::Session::welcome`] makes the message.
    pub welcome: Option<Connection>,
    /// Recipients of Refusals; their connections are closed afterwards.
    pub refusals: Refusals,
    /// Connection without further use; it should be closed.
    pub close: Option<Connection>,
    /// Cause of an end of a session, or of a stop, in this tick.
    pub ended: Option<Cause>,
    /// A stop is latched: asserted by other than a quit, and not re-armed. To be stored before the
    /// references are written, and given to the next session's [`super::Start::stop_latched`], in
    /// this process or a later one.
    pub latched: bool,
}

impl<const N: usize> Output<N> {
    /// No reference, no answer, the State of a server that has not run.
    #[inline]
    pub(crate) fn nothing() -> Self {
        let state = State {
            tick: Tick(0),
            epoch: Epoch(0),
            accepted: Sequence(0),
            phase: Phase::Listening,
            cause: Cause::None,
            on_time_of_100: 0,
            arrival_us: 0,
            ramp_ticks_left: 0,
            counters: Counters::default(),
            sensor: None,
            axes: [AxisState::default(); N],
        };
        Self {
            references: [Reference::ZERO; N],
            withheld: true,
            state,
            owner: None,
            welcome: None,
            refusals: Refusals::new(),
            close: None,
            ended: None,
            latched: false,
        }
    }
}
