//! A link that does harm on purpose: delayed, held up, out of order, twice, cut short, corrupt, in pieces, silent, reset.
//!
//! | module | what it holds |
//! |---|---|
//! | [`plan`] | what is to happen, and when: odds per frame under a seed, and a script |
//! | [`mangle`] | one direction of a link, as a state machine without sockets and clock: simulations step it by hand |
//! | [`tcp`] | a relay for byte streams; it finds the frames of `wire.md` in them |
//! | [`udp`] | a relay for datagrams |
//!
//! A frame suffers at most one fault. The same seed and the same frames give the same faults, on every machine.

mod frames;
pub mod mangle;
pub mod plan;
pub mod tcp;
pub mod udp;

use std::collections::BTreeMap;
use std::fmt;
use std::net::SocketAddr;
use std::time::Duration;

use serde::Serialize;

/// What can happen to a frame, or to the link it is on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Fault {
    /// The frame is lost. (TCP loses nothing; on a stream this is a sender that skips a frame.)
    Drop,
    /// The frame comes more than once. Parameter: how many times more (1).
    Duplicate,
    /// The frame comes later than those behind it, datagrams only. Parameter: by so many ms (2).
    Reorder,
    /// One bit is flipped. Parameter: which (drawn).
    Corrupt,
    /// Only the beginning comes. Parameter: how many bytes of it (drawn).
    Truncate,
    /// The frame comes in two pieces. Parameter: bytes of the first (drawn).
    Split,
    /// This frame and those behind it are held back, and then come all at once. Parameter: after so many ms (10).
    Burst,
    /// As a burst, and meanwhile a stream is not read, so that its sender's buffers fill. Parameter: for so many ms (10).
    Stall,
    /// From here on nothing comes in this direction any more, and nobody is told: neither side's close is passed on.
    HalfOpen,
    /// The connection is reset at both ends (TCP only).
    Reset,
}

impl Fault {
    /// Every one.
    pub const ALL: [Self; 10] = [
        Self::Drop,
        Self::Duplicate,
        Self::Reorder,
        Self::Corrupt,
        Self::Truncate,
        Self::Split,
        Self::Burst,
        Self::Stall,
        Self::HalfOpen,
        Self::Reset,
    ];

    /// Its word in scripts, options and reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Drop => "drop",
            Self::Duplicate => "duplicate",
            Self::Reorder => "reorder",
            Self::Corrupt => "corrupt",
            Self::Truncate => "truncate",
            Self::Split => "split",
            Self::Burst => "burst",
            Self::Stall => "stall",
            Self::HalfOpen => "half-open",
            Self::Reset => "reset",
        }
    }

    /// Whether it has a parameter.
    #[must_use]
    pub const fn has_parameter(self) -> bool {
        !matches!(self, Self::Drop | Self::HalfOpen | Self::Reset)
    }

    /// Whether it makes sense on such a link: a stream keeps its order, a datagram has no connection.
    #[must_use]
    pub const fn suits(self, medium: Medium) -> bool {
        match medium {
            Medium::Stream => !matches!(self, Self::Reorder),
            Medium::Datagrams => !matches!(self, Self::Reset),
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// What a link carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Medium {
    /// Bytes in order, TCP.
    Stream,
    /// Frames by themselves, UDP.
    Datagrams,
}

/// One of the two ways through a link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From the client to the server.
    Up,
    /// From the server to the client.
    Down,
}

/// How often a fault has acted, and when last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Acted {
    /// How often.
    pub times: u64,
    /// When last, since the link began.
    pub last: Duration,
}

/// What became of one direction of one link.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Frames that came in; of a stream without frames, pieces as they were read.
    pub frames: u64,
    /// What was done to them.
    pub acted: BTreeMap<Fault, Acted>,
}

impl Tally {
    /// Whether a fault acted at `since` or later.
    #[must_use]
    pub fn acted_since(&self, fault: Fault, since: Duration) -> bool {
        self.acted
            .get(&fault)
            .is_some_and(|acted| acted.last >= since)
    }

    /// Adds another tally.
    pub fn add(&mut self, other: &Self) {
        self.frames += other.frames;
        for (fault, theirs) in &other.acted {
            let ours = self.acted.entry(*fault).or_default();
            ours.times += theirs.times;
            ours.last = ours.last.max(theirs.last);
        }
    }

    fn note(&mut self, fault: Fault, now: Duration) {
        let acted = self.acted.entry(fault).or_default();
        acted.times += 1;
        acted.last = now;
    }
}

/// A link that has ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ended {
    /// The client's address.
    pub peer: SocketAddr,
    /// How long it existed.
    pub age: Duration,
    /// From client to server.
    pub up: Tally,
    /// From server to client.
    pub down: Tally,
}
