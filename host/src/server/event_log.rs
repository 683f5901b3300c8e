//! Log lines for the rows of a server, written outside its cycle, once per event.

use gantry_tau_core::control::message::{Cause, Counters, Phase};

use super::cycle::Row;

/// Logs phase changes, ends of sessions and the first of each kind of trouble.
#[derive(Debug)]
pub struct EventLog {
    phase: Phase,
    counters: Counters,
    plant_failed: bool,
    latch_lost: bool,
}

impl Default for EventLog {
    fn default() -> Self {
        Self { phase: Phase::Listening, counters: Counters::default(), plant_failed: false, latch_lost: false }
    }
}

impl EventLog {
    /// Logs what has changed since the previous row.
    pub fn see<const N: usize>(&mut self, row: &Row<N>) {
        let state = &row.state;
        let tick = state.tick.0;
        if row.welcomed {
            tracing::info!("tick {tick}: session granted (epoch {})", state.epoch.0);
            self.counters = Counters::default();
        }
        let (refused, before, now) = (row.refused, self.phase.name(), state.phase.name());
        if refused > 0 {
            tracing::info!("tick {tick}: {refused} client(s) refused in {now}");
        }
        if let Some(cause) = row.ended {
            self.log_end(row, cause);
        }
        if state.phase != self.phase {
            tracing::info!("tick {tick}: {before} -> {now}");
            self.phase = state.phase;
        }
        if row.plant_failed && !self.plant_failed {
            tracing::error!("tick {tick}: the machine did not answer; stopped");
        }
        self.plant_failed = row.plant_failed;
        if row.latch_lost && !self.latch_lost {
            tracing::error!("tick {tick}: the stop latch cannot be written: do not restart the server before a re-arm");
        }
        self.latch_lost = row.latch_lost;
        self.log_counters(tick, &state.counters);
    }

    /// Logs a requested end as information, any other as a warning.
    fn log_end<const N: usize>(&self, row: &Row<N>, cause: Cause) {
        let state = &row.state;
        let (tick, text, left) = (state.tick.0, cause, state.ramp_ticks_left);
        if matches!(self.phase, Phase::Listening | Phase::SafeDisconnect) {
            return tracing::info!("tick {tick}: {text}; {left} ticks of ramp left");
        }
        let (epoch, counts) = (state.epoch.0, state.counters);
        let summary = format!(
            "tick {tick}: session ended (epoch {epoch}): {text}; {left} ticks of ramp left; \
             {} received, {} missed, {} late, {} duplicate, {} stale, {} malformed",
            counts.received, counts.missed, counts.late, counts.duplicate, counts.stale, counts.malformed
        );
        match cause {
            Cause::Goodbye | Cause::Stop => tracing::info!("{summary}"),
            _ => tracing::warn!("{summary}"),
        }
    }

    /// Explains a counter when it leaves zero: once per session.
    fn log_counters(&mut self, tick: u64, now: &Counters) {
        type Of = fn(&Counters) -> u32;
        let texts: [(Of, _); 8] = [
            (|c| c.missed, "no fresh valid command before a deadline (or the server skipped it)"),
            (|c| c.late, "a command came late"),
            (|c| c.duplicate, "a command came twice"),
            (|c| c.stale, "a frame of another epoch, sequence or tick"),
            (|c| c.malformed, "a frame with bad content, or not allowed in this phase"),
            (|c| c.out_of_range, "a target beyond its limit"),
            (|c| c.clamped, "a reference was clamped to the travel"),
            (|c| c.non_owner, "frames from a connection that does not own the session"),
        ];
        for (of, text) in texts {
            if of(&self.counters) == 0 && of(now) > 0 {
                tracing::info!("tick {tick}: {text}; further ones of this session are only counted");
            }
        }
        self.counters = *now;
    }
}
