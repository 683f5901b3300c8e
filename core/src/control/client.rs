//! Client's half of the protocol: bytes in, events and frames out. No clock, no sockets.
//!
//! One client is one connection and one session. Its order of work:
//!
//! 1. Send [`Client::hello`]. Over datagrams, send it again until [`Event::Welcomed`] or
//!    [`Event::Refused`].
//! 2. [`Client::feed`] everything that was read, [poll](Received::poll_event) its events, then send
//!    [`Client::answer`]: it answers the newest State, and each State once.
//! 3. To leave, send [`Client::goodbye`] after every feed until [`Client::is_gone`]. Send
//!    [`Client::stop`] at any time.
//!
//! The caller keeps the time: a server that is silent for too long has vanished.
//!
//! ```
//! use gantry_tau_core::control::client::{Client, Event, Requirements};
//! use gantry_tau_core::{Mode, Offsets, Transport};
//! # use gantry_tau_core::{AxisConfig, Config, Endpoint, EpochRange, LimitValues, Limits, Parameters, PositionNm};
//! # use gantry_tau_core::{Session, Start, Travel, TickInput, Reading, OffsetNm, Write};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let limits = Limits::new(LimitValues { max: 2_000_000, step: 5_000, accel: 10_000, ramp: 100 })?;
//! # let axis = AxisConfig::position_only(limits, Travel::around_zero(1_000_000_000), 2_000_000);
//! # let config = Config::new(Parameters::thesis([axis]))?;
//! # let session = Session::new(config, &Start::at_rest([PositionNm(0)]))?;
//! # let mut server = Endpoint::new(session, EpochRange::VOLATILE);
//! # let connection = server.open(Transport::Stream)?;
//! let mut client = Client::<1>::new(Transport::Stream, Requirements::default());
//! let mut outgoing: Vec<u8> = client.hello().unwrap().to_vec();
//! for _ in 0..5 {
//! #    server.feed(connection, &outgoing);
//! #    let tick = TickInput { elapsed_cycles: 1, reading: Some(Reading::unmeasured([PositionNm(0)])), sensor: None,
//! #        stop: false, quit: false, rearm: false };
//! #    if let Write::Due(write) = server.tick(&tick) { write.accepted(); }
//! #    let mut incoming = Vec::new();
//! #    while let Some((_, frame)) = server.poll_transmit() { incoming.extend_from_slice(frame); }
//!     // `outgoing` was sent, `incoming` was read from the socket.
//!     let mut received = client.feed(&incoming);
//!     while let Some(event) = received.poll_event() {
//!         if let Event::Welcomed(welcome) = event? {
//!             assert_eq!(welcome.cycle_us, 1_000);
//!         }
//!     }
//!     // The first command always asks for Submit.
//!     if let Some(answer) = client.answer(Mode::Obtain, &[Offsets::position(OffsetNm(3_000_000))]) {
//!         assert!(answer.saturated[0].position, "the server's limit is 2 mm");
//!         outgoing = answer.frame.to_vec();
//!     }
//! }
//! # assert_eq!(client.phase(), Some(gantry_tau_core::Phase::Obtain));
//! # Ok(())
//! # }
//! ```

pub(crate) mod dialogue;
mod error;
pub(crate) mod guard;
mod saturation;

use crate::control::axis::Offsets;
use crate::control::endpoint::Transport;
use crate::control::message::{
    Capabilities, ClientMessage, Command, FrameError, Mode, Phase, Refusal, State, Welcome,
};
use crate::control::wire::{Deframer, Feed, FrameBytes, Sealed, Suite};

use dialogue::Dialogue;
use guard::Guard;

pub use error::ClientError;
pub use saturation::Saturated;

/// Live States after a Goodbye in which the server may still not have received it.
pub const GOODBYE_STATES: u8 = 100;

/// Terms that a client accepts. The number of axes is the client's `N`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Requirements {
    /// Abilities of the client, stated in its Hello. The server must not need others.
    pub capabilities: Capabilities,
    /// Length of the server's cycle, µs; `None` accepts any.
    pub cycle_us: Option<u32>,
    /// Checksum of the server's kinematic parameters; `None` accepts any.
    pub kinematics_checksum: Option<u32>,
}

/// Result of a received frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Event<const N: usize> {
    /// The server, which has keys, asks for another Hello: send [`Client::hello`] again.
    Challenged,
    /// The session is granted, on terms that fit the requirements.
    Welcomed(Welcome<N>),
    /// The session is refused. This client has no further use.
    Refused(Refusal),
    /// A State newer than any before, to be answered.
    State(State<N>),
    /// A newer State of a session that is over; its cause tells why. One follows per tick of the
    /// ramp to zero.
    Ended(State<N>),
}

/// Counts of received frames without effect; they saturate. Over streams, all but `broken` are
/// errors instead.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Ignored {
    /// Datagrams without a valid frame; with a key also those without its tag.
    pub broken: u32,
    /// States that were not newer than the last one: duplicated or overtaken.
    pub old: u32,
    /// States of another session.
    pub other_epoch: u32,
    /// Messages that do not fit: a second answer to Hello, a State before the Welcome.
    pub unexpected: u32,
}

/// Answer to a State.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Answer<const N: usize> {
    /// The frame to send.
    pub frame: FrameBytes,
    /// The command in it.
    pub command: Command<N>,
    /// Targets that were cut to the limits of the Welcome, axis order.
    pub saturated: [Saturated; N],
}

impl<const N: usize> Answer<N> {
    /// True if a target was cut.
    #[must_use]
    pub fn is_saturated(&self) -> bool {
        self.saturated.iter().any(|axis| axis.any())
    }
}

/// Client's half of the protocol for `N` axes.
#[derive(Clone, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Client<const N: usize> {
    dialogue: Dialogue<N>,
    deframer: Deframer,
    guard: Guard,
}

impl<const N: usize> Client<N> {
    /// Creates a client that has said nothing yet.
    #[must_use]
    pub const fn new(transport: Transport, requirements: Requirements) -> Self {
        Self {
            dialogue: Dialogue::new(transport, requirements),
            deframer: Deframer::new(),
            guard: Guard::Checksum,
        }
    }

    /// Builds a client, between two frames, from its parts.
    pub(crate) const fn from_parts(dialogue: Dialogue<N>, guard: Guard) -> Self {
        let suite = match &guard {
            Guard::Checksum => Suite::Checksum,
            #[cfg(feature = "keyed")]
            Guard::Tag(_) => Suite::Tag,
        };
        Self {
            dialogue,
            deframer: Deframer::of(suite),
            guard,
        }
    }

    /// Returns the state machine on messages.
    pub(crate) const fn dialogue(&self) -> &Dialogue<N> {
        &self.dialogue
    }

    /// The invariant: dialogue and deframer are valid.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.dialogue.is_valid() && self.deframer.is_valid()
    }

    /// Returns the Hello to send: over streams once, over datagrams as often as asked; and again after
    /// each [`Event::Challenged`]. `None` after an answer to it.
    #[must_use = "the frame must be sent"]
    pub fn hello(&mut self) -> Option<FrameBytes> {
        let hello = ClientMessage::<N>::Hello(self.dialogue.hello()?);
        Some(self.guard.enclose(&hello))
    }

    /// Takes bytes that were read from a stream, or one whole datagram: frame by frame, as their events
    /// are polled.
    pub const fn feed<'a>(&'a mut self, bytes: &'a [u8]) -> Received<'a, N> {
        Received {
            client: self,
            rest: Some(bytes),
        }
    }

    /// Takes the next frame. Returns the bytes behind it, if any, and its event.
    fn take<'a>(
        &mut self,
        bytes: &'a [u8],
    ) -> (Option<&'a [u8]>, Result<Option<Event<N>>, ClientError>) {
        let Self {
            dialogue,
            deframer,
            guard,
        } = self;
        if dialogue.transport == Transport::Datagram {
            let sealed = Sealed::parse(bytes, deframer.suite());
            let event = match sealed.and_then(|sealed| guard.open(sealed)) {
                Ok(frame) => guard.receive(dialogue, &frame),
                Err(_) => {
                    dialogue.count_broken();
                    Ok(None)
                }
            };
            return (None, event);
        }
        let error = match deframer.feed_sealed(bytes) {
            Feed::Incomplete => return (None, Ok(None)),
            Feed::Frame { frame, consumed } => match guard.open(frame) {
                Ok(frame) => {
                    let rest = bytes.get(consumed..).filter(|rest| !rest.is_empty());
                    return (rest, guard.receive(dialogue, &frame));
                }
                Err(error) => {
                    deframer.give_up(error);
                    error
                }
            },
            Feed::Broken(error) => error,
        };
        let error = match error {
            FrameError::Notice(notice) => ClientError::Notice(notice),
            error => ClientError::Frame(error),
        };
        (None, Err(error))
    }

    /// Returns the answer to the newest State. `None` if every State is answered, without a
    /// session, and after a Goodbye.
    ///
    /// Targets are cut to the limits of the Welcome. The mode is Submit, regardless of `mode`, in
    /// the first command and until a State reports that the server accepted it.
    #[must_use = "the frame must be sent"]
    pub fn answer(&mut self, mode: Mode, targets: &[Offsets; N]) -> Option<Answer<N>> {
        let (command, saturated) = self.dialogue.answer(mode, targets)?;
        Some(Answer {
            frame: self.guard.enclose(&ClientMessage::Command(command)),
            command,
            saturated,
        })
    }

    /// Returns the Goodbye to send: once, and over datagrams again for each State until the session
    /// is over. No State is answered any more. `None` if there is nothing to send.
    ///
    /// Wait for [`Self::is_gone`] before closing: a connection that is closed at once can hide the
    /// Goodbye.
    #[must_use = "the frame must be sent"]
    pub fn goodbye(&mut self) -> Option<FrameBytes> {
        let goodbye = ClientMessage::<N>::Goodbye(self.dialogue.goodbye()?);
        Some(self.guard.enclose(&goodbye))
    }

    /// Returns a Stop to send: every offset ramps to zero and stays there until a re-arm at the
    /// machine. `None` without a session.
    ///
    /// It may be repeated, also while the offsets ramp.
    #[must_use = "the frame must be sent"]
    pub fn stop(&self) -> Option<FrameBytes> {
        let stop = ClientMessage::<N>::Stop(self.welcome()?.epoch);
        Some(self.guard.enclose(&stop))
    }

    /// True once the server has refused or ended the session.
    #[must_use]
    pub const fn is_gone(&self) -> bool {
        self.dialogue.is_over()
    }

    /// Returns the terms of the session; `None` before the Welcome and after a Refusal.
    #[must_use]
    pub const fn welcome(&self) -> Option<&Welcome<N>> {
        self.dialogue.welcome()
    }

    /// Returns the phase in the newest State; `None` before the first one.
    #[must_use]
    pub fn phase(&self) -> Option<Phase> {
        self.dialogue.last().map(|last| last.phase)
    }

    /// True if the newest State is not answered yet.
    #[must_use]
    pub const fn has_unanswered(&self) -> bool {
        self.dialogue.has_unanswered()
    }

    /// True if the stream ends between two frames.
    #[must_use]
    pub fn is_at_boundary(&self) -> bool {
        self.deframer.is_at_boundary()
    }

    /// Returns the counts of frames without effect.
    #[must_use]
    pub const fn ignored(&self) -> Ignored {
        self.dialogue.ignored
    }
}

/// Bytes that a client takes as their events are polled.
#[derive(Debug)]
#[must_use = "bytes are taken as events are polled"]
pub struct Received<'a, const N: usize> {
    client: &'a mut Client<N>,
    rest: Option<&'a [u8]>,
}

impl<const N: usize> Received<'_, N> {
    /// Returns the next event; `None` if all bytes are taken: an incomplete frame waits for its rest,
    /// and an ignored datagram is counted.
    ///
    /// # Errors
    /// [`ClientError`]: the server breaks the protocol, its terms do not fit, or a Goodbye has no
    /// effect. The session, if any, goes on as if the frame had not come; a stream that lost its
    /// frame boundary stays lost.
    pub fn poll_event(&mut self) -> Option<Result<Event<N>, ClientError>> {
        while let Some(bytes) = self.rest.take() {
            let (rest, event) = self.client.take(bytes);
            self.rest = rest;
            if let Some(event) = event.transpose() {
                return Some(event);
            }
        }
        None
    }

    /// Returns the number of bytes that are not taken yet. They must be fed again if they are not
    /// polled: a stream without them is broken.
    #[must_use]
    pub const fn left(&self) -> usize {
        match self.rest {
            Some(bytes) => bytes.len(),
            None => 0,
        }
    }
}

#[cfg(test)]
mod tests;
