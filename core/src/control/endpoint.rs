//! Server side of the protocol: bytes in; references out, then frames on request.
//!
//! The endpoint owns the [`Session`], a deframer per connection, and the inbox of the coming tick. It
//! has no clock and no sockets. Once per cycle, in this order:
//!
//! 1. [`Endpoint::feed`] the bytes that were read (and [`Endpoint::open`], [`Endpoint::close`]
//!    connections);
//! 2. [`Endpoint::tick`]; write the references that it returns to the drives ([`MotorMap`] has those of
//!    the motors), and tell [`PendingWrite`] what became of them;
//! 3. [`Endpoint::poll_transmit`] until it returns `None`, and send the frames;
//! 4. [`Endpoint::poll_close`] until it returns `None`, and close the connections.

#[cfg(test)]
pub(crate) mod bench;
#[cfg(feature = "keyed")]
pub(crate) mod gate;
#[cfg(feature = "keyed")]
pub(crate) mod keyed;
mod motors;
pub(crate) mod slot;
pub(crate) mod write;

use core::fmt;

use heapless::Vec;

use crate::control::axis::Offsets;
use crate::control::message::{ClientMessage, Notice, Refusal};
use crate::control::session::{
    Connection, EVENTS, Event, Held, Input, LastWrite, NoRecorder, Output, Record, Session,
    TickInput,
};
use crate::control::wire::{Frame, FrameBytes, Kind, Suite, decode_client, enclose, encode_notice};
use crate::units::{EpochRange, PositionNm};
use crate::zip::each;

#[cfg(feature = "keyed")]
use gate::Gate;
use slot::{Answer, Slot};
use write::report;

#[cfg(feature = "keyed")]
pub use gate::Budget;
pub use motors::{MotorMap, MotorMapError};
pub use slot::Transport;
pub use write::{PendingReadBack, PendingWrite, Write};

/// Connections that can be open at once: the owner, and others that receive a Refusal.
pub const CONNECTIONS: usize = 6;
/// Largest number of Refusals per tick: one per connection, one per event.
pub const REFUSALS: usize = CONNECTIONS + EVENTS;
/// Largest number of frames per tick: notices and Refusals, a Welcome, a State.
pub const FRAMES: usize = REFUSALS + 2;
/// Ticks in which a client shows its key, before its connection has to make room.
#[cfg(feature = "keyed")]
const GREETING_TICKS: u32 = 8;
/// Events of all non-owners together that reach a tick.
const NON_OWNER_EVENTS: u8 = 5;
/// Events of the owner that reach a tick: its frames, the flood or broken stream after them, one
/// Stop behind a flood, its closing.
const OWNER_EVENTS: usize = 11;
#[expect(
    clippy::as_conversions,
    reason = "u8 to usize is lossless; `From` is not const"
)]
const _: () = assert!(
    OWNER_EVENTS.saturating_add(NON_OWNER_EVENTS as usize) <= EVENTS,
    "the inbox has room for every event"
);

/// Error of [`Endpoint::open`]: all [`CONNECTIONS`] are in use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Full;

impl fmt::Display for Full {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "all {CONNECTIONS} connections are in use")
    }
}

impl core::error::Error for Full {}

/// Result of [`Endpoint::greet`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Greeted<'a> {
    /// The datagram is not answered.
    Nothing,
    /// The frame is to be sent to the peer, of which nothing is remembered.
    Answer(&'a [u8]),
    /// The peer has a place, and its Hello waits for the coming tick.
    Peer(Connection),
}

/// Next frame of a tick to be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Transmit {
    /// Answers of the slots.
    Answers,
    /// Refusal with this index in the output.
    Refusal(usize),
    /// The Welcome.
    Welcome,
    /// The State.
    State,
    /// All frames are sent.
    Done,
}

/// Server side of the protocol for `N` axes.
#[derive(Clone, Debug)]
pub struct Endpoint<const N: usize> {
    session: Session<N>,
    slots: Vec<Slot, CONNECTIONS>,
    /// Input of the coming tick; its events are the inbox.
    input: Input<N>,
    /// Events of non-owners in the inbox. They have a budget of their own, so that they cannot
    /// crowd out the owner's.
    non_owner_events: u8,
    next_connection: u64,
    /// Output of the last tick.
    output: Option<Output<N>>,
    /// The fate of the references of the last tick is told; it is in the input. Until then that says
    /// unknown.
    is_told: bool,
    transmit: Transmit,
    /// The frame that was made last.
    frame: FrameBytes,
    /// Its keys; without them every peer is heard.
    #[cfg(feature = "keyed")]
    gate: Option<Gate>,
}

impl<const N: usize> Endpoint<N> {
    /// Creates an endpoint without connections. `epochs` are those that this run of the server may
    /// grant.
    #[must_use]
    pub const fn new(session: Session<N>, epochs: EpochRange) -> Self {
        Self {
            session,
            slots: Vec::new(),
            input: Input::empty(epochs),
            non_owner_events: 0,
            next_connection: 0,
            output: None,
            // What a session starts from is in force, as the empty input says.
            is_told: true,
            transmit: Transmit::Done,
            frame: FrameBytes::EMPTY,
            #[cfg(feature = "keyed")]
            gate: None,
        }
    }

    /// Returns the form of the trailers of its frames.
    #[must_use]
    pub const fn suite(&self) -> Suite {
        #[cfg(feature = "keyed")]
        if self.gate.is_some() {
            return Suite::Tag;
        }
        Suite::Checksum
    }

    /// Replaces the epochs that may be granted. Epochs up to the last one granted are never granted
    /// again.
    pub const fn set_epochs(&mut self, epochs: EpochRange) {
        self.input.epochs = epochs;
    }

    /// The invariant, clause by clause: the session and every deframer are valid; connections are
    /// in the order of their numbers, which is that of their opening; no connection was read beyond
    /// its budget, and none has more events than it was read for, so that those that may still
    /// arrive before the tick find room; the owner has a connection, or its Closed waits; references
    /// of which nothing was said are unknown.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.session.is_valid()
            && self
                .slots
                .iter()
                .all(|slot| slot.is_valid() && slot.connection.0 < self.next_connection)
            && self
                .slots
                .is_sorted_by(|one, next| one.connection < next.connection)
            && self.inbox_has_room()
            && self.owner_is_connected()
            && (self.is_told || self.input.last_write == LastWrite::Unknown)
    }

    /// True if the owner has a connection that is not to be closed, or the coming tick learns that
    /// it has none.
    fn owner_is_connected(&self) -> bool {
        let Some(owner) = self.session.owner() else {
            return true;
        };
        self.slots
            .iter()
            .any(|slot| slot.connection == owner && !slot.closed)
            || self.input.events.contains(&(owner, Event::Closed))
    }

    /// True if the inbox holds no more events of the owner than it was read for, and its Closed;
    /// and at most [`NON_OWNER_EVENTS`] of others.
    fn inbox_has_room(&self) -> bool {
        let owner = self.session.owner();
        let events = self.input.events.iter();
        let of_owner = events.filter(|(from, _)| owner == Some(*from)).count();
        let of_others = self.input.events.len().saturating_sub(of_owner);
        let slot = self
            .slots
            .iter()
            .find(|slot| owner == Some(slot.connection));
        of_owner <= slot.map_or(OWNER_EVENTS, Slot::most_events)
            && of_others <= usize::from(self.non_owner_events)
            && self.non_owner_events <= NON_OWNER_EVENTS
    }

    /// Returns the session.
    #[must_use]
    pub const fn session(&self) -> &Session<N> {
        &self.session
    }

    /// Returns the output of the last tick, with the State as it is sent; `None` before the first.
    #[must_use]
    pub const fn output(&self) -> Option<&Output<N>> {
        self.output.as_ref()
    }

    /// Returns the events that wait for the coming tick.
    #[must_use]
    pub(crate) fn inbox(&self) -> &[(Connection, Event<N>)] {
        &self.input.events
    }

    /// True if a connection has its place.
    #[must_use]
    pub(crate) fn is_open(&self, connection: Connection) -> bool {
        self.slots.iter().any(|slot| slot.connection == connection)
    }

    /// Registers a new connection.
    ///
    /// # Errors
    /// [`Full`]: all [`CONNECTIONS`] are in use. Send [`Endpoint::full_refusal`] to the peer and
    /// close it.
    pub fn open(&mut self, transport: Transport) -> Result<Connection, Full> {
        let connection = Connection(self.next_connection);
        let slot = Slot::new(connection, transport, self.suite());
        self.slots.push(slot).map_err(|_| Full)?;
        self.next_connection = self.next_connection.saturating_add(1);
        Ok(connection)
    }

    /// Returns the connection that is to make room for a new stream when all places are taken: of those
    /// without the session the one that has been open longest, for a client says Hello at once. With
    /// keys one that has shown its key goes last, and a new one stays until it can have done so. `None`:
    /// the new stream is refused.
    #[must_use]
    pub fn longest_idle(&self) -> Option<Connection> {
        let (owner, patience) = (self.session.owner(), self.greeting_ticks());
        let is_idle =
            |slot: &&Slot| owner != Some(slot.connection) && slot.idle_ticks() >= patience;
        let idle = self.slots.iter().filter(is_idle);
        // The first of several: they are in the order of their opening.
        idle.min_by_key(|slot| slot.has_shown_key())
            .map(|slot| slot.connection)
    }

    /// Ticks that a new stream has to show its key.
    const fn greeting_ticks(&self) -> u32 {
        match self.suite() {
            Suite::Checksum => 0,
            #[cfg(feature = "keyed")]
            Suite::Tag => GREETING_TICKS,
        }
    }

    /// Returns the frame for a peer without room for its connection: over a stream a notice.
    #[must_use]
    pub fn full_refusal(transport: Transport) -> FrameBytes {
        match transport {
            Transport::Stream => encode_notice(Notice::FULL),
            Transport::Datagram => enclose(Kind::Refusal, &Refusal::Unavailable),
        }
    }

    /// Takes a datagram of a peer without a connection. Only a Hello gets it one; with keys only a Hello
    /// with a right tag, from a peer that has shown that it hears, and other ones get no answer or one
    /// that is not longer than they are.
    ///
    /// `peer`: its IPv6 address, or that of IPv4 as it is mapped into IPv6, and its port, all
    /// big-endian.
    #[cfg_attr(
        not(feature = "keyed"),
        expect(unused_variables, reason = "cookies are bound to it")
    )]
    pub fn greet(&mut self, peer: &[u8; 18], datagram: &[u8]) -> Greeted<'_> {
        #[cfg(feature = "keyed")]
        if self.gate.is_some() {
            return self.greet_keyed(peer, datagram);
        }
        if !is_hello::<N>(datagram) {
            return Greeted::Nothing;
        }
        match self.open(Transport::Datagram) {
            Ok(connection) => {
                self.feed(connection, datagram);
                Greeted::Peer(connection)
            }
            Err(Full) => {
                self.frame = Self::full_refusal(Transport::Datagram);
                Greeted::Answer(&self.frame)
            }
        }
    }

    /// Takes note that a connection is gone: closed by its peer, reset, or closed by the host
    /// because a write failed.
    pub fn close(&mut self, connection: Connection) {
        // Only the first time: repeated, it would fill the inbox.
        if !self.remove(connection) {
            return;
        }
        if self.session.owner() == Some(connection) {
            self.post(connection, Event::Closed);
        } else {
            self.withdraw(connection);
        }
    }

    /// Takes bytes that were read from a stream, or one datagram. Returns the number of frames of
    /// the connection in the coming tick.
    ///
    /// Work is bounded by the length of `bytes`. Frames beyond the budget of a connection are
    /// dropped: for the owner that ends the session, but a Stop still counts; a non-owner is
    /// closed.
    pub fn feed(&mut self, connection: Connection, bytes: &[u8]) -> u8 {
        let is_owner = self.session.owner() == Some(connection);
        let mut rest = bytes;
        let mut begun = false;
        loop {
            let Some(slot) = find(&mut self.slots, connection) else {
                return 0;
            };
            // An empty read of a stream has no frame; an empty datagram is a broken one.
            let nothing = rest.is_empty() && (begun || slot.transport == Transport::Stream);
            if nothing || !slot.is_read() {
                return slot.frames;
            }
            begun = true;
            #[cfg(feature = "keyed")]
            let decoded = match &mut self.gate {
                None => slot.decode(rest, is_owner),
                Some(gate) => {
                    keyed::decode(slot, rest, is_owner, gate, &self.session, &mut self.input)
                }
            };
            #[cfg(not(feature = "keyed"))]
            let decoded = slot.decode(rest, is_owner);
            let Some((event, consumed)) = decoded else {
                return slot.frames;
            };
            let expelled = slot.closing && !is_owner;
            rest = rest.get(consumed..).unwrap_or_default();
            if expelled {
                self.withdraw(connection);
            }
            if let Some(event) = event {
                self.admit(connection, event, is_owner);
            }
        }
    }

    /// Returns the number of frames of a connection in the coming tick.
    #[must_use]
    pub fn frames_of(&self, connection: Connection) -> u8 {
        let slot = self.slots.iter().find(|slot| slot.connection == connection);
        slot.map_or(0, |slot| slot.frames)
    }

    /// True if the coming tick has what a server in lock-step waits for: a Command that answers the
    /// last State, or an event of the owner that ends the session.
    #[must_use]
    pub fn owner_has_answered(&self) -> bool {
        let session = &self.session;
        self.input.events.iter().any(|(from, event)| {
            session.owner() == Some(*from)
                && match event {
                    Event::Message(ClientMessage::Command(command)) => {
                        command.epoch == session.epoch() && command.echo == session.last_tick()
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

    /// Runs one cycle. Write its references to the drives before anything else, and say what became of
    /// them: with the values in force unknown, [`Write::Withheld`] has none.
    ///
    /// Frames of an earlier tick that were not polled are discarded.
    pub fn tick(&mut self, tick: &TickInput<N>) -> Write<'_, N> {
        self.tick_recorded(tick, &mut NoRecorder)
    }

    /// Runs one cycle as [`Self::tick`] does, and records it.
    pub fn tick_recorded(
        &mut self,
        tick: &TickInput<N>,
        recorder: &mut impl Record<N>,
    ) -> Write<'_, N> {
        self.complete_input(tick);
        recorder.before_tick(&self.session);
        let output = self.output.insert(self.session.tick(&self.input));
        recorder.after_tick(&self.input, output);
        mark_closed(&mut self.slots, output);
        self.input.events.clear();
        self.input.arrival_us = 0;
        self.input.unauthentic = 0;
        if let Some(lost) = lost_owner(&self.session, &self.slots) {
            // There is room: the inbox is empty.
            self.input.events.push((lost, Event::Closed)).unwrap_or(());
        }
        self.transmit = Transmit::Answers;
        Write::of(
            &self.session,
            output,
            &mut self.input.last_write,
            &mut self.is_told,
        )
    }

    /// Returns the references of the last tick again, if nothing was said of them yet: for an interface
    /// that cannot keep what [`Self::tick`] returned.
    pub fn pending(&mut self) -> Option<Write<'_, N>> {
        if self.is_told {
            return None;
        }
        Some(Write::of(
            &self.session,
            self.output.as_mut()?,
            &mut self.input.last_write,
            &mut self.is_told,
        ))
    }

    /// Returns the references of a cycle in which no tick is run, `cycles` after the last one
    /// ([`Session::hold`]): for a late thread that calls in a burst, for instance. `None`: nothing
    /// may be written, before the first tick or after references that are not in force.
    ///
    /// Tell the next tick the nominal references that were followed, or those of the tick before.
    #[must_use = "the references must be written to the drives"]
    pub fn hold(&self, nominal: &[PositionNm; N], cycles: u32) -> Option<Held<N>> {
        let is_in_force = self.input.last_write == LastWrite::Accepted && self.output.is_some();
        is_in_force.then(|| self.session.hold(nominal, cycles))
    }

    /// Takes note of the time from the departure of the last State to the arrival of the last command,
    /// µs. It is recorded, and reported by the State of the coming tick.
    pub const fn note_arrival(&mut self, us: u16) {
        self.input.arrival_us = us;
    }

    /// True if the drives took references without offsets in the last tick: the server may end.
    /// After a refused write it may not, even if zeros were in force before: the drives may have
    /// taken a part of it.
    #[must_use]
    pub fn is_at_zero(&self) -> bool {
        let at_zero =
            |output: &Output<N>| each(&output.state.axes).all(|axis| axis.offsets == Offsets::ZERO);
        self.input.last_write == LastWrite::Accepted && self.output.as_ref().is_some_and(at_zero)
    }

    /// Takes what was not told for unknown, as the input of the coming tick does.
    fn settle(&mut self) {
        if core::mem::replace(&mut self.is_told, true) {
            return;
        }
        if let Some(output) = &mut self.output {
            report(output, self.session.in_force());
        }
    }

    /// Returns the next frame to send and its recipient: notices, Refusals, the Welcome, the State. `None`
    /// when all are sent. Nothing is encoded before it is polled. References of which nothing was said
    /// are then unknown.
    // Not inlined, so that its stack is not added to that of the tick.
    #[inline(never)]
    pub fn poll_transmit(&mut self) -> Option<(Connection, &[u8])> {
        self.settle();
        let output = self.output.as_ref()?;
        loop {
            let to = match self.transmit {
                Transmit::Answers => {
                    let noted = |slot: &mut Slot| Some((slot.connection, slot.answer.take()?));
                    let Some((connection, answer)) = self.slots.iter_mut().find_map(noted) else {
                        self.transmit = Transmit::Refusal(0);
                        continue;
                    };
                    match answer {
                        Answer::Notice(notice) => self.frame.notice(notice),
                        #[cfg(feature = "keyed")]
                        answer => {
                            keyed::enclose(answer, &mut self.frame);
                            keyed::tag_answer(&self.gate, &self.slots, connection, &mut self.frame);
                        }
                    }
                    connection
                }
                Transmit::Refusal(index) => {
                    let Some((connection, reason)) = output.refusals.get(index) else {
                        self.transmit = Transmit::Welcome;
                        continue;
                    };
                    self.transmit = Transmit::Refusal(index.saturating_add(1));
                    self.frame.enclose(Kind::Refusal, reason);
                    #[cfg(feature = "keyed")]
                    keyed::tag_answer(&self.gate, &self.slots, *connection, &mut self.frame);
                    *connection
                }
                Transmit::Welcome => {
                    self.transmit = Transmit::State;
                    let Some(connection) = output.welcome else {
                        continue;
                    };
                    let welcome = self.session.welcome();
                    self.frame.enclose(Kind::Welcome, &welcome);
                    #[cfg(feature = "keyed")]
                    if let Some(gate) = &mut self.gate {
                        let hello = keyed::hello_of(&self.slots, connection);
                        gate.tag_welcome(hello, &welcome, &mut self.frame);
                    }
                    connection
                }
                Transmit::State => {
                    self.transmit = Transmit::Done;
                    let Some(owner) = output.owner else { continue };
                    self.frame.enclose(Kind::State, &output.state);
                    #[cfg(feature = "keyed")]
                    if let Some(gate) = &self.gate {
                        gate.tag_state(output.state.epoch, &mut self.frame);
                    }
                    owner
                }
                Transmit::Done => return None,
            };
            // One without its key is not sent.
            if !self.frame.is_empty() {
                return Some((to, &self.frame));
            }
        }
    }

    /// Returns the next connection to close; `None` when none is left. Poll the frames first: the
    /// last one may be for it.
    ///
    /// A connection that is not polled keeps its place among the [`CONNECTIONS`].
    pub fn poll_close(&mut self) -> Option<Connection> {
        let connection = self.slots.iter().find(|slot| slot.closed)?.connection;
        self.remove(connection);
        Some(connection)
    }

    /// Removes the slot of a connection. Returns true if it had one.
    fn remove(&mut self, connection: Connection) -> bool {
        let open = self.slots.len();
        self.slots.retain(|slot| slot.connection != connection);
        self.slots.len() < open
    }

    /// Queues an event, a non-owner's only within the common budget of non-owners; beyond it the
    /// non-owner is closed.
    fn admit(&mut self, connection: Connection, event: Event<N>, is_owner: bool) {
        if is_owner {
            return self.post(connection, event);
        }
        if self.non_owner_events < NON_OWNER_EVENTS {
            self.non_owner_events = self.non_owner_events.saturating_add(1);
            return self.post(connection, event);
        }
        if let Some(slot) = find(&mut self.slots, connection) {
            slot.closing = true;
        }
    }

    /// Drops queued events of a closed non-owner, so that a session is never granted to a dead
    /// connection.
    fn withdraw(&mut self, connection: Connection) {
        self.input.events.retain(|(from, _)| *from != connection);
    }

    /// Queues an event. There is room: [`Self::inbox_has_room`].
    fn post(&mut self, connection: Connection, event: Event<N>) {
        self.input.events.push((connection, event)).unwrap_or(());
    }

    /// Completes the input of the tick: the events are in place.
    fn complete_input(&mut self, tick: &TickInput<N>) {
        let owner = self.session.owner();
        let patience = self.session.config().parameters().handshake_ticks;
        for slot in &mut self.slots {
            slot.begin_tick(owner == Some(slot.connection), patience);
        }
        #[cfg(feature = "keyed")]
        if let Some(gate) = &mut self.gate {
            gate.begin_tick();
        }
        self.non_owner_events = 0;
        self.input.tick = *tick;
    }
}

/// Marks the connections without further use for [`Endpoint::poll_close`].
fn mark_closed<const N: usize>(slots: &mut [Slot], output: &Output<N>) {
    for slot in slots {
        let connection = slot.connection;
        let refused = output.refusals.iter().any(|(to, _)| *to == connection);
        slot.closed |= slot.closing || refused || output.close == Some(connection);
    }
}

/// Returns the owner, if it has no connection any more: the coming tick closes its session.
fn lost_owner<const N: usize>(session: &Session<N>, slots: &[Slot]) -> Option<Connection> {
    let owner = session.owner()?;
    let connected = |slot: &Slot| slot.connection == owner && !slot.closed;
    (!slots.iter().any(connected)).then_some(owner)
}

/// Returns the slot of a connection.
fn find(slots: &mut [Slot], connection: Connection) -> Option<&mut Slot> {
    slots.iter_mut().find(|slot| slot.connection == connection)
}

/// True if a datagram asks for a session.
fn is_hello<const N: usize>(datagram: &[u8]) -> bool {
    Frame::parse(datagram)
        .is_ok_and(|frame| matches!(decode_client::<N>(&frame), Ok(ClientMessage::Hello(_))))
}

#[cfg(test)]
mod tests;
