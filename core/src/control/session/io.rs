//! What goes into a tick and what comes out of it.

use heapless::Vec;

use super::fsm::Connection;
use crate::control::axis::{Actual, Reference};
use crate::control::message::{Cause, ClientMessage, ContentError, FrameError, Refusal, State};
use crate::units::{Epoch, PositionNm, TorquePermille, VelocityUmS};

/// Events that one tick can take: 8 frames of the owner, its flood or broken stream, a Stop behind a flood, its closing, and 5 events
/// of strangers.
pub const EVENTS: usize = 16;
/// Frames of the owner that are read per tick (`K`); one more ends the session.
pub const OWNER_FRAMES: u8 = 8;

/// Something that happened on a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Event<const N: usize> {
    /// A message.
    Message(ClientMessage<N>),
    /// A well-framed frame with bad content. It costs that frame.
    Malformed(ContentError),
    /// A datagram that is no frame. It costs that datagram.
    Dropped(FrameError),
    /// The stream lost its frame boundary.
    Broken(FrameError),
    /// More frames than are read per tick.
    Flood,
    /// The connection is gone.
    Closed,
}

/// One tick's events, in order of arrival.
pub type Events<const N: usize> = Vec<(Connection, Event<N>), EVENTS>;
/// Hellos refused in one tick.
pub type Refusals = Vec<(Connection, Refusal), EVENTS>;

/// What the host gives to one cycle, beside what arrived.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Cycle<const N: usize> {
    /// Cycles since the last tick: 1 when on time; 0 counts as 1.
    pub elapsed: u32,
    /// Nominal references of this cycle.
    pub nominal: [PositionNm; N],
    /// What the drives measure.
    pub actual: [Actual; N],
    /// The stop at the machine is asserted.
    pub stop: bool,
    /// Somebody at the machine re-arms. It counts only once it was seen released in the fault: one that is stuck re-arms nothing.
    pub rearm: bool,
    /// Epoch for the next session, from a counter persisted before use: greater than every one before. It is used up when
    /// [`Output::welcome`] is there.
    pub next_epoch: Epoch,
    /// When in the cycle the last command arrived, µs; evidence only.
    pub arrival_us: u16,
}

impl<const N: usize> Cycle<N> {
    /// Cycles since the last tick, at least 1.
    #[inline]
    #[must_use]
    pub const fn cycles(&self) -> u32 {
        if self.elapsed == 0 { 1 } else { self.elapsed }
    }

    /// A cycle in which nothing special happens.
    #[must_use]
    pub const fn on_time(nominal: [PositionNm; N], actual: [Actual; N], next_epoch: Epoch) -> Self {
        Self {
            elapsed: 1,
            nominal,
            actual,
            stop: false,
            rearm: false,
            next_epoch,
            arrival_us: 0,
        }
    }
}

/// Everything that one tick depends on, beside the session itself.
#[derive(Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Input<const N: usize> {
    /// What the host gives.
    pub cycle: Cycle<N>,
    /// What arrived.
    pub events: Events<N>,
}

impl<const N: usize> Input<N> {
    /// No event, everything at zero.
    #[must_use]
    pub const fn nothing() -> Self {
        let at_rest = Actual {
            position: PositionNm(0),
            velocity: VelocityUmS(0),
            torque: TorquePermille(0),
        };
        Self {
            cycle: Cycle::on_time([PositionNm(0); N], [at_rest; N], Epoch(0)),
            events: Vec::new(),
        }
    }
}

impl<const N: usize> Clone for Input<N> {
    fn clone(&self) -> Self {
        Self {
            cycle: self.cycle,
            events: self.events.clone(),
        }
    }

    /// Copies `other` into this place: only the events there are, not the room for more.
    fn clone_from(&mut self, other: &Self) {
        self.cycle = other.cycle;
        self.events.clear();
        // There is room: both have the same capacity.
        self.events.extend_from_slice(&other.events).unwrap_or(());
    }
}

/// Everything that one tick produces.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Output<const N: usize> {
    /// What the drives receive.
    pub references: [Reference; N],
    /// The State of this tick.
    pub state: State<N>,
    /// Whom to send the State to.
    pub owner: Option<Connection>,
    /// Whom to welcome, before the State; [`super::Session::welcome`] makes the message.
    pub welcome: Option<Connection>,
    /// Whom to refuse, and to close afterwards.
    pub refusals: Refusals,
    /// Whose connection has no further use and should be closed.
    pub close: Option<Connection>,
    /// Why a session ended, or the server stopped, in this tick.
    pub ended: Option<Cause>,
}
