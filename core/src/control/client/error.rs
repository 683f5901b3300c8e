//! Errors of a client: the server breaks the protocol, or its terms do not fit.

use core::fmt;

use crate::control::message::{Capabilities, ContentError, FrameError, Notice};
use crate::control::wire::Kind;
use crate::units::{Epoch, Tick};

/// Error of [`super::Client::feed`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ClientError {
    /// The stream lost its frame boundary.
    Frame(FrameError),
    /// The server cannot read this client's frames, or has no place for it, and closes.
    Notice(Notice),
    /// A frame with invalid content, or of a server with another number of axes.
    Content(ContentError),
    /// A message that does not fit: a second answer to Hello, or a State before the Welcome.
    Unexpected {
        /// Kind of the message.
        received: Kind,
    },
    /// A State is not newer than the one before. (Over datagrams it is ignored.)
    OldState {
        /// Oldest tick that would have been new.
        expected: Tick,
        /// Tick of the State.
        received: Tick,
    },
    /// A State belongs to another session. (Over datagrams it is ignored.)
    Epoch {
        /// Epoch of the Welcome.
        expected: Epoch,
        /// Epoch of the State.
        received: Epoch,
    },
    /// The server's cycle differs.
    Cycle {
        /// Cycle of the client, µs.
        expected_us: u32,
        /// Cycle of the server, µs.
        received_us: u32,
    },
    /// The server's kinematic parameters differ.
    Checksum {
        /// Checksum of the client's parameters.
        expected: u32,
        /// Checksum of the server's.
        received: u32,
    },
    /// The server needs an ability that the client lacks.
    Capability {
        /// Abilities that the server needs.
        needed: Capabilities,
    },
    /// The server goes on asking for Hellos: it grants sessions to others, or holds this client's Hellos
    /// up for too long.
    Challenges {
        /// Challenges that were answered.
        answered: u8,
    },
    /// The session goes on after a Goodbye.
    GoodbyeUnheard {
        /// States received since the Goodbye.
        states: u8,
    },
}

impl fmt::Display for ClientError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Frame(error) => write!(f, "the stream is broken: {error}"),
            Self::Notice(notice) => notice.fmt(f),
            Self::Content(error) => write!(f, "invalid message: {error}"),
            Self::Unexpected { received } => {
                write!(
                    f,
                    "unexpected {received:?}: expected one answer to Hello, then States"
                )
            }
            Self::OldState { expected, received } => {
                write!(
                    f,
                    "expected a State of tick {} or later, got tick {}",
                    expected.0, received.0
                )
            }
            Self::Epoch { expected, received } => {
                write!(
                    f,
                    "expected a State of epoch {}, got epoch {}",
                    expected.0, received.0
                )
            }
            Self::Cycle {
                expected_us,
                received_us,
            } => {
                write!(
                    f,
                    "the server's cycle is {received_us} us, the client's is {expected_us} us"
                )
            }
            Self::Checksum { expected, received } => {
                write!(
                    f,
                    "the server's machine has checksum {received:08x}, the client's has {expected:08x}"
                )
            }
            Self::Capability { needed } => {
                write!(f, "the server needs capabilities {:#06x}", needed.0)
            }
            Self::Challenges { answered } => {
                write!(
                    f,
                    "the server asks for another Hello after {answered} of them"
                )
            }
            Self::GoodbyeUnheard { states } => {
                write!(
                    f,
                    "the session goes on {states} States after the Goodbye; close the connection"
                )
            }
        }
    }
}

impl core::error::Error for ClientError {}

impl From<ContentError> for ClientError {
    fn from(error: ContentError) -> Self {
        Self::Content(error)
    }
}
