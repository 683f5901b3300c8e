//! Notice: what a server says to a peer whose frames it cannot read.

use core::fmt;

use super::PROTOCOL_VERSION;

/// Last words of a server over a stream that it closes: to a peer of another protocol version or
/// suite, or without a place for its connection. In every version it has the bytes of a Refusal of
/// version 1. It proves nothing: a client shows it, and acts on the closed connection alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Notice {
    /// Reason; later versions may have others than those named here.
    pub reason: u8,
    /// Number that belongs to the reason.
    pub detail: u8,
}

impl Notice {
    /// The server speaks another version, which is the detail.
    pub const VERSION: Self = Self {
        reason: 4,
        detail: PROTOCOL_VERSION,
    };
    /// All connections of the server are in use.
    pub const FULL: Self = Self {
        reason: 7,
        detail: 0,
    };

    /// The server takes frames of this suite only, which is the detail.
    #[must_use]
    pub const fn suite(detail: u8) -> Self {
        Self { reason: 8, detail }
    }
}

impl fmt::Display for Notice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { reason, detail } = *self;
        match reason {
            4 => write!(f, "the server speaks protocol version {detail}"),
            7 => f.write_str("the server has no room for another connection"),
            8 if detail == 0 => {
                f.write_str("the server has no key: it takes frames with checksums only")
            }
            8 if detail == 1 => f.write_str("the server has keys: it takes frames with tags only"),
            _ => write!(f, "the server gives reason {reason}, detail {detail}"),
        }
    }
}
