//! Clients that come and go over links that do harm, for a long time: nothing jumps, nothing leaks,
//! every end has its reason.
//!
//! | module | what it holds |
//! |---|---|
//! | [`audit`] | what every tick of every server must keep: bounds, counters, deadlines |
//! | [`cause_attribution`] | client faults and link faults that explain a cause |
//! | [`simulated_time`] | a server in this process, simulated time, links of [`gantry_tau::faults::injector`] |
//! | [`real_time`] | the server's own thread, real time, real sockets, [`gantry_tau::faults::relay`] |

pub mod audit;
pub mod cause_attribution;
mod client;
mod links;
pub mod real_time;
pub mod simulated_time;

use std::collections::BTreeMap;

use gantry_tau::faults::FaultStats;
use gantry_tau_core::control::message::Cause;
use gantry_tau_core::control::session::config::MissBudget;
use serde::Serialize;

/// A budget of misses that a rough link exceeds and a clean one does not.
pub const BUDGET: MissBudget = MissBudget {
    window: 100,
    allowed: 4,
};

/// Results of a soak. A property that does not hold ends it before.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Summary {
    /// Ticks of the server, each one audited.
    pub ticks: u64,
    /// Sessions granted.
    pub sessions: u64,
    /// Sessions that came to Obtain.
    pub obtained: u64,
    /// Hellos refused.
    pub refused: u64,
    /// Count of sessions by the cause of their end.
    pub ends: BTreeMap<String, u64>,
    /// Count of each fault, both directions.
    pub faults: BTreeMap<String, u64>,
    /// Frames that met the links.
    pub frames: u64,
    /// Ends that no fault explains but this machine's own lateness; in simulated time there are
    /// none.
    pub machine_late: u64,
    /// Largest change of a reference in one tick, nm.
    pub largest_change_nm: u64,
    /// Largest change beyond the nominal's own, nm.
    pub largest_external_change_nm: u64,
    /// Its limit (S), nm.
    pub external_limit_nm: u64,
}

impl Summary {
    /// A session ended.
    pub fn end(&mut self, cause: Cause) {
        *self.ends.entry(format!("{cause:?}")).or_default() += 1;
    }

    /// A link ended.
    pub fn link(&mut self, stats: &FaultStats) {
        self.frames += stats.frames;
        for (fault, occurrences) in &stats.faults {
            *self.faults.entry(fault.to_string()).or_default() += occurrences.times;
        }
    }
}
