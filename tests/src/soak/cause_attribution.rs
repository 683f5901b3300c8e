//! Causes of a session's end, explained by deeds of clients and faults of links. A cause without a
//! reason is a bug.

use std::time::Duration;

use gantry_tau::faults::{Fault, FaultStats};
use gantry_tau_core::control::message::Cause;

use super::BUDGET;

/// Longest time from a fault or a deed to the end that it explains: the longest burst or stall, and
/// some ticks.
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
    pub const ALL: [Self; 6] = [
        Self::Goodbye,
        Self::Stop,
        Self::Close,
        Self::Silence,
        Self::Flood,
        Self::Garbage,
    ];
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
    /// The client has closed.
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
        match cause {
            Cause::Goodbye => self.did(ClientFault::Goodbye),
            Cause::Stop => self.did(ClientFault::Stop) || self.stopped,
            Cause::Closed => self.closed || self.has_ever_had(Fault::Reset),
            Cause::Malformed => {
                let on_the_way = [Fault::Corrupt, Fault::Truncate];
                self.did(ClientFault::Garbage)
                    || on_the_way
                        .into_iter()
                        .any(|fault| self.up.occurred_since(fault, since))
            }
            Cause::Flood => {
                let at_once = [Fault::Burst, Fault::Stall, Fault::Duplicate];
                self.did(ClientFault::Flood)
                    || at_once
                        .into_iter()
                        .any(|fault| self.had_since(fault, since))
            }
            Cause::ClientLate | Cause::NetworkLate => {
                self.deed.is_some_and(|(_, when)| when >= since) || self.made_late(since)
            }
            // Misses of the whole window count.
            Cause::Budget => {
                let window = Duration::from_millis(BUDGET.window.into());
                self.made_late(since.saturating_sub(window))
            }
            Cause::ServerLate => self.skipped,
            // The Welcome or every answer was lost, or the client never meant to answer.
            Cause::HandshakeTimeout => {
                self.deed.is_some() || Fault::ALL.into_iter().any(|fault| self.has_ever_had(fault))
            }
            Cause::Nominal => self.jumped,
            _ => false,
        }
    }

    /// True if this was the client's last deed.
    fn did(&self, deed: ClientFault) -> bool {
        self.deed.is_some_and(|(done, _)| done == deed)
    }

    /// True if a link had this fault since then.
    fn had_since(&self, fault: Fault, since: Duration) -> bool {
        self.up.occurred_since(fault, since) || self.down.occurred_since(fault, since)
    }

    /// True if a link ever had this fault.
    fn has_ever_had(&self, fault: Fault) -> bool {
        self.up.faults.contains_key(&fault) || self.down.faults.contains_key(&fault)
    }

    /// The link was slow, or something since then has made a frame late: any fault but one that has
    /// it come twice.
    fn made_late(&self, since: Duration) -> bool {
        let mut late = Fault::ALL
            .into_iter()
            .filter(|fault| *fault != Fault::Duplicate);
        self.slow || late.any(|fault| self.had_since(fault, since))
    }
}
