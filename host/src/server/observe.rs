//! Watches the rows of a server outside its cycle: says what happens, once per event.

use gantry_tau_core::control::message::{Cause, Counters, Phase};

use super::cycle::Row;

/// Says what happens.
#[derive(Debug, Default)]
pub struct Observer {
    phase: Phase,
    counters: Counters,
    plant_failed: bool,
}

impl Observer {
    /// Looks at one row.
    pub fn see<const N: usize>(&mut self, row: &Row<N>) {
        let state = &row.state;
        let tick = state.tick.0;
        if row.welcomed {
            tracing::info!("tick {tick}: session granted (epoch {})", state.epoch.0);
            self.counters = Counters::default();
        }
        if row.refused > 0 {
            tracing::info!(
                "tick {tick}: {} client(s) refused in {}",
                row.refused,
                state.phase.name()
            );
        }
        if let Some(cause) = row.ended {
            self.explain_end(row, cause);
        }
        if state.phase != self.phase {
            tracing::info!(
                "tick {tick}: {} -> {}",
                self.phase.name(),
                state.phase.name()
            );
            self.phase = state.phase;
        }
        if row.plant_failed && !self.plant_failed {
            tracing::error!("tick {tick}: the machine did not answer; stopped");
        }
        self.plant_failed = row.plant_failed;
        self.explain_counters(tick, &state.counters);
    }

    /// An end that somebody wanted is information, any other a warning.
    fn explain_end<const N: usize>(&self, row: &Row<N>, cause: Cause) {
        let state = &row.state;
        let (tick, text, left) = (state.tick.0, cause, state.ramp_ticks_left);
        if matches!(self.phase, Phase::Listening | Phase::SafeDisconnect) {
            return tracing::info!("tick {tick}: {text}; {left} ticks of ramp left");
        }
        let (epoch, counts) = (state.epoch.0, state.counters);
        let summary = format!(
            "tick {tick}: session ended (epoch {epoch}): {text}; {left} ticks of ramp left; {} received, {} missed, {} late, {} duplicate, {} stale, {} malformed",
            counts.received,
            counts.missed,
            counts.late,
            counts.duplicate,
            counts.stale,
            counts.malformed
        );
        match cause {
            Cause::Goodbye | Cause::Stop => tracing::info!("{summary}"),
            _ => tracing::warn!("{summary}"),
        }
    }

    /// Each kind of trouble is explained when its counter leaves zero: once per session and cause.
    fn explain_counters(&mut self, tick: u64, now: &Counters) {
        let before = self.counters;
        let kinds = [
            (
                before.missed,
                now.missed,
                "a deadline passed without a fresh valid command (or the server skipped it)",
            ),
            (before.late, now.late, "a command came late"),
            (before.duplicate, now.duplicate, "a command came twice"),
            (
                before.stale,
                now.stale,
                "a frame of another epoch, sequence or tick",
            ),
            (
                before.malformed,
                now.malformed,
                "a frame with bad content, or without a place in this phase",
            ),
            (
                before.out_of_range,
                now.out_of_range,
                "a target beyond its limit",
            ),
            (
                before.clamped,
                now.clamped,
                "a reference was clamped to the travel",
            ),
            (
                before.non_owner,
                now.non_owner,
                "frames from a connection that owns nothing",
            ),
        ];
        for (old, new, text) in kinds {
            if old == 0 && new > 0 {
                tracing::info!(
                    "tick {tick}: {text}; further ones of this session are only counted"
                );
            }
        }
        self.counters = *now;
    }
}
