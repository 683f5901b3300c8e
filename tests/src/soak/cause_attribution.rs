//! Causes of a session's end, explained by deeds of clients and faults of links. A cause without a reason is a bug.

use std::time::Duration;

use gantry_tau::faults::{Fault, FaultStats};
use gantry_tau_core::control::message::Cause;

use super::BUDGET;

/// Longest time from a fault or a deed to the end that it explains: the longest burst or stall, and some ticks.
const RECENT: Duration = Duration::from_millis(45);

/// Deed of a client that ends its session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClientFault {
    /// Says goodbye.
    Goodbye,
    /// Stops the machine's offsets.
    Stop,
    /// Closes without a Goodbye.
    Close,
    /// Says nothing more.
    Silence,
    /// Sends a dozen frames at once.
    Flood,
    /// Sends random bytes instead of a frame.
    Garbage,
}

impl ClientFault {
    /// Every one.
    pub const ALL: [Self; 6] = [Self::Goodbye, Self::Stop, Self::Close, Self::Silence, Self::Flood, Self::Garbage];
}

/// Evidence about a session that ended. Times count from the link's beginning.
#[derive(Clone, Copy, Debug)]
pub struct Evidence<'a> {
    /// Time of the end.
    pub at: Duration,
    /// From client to server.
    pub up: &'a FaultStats,
    /// From server to client.
    pub down: &'a FaultStats,
    /// Last deed of the client, and its time.
    pub deed: Option<(ClientFault, Duration)>,
    /// The client has closed, whatever it did last.
    pub closed: bool,
    /// The link's own delay is longer than a tick, now and then.
    pub slow: bool,
    /// The server skipped cycles in this tick or the last.
    pub skipped: bool,
    /// The machine was stopped in this tick.
    pub stopped: bool,
    /// The nominal reference stepped too far in this tick.
    pub jumped: bool,
}

impl Evidence<'_> {
    /// True if the end is explained.
    #[must_use]
    pub fn explains(&self, cause: Cause) -> bool {
        let since = self.at.saturating_sub(RECENT);
        let did = |deed| self.deed.is_some_and(|(done, _)| done == deed);
        let did_recently = self.deed.is_some_and(|(_, when)| when >= since);
        let up = |fault| self.up.occurred_since(fault, since);
        let down = |fault| self.down.occurred_since(fault, since);
        let ever = |fault| self.up.faults.contains_key(&fault) || self.down.faults.contains_key(&fault);
        match cause {
            Cause::Goodbye => did(ClientFault::Goodbye),
            Cause::Stop => did(ClientFault::Stop) || self.stopped,
            Cause::Closed => self.closed || ever(Fault::Reset),
            Cause::Malformed => did(ClientFault::Garbage) || up(Fault::Corrupt) || up(Fault::Truncate),
            Cause::Flood => {
                let at_once = [Fault::Burst, Fault::Stall, Fault::Duplicate];
                did(ClientFault::Flood) || at_once.into_iter().any(|fault| up(fault) || down(fault))
            }
            Cause::ClientLate | Cause::NetworkLate => did_recently || self.made_late(since),
            // Misses of the whole window count.
            Cause::Budget => {
                let window = Duration::from_millis(BUDGET.window.into());
                self.made_late(since.saturating_sub(window))
            }
            Cause::ServerLate => self.skipped,
            // The Welcome or every answer was lost, or the client never meant to answer.
            Cause::HandshakeTimeout => self.deed.is_some() || Fault::ALL.into_iter().any(ever),
            Cause::Nominal => self.jumped,
            _ => false,
        }
    }

    /// The link was slow, or something since then has made a frame late: any fault but one that has it come twice.
    fn made_late(&self, since: Duration) -> bool {
        let late = |fault| {
            fault != Fault::Duplicate
                && (self.up.occurred_since(fault, since) || self.down.occurred_since(fault, since))
        };
        self.slow || Fault::ALL.into_iter().any(late)
    }
}
