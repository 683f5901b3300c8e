//! Client's half of the protocol on messages: a state machine without bytes.

use super::saturation::{Saturated, saturate};
use super::{ClientError, Event, GOODBYE_STATES, Ignored, Requirements};
use crate::control::axis::Offsets;
use crate::control::endpoint::Transport;
use crate::control::message::{Command, Hello, Mode, Phase, ServerMessage, State, Welcome};
use crate::control::wire::Kind;
use crate::units::{Epoch, Sequence, Tick};

/// State of a client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Dialogue<const N: usize> {
    /// Carrier of the frames.
    pub transport: Transport,
    /// Terms that the client accepts.
    pub requirements: Requirements,
    /// Progress of the session.
    pub stage: Stage<N>,
    /// Counts of messages without effect.
    pub ignored: Ignored,
}

/// Progress of a client's session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Stage<const N: usize> {
    /// The server has not answered a Hello.
    Greeting {
        /// A Hello was sent.
        said: bool,
    },
    /// The session is granted.
    Granted(Granted<N>),
    /// The session is refused.
    Refused,
}

/// A granted session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Granted<const N: usize> {
    /// Terms of the session.
    pub welcome: Welcome<N>,
    /// Sequence of the last command; 0 before the first.
    pub sequence: Sequence,
    /// The newest State.
    pub last: Option<Last>,
    /// The newest State waits for an answer.
    pub unanswered: bool,
    /// Live States since the first Goodbye; `None` before it.
    pub leaving: Option<u8>,
    /// A State said that the session is over.
    pub ended: bool,
}

/// Part of the newest State that an answer depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Last {
    /// Its tick.
    pub tick: Tick,
    /// Its phase.
    pub phase: Phase,
}

impl<const N: usize> Dialogue<N> {
    /// A dialogue in which nothing was said.
    #[must_use]
    pub const fn new(transport: Transport, requirements: Requirements) -> Self {
        Self {
            transport,
            requirements,
            stage: Stage::Greeting { said: false },
            ignored: Ignored {
                broken: 0,
                old: 0,
                other_epoch: 0,
                unexpected: 0,
            },
        }
    }

    /// The invariant of a granted session, clause by clause: before the first State none waits and
    /// none ended the session; States are not older than the Welcome; a session that goes on is in
    /// a live phase; after its end no State waits; the count of the Goodbye is bounded.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let Stage::Granted(session) = &self.stage else {
            return true;
        };
        let states = match session.last {
            None => !session.unanswered && !session.ended,
            Some(last) => {
                last.tick >= session.welcome.tick
                    && (session.ended || is_live(last.phase))
                    && !(session.ended && session.unanswered)
            }
        };
        states && session.leaving.is_none_or(|count| count <= GOODBYE_STATES)
    }

    /// Returns the Hello to send. Over streams a second one would be a protocol error.
    pub fn hello(&mut self) -> Option<Hello> {
        let Stage::Greeting { said } = &mut self.stage else {
            return None;
        };
        if *said && self.transport == Transport::Stream {
            return None;
        }
        *said = true;
        Some(Hello {
            axes: u8::try_from(N).unwrap_or(u8::MAX),
            capabilities: self.requirements.capabilities,
        })
    }

    /// Takes note that another Hello is asked for. Returns false if none was said, or it was answered.
    #[cfg(feature = "keyed")]
    pub const fn greet_again(&mut self) -> bool {
        match &mut self.stage {
            Stage::Greeting { said } => core::mem::replace(said, false),
            Stage::Granted(_) | Stage::Refused => false,
        }
    }

    /// Takes a message of the server.
    ///
    /// # Errors
    /// A message that breaks the protocol, over streams; terms that do not fit; a Goodbye without
    /// effect.
    pub fn receive(&mut self, message: ServerMessage<N>) -> Result<Option<Event<N>>, ClientError> {
        match (&mut self.stage, message) {
            (Stage::Greeting { said: true }, ServerMessage::Welcome(welcome)) => {
                self.requirements.check(&welcome)?;
                self.stage = Stage::Granted(Granted {
                    welcome,
                    sequence: Sequence(0),
                    last: None,
                    unanswered: false,
                    leaving: None,
                    ended: false,
                });
                Ok(Some(Event::Welcomed(welcome)))
            }
            // A server without room refuses before it has received a Hello.
            (Stage::Greeting { .. }, ServerMessage::Refusal(refusal)) => {
                self.stage = Stage::Refused;
                Ok(Some(Event::Refused(refusal)))
            }
            (Stage::Granted(session), ServerMessage::State(state)) => match session.check(&state) {
                Ok(()) => session.note(state).map(Some),
                Err(error) => self.ignore(error),
            },
            (_, ServerMessage::Welcome(_)) => self.unexpected(Kind::Welcome),
            (_, ServerMessage::State(_)) => self.unexpected(Kind::State),
            (_, ServerMessage::Refusal(_)) => self.unexpected(Kind::Refusal),
        }
    }

    /// Returns the command that answers the newest State, and flags for targets that were cut to
    /// the limits of the Welcome.
    pub fn answer(
        &mut self,
        mode: Mode,
        targets: &[Offsets; N],
    ) -> Option<(Command<N>, [Saturated; N])> {
        let Stage::Granted(session) = &mut self.stage else {
            return None;
        };
        if !session.unanswered || session.leaving.is_some() {
            return None;
        }
        let last = session.last?;
        let sequence = Sequence(session.sequence.0.checked_add(1)?);
        let submitted =
            session.sequence.0 > 0 && matches!(last.phase, Phase::Submit | Phase::Obtain);
        let mut command = Command {
            epoch: session.welcome.epoch,
            sequence,
            echo: last.tick,
            mode: if submitted { mode } else { Mode::Submit },
            targets: [Offsets::ZERO; N],
        };
        let mut saturated = [Saturated::default(); N];
        for index in 0..N {
            if let (Some(wanted), Some(limits), Some(target), Some(flags)) = (
                targets.get(index),
                session.welcome.limits.get(index),
                command.targets.get_mut(index),
                saturated.get_mut(index),
            ) {
                (*target, *flags) = saturate(wanted, limits);
            }
        }
        session.sequence = sequence;
        session.unanswered = false;
        Some((command, saturated))
    }

    /// Returns the epoch of the Goodbye to send: the first, and over datagrams one for each State
    /// after it.
    pub fn goodbye(&mut self) -> Option<Epoch> {
        let Stage::Granted(session) = &mut self.stage else {
            return None;
        };
        let again = self.transport == Transport::Datagram && session.unanswered;
        if session.ended || (session.leaving.is_some() && !again) {
            return None;
        }
        session.leaving = session.leaving.or(Some(0));
        session.unanswered = false;
        Some(session.welcome.epoch)
    }

    /// True once the server has refused or ended the session.
    #[must_use]
    pub const fn is_over(&self) -> bool {
        match &self.stage {
            Stage::Greeting { .. } => false,
            Stage::Granted(session) => session.ended,
            Stage::Refused => true,
        }
    }

    /// Returns the terms of the session.
    #[must_use]
    pub const fn welcome(&self) -> Option<&Welcome<N>> {
        match &self.stage {
            Stage::Granted(session) => Some(&session.welcome),
            Stage::Greeting { .. } | Stage::Refused => None,
        }
    }

    /// Returns the newest State's part.
    #[must_use]
    pub const fn last(&self) -> Option<Last> {
        match &self.stage {
            Stage::Granted(session) => session.last,
            Stage::Greeting { .. } | Stage::Refused => None,
        }
    }

    /// True if the newest State waits for an answer.
    #[must_use]
    pub const fn has_unanswered(&self) -> bool {
        matches!(&self.stage, Stage::Granted(session) if session.unanswered)
    }

    /// Counts a datagram without a valid frame.
    pub const fn count_broken(&mut self) {
        self.ignored.broken = self.ignored.broken.saturating_add(1);
    }

    /// Counts a message that does not fit.
    ///
    /// # Errors
    /// The message, over streams.
    pub fn unexpected(&mut self, received: Kind) -> Result<Option<Event<N>>, ClientError> {
        self.ignore(ClientError::Unexpected { received })
    }

    /// Counts a message that breaks the protocol: datagrams are duplicated and overtake each other.
    ///
    /// # Errors
    /// The error itself, over streams.
    fn ignore(&mut self, error: ClientError) -> Result<Option<Event<N>>, ClientError> {
        if self.transport == Transport::Stream {
            return Err(error);
        }
        let count = match error {
            ClientError::OldState { .. } => &mut self.ignored.old,
            ClientError::Epoch { .. } => &mut self.ignored.other_epoch,
            _ => &mut self.ignored.unexpected,
        };
        *count = count.saturating_add(1);
        Ok(None)
    }
}

impl<const N: usize> Granted<N> {
    /// Checks that a State belongs to this session and is newer than the last one. The first may be
    /// of the Welcome's tick.
    fn check(&self, state: &State<N>) -> Result<(), ClientError> {
        let expected = self.welcome.epoch;
        if state.epoch != expected {
            return Err(ClientError::Epoch {
                expected,
                received: state.epoch,
            });
        }
        let (is_new, expected) = match self.last {
            None => (state.tick >= self.welcome.tick, self.welcome.tick),
            Some(last) => (state.tick > last.tick, Tick(last.tick.0.saturating_add(1))),
        };
        if is_new {
            Ok(())
        } else {
            Err(ClientError::OldState {
                expected,
                received: state.tick,
            })
        }
    }

    /// Takes note of a new State.
    fn note(&mut self, state: State<N>) -> Result<Event<N>, ClientError> {
        self.last = Some(Last {
            tick: state.tick,
            phase: state.phase,
        });
        self.ended |= !is_live(state.phase);
        self.unanswered = !self.ended;
        if self.ended {
            return Ok(Event::Ended(state));
        }
        if let Some(states) = &mut self.leaving {
            *states = states.saturating_add(1).min(GOODBYE_STATES);
            if *states == GOODBYE_STATES {
                return Err(ClientError::GoodbyeUnheard { states: *states });
            }
        }
        Ok(Event::State(state))
    }
}

impl Requirements {
    /// Checks the terms of a Welcome.
    fn check<const N: usize>(&self, welcome: &Welcome<N>) -> Result<(), ClientError> {
        let (received_us, received) = (welcome.cycle_us, welcome.kinematics_checksum);
        match (self.cycle_us, self.kinematics_checksum) {
            (Some(expected_us), _) if expected_us != received_us => Err(ClientError::Cycle {
                expected_us,
                received_us,
            }),
            (_, Some(expected)) if expected != received => {
                Err(ClientError::Checksum { expected, received })
            }
            _ if !self.capabilities.contains(welcome.capabilities) => {
                Err(ClientError::Capability {
                    needed: welcome.capabilities,
                })
            }
            _ => Ok(()),
        }
    }
}

/// True if a session is running in this phase.
const fn is_live(phase: Phase) -> bool {
    matches!(phase, Phase::Handshake | Phase::Submit | Phase::Obtain)
}

#[cfg(kani)]
impl<const N: usize> kani::Arbitrary for Dialogue<N> {
    fn any() -> Self {
        let dialogue = Self {
            transport: kani::any(),
            requirements: kani::any(),
            stage: kani::any(),
            ignored: kani::any(),
        };
        kani::assume(dialogue.is_valid());
        kani::cover!(true, "some dialogues are valid");
        dialogue
    }
}
