//! Keys of an endpoint: who is heard, and the tags of what is said.

use core::fmt;

use crate::control::keys::{Cookie, Keyring, MacKey, Role, SessionOf};
use crate::control::message::{Capabilities, KeyedHello, Welcome};
use crate::control::session::{Connection, Session};
use crate::control::wire::{Body, Frame, FrameBytes, Kind, Sealed, Suite, claims_of_command};
use crate::units::{Epoch, Sequence};

/// Largest distance of a Command ahead of the accepted sequence.
const SEQUENCES: u64 = 65_536;
/// States that a Command may be behind, at least: what is late is still counted as late.
const ECHOES: u64 = 128;

/// Work per tick that frames without proof can cause.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Budget {
    /// Tags of datagrams from the owner's address.
    pub tags: u8,
    /// Hellos of others.
    pub greetings: u8,
}

impl Default for Budget {
    fn default() -> Self {
        Self {
            tags: 16,
            greetings: 4,
        }
    }
}

/// Terms of the coming tick that a Hello is judged by.
#[derive(Clone, Copy, Debug)]
pub struct Coming<'a, const N: usize> {
    /// The session.
    pub session: &'a Session<N>,
    /// Epoch that would be granted; `None` when they are used up.
    pub epoch: Option<Epoch>,
}

/// Keys of an endpoint, and its work with them in this tick.
#[derive(Clone, Debug)]
pub struct Gate {
    keyring: Keyring,
    budget: Budget,
    left: Budget,
    seen: Seen,
    session: Option<SessionKey>,
    /// Hellos that were passed on to the session.
    proven: u64,
}

/// Frames of the owner in this tick: none is heard twice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Seen {
    /// Sequence of the last Command.
    pub sequence: Option<Sequence>,
    /// A Goodbye.
    pub goodbye: bool,
    /// A Stop.
    pub stop: bool,
}

/// Key of a session. `Debug` does not show it.
#[derive(Clone)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct SessionKey {
    /// Epoch of the session.
    pub epoch: Epoch,
    /// The client has asked for States with tags.
    pub tags_states: bool,
    /// The key.
    pub key: MacKey,
}

impl fmt::Debug for SessionKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "SessionKey(epoch {})", self.epoch.0)
    }
}

/// Judgement of a Hello.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Greeting {
    /// It is not of a known key, or too many came: no answer.
    Silence,
    /// Its cookie is not one of this peer for the coming session; it is asked to use this one.
    Challenge(KeyedHello, Cookie),
    /// Its key may only read.
    ReadOnly(KeyedHello),
    /// The holder of a key hears what is sent to this peer.
    Proven(KeyedHello),
}

/// Returns the number of a stream in the place of an address: port 0 is no peer's.
pub fn peer_of_stream(connection: Connection) -> [u8; 18] {
    let mut peer = [0; 18];
    for (place, byte) in peer.iter_mut().zip(connection.0.to_le_bytes()) {
        *place = byte;
    }
    peer
}

impl Gate {
    /// A gate before the first tick.
    pub const fn new(keyring: Keyring, budget: Budget) -> Self {
        Self {
            keyring,
            budget,
            left: budget,
            seen: Seen {
                sequence: None,
                goodbye: false,
                stop: false,
            },
            session: None,
            proven: 0,
        }
    }

    /// Builds a gate from its parts, in the middle of a tick.
    pub const fn from_parts(
        keyring: Keyring,
        (budget, left): (Budget, Budget),
        seen: Seen,
        session: Option<SessionKey>,
        proven: u64,
    ) -> Self {
        Self {
            keyring,
            budget,
            left,
            seen,
            session,
            proven,
        }
    }

    /// Returns the number of Hellos that were passed on.
    pub const fn proven(&self) -> u64 {
        self.proven
    }

    /// Returns what is left of the budget, what was seen in this tick, and the key of the session.
    pub const fn parts(&self) -> (&Budget, &Seen, Option<&SessionKey>) {
        (&self.left, &self.seen, self.session.as_ref())
    }

    /// Restores the budget.
    pub fn begin_tick(&mut self) {
        self.left = self.budget;
        self.seen = Seen::default();
    }

    /// Judges a Hello from an address and port, or a [stream](peer_of_stream).
    #[inline(never)]
    pub fn judge<const N: usize>(
        &mut self,
        sealed: Sealed<'_>,
        peer: &[u8; 18],
        coming: &Coming<'_, N>,
    ) -> Greeting {
        if sealed.kind_code() != Kind::KeyedHello.code() {
            return Greeting::Silence;
        }
        let (Ok(hello), Some(left)) = (
            KeyedHello::read(sealed.body()),
            self.left.greetings.checked_sub(1),
        ) else {
            return Greeting::Silence;
        };
        self.left.greetings = left;
        let (key, is_known) = self.keyring.under(hello.key);
        if sealed.check_tag(key.greeting(), &[]).is_err() || !is_known {
            return Greeting::Silence;
        }
        // Without an epoch left the session refuses. Each Hello that is passed on voids all cookies,
        // as a grant does: one that is refused could be sent again by somebody else, for a later
        // session. The sum only grows.
        let next = Epoch(
            coming
                .epoch
                .map_or(0, |next| next.0)
                .saturating_add(self.proven),
        );
        let tick = coming.session.last_tick();
        if !(self.keyring).is_fresh(&hello.cookie, (peer, &hello.nonce), next, tick) {
            let cookie = self.keyring.cookie(peer, &hello.nonce, next, tick);
            return Greeting::Challenge(hello, cookie);
        }
        match key.role() {
            Role::Control => {
                self.proven = self.proven.saturating_add(1);
                Greeting::Proven(hello)
            }
            Role::Read => Greeting::ReadOnly(hello),
        }
    }

    /// Tags an answer to a Hello. Nothing is left of the frame without a Hello and its key.
    #[inline(never)]
    pub fn tag_answer(&self, hello: Option<&KeyedHello>, frame: &mut FrameBytes) {
        match hello.and_then(|hello| Some((hello, self.keyring.get(hello.key)?))) {
            Some((hello, key)) => frame.tag(key.greeting(), &hello.nonce),
            None => frame.clear(),
        }
    }

    /// Derives the key of a session that was just granted, and tags its Welcome. Nothing is left of the
    /// frame without a Hello and its key.
    #[inline(never)]
    pub fn tag_welcome<const N: usize>(
        &mut self,
        hello: Option<&KeyedHello>,
        welcome: &Welcome<N>,
        frame: &mut FrameBytes,
    ) {
        let Some((hello, key)) =
            hello.and_then(|hello| Some((hello, self.keyring.get(hello.key)?)))
        else {
            return frame.clear();
        };
        let key = key.session(&SessionOf {
            nonce: hello.nonce,
            cookie: hello.cookie,
            epoch: welcome.epoch,
            axes: u8::try_from(N).unwrap_or(u8::MAX),
            kinematics_checksum: welcome.kinematics_checksum,
        });
        frame.tag(&key, &[]);
        self.session = Some(SessionKey {
            epoch: welcome.epoch,
            tags_states: (hello.hello.capabilities).contains(Capabilities::TAGGED_STATES),
            key,
        });
    }

    /// Tags a State, if its client has asked for tags. Nothing is left of the frame without a key of
    /// this epoch.
    pub fn tag_state(&self, epoch: Epoch, frame: &mut FrameBytes) {
        match self.session_of(epoch) {
            Some(session) if session.tags_states => frame.tag(&session.key, &[]),
            Some(_) => {}
            None => frame.clear(),
        }
    }

    fn session_of(&self, epoch: Epoch) -> Option<&SessionKey> {
        self.session
            .as_ref()
            .filter(|session| session.epoch == epoch)
    }

    /// Opens a datagram from the owner's address. `None`: it is not the owner's, or not new.
    #[inline(never)]
    pub fn open_datagram<'a, const N: usize>(
        &mut self,
        bytes: &'a [u8],
        session: &Session<N>,
    ) -> Option<Frame<'a>> {
        let sealed = Sealed::parse(bytes, Suite::Tag).ok()?;
        let seen = self.seen.with(&sealed, session)?;
        self.left.tags = self.left.tags.checked_sub(1)?;
        let frame = self.open_stream(sealed, session.epoch())?;
        self.seen = seen;
        Some(frame)
    }

    /// Opens a frame from the owner's stream.
    pub fn open_stream<'a>(&self, sealed: Sealed<'a>, epoch: Epoch) -> Option<Frame<'a>> {
        sealed.check_tag(&self.session_of(epoch)?.key, &[]).ok()
    }
}

impl Seen {
    /// Returns what is seen once this frame is heard; `None` if it cannot be a new one of the owner.
    fn with<const N: usize>(self, sealed: &Sealed<'_>, session: &Session<N>) -> Option<Self> {
        let of_session = || Epoch::read(sealed.body()) == Ok(session.epoch());
        match Kind::from_code(sealed.kind_code())? {
            Kind::Command => {
                let (epoch, sequence, echo) = claims_of_command::<N>(sealed.body())?;
                let last = self.sequence.max(Some(session.accepted()))?;
                let ahead = sequence.0.checked_sub(last.0)?;
                let behind = session.last_tick().0.checked_sub(echo.0)?;
                let is_new = epoch == session.epoch()
                    && (1..=SEQUENCES).contains(&ahead)
                    && behind <= ECHOES.max(session.config().parameters().echo_window.into());
                is_new.then_some(Self {
                    sequence: Some(sequence),
                    ..self
                })
            }
            Kind::Goodbye if !self.goodbye && of_session() => Some(Self {
                goodbye: true,
                ..self
            }),
            Kind::Stop if !self.stop && of_session() => Some(Self { stop: true, ..self }),
            _ => None,
        }
    }
}
