//! Keys of a client: tags of what it says, and the judgement of what it hears.

use core::fmt;

use super::super::dialogue::Dialogue;
use super::super::{Client, ClientError, Event, Requirements};
use super::Guard;
use crate::control::endpoint::Transport;
use crate::control::keys::{Cookie, Key, MacKey, Nonce, SessionOf};
use crate::control::message::{
    Capabilities, Challenge, ContentError, FrameError, Hello, KeyedHello,
};
use crate::control::wire::{
    Body, Deframer, Frame, FrameBytes, Kind, Sealed, Suite, enclose, session_of_welcome,
};

/// Challenges that a client answers.
const CHALLENGES: u8 = 8;

/// Keys of a client. `Debug` shows the name of its key.
#[derive(Clone, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Keyed {
    key: Key,
    nonce: Nonce,
    /// Cookie of the newest Challenge; zero before one.
    cookie: Cookie,
    /// Challenges that were answered.
    challenges: u8,
    /// Key of the session, from the Welcome on.
    session: Option<SessionKey>,
}

/// Key of a session. `Debug` does not show it.
#[derive(Clone)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
struct SessionKey(MacKey);

#[cfg(feature = "defmt")]
impl defmt::Format for SessionKey {
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(f, "SessionKey");
    }
}

impl fmt::Debug for SessionKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("SessionKey")
    }
}

impl<const N: usize> Client<N> {
    /// Creates a client for a server that has this key. Frames without its tag are not heard, and all
    /// States are asked for with tags. `nonce`: random bytes for this client alone.
    #[must_use]
    pub fn keyed(transport: Transport, requirements: Requirements, key: Key, nonce: Nonce) -> Self {
        let capabilities = requirements.capabilities.0 | Capabilities::TAGGED_STATES.0;
        let requirements = Requirements {
            capabilities: Capabilities(capabilities),
            ..requirements
        };
        Self {
            dialogue: Dialogue::new(transport, requirements),
            deframer: Deframer::of(Suite::Tag),
            guard: Guard::Tag(Keyed::new(key, nonce)),
        }
    }
}

impl Keyed {
    /// Keys of a client that has said nothing yet.
    pub const fn new(key: Key, nonce: Nonce) -> Self {
        Self {
            key,
            nonce,
            cookie: [0; 16],
            challenges: 0,
            session: None,
        }
    }

    /// Encloses the next Hello.
    pub(crate) fn hello(&self, hello: Hello) -> FrameBytes {
        let mut frame = enclose(
            Kind::KeyedHello,
            &KeyedHello {
                hello,
                key: self.key.id(),
                nonce: self.nonce,
                cookie: self.cookie,
            },
        );
        frame.tag(self.key.greeting(), &[]);
        frame
    }

    /// Tags a frame of the session. Nothing is left of it before one.
    pub(crate) fn tag(&self, frame: &mut FrameBytes) {
        match &self.session {
            Some(SessionKey(key)) => frame.tag(key, &[]),
            None => frame.clear(),
        }
    }

    /// Opens a frame of the server.
    ///
    /// # Errors
    /// [`FrameError::Tag`]: the frame is not of the holder of the key, or answers another Hello.
    pub(crate) fn open<'a>(&mut self, sealed: Sealed<'a>) -> Result<Frame<'a>, FrameError> {
        match (Kind::from_code(sealed.kind_code()), &self.session) {
            (Some(Kind::Challenge | Kind::Refusal), _) => {
                sealed.check_tag(self.key.greeting(), &self.nonce)
            }
            (Some(Kind::Welcome), None) => {
                let (epoch, axes, kinematics_checksum) =
                    session_of_welcome(sealed.body()).ok_or(FrameError::Tag)?;
                let key = self.key.session(&SessionOf {
                    nonce: self.nonce,
                    cookie: self.cookie,
                    epoch,
                    axes,
                    kinematics_checksum,
                });
                let frame = sealed.check_tag(&key, &[])?;
                self.session = Some(SessionKey(key));
                Ok(frame)
            }
            (Some(Kind::Welcome | Kind::State), Some(SessionKey(key))) => {
                sealed.check_tag(key, &[])
            }
            // A frame of this client that somebody has sent back has a right tag.
            _ => Err(FrameError::Tag),
        }
    }

    /// Takes a Challenge: the next Hello has its cookie.
    ///
    /// # Errors
    /// One that does not fit, over streams; too many.
    pub(crate) fn challenged<const N: usize>(
        &mut self,
        Challenge { cookie }: Challenge,
        dialogue: &mut Dialogue<N>,
    ) -> Result<Option<Event<N>>, ClientError> {
        if cookie == self.cookie || !dialogue.greet_again() {
            return dialogue.unexpected(Kind::Challenge);
        }
        if self.challenges >= CHALLENGES {
            return Err(ClientError::Challenges {
                answered: self.challenges,
            });
        }
        self.challenges = self.challenges.saturating_add(1);
        self.cookie = cookie;
        Ok(Some(Event::Challenged))
    }
}

/// Returns the Challenge in a frame, if it is of that kind.
pub(crate) fn challenge_in(frame: &Frame<'_>) -> Option<Result<Challenge, ContentError>> {
    let is_challenge = frame.kind_code() == Kind::Challenge.code();
    is_challenge.then(|| Challenge::read(frame.body()))
}
