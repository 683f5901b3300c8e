//! Events of a session that the States of a client show.

use gantry_tau_core::control::message::{Phase, State};
use gantry_tau_server::record::{Event, EventKind};

/// Watch over a client's session for its events: that it was granted, and its phases.
#[derive(Clone, Copy, Debug, Default)]
pub struct SessionEvents {
    phase: Option<Phase>,
}

impl SessionEvents {
    /// Returns what has changed since the previous State.
    pub fn observe<const N: usize>(&mut self, state: &State<N>) -> Vec<Event> {
        let now = state.phase;
        let (kind, code, text) = match self.phase.replace(now) {
            None => (
                EventKind::Granted,
                0,
                format!("session granted (epoch {})", state.epoch.0),
            ),
            Some(before) if before != now => (
                EventKind::Phase,
                now.code(),
                format!("{} -> {}", before.name(), now.name()),
            ),
            Some(_) => return Vec::new(),
        };
        vec![Event {
            tick: state.tick.0,
            kind,
            code,
            text,
        }]
    }
}
