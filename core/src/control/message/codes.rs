//! Codes, names and texts of phases, modes, causes and refusals: one table for the wire, for files
//! and for people.

use core::fmt;

use super::{Cause, Mode, Phase, Refusal};

/// Gives an enum without fields its codes on the wire, its stable names, and its texts.
macro_rules! coded {
    ($name:ident { $($code:literal => $variant:ident $text:literal)+ }) => {
        impl $name {
            /// Every value, in the order of the codes.
            pub const ALL: &'static [Self] = &[$(Self::$variant),+];

            /// Returns the code on the wire.
            #[inline]
            #[must_use]
            pub const fn code(self) -> u8 {
                match self {
                    $(Self::$variant => $code,)+
                }
            }

            /// Returns the value of a code on the wire; `None` for an unknown code.
            #[inline]
            #[must_use]
            pub const fn from_code(code: u8) -> Option<Self> {
                Some(match code {
                    $($code => Self::$variant,)+
                    _ => return None,
                })
            }

            /// Returns the name for files and scripts; it never changes.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => stringify!($variant),)+
                }
            }
        }

        /// Writes a text for people; [`Self::name`] is the stable name.
        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(match self {
                    $(Self::$variant => $text,)+
                })
            }
        }
    };
}

coded!(Phase {
    0 => Listening "listening"
    1 => Handshake "handshake"
    2 => Submit "submit"
    3 => Obtain "obtain"
    4 => SafeDisconnect "safe disconnect"
    5 => Fault "fault"
});

coded!(Mode {
    1 => Submit "submit"
    2 => Obtain "obtain"
});

coded!(Cause {
    0 => None "no session has ended"
    1 => ClientLate "no command arrived before two consecutive deadlines"
    2 => NetworkLate "two consecutive deadlines passed; commands arrived, but late"
    3 => ServerLate "the server overran its cycle"
    4 => Malformed "broken frame boundary, checksum or tag on the stream"
    5 => Closed "the connection was closed, or could not take a State"
    6 => Goodbye "the client said goodbye"
    7 => Budget "too many missed deadlines within the window"
    8 => Stop "stopped"
    9 => Nominal "the nominal reference stepped further than its limit"
    10 => Flood "too many frames in one tick"
    11 => HandshakeTimeout "no command followed the Welcome in time"
    12 => Restart "offsets were in force that the server did not expect: after a restart or a refused write"
    13 => Agitated "an offset was shaken by more than its agitation budget allows"
});

impl Refusal {
    /// Returns the code on the wire.
    #[inline]
    #[must_use]
    pub const fn code(&self) -> u8 {
        match self {
            Self::Busy => 1,
            Self::Ramping { .. } => 2,
            Self::Faulted { .. } => 3,
            Self::Axes { .. } => 5,
            Self::Capability { .. } => 6,
            Self::Unavailable => 7,
            Self::Role => 9,
        }
    }

    /// Returns the name for files and scripts; it never changes.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Busy => "Busy",
            Self::Ramping { .. } => "Ramping",
            Self::Faulted { .. } => "Faulted",
            Self::Axes { .. } => "Axes",
            Self::Capability { .. } => "Capability",
            Self::Unavailable => "Unavailable",
            Self::Role => "Role",
        }
    }
}

/// Writes a text for people, with what the client can do about it; [`Self::name`] is the stable
/// name.
impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Busy => f.write_str("another client owns the session"),
            Self::Ramping { ticks_left } => {
                write!(
                    f,
                    "offsets are still ramping to zero; try again in {ticks_left} ticks"
                )
            }
            Self::Faulted { ticks_left } => {
                write!(
                    f,
                    "the server is stopped ({ticks_left} ticks of ramp left); it must be re-armed at the machine"
                )
            }
            Self::Axes { expected } => write!(f, "the server has {expected} axes"),
            Self::Capability { needed } => {
                write!(f, "the server needs capabilities {:#06x}", needed.0)
            }
            Self::Unavailable => f.write_str(
                "the server has no room for another connection, or its epochs are used up",
            ),
            Self::Role => f.write_str("this key may only read"),
        }
    }
}
