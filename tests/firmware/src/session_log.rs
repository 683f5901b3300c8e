//! Log of a server: one line of `name=value` words per event of a session.

use gantry_tau_core::control::message::Phase;
use gantry_tau_core::control::session::Output;

use crate::machine::AXES;

/// Log of a server, tick by tick.
pub(crate) struct SessionLog {
    phase: Phase,
    /// Ticks so far.
    pub(crate) ticks: u32,
    /// Sessions whose offsets are back at zero.
    pub(crate) sessions: u32,
}

impl SessionLog {
    /// Begins the log of a server without a session.
    pub(crate) const fn new() -> Self {
        Self {
            phase: Phase::Listening,
            ticks: 0,
            sessions: 0,
        }
    }

    /// Logs the events of one tick.
    pub(crate) fn note(&mut self, output: &Output<AXES>) {
        let state = &output.state;
        let tick = state.tick.0;
        self.ticks = self.ticks.saturating_add(1);
        if output.welcome.is_some() {
            defmt::info!("tick={=u64} welcome={=u64}", tick, state.epoch.0);
        }
        if let Some(cause) = output.ended {
            defmt::info!("tick={=u64} ended={} {}", tick, cause, state.counters);
        }
        if self.phase != state.phase {
            self.phase = state.phase;
            defmt::info!("tick={=u64} phase={}", tick, state.phase);
            if state.phase == Phase::Listening {
                self.sessions = self.sessions.saturating_add(1);
            }
        }
    }
}
