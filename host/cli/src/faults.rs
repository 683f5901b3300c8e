//! Fault injection on the connection between a client and a server: delay, loss, duplication,
//! corruption, stalls, silence, resets.
//!
//! | module | contents |
//! |---|---|
//! | [`plan`] | probabilities per frame under a seed, and scripted faults |
//! | [`injector`] | one direction of a connection as a state machine without sockets and clock: simulations step it by hand |
//! | [`relay`] | forwards TCP streams or UDP datagrams through injectors |
//!
//! A frame suffers at most one fault. The same seed and the same frames give the same faults, on
//! every machine.

pub mod injector;
pub mod plan;
pub mod relay;

use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

use gantry_tau_core::control::endpoint::Transport;
use serde::{Deserialize, Serialize};

/// Fault of a frame, or of the connection that carries it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Fault {
    /// The frame is lost. (TCP loses nothing; on a stream this is a sender that skips a frame.)
    Drop,
    /// The frame arrives more than once. Parameter: number of additional copies (1).
    Duplicate,
    /// The frame arrives later than its successors, datagrams only. Parameter: delay in ms (2).
    Reorder,
    /// One bit is flipped. Parameter: its index (drawn).
    Corrupt,
    /// The end of the frame is lost. Parameter: bytes that remain (drawn).
    Truncate,
    /// The frame arrives in two pieces. Parameter: bytes of the first (drawn).
    Split,
    /// This frame and its successors are held back, then arrive together. Parameter: duration in ms
    /// (10).
    Burst,
    /// As a burst, and meanwhile a stream is not read, so that the buffers of its sender fill.
    /// Parameter: duration in ms (10).
    Stall,
    /// From here on nothing passes in this direction, closing the connection included.
    HalfOpen,
    /// The connection is reset at both ends (TCP only).
    Reset,
}

impl Fault {
    /// Every fault.
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

    /// True if the fault takes a parameter.
    #[must_use]
    pub const fn has_parameter(self) -> bool {
        !matches!(self, Self::Drop | Self::HalfOpen | Self::Reset)
    }

    /// True if the fault exists on this transport: a stream keeps its order, a datagram has no
    /// connection.
    #[must_use]
    pub const fn suits(self, transport: Transport) -> bool {
        match transport {
            Transport::Stream => !matches!(self, Self::Reorder),
            Transport::Datagram => !matches!(self, Self::Reset),
        }
    }
}

/// Name in scripts, options and reports.
impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

/// Direction of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From the client to the server.
    Up,
    /// From the server to the client.
    Down,
}

/// Occurrences of one fault.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Occurrences {
    /// Number.
    pub times: u64,
    /// Time of the last one, since the connection began.
    pub last: Duration,
}

/// Frames and faults of one direction of a connection.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FaultStats {
    /// Frames that came in; of a stream without frames, pieces as they were read.
    pub frames: u64,
    /// Faults that occurred.
    pub faults: BTreeMap<Fault, Occurrences>,
}

impl FaultStats {
    /// True if the fault occurred at `since` or later.
    #[must_use]
    pub fn occurred_since(&self, fault: Fault, since: Duration) -> bool {
        self.faults
            .get(&fault)
            .is_some_and(|occurrences| occurrences.last >= since)
    }

    /// Returns how often the fault occurred.
    #[must_use]
    pub fn times(&self, fault: Fault) -> u64 {
        self.faults
            .get(&fault)
            .map_or(0, |occurrences| occurrences.times)
    }

    /// Adds the counts of another connection.
    pub fn add(&mut self, other: &Self) {
        self.frames += other.frames;
        for (fault, theirs) in &other.faults {
            let ours = self.faults.entry(*fault).or_default();
            ours.times += theirs.times;
            ours.last = ours.last.max(theirs.last);
        }
    }

    fn count(&mut self, fault: Fault, now: Duration) {
        let occurrences = self.faults.entry(fault).or_default();
        occurrences.times += 1;
        occurrences.last = now;
    }
}
