//! Trailers of a client: made for what it says, checked of what it hears.

#[cfg(feature = "keyed")]
pub(crate) mod keyed;

use super::dialogue::Dialogue;
use super::{ClientError, Event};
use crate::control::message::{ClientMessage, FrameError};
use crate::control::wire::{Frame, FrameBytes, Sealed, decode_server, encode_client};

#[cfg(feature = "keyed")]
use keyed::Keyed;

/// Form of a client's trailers.
#[cfg_attr(
    feature = "keyed",
    expect(clippy::large_enum_variant, reason = "a client has one")
)]
#[derive(Clone, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Guard {
    /// Checksums.
    Checksum,
    /// Tags under a key.
    #[cfg(feature = "keyed")]
    Tag(Keyed),
}

impl Guard {
    /// Encloses a message. Nothing is left of one of a session without its key.
    pub(super) fn enclose<const N: usize>(&self, message: &ClientMessage<N>) -> FrameBytes {
        match (self, message) {
            (Self::Checksum, _) => encode_client(message),
            #[cfg(feature = "keyed")]
            (Self::Tag(keyed), ClientMessage::Hello(hello)) => keyed.hello(*hello),
            #[cfg(feature = "keyed")]
            (Self::Tag(keyed), _) => {
                let mut frame = encode_client(message);
                keyed.tag(&mut frame);
                frame
            }
        }
    }

    /// Checks the trailer of a frame.
    ///
    /// # Errors
    /// [`FrameError::Checksum`] or [`FrameError::Tag`].
    pub(super) fn open<'a>(&mut self, sealed: Sealed<'a>) -> Result<Frame<'a>, FrameError> {
        match self {
            Self::Checksum => sealed.check_sum(),
            #[cfg(feature = "keyed")]
            Self::Tag(keyed) => keyed.open(sealed),
        }
    }

    /// Passes the message of a frame to the dialogue, or a Challenge to the keys.
    ///
    /// # Errors
    /// As [`Dialogue::receive`]; or too many Challenges.
    pub(super) fn receive<const N: usize>(
        &mut self,
        dialogue: &mut Dialogue<N>,
        frame: &Frame<'_>,
    ) -> Result<Option<Event<N>>, ClientError> {
        #[cfg(feature = "keyed")]
        if let (Self::Tag(keyed), Some(challenge)) = (self, keyed::challenge_in(frame)) {
            return keyed.challenged(challenge?, dialogue);
        }
        dialogue.receive(decode_server(frame)?)
    }
}
