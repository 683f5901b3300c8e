//! Frames of a connection whose endpoint has keys. What has not the tag of the owner has no event; a
//! Hello has one once its sender has shown that it hears.

use super::{Answer, NON_OWNER_FRAMES, Slot, Transport, event};
use crate::control::endpoint::gate::{Coming, Gate, Greeting, peer_of_stream};
use crate::control::message::{Challenge, ClientMessage, FrameError};
use crate::control::session::Event;
use crate::control::wire::{Feed, Kind, Sealed};

/// Result of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Heard<const N: usize> {
    /// The frame is not authentic, or not new.
    Nothing,
    /// The frame is authentic, or ends an owner's stream; it may have an event.
    Frame(Option<Event<N>>),
}

impl Slot {
    /// Decodes the next frame, as [`Self::decode`] does. Returns what it is and the number of bytes
    /// consumed; `None` for an incomplete frame.
    pub fn decode_keyed<const N: usize>(
        &mut self,
        bytes: &[u8],
        is_owner: bool,
        gate: &mut Gate,
        coming: &Coming<'_, N>,
    ) -> Option<(Heard<N>, usize)> {
        if self.transport == Transport::Datagram {
            let frame = if is_owner {
                gate.open_datagram(bytes, coming.session)
            } else {
                None
            };
            let heard = frame.map_or(Heard::Nothing, |frame| {
                Heard::Frame(self.within_budget(event(&frame), true))
            });
            return Some((heard, bytes.len()));
        }
        let (sealed, consumed) = match self.deframer.feed_sealed(bytes) {
            Feed::Incomplete => return None,
            Feed::Frame { frame, consumed } => (frame, consumed),
            Feed::Broken(error) => {
                return Some((self.broken(error, is_owner), bytes.len()));
            }
        };
        if !is_owner {
            let greeting = if self.frames < NON_OWNER_FRAMES {
                gate.judge(sealed, &peer_of_stream(self.connection), coming)
            } else {
                Greeting::Silence
            };
            return Some((self.greeted(greeting), consumed));
        }
        if !is_looked_at(&sealed, self.over_budget) {
            return Some((Heard::Nothing, consumed));
        }
        let Some(frame) = gate.open_stream(sealed, coming.session.epoch()) else {
            self.deframer.give_up(FrameError::Tag);
            return Some((self.broken(FrameError::Tag, true), bytes.len()));
        };
        let event = event(&frame);
        Some((Heard::Frame(self.within_budget(event, true)), consumed))
    }

    /// Closes a broken stream, which is an event of the owner's only.
    fn broken<const N: usize>(&mut self, error: FrameError, is_owner: bool) -> Heard<N> {
        let event = self.break_off(error);
        if is_owner {
            Heard::Frame(event)
        } else {
            Heard::Nothing
        }
    }

    /// Takes note of the judgement of a Hello.
    pub fn greeted<const N: usize>(&mut self, greeting: Greeting) -> Heard<N> {
        let (hello, answer) = match greeting {
            Greeting::Silence => {
                self.closing = true;
                return Heard::Nothing;
            }
            Greeting::Challenge(hello, cookie) => {
                (hello, Some(Answer::Challenge(Challenge { cookie })))
            }
            Greeting::ReadOnly(hello) => {
                self.closing = true;
                (hello, Some(Answer::ReadOnly))
            }
            Greeting::Proven(hello) => (hello, None),
        };
        self.frames = self.frames.saturating_add(1);
        self.hello = Some(hello);
        self.answer = answer;
        let request = Event::Message(ClientMessage::Hello(hello.hello));
        Heard::Frame(answer.is_none().then_some(request))
    }
}

/// True if the tag of a frame of the owner's stream is computed: not of a Hello that comes again, and
/// behind a flood of a Stop only. At most ten are per tick: the budget, a flood, a Stop behind it.
fn is_looked_at(sealed: &Sealed<'_>, over_budget: bool) -> bool {
    match Kind::from_code(sealed.kind_code()) {
        Some(Kind::KeyedHello) => false,
        Some(Kind::Stop) => true,
        _ => !over_budget,
    }
}
