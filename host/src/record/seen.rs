//! Events of a session that the States of a client show.

use gantry_tau_core::control::message::{Phase, State};

use crate::server::event_log::{Event, EventKind};

/// What a client has seen of its session: that it was granted, and its phases.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seen {
    phase: Option<Phase>,
}

impl Seen {
    /// Returns what has changed since the previous State.
    pub fn see<const N: usize>(&mut self, state: &State<N>) -> Vec<Event> {
        let (tick, epoch, now) = (state.tick.0, state.epoch.0, state.phase);
        let event = |kind, code, text| vec![Event { tick, kind, code, text }];
        match self.phase.replace(now) {
            None => event(EventKind::Granted, 0, format!("session granted (epoch {epoch})")),
            Some(before) if before != now => {
                event(EventKind::Phase, now.code(), format!("{} -> {}", before.name(), now.name()))
            }
            Some(_) => Vec::new(),
        }
    }
}
