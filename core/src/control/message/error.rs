//! Errors of frames and bodies, without bytes: sessions count them, the wire format finds them.

use core::fmt;

use super::{MAX_BODY, Notice, PROTOCOL_VERSION};

/// Error of a frame's header, length, checksum or tag. A stream loses its frame boundary with it; a
/// datagram is dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
#[non_exhaustive]
pub enum FrameError {
    /// The first two bytes are not `GT`.
    Magic,
    /// The third byte is not this version.
    Version {
        /// Version of the frame.
        received: u8,
    },
    /// The body would be longer than [`MAX_BODY`].
    TooLong {
        /// Stated length of the body.
        length: u16,
    },
    /// The trailer is of another suite.
    Suite {
        /// Suite of the frame.
        received: u16,
    },
    /// The frame is a server's notice.
    Notice(Notice),
    /// A datagram is shorter or longer than its header states.
    Length,
    /// The checksum does not match.
    Checksum,
    /// The tag is not that of the frame.
    Tag,
}

impl fmt::Display for FrameError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Magic => f.write_str("the frame does not begin with \"GT\""),
            Self::Version { received } => write!(
                f,
                "protocol version {received}; this side speaks {PROTOCOL_VERSION}"
            ),
            Self::TooLong { length } => {
                write!(
                    f,
                    "the header states a body of {length} bytes; at most {MAX_BODY} are allowed"
                )
            }
            Self::Suite { received: 0 } => {
                f.write_str("a frame with a checksum; this side takes frames with tags")
            }
            Self::Suite { received: 1 } => {
                f.write_str("a frame with a tag; this side takes frames with checksums")
            }
            Self::Suite { received } => write!(f, "suite {received} is unknown"),
            Self::Notice(notice) => notice.fmt(f),
            Self::Length => {
                f.write_str("the datagram's length differs from the length in its header")
            }
            Self::Checksum => f.write_str("the checksum does not match"),
            Self::Tag => f.write_str("the tag is not that of the frame"),
        }
    }
}

impl core::error::Error for FrameError {}

/// Error of a body with a valid frame around it. The frame is discarded; the session goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
#[non_exhaustive]
pub enum ContentError {
    /// The kind is unknown, or this side does not receive it.
    Kind {
        /// The kind byte.
        received: u8,
    },
    /// The length of the body does not fit its kind and number of axes.
    Length {
        /// Expected length.
        expected: usize,
        /// Length found.
        received: usize,
    },
    /// The number of axes differs.
    Axes {
        /// Axes of this side.
        expected: usize,
        /// Axes in the frame.
        received: u8,
    },
    /// A mode, phase, cause or refusal code is unknown.
    Code {
        /// The code.
        received: u8,
    },
    /// Reserved bits are set.
    Reserved,
    /// The limits in a Welcome contradict each other.
    Limits,
}

impl fmt::Display for ContentError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Kind { received } => {
                write!(f, "kind {received} is unknown or not received by this side")
            }
            Self::Length { expected, received } => {
                write!(f, "expected a body of {expected} bytes, got {received}")
            }
            Self::Axes { expected, received } => {
                write!(f, "expected {expected} axes, got {received}")
            }
            Self::Code { received } => write!(f, "unknown code {received}"),
            Self::Reserved => f.write_str("reserved bits are set"),
            Self::Limits => f.write_str("the limits contradict each other"),
        }
    }
}

impl core::error::Error for ContentError {}
