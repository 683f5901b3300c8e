//! What client and server say to each other, as types; no bytes. The bytes are in [`crate::control::wire`].

use core::fmt;

use crate::control::axis::{Actual, Offsets};
use crate::control::channel::Limits;
use crate::units::{Epoch, PositionNm, Sequence, Tick};

/// Largest number of axes a frame can carry.
pub const MAX_AXES: usize = 6;
/// Version of this protocol; the third byte of every frame.
pub const PROTOCOL_VERSION: u8 = 1;
/// Longest body of any frame, in bytes. Sized for the largest message at [`MAX_AXES`], with room to spare.
pub const MAX_BODY: usize = 384;

/// Abilities of a side, one bit each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Capabilities(pub u16);

impl Capabilities {
    /// Nothing beyond the protocol.
    pub const NONE: Self = Self(0);
    /// Lock-step: time is ticks, the server waits for its client instead of counting a miss at a deadline.
    pub const LOCKSTEP: Self = Self(1);

    /// Whether every bit of `other` is set here.
    #[inline]
    #[must_use]
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
}

/// Limits of the three channels of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct AxisLimits {
    /// Position offset, nm.
    pub position: Limits,
    /// Velocity offset, µm/s.
    pub velocity: Limits,
    /// Torque offset, per mille of rated torque.
    pub torque: Limits,
}

impl AxisLimits {
    /// Whether every one of the three targets lies within its `M`.
    #[inline]
    #[must_use]
    pub fn admits(&self, target: &Offsets) -> bool {
        self.position.admits(target.position.0)
            && self.velocity.admits(target.velocity.0)
            && self.torque.admits(i32::from(target.torque.0))
    }
}

/// Client: asks for the session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Hello {
    /// How many axes the client is built for.
    pub axes: u8,
    /// What the client can do.
    pub capabilities: Capabilities,
}

/// What a command asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Mode {
    /// Targets move a reported shadow, never a drive `[T 4.2.4]`.
    Submit,
    /// Targets move the drives' references `[T 4.2.4]`.
    Obtain,
}

/// Client: the answer to one State.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Command<const N: usize> {
    /// Epoch of the session, from Welcome.
    pub epoch: Epoch,
    /// Number of this command, from 1.
    pub sequence: Sequence,
    /// Tick of the State this answers.
    pub echo: Tick,
    /// Submit or Obtain.
    pub mode: Mode,
    /// Wanted offsets, axis order.
    pub targets: [Offsets; N],
}

/// What a client can say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum ClientMessage<const N: usize> {
    /// Asks for the session.
    Hello(Hello),
    /// Wanted offsets.
    Command(Command<N>),
    /// Ends the session of this epoch.
    Goodbye(Epoch),
    /// Stops: takes every offset away and keeps it away until somebody at the machine re-arms.
    Stop(Epoch),
}

/// Server: grants the session and says its terms.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Welcome<const N: usize> {
    /// Epoch of the session; every frame of the client carries it from here on.
    pub epoch: Epoch,
    /// Tick in which the session was granted.
    pub tick: Tick,
    /// Length of a cycle in µs.
    pub cycle_us: u32,
    /// How many ticks a command's echo may be behind (`W`).
    pub echo_window: u8,
    /// What the server does.
    pub capabilities: Capabilities,
    /// Checksum of the kinematic parameters, to be compared with the client's own.
    pub kinematics_checksum: u32,
    /// Limits of the channels, axis order.
    pub limits: [AxisLimits; N],
}

/// Phases of a session `[T Figure 5.4]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Phase {
    /// No session. All offsets are zero.
    #[default]
    Listening,
    /// A session is granted, its first command is awaited. All offsets are zero.
    Handshake,
    /// Commands move the shadow. All offsets are zero.
    Submit,
    /// Commands move the drives' references.
    Obtain,
    /// The session is over; every offset ramps to zero.
    SafeDisconnect,
    /// Stopped; every offset ramps to zero and only a local re-arm leads out.
    Fault,
}

/// Why the last session ended, or why the server is not Listening.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Cause {
    /// Nothing has ended yet.
    #[default]
    None,
    /// Two deadlines in a row passed without any command.
    ClientLate,
    /// Two deadlines in a row passed, but commands for older ticks did arrive: delayed on their way, or by a slow client.
    NetworkLate,
    /// The server itself overran its cycle.
    ServerLate,
    /// A broken frame boundary or checksum on the owner's stream.
    Malformed,
    /// The owner's connection was closed or could not take a State.
    Closed,
    /// The owner said goodbye.
    Goodbye,
    /// More misses within the window than the budget allows.
    Budget,
    /// A stop, at the machine or by the owner.
    Stop,
    /// The nominal reference stepped further than its limit.
    Nominal,
    /// The owner sent more frames in one tick than are read.
    Flood,
    /// No command followed the Welcome in time.
    HandshakeTimeout,
    /// The server started with offsets still in force.
    Restart,
}

/// Counts since the session was granted; they saturate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Counters {
    /// Frames of the owner, whatever their content.
    pub received: u32,
    /// Deadlines that passed without a fresh valid command.
    pub missed: u32,
    /// Commands for a tick already past, behind the last accepted one, or overtaken in the same tick.
    pub late: u32,
    /// Commands with the sequence of the last accepted one, or of one in the same tick.
    pub duplicate: u32,
    /// Frames of another epoch, out of sequence, or echoing a tick that was never sent.
    pub stale: u32,
    /// Well-framed commands with bad content, and frames that have no place in the phase.
    pub malformed: u32,
    /// Commands refused because a target lies beyond `M`.
    pub out_of_range: u32,
    /// Channel steps that `S` or `A` held back.
    pub limited: u32,
    /// References that the travel clamped.
    pub clamped: u32,
    /// Frames from connections that own nothing, Hellos aside.
    pub strangers: u32,
    /// Longest run of consecutive misses.
    pub longest_miss_run: u16,
}

/// Flags of an axis in one tick, one bit each; no bit is ever set that has no name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AxisFlags(pub(crate) u8);

impl AxisFlags {
    /// The position reference was clamped to the travel.
    pub const TRAVEL: Self = Self(1);
    /// The position offset could not reach its target within `S` and `A`.
    pub const POSITION_LIMITED: Self = Self(2);
    /// The same for the velocity offset.
    pub const VELOCITY_LIMITED: Self = Self(4);
    /// The same for the torque offset.
    pub const TORQUE_LIMITED: Self = Self(8);
    /// The nominal reference stepped further than its limit.
    pub const NOMINAL_STEP: Self = Self(16);
    /// Some offset could not reach its target.
    pub const LIMITED: Self = Self(2 | 4 | 8);
    /// All flags there are.
    pub const ALL: Self = Self(31);

    /// The flags of these bits, if every one of them has a name.
    #[inline]
    #[must_use]
    pub const fn from_bits(bits: u8) -> Option<Self> {
        if bits & !Self::ALL.0 == 0 {
            Some(Self(bits))
        } else {
            None
        }
    }

    /// The bits.
    #[inline]
    #[must_use]
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// Adds `other` if `condition` holds.
    #[inline]
    #[must_use]
    pub const fn with(self, other: Self, condition: bool) -> Self {
        if condition {
            Self(self.0 | other.0)
        } else {
            self
        }
    }

    /// Whether every bit of `other` is set here.
    #[inline]
    #[must_use]
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
}

#[cfg(kani)]
impl kani::Arbitrary for AxisFlags {
    fn any() -> Self {
        Self(kani::any::<u8>() & Self::ALL.0)
    }
}

/// One axis in a State.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct AxisState {
    /// Nominal reference, without offset.
    pub nominal: PositionNm,
    /// Offsets in force.
    pub offsets: Offsets,
    /// Where the offsets would be if Submit were Obtain; zero outside Submit.
    pub shadow: Offsets,
    /// What the drive measures.
    pub actual: Actual,
    /// What was clamped or limited in this tick.
    pub flags: AxisFlags,
}

/// Server: one per tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct State<const N: usize> {
    /// Tick at whose end this left.
    pub tick: Tick,
    /// Epoch of the current or last session.
    pub epoch: Epoch,
    /// Sequence of the last accepted command; 0 before the first.
    pub accepted: Sequence,
    /// Phase after this tick.
    pub phase: Phase,
    /// Why the last session ended.
    pub cause: Cause,
    /// On-time commands among the last 100 deadlines; deadlines before the session count as on time.
    pub on_time_of_100: u8,
    /// When the last command arrived, µs after the previous State left, as the host measured it; 0 where it did not.
    pub arrival_us: u16,
    /// Ticks until every offset would be zero if the ramp began now.
    pub ramp_ticks_left: u32,
    /// Counts since the session was granted.
    pub counters: Counters,
    /// The axes, axis order.
    pub axes: [AxisState; N],
}

/// Why a Hello is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Refusal {
    /// Somebody else owns the session.
    Busy,
    /// Offsets are still on their way to zero.
    Ramping {
        /// Ticks until they are there.
        ticks_left: u32,
    },
    /// The server is stopped; somebody at the machine must re-arm it.
    Faulted {
        /// Ticks until the offsets are zero.
        ticks_left: u32,
    },
    /// The frame's protocol version is not the server's.
    Version {
        /// The server's version.
        supported: u8,
    },
    /// The client is built for another number of axes.
    Axes {
        /// The server's number of axes.
        expected: u8,
    },
    /// The client lacks an ability that the server needs.
    Capability {
        /// What it needs.
        needed: Capabilities,
    },
    /// The server has no epoch to give, or no room for another connection.
    Unavailable,
}

/// What a server can say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum ServerMessage<const N: usize> {
    /// Grants the session.
    Welcome(Welcome<N>),
    /// One per tick.
    State(State<N>),
    /// Refuses a Hello.
    Refusal(Refusal),
}

/// Why bytes are no frame. On a stream the boundary is lost with it; a datagram is simply dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum FrameError {
    /// The first two bytes are not "GT".
    Magic,
    /// The third byte is not this version.
    Version {
        /// What it is.
        received: u8,
    },
    /// The body would be longer than [`MAX_BODY`].
    TooLong {
        /// Stated length of the body.
        length: u16,
    },
    /// A datagram is shorter or longer than its header states.
    Length,
    /// The checksum does not match.
    Checksum,
}

impl fmt::Display for FrameError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Magic => f.write_str("a frame does not begin with \"GT\""),
            Self::Version { received } => write!(
                f,
                "protocol version {received}, this side speaks {PROTOCOL_VERSION}"
            ),
            Self::TooLong { length } => {
                write!(
                    f,
                    "a body of {length} bytes, at most {MAX_BODY} are allowed"
                )
            }
            Self::Length => f.write_str("a datagram's length differs from its header's"),
            Self::Checksum => f.write_str("the checksum does not match"),
        }
    }
}

impl core::error::Error for FrameError {}

/// Why a well-framed body is no message. It costs that frame, nothing else.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum ContentError {
    /// The kind byte is unknown, or this side does not receive that kind.
    Kind {
        /// The kind byte.
        received: u8,
    },
    /// The body is longer or shorter than its kind and its number of axes ask for.
    Length {
        /// Length this side expects.
        expected: usize,
        /// Length of the body.
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
    /// The limits in a Welcome are no limits.
    Limits,
}

impl fmt::Display for ContentError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Kind { received } => write!(f, "kind {received} is not received here"),
            Self::Length { expected, received } => {
                write!(f, "a body of {received} bytes where {expected} belong")
            }
            Self::Axes { expected, received } => {
                write!(f, "{received} axes where {expected} belong")
            }
            Self::Code { received } => write!(f, "unknown code {received}"),
            Self::Reserved => f.write_str("reserved bits are set"),
            Self::Limits => f.write_str("limits that contradict each other"),
        }
    }
}

impl core::error::Error for ContentError {}
