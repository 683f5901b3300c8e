//! Messages between client and server, as types. Their bytes are in [`super::wire`].

mod codes;
mod error;
#[cfg(feature = "keyed")]
mod keyed;
mod notice;

use crate::control::axis::{Actual, Offsets};
use crate::control::channel::Limits;
use crate::units::{
    Epoch, OffsetNm, PositionNm, Sequence, Tick, TorquePermille, VelocityUmS, WrenchSample,
};

pub use error::{ContentError, FrameError};
#[cfg(feature = "keyed")]
pub use keyed::{Challenge, KeyedHello};
pub use notice::Notice;

/// Largest number of axes a frame can carry.
pub const MAX_AXES: usize = 6;
/// Version of this protocol; the third byte of every frame.
pub const PROTOCOL_VERSION: u8 = 2;
/// Longest body of any frame, in bytes. Sized for the largest message at [`MAX_AXES`], with room to
/// spare.
pub const MAX_BODY: usize = 384;

/// Abilities of a side, one bit each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Capabilities(pub u16);

impl Capabilities {
    /// Nothing beyond the protocol.
    pub const NONE: Self = Self(0);
    /// Lock-step: time is ticks, the server waits for its client instead of counting a miss at a
    /// deadline.
    pub const LOCKSTEP: Self = Self(1);
    /// States with tags. A client with a key that does not state it is sent States with checksums.
    pub const TAGGED_STATES: Self = Self(2);

    /// True if every bit of `other` is set.
    #[inline]
    #[must_use]
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
}

/// Limits of the three channels of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct AxisLimits {
    /// Position offset, nm.
    pub position: Limits<OffsetNm>,
    /// Velocity offset, µm/s.
    pub velocity: Limits<VelocityUmS>,
    /// Torque offset, per mille of rated torque.
    pub torque: Limits<TorquePermille>,
}

impl AxisLimits {
    /// All three channels stay at zero.
    pub const DISABLED: Self = Self {
        position: Limits::DISABLED,
        velocity: Limits::DISABLED,
        torque: Limits::DISABLED,
    };

    /// True if each of the three targets lies within its `M`.
    #[inline]
    #[must_use]
    pub fn admits(&self, target: &Offsets) -> bool {
        self.position.admits(target.position)
            && self.velocity.admits(target.velocity)
            && self.torque.admits(target.torque)
    }
}

/// Client: asks for the session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Hello {
    /// Number of axes of the client.
    pub axes: u8,
    /// Abilities of the client.
    pub capabilities: Capabilities,
}

/// Mode that a command asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
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
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
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
    #[cfg_attr(feature = "serde", serde(with = "crate::serde_array"))]
    pub targets: [Offsets; N],
}

/// Messages of a client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum ClientMessage<const N: usize> {
    /// Asks for the session.
    Hello(Hello),
    /// Wanted offsets.
    Command(Command<N>),
    /// Ends the session of this epoch.
    Goodbye(Epoch),
    /// Stops: ramps every offset to zero and keeps it there until a local re-arm.
    Stop(Epoch),
}

/// Server: grants the session and states its terms.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Welcome<const N: usize> {
    /// Epoch of the session; every frame of the client carries it from here on.
    pub epoch: Epoch,
    /// Tick in which the session was granted.
    pub tick: Tick,
    /// Length of a cycle in µs.
    pub cycle_us: u32,
    /// Number of ticks that a command's echo may be behind (`W`).
    pub echo_window: u8,
    /// Abilities of the server.
    pub capabilities: Capabilities,
    /// Checksum of the kinematic parameters, to be compared with the client's own.
    pub kinematics_checksum: u32,
    /// Limits of the channels, axis order.
    #[cfg_attr(feature = "serde", serde(with = "crate::serde_array"))]
    pub limits: [AxisLimits; N],
}

/// Phases of a session `[T Figure 5.4]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
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

/// Cause of the end of the last session.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
#[non_exhaustive]
pub enum Cause {
    /// No session has ended yet.
    #[default]
    None,
    /// Two deadlines in a row passed without any command.
    ClientLate,
    /// Two deadlines in a row passed, but commands for older ticks did arrive: delayed on their
    /// way, or by a slow client.
    NetworkLate,
    /// The server itself overran its cycle.
    ServerLate,
    /// A broken frame boundary, checksum or tag on the owner's stream.
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
    /// Offsets were in force that the server did not expect: at its start, or after a refused
    /// write.
    Restart,
    /// The position offset of an axis was shaken by more than its agitation budget allows.
    Agitated,
}

/// Counts since the session was granted; they saturate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Counters {
    /// Frames of the owner, valid or not.
    pub received: u32,
    /// Deadlines that passed without a fresh valid command.
    pub missed: u32,
    /// Commands for a tick already past, behind the last accepted one, or overtaken in the same
    /// tick.
    pub late: u32,
    /// Commands with the sequence of the last accepted one, or of one in the same tick.
    pub duplicate: u32,
    /// Frames of another epoch, out of sequence, or echoing a tick that was never sent.
    pub stale: u32,
    /// Frames of the owner with bad content, or not allowed in the phase.
    pub malformed: u32,
    /// Commands refused because a target lies beyond `M`.
    pub out_of_range: u32,
    /// Channel steps that `S` or `A` held back.
    pub limited: u32,
    /// References that the travel clamped.
    pub clamped: u32,
    /// Frames of non-owners, Hellos aside; with keys, all frames without a right tag, and replayed ones.
    pub non_owner: u32,
    /// Longest run of consecutive misses.
    pub longest_miss_run: u16,
}

/// Flags of an axis in one tick, one bit each. Only named bits are ever set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(try_from = "u8", into = "u8"))]
pub struct AxisFlags(pub(crate) u8);

impl From<AxisFlags> for u8 {
    fn from(flags: AxisFlags) -> Self {
        flags.0
    }
}

impl TryFrom<u8> for AxisFlags {
    type Error = ContentError;

    fn try_from(bits: u8) -> Result<Self, Self::Error> {
        Self::from_bits(bits).ok_or(ContentError::Reserved)
    }
}

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
    /// The nominal reference accelerated more than its limit.
    pub const NOMINAL_ACCEL: Self = Self(32);
    /// Some offset could not reach its target.
    pub const LIMITED: Self = Self(2 | 4 | 8);
    /// All flags.
    pub const ALL: Self = Self(63);

    /// Returns the flags of these bits, if every one of them has a name.
    #[inline]
    #[must_use]
    pub const fn from_bits(bits: u8) -> Option<Self> {
        if bits & !Self::ALL.0 == 0 {
            Some(Self(bits))
        } else {
            None
        }
    }

    /// Returns the bits.
    #[inline]
    #[must_use]
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// Returns the flags, with `other` added if `condition` holds.
    #[inline]
    #[must_use]
    pub const fn with(self, other: Self, condition: bool) -> Self {
        Self(self.0 | if condition { other.0 } else { 0 })
    }

    /// True if every bit of `other` is set.
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
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct AxisState {
    /// Nominal reference, without offset.
    pub nominal: PositionNm,
    /// Offsets in force.
    pub offsets: Offsets,
    /// Offsets that would be in force if Submit were Obtain; zero outside Submit.
    pub shadow: Offsets,
    /// Measurements of the drive.
    pub actual: Actual,
    /// Values that were clamped or limited in this tick.
    pub flags: AxisFlags,
}

/// Server: one per tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
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
    /// Cause of the end of the last session.
    pub cause: Cause,
    /// On-time commands among the last 100 deadlines; deadlines before the session count as on
    /// time.
    pub on_time_of_100: u8,
    /// Time from the departure of the previous State to the arrival of the last command, µs,
    /// measured by the host; 0 without a measurement.
    pub arrival_us: u16,
    /// Ticks until every offset would be zero if the ramp began now.
    pub ramp_ticks_left: u32,
    /// Counts since the session was granted.
    pub counters: Counters,
    /// Sample of the force sensor; `None` without one.
    pub sensor: Option<WrenchSample>,
    /// The axes, axis order.
    #[cfg_attr(feature = "serde", serde(with = "crate::serde_array"))]
    pub axes: [AxisState; N],
}

/// Reason for which a Hello is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Refusal {
    /// Another connection owns the session.
    Busy,
    /// Offsets are still ramping to zero.
    Ramping {
        /// Ticks until they are zero.
        ticks_left: u32,
    },
    /// The server is stopped and must be re-armed at the machine.
    Faulted {
        /// Ticks until the offsets are zero.
        ticks_left: u32,
    },
    /// The client is built for another number of axes.
    Axes {
        /// The server's number of axes.
        expected: u8,
    },
    /// The client lacks an ability that the server needs.
    Capability {
        /// Abilities that the client must have.
        needed: Capabilities,
    },
    /// The server's epochs are used up, or, over datagrams, it has no room for another peer.
    Unavailable,
    /// The key of the client may only read.
    Role,
}

/// Messages of a server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum ServerMessage<const N: usize> {
    /// Grants the session.
    Welcome(Welcome<N>),
    /// One per tick.
    State(State<N>),
    /// Refuses a Hello.
    Refusal(Refusal),
}

#[cfg(test)]
mod tests;
