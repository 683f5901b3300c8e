//! One server's end of all its connections: bytes in, bytes and drive references out.
//!
//! The endpoint owns the [`Session`], a deframer per connection, the inbox of the coming tick, the black box, and the map
//! from axes to motors. It has no clock and no sockets: the host opens and closes connections, feeds what it read,
//! calls [`Endpoint::tick`] once per cycle, writes the references and then the bytes that come out, and closes what it is told to close.

use core::fmt;

use heapless::Vec;

use crate::control::axis::{Offsets, Reference};
use crate::control::message::{ClientMessage, Refusal, ServerMessage};
pub use crate::control::session::Cycle;
use crate::control::session::fsm::Connection;
use crate::control::session::{
    BlackBox, EVENTS, Event, Input, OWNER_FRAMES, Output, Session, StartError,
};
use crate::control::wire::{
    Deframer, Feed, Frame, FrameBytes, FrameError, PROTOCOL_VERSION, decode_client, encode_server,
    encode_state,
};

/// Connections that can be open at once: the owner and strangers who are told why they cannot be.
pub const CONNECTIONS: usize = 6;
/// Refusals that one tick sends at most: one per connection, one per event.
pub const REFUSALS: usize = CONNECTIONS + EVENTS;
/// Frames that one tick sends at most: the Refusals, a Welcome, a State.
pub const FRAMES: usize = REFUSALS + 2;

/// How bytes travel. A broken stream has lost its boundary and ends; a broken datagram is dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Transport {
    /// TCP and the like.
    Stream,
    /// UDP and the like: each `feed` is one whole datagram.
    Datagram,
}

/// Which of `N` axes drives each motor. Two motors on one cart (F1) have the same axis, so they always receive the same reference (T10).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct MotorMap<const N: usize, const MOTORS: usize> {
    axis_of_motor: [usize; MOTORS],
}

/// A motor is mapped to an axis that does not exist.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct MotorMapError {
    /// Which motor.
    pub motor: usize,
    /// The axis it was given.
    pub axis: usize,
    /// How many axes there are.
    pub axes: usize,
}

impl fmt::Display for MotorMapError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { motor, axis, axes } = self;
        write!(
            f,
            "motor {motor} is mapped to axis {axis}, there are {axes}"
        )
    }
}

impl core::error::Error for MotorMapError {}

impl<const N: usize, const MOTORS: usize> MotorMap<N, MOTORS> {
    /// A map from motors to axes.
    ///
    /// # Errors
    /// The first motor whose axis does not exist.
    pub fn new(axis_of_motor: [usize; MOTORS]) -> Result<Self, MotorMapError> {
        for (motor, axis) in axis_of_motor.into_iter().enumerate() {
            let exists = axis < N;
            if !exists {
                return Err(MotorMapError {
                    motor,
                    axis,
                    axes: N,
                });
            }
        }
        Ok(Self { axis_of_motor })
    }

    /// Which axis each motor drives.
    #[must_use]
    pub const fn axis_of_motor(&self) -> &[usize; MOTORS] {
        &self.axis_of_motor
    }

    /// Axis references to motor references.
    #[must_use]
    pub fn spread(&self, axes: &[Reference; N]) -> [Reference; MOTORS] {
        // Every axis of a checked map exists; the default is never taken.
        self.axis_of_motor
            .map(|axis| axes.get(axis).copied().unwrap_or_default())
    }
}

/// What one cycle gives back to the host, beside the bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Turn<const N: usize, const MOTORS: usize> {
    /// What every motor receives.
    pub motors: [Reference; MOTORS],
    /// What the session produced.
    pub output: Output<N>,
    /// Connections to close once their bytes are written.
    pub close: Vec<Connection, CONNECTIONS>,
}

/// No room for another connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Full;

#[derive(Clone, Debug)]
struct Slot {
    connection: Connection,
    transport: Transport,
    deframer: Deframer,
    /// Frames taken since the last tick.
    frames: u8,
    /// The owner has exceeded its frames; only a Stop still gets through.
    flooded: bool,
    /// Nothing more is read; the host is told to close it.
    finished: bool,
    /// The peer speaks another version of the protocol and shall be told so.
    foreign: bool,
    /// Ticks without owning the session.
    idle_ticks: u32,
}

/// The server side of the protocol for `N` axes and `MOTORS` motors, with a black box of `3 HALF` ticks.
#[derive(Clone, Debug)]
pub struct Endpoint<const N: usize, const MOTORS: usize, const HALF: usize> {
    session: Session<N>,
    motors: MotorMap<N, MOTORS>,
    slots: Vec<Slot, CONNECTIONS>,
    /// What the coming tick depends on; its events are the inbox.
    input: Input<N>,
    /// Events of strangers in the inbox; they have a budget of their own, so that they cannot crowd out the owner's.
    stranger_events: u8,
    next_connection: u64,
    black_box: BlackBox<N, HALF>,
}

impl<const N: usize, const MOTORS: usize, const HALF: usize> Endpoint<N, MOTORS, HALF> {
    /// An endpoint without connections. Inlined for the reason that [`BlackBox::new`](crate::control::session::recorder::Recorder::new) is.
    #[inline(always)]
    #[must_use]
    pub const fn new(session: Session<N>, motors: MotorMap<N, MOTORS>) -> Self {
        Self {
            session,
            motors,
            slots: Vec::new(),
            input: Input::nothing(),
            stranger_events: 0,
            next_connection: 0,
            black_box: BlackBox::new(),
        }
    }

    /// The invariant, clause by clause: the session, every deframer and the black box are valid; connections are in the order of
    /// their numbers, which is that of their opening; nobody has been read beyond its budget; what may still arrive before the
    /// tick finds room.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let opened = |slot: &Slot| slot.connection.0 < self.next_connection;
        self.session.is_valid()
            && self.black_box.is_valid()
            && self
                .slots
                .iter()
                .all(|slot| slot.is_valid() && opened(slot))
            && self
                .slots
                .is_sorted_by(|one, next| one.connection < next.connection)
            && self.inbox_has_room()
    }

    /// As many events as there can be before the tick: at most [`OWNER_EVENTS`] of the owner and [`STRANGER_EVENTS`] of others.
    fn inbox_has_room(&self) -> bool {
        let owner = self.session.owner();
        let events = self.input.events.iter();
        let of_owner = events.filter(|(from, _)| owner == Some(*from)).count();
        let of_others = self.input.events.len().saturating_sub(of_owner);
        of_owner <= OWNER_EVENTS
            && of_others <= usize::from(self.stranger_events)
            && self.stranger_events <= STRANGER_EVENTS
    }

    /// The session.
    #[must_use]
    pub const fn session(&self) -> &Session<N> {
        &self.session
    }

    /// The black box.
    #[must_use]
    pub const fn black_box(&self) -> &BlackBox<N, HALF> {
        &self.black_box
    }

    /// The black box, to release it.
    pub const fn black_box_mut(&mut self) -> &mut BlackBox<N, HALF> {
        &mut self.black_box
    }

    /// As [`Session::resume`]: the machine did not take the last references, and has these offsets in force.
    /// The black box begins anew, for what follows does not follow from what it holds.
    ///
    /// # Errors
    /// As [`Session::resume`].
    pub fn resume(&mut self, in_force: &[Offsets; N]) -> Result<(), StartError> {
        self.session.resume(in_force)?;
        self.black_box.release();
        Ok(())
    }

    /// Registers a new connection.
    ///
    /// # Errors
    /// [`Full`]: all [`CONNECTIONS`] are in use; [`Endpoint::full_refusal`] is what the peer should be told.
    pub fn open(&mut self, transport: Transport) -> Result<Connection, Full> {
        let connection = Connection(self.next_connection);
        let slot = Slot {
            connection,
            transport,
            deframer: Deframer::new(),
            frames: 0,
            flooded: false,
            finished: false,
            foreign: false,
            idle_ticks: 0,
        };
        self.slots.push(slot).map_err(|_| Full)?;
        self.next_connection = self.next_connection.saturating_add(1);
        Ok(connection)
    }

    /// What a peer is told for whom there is no room.
    #[must_use]
    pub fn full_refusal() -> FrameBytes {
        encode_server(&ServerMessage::<N>::Refusal(Refusal::Unavailable))
    }

    /// Says that a connection is gone: closed by its peer, reset, or by the host because a write failed.
    pub fn close(&mut self, connection: Connection) {
        let open = self.slots.len();
        self.slots.retain(|slot| slot.connection != connection);
        // Once is enough: told again and again, it would fill the inbox.
        if self.slots.len() == open {
            return;
        }
        if self.session.owner() == Some(connection) {
            self.post(connection, Event::Closed);
        } else {
            self.withdraw(connection);
        }
    }

    /// Takes bytes that were read from a stream, or one datagram. Returns how many frames the coming tick has of the connection.
    ///
    /// Work is bounded by the length of `bytes`; what exceeds a connection's budget of frames is dropped:
    /// for the owner that ends the session, and a Stop still counts; a stranger is closed.
    pub fn feed(&mut self, connection: Connection, bytes: &[u8]) -> u8 {
        let is_owner = self.session.owner() == Some(connection);
        let mut rest = bytes;
        let mut begun = false;
        loop {
            let Some(slot) = find(&mut self.slots, connection) else {
                return 0;
            };
            // No bytes of a stream are nothing; an empty datagram is a broken one.
            let nothing = rest.is_empty() && (begun || slot.transport == Transport::Stream);
            if nothing || slot.finished {
                return slot.frames;
            }
            begun = true;
            let Some((event, consumed)) = slot.take(rest, is_owner) else {
                return slot.frames;
            };
            let expelled = slot.finished && !is_owner;
            rest = rest.get(consumed..).unwrap_or_default();
            if expelled {
                self.withdraw(connection);
            }
            if let Some(event) = event {
                self.admit(connection, event, is_owner);
            }
        }
    }

    /// How many frames the coming tick has of a connection; none of one that is not open.
    #[must_use]
    pub fn frames_of(&self, connection: Connection) -> u8 {
        let slot = self.slots.iter().find(|slot| slot.connection == connection);
        slot.map_or(0, |slot| slot.frames)
    }

    /// Whether the coming tick has what a server in lock-step waits for: a Command that answers the last State,
    /// or something of the owner's that ends the session.
    #[must_use]
    pub fn owner_has_answered(&self) -> bool {
        let discrete = &self.session.parts().discrete;
        self.input.events.iter().any(|(from, event)| {
            discrete.owner == Some(*from)
                && match event {
                    Event::Message(ClientMessage::Command(command)) => {
                        command.epoch == discrete.epoch && command.echo == discrete.tick
                    }
                    Event::Message(ClientMessage::Goodbye(_) | ClientMessage::Stop(_))
                    | Event::Broken(_)
                    | Event::Flood
                    | Event::Closed => true,
                    Event::Message(ClientMessage::Hello(_))
                    | Event::Malformed(_)
                    | Event::Dropped(_) => false,
                }
        })
    }

    /// One cycle. `send` receives, in order, the bytes to write and to whom: refusals, the Welcome, the State.
    /// It should keep them: the references, which come first, are in what is returned.
    pub fn tick(
        &mut self,
        cycle: &Cycle<N>,
        send: &mut impl FnMut(Connection, &[u8]),
    ) -> Turn<N, MOTORS> {
        self.complete_input(cycle);
        self.black_box.before_tick(&self.session);
        let output = self.session.tick(&self.input);
        self.black_box
            .after_tick(&self.input, &output, output.ended.is_some());
        self.input.events.clear();
        self.send(&output, send);
        let close = self.finished(&output);
        self.close_lost_owner();
        Turn {
            motors: self.motors.spread(&output.references),
            output,
            close,
        }
    }

    /// Queues an event, a stranger's only within the strangers' common budget; beyond it the stranger is closed.
    fn admit(&mut self, connection: Connection, event: Event<N>, is_owner: bool) {
        if is_owner {
            return self.post(connection, event);
        }
        if self.stranger_events < STRANGER_EVENTS {
            self.stranger_events = self.stranger_events.saturating_add(1);
            return self.post(connection, event);
        }
        if let Some(slot) = find(&mut self.slots, connection) {
            slot.finished = true;
        }
    }

    /// Takes back what a stranger asked for that is gone, or is about to be closed: nobody is granted a session without a connection.
    fn withdraw(&mut self, connection: Connection) {
        self.input.events.retain(|(from, _)| *from != connection);
    }

    /// Queues an event. There is room: [`Self::inbox_has_room`].
    fn post(&mut self, connection: Connection, event: Event<N>) {
        self.input.events.push((connection, event)).unwrap_or(());
    }

    /// The events are in place already; everything else comes with the cycle.
    fn complete_input(&mut self, cycle: &Cycle<N>) {
        let owner = self.session.owner();
        let patience = self.session.config().parameters().handshake_ticks;
        for slot in &mut self.slots {
            slot.frames = 0;
            slot.finished |= slot.flooded;
            slot.idle_ticks = if owner == Some(slot.connection) {
                0
            } else {
                slot.idle_ticks.saturating_add(1)
            };
            slot.finished |= slot.idle_ticks > patience;
        }
        self.stranger_events = 0;
        self.input.cycle = *cycle;
    }

    /// Not inlined, as the other large parts of a tick: it needs as much stack as one of them, not as all together.
    #[inline(never)]
    fn send(&mut self, output: &Output<N>, send: &mut impl FnMut(Connection, &[u8])) {
        for slot in self.slots.iter_mut().filter(|slot| slot.foreign) {
            slot.foreign = false;
            let supported = PROTOCOL_VERSION;
            let refusal = ServerMessage::<N>::Refusal(Refusal::Version { supported });
            send(slot.connection, &encode_server(&refusal));
        }
        for (connection, reason) in &output.refusals {
            send(
                *connection,
                &encode_server(&ServerMessage::<N>::Refusal(*reason)),
            );
        }
        if let Some(connection) = output.welcome {
            let welcome = self.session.welcome();
            send(connection, &encode_server(&ServerMessage::Welcome(welcome)));
        }
        if let Some(owner) = output.owner {
            send(owner, &encode_state(&output.state));
        }
    }

    /// An owner without a connection is closed in the coming tick, whichever way it lost it.
    fn close_lost_owner(&mut self) {
        if let Some(owner) = self.session.owner() {
            if find(&mut self.slots, owner).is_none() {
                self.post(owner, Event::Closed);
            }
        }
    }

    /// Forgets, and names, the connections that have no further use.
    fn finished(&mut self, output: &Output<N>) -> Vec<Connection, CONNECTIONS> {
        let mut close = Vec::new();
        self.slots.retain(|slot| {
            let refused = output
                .refusals
                .iter()
                .any(|(connection, _)| *connection == slot.connection);
            let keep = !(slot.finished || refused || output.close == Some(slot.connection));
            if !keep {
                // There is room: `close` is as long as `slots`.
                close.push(slot.connection).unwrap_or(());
            }
            keep
        });
        close
    }
}

impl Slot {
    /// The invariant: the deframer is valid, and nobody is read beyond the budget.
    fn is_valid(&self) -> bool {
        self.deframer.is_valid() && self.frames <= OWNER_FRAMES
    }

    /// One frame's worth of bytes: the event it makes, if any, and how many bytes it took. `None` when the frame is not complete.
    fn take<const N: usize>(
        &mut self,
        bytes: &[u8],
        is_owner: bool,
    ) -> Option<(Option<Event<N>>, usize)> {
        if self.transport == Transport::Datagram {
            let event = match Frame::parse(bytes) {
                Ok(frame) => judge(&frame),
                Err(error) => Event::Dropped(error),
            };
            return Some((self.within_budget(event, is_owner), bytes.len()));
        }
        match self.deframer.feed(bytes) {
            Feed::Incomplete => None,
            Feed::Frame { frame, consumed } => {
                let event = judge(&frame);
                Some((self.within_budget(event, is_owner), consumed))
            }
            Feed::Broken(error) => {
                self.finished = true;
                self.foreign = matches!(error, FrameError::Version { .. });
                // A flood has already ended the session.
                let event = (!self.flooded).then_some(Event::Broken(error));
                Some((event, bytes.len()))
            }
        }
    }

    /// The event itself within the budget. Beyond it the owner's first excess is a flood, and of the rest one Stop still counts,
    /// for a stop must not get lost behind a burst; a stranger is closed.
    fn within_budget<const N: usize>(
        &mut self,
        event: Event<N>,
        is_owner: bool,
    ) -> Option<Event<N>> {
        let budget = if is_owner {
            OWNER_FRAMES
        } else {
            STRANGER_FRAMES
        };
        if self.frames < budget {
            self.frames = self.frames.saturating_add(1);
            return Some(event);
        }
        let stops = matches!(event, Event::Message(ClientMessage::Stop(_)));
        if !is_owner || stops {
            self.finished = true;
            return (is_owner && stops).then_some(event);
        }
        let first = !self.flooded;
        self.flooded = true;
        first.then_some(Event::Flood)
    }
}

/// The slot of a connection.
fn find(slots: &mut [Slot], connection: Connection) -> Option<&mut Slot> {
    slots.iter_mut().find(|slot| slot.connection == connection)
}

/// Frames that are read per tick of a connection that owns nothing.
const STRANGER_FRAMES: u8 = 1;
/// Events of all strangers together that reach a tick.
const STRANGER_EVENTS: u8 = 5;
/// Events of the owner that reach a tick: its frames, the flood or broken stream after them, one Stop behind a flood, its closing.
const OWNER_EVENTS: usize = 11;

/// The message of a frame, or what is wrong with it.
fn judge<const N: usize>(frame: &Frame<'_>) -> Event<N> {
    match decode_client(frame) {
        Ok(message) => Event::Message(message),
        Err(error) => Event::Malformed(error),
    }
}

#[cfg(test)]
mod tests;
