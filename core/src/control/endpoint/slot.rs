//! One connection of an endpoint: deframer, budget, and reasons to close it.

#[cfg(feature = "keyed")]
pub(crate) mod keyed;

#[cfg(feature = "keyed")]
use crate::control::message::{Challenge, KeyedHello};
use crate::control::message::{ClientMessage, FrameError, Notice};
use crate::control::session::{Connection, Event, OWNER_FRAMES};
use crate::control::wire::{Deframer, Feed, Frame, Suite, decode_client};

/// Carrier of the frames. A broken stream has lost its frame boundary and ends; a broken datagram
/// is dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Transport {
    /// TCP and the like.
    Stream,
    /// UDP and the like: each `feed` is one whole datagram.
    Datagram,
}

/// Frames that are read per tick of a connection that does not own the session.
const NON_OWNER_FRAMES: u8 = 1;

/// Answer of an endpoint that no session gives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Answer {
    /// The peer speaks another version or suite.
    Notice(Notice),
    /// The peer has to show that it hears.
    #[cfg(feature = "keyed")]
    Challenge(Challenge),
    /// The key of the peer may only read.
    #[cfg(feature = "keyed")]
    ReadOnly,
}

/// State of one connection.
#[derive(Clone, Debug)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Slot {
    /// Its name.
    pub connection: Connection,
    /// Carrier of its frames.
    pub transport: Transport,
    deframer: Deframer,
    /// Frames taken since the last tick.
    pub frames: u8,
    /// The owner has exceeded its frames; only a Stop is still accepted.
    over_budget: bool,
    /// Nothing more is read, and the connection is closed after the coming tick.
    pub closing: bool,
    /// The connection has no further use and waits for [`super::Endpoint::poll_close`].
    pub closed: bool,
    /// Answer to be sent.
    pub answer: Option<Answer>,
    /// The last Hello with a right tag.
    #[cfg(feature = "keyed")]
    pub hello: Option<KeyedHello>,
    /// Ticks without owning the session.
    idle_ticks: u32,
}

impl Slot {
    /// A new connection.
    #[must_use]
    pub const fn new(connection: Connection, transport: Transport, suite: Suite) -> Self {
        Self {
            connection,
            transport,
            deframer: Deframer::of(suite),
            frames: 0,
            over_budget: false,
            closing: false,
            closed: false,
            answer: None,
            #[cfg(feature = "keyed")]
            hello: None,
            idle_ticks: 0,
        }
    }

    /// The invariant: the deframer is valid, and no more frames were read than the budget allows.
    pub fn is_valid(&self) -> bool {
        self.deframer.is_valid() && self.frames <= OWNER_FRAMES
    }

    /// Largest number of events of this connection in the inbox while it owns the session: its
    /// frames, the flood after them, and a Stop behind a flood or a broken stream. Of a closed one
    /// that it is closed.
    pub fn most_events(&self) -> usize {
        let [flood, last] = [self.over_budget, self.closing].map(usize::from);
        if self.closed {
            1
        } else {
            usize::from(self.frames)
                .saturating_add(flood)
                .saturating_add(last)
        }
    }

    /// Returns the bytes of the frame that is collected, or was collected last.
    pub fn held(&self) -> &[u8] {
        self.deframer.held()
    }

    /// Returns the number of ticks without owning the session.
    pub const fn idle_ticks(&self) -> u32 {
        self.idle_ticks
    }

    /// True if a Hello with a right tag has come.
    pub const fn has_shown_key(&self) -> bool {
        #[cfg(feature = "keyed")]
        let has_shown_key = self.hello.is_some();
        #[cfg(not(feature = "keyed"))]
        let has_shown_key = false;
        has_shown_key
    }

    /// True if bytes of this connection are still read.
    pub const fn is_read(&self) -> bool {
        !self.closing && !self.closed
    }

    /// Begins a tick: restores the budget, and closes what is over budget or has not owned the
    /// session for `patience` ticks.
    pub fn begin_tick(&mut self, is_owner: bool, patience: u32) {
        self.frames = 0;
        self.idle_ticks = if is_owner {
            0
        } else {
            self.idle_ticks.saturating_add(1)
        };
        self.closing |= self.over_budget || self.idle_ticks > patience;
    }

    /// Decodes the next frame. Returns its event, if any, and the number of bytes consumed; `None`
    /// for an incomplete frame.
    pub fn decode<const N: usize>(
        &mut self,
        bytes: &[u8],
        is_owner: bool,
    ) -> Option<(Option<Event<N>>, usize)> {
        if self.transport == Transport::Datagram {
            let event = match Frame::parse(bytes) {
                Ok(frame) => event(&frame),
                Err(error) => Event::Dropped(error),
            };
            return Some((self.within_budget(event, is_owner), bytes.len()));
        }
        match self.deframer.feed(bytes) {
            Feed::Incomplete => None,
            Feed::Frame { frame, consumed } => {
                let event = event(&frame);
                Some((self.within_budget(event, is_owner), consumed))
            }
            Feed::Broken(error) => Some((self.break_off(error), bytes.len())),
        }
    }

    /// Closes a stream without a frame boundary. Returns its event.
    fn break_off<const N: usize>(&mut self, error: FrameError) -> Option<Event<N>> {
        self.closing = true;
        self.answer = match error {
            FrameError::Version { .. } => Some(Answer::Notice(Notice::VERSION)),
            FrameError::Suite { .. } => {
                let suite = self.deframer.suite().code();
                Some(Answer::Notice(Notice::suite(suite)))
            }
            _ => None,
        };
        // A flood has already ended the session.
        (!self.over_budget).then_some(Event::Broken(error))
    }

    /// Returns the event itself within the budget. Beyond it, the owner's first excess is a flood,
    /// and one Stop is still accepted: a stop must not get lost behind a burst. A non-owner is
    /// closed.
    fn within_budget<const N: usize>(
        &mut self,
        event: Event<N>,
        is_owner: bool,
    ) -> Option<Event<N>> {
        let budget = if is_owner {
            OWNER_FRAMES
        } else {
            NON_OWNER_FRAMES
        };
        if self.frames < budget {
            self.frames = self.frames.saturating_add(1);
            return Some(event);
        }
        let stops = matches!(event, Event::Message(ClientMessage::Stop(_)));
        if !is_owner || stops {
            self.closing = true;
            return (is_owner && stops).then_some(event);
        }
        let first = !self.over_budget;
        self.over_budget = true;
        first.then_some(Event::Flood)
    }
}

/// Returns the message of a frame, or the error of its content.
fn event<const N: usize>(frame: &Frame<'_>) -> Event<N> {
    match decode_client(frame) {
        Ok(message) => Event::Message(message),
        Err(error) => Event::Malformed(error),
    }
}
