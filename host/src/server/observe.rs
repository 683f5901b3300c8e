//! Watches the rows of a server outside its cycle: says what happens, once per event, and moves the simulated hand.

use gantry_tau_core::control::message::{Cause, Counters, Phase};

use super::cycle::Row;
use crate::client::cause_text;
use crate::sim::load_generator::{Load, LoadGenerator};

/// Difference between two steps of the hand, N.
const FORCE_STEP_N: f64 = 60.0;
/// Steps at most.
const MAX_STEPS: usize = 100;

/// The simulated hand's programme: force steps in x while a client is in Obtain, nothing otherwise.
#[derive(Debug)]
pub struct Programme {
    hand: LoadGenerator,
    forces_n: Vec<f64>,
    step_ticks: u64,
    since: Option<u64>,
    step: u32,
}

impl Programme {
    /// Steps of 60 N up to `force_max_n` and down to zero again, each `step_seconds` long.
    #[must_use]
    pub fn new(hand: LoadGenerator, force_max_n: f64, step_seconds: f64) -> Self {
        let steps = std::iter::successors(Some(0.0), |force| Some(force + FORCE_STEP_N));
        let forces_n = steps
            .take(MAX_STEPS)
            .take_while(|force| *force <= force_max_n.max(0.0))
            .collect();
        let milliseconds = (step_seconds.clamp(0.1, 3_600.0) * 1e3).round();
        let step_ticks = (0_u32..)
            .find(|tick| f64::from(*tick) >= milliseconds)
            .unwrap_or(1);
        Self {
            hand,
            forces_n,
            step_ticks: u64::from(step_ticks.max(1)),
            since: None,
            step: 0,
        }
    }

    fn see<const N: usize>(&mut self, row: &Row<N>) {
        let tick = row.state.tick.0;
        if row.state.phase != Phase::Obtain {
            if self.since.take().is_some() {
                self.hand.release();
                self.step = 0;
            }
            return;
        }
        let since = *self.since.get_or_insert(tick);
        let number = tick.saturating_sub(since) / self.step_ticks;
        let count = u64::try_from(self.forces_n.len()).unwrap_or(1);
        let step = u32::try_from(number % count).unwrap_or(0);
        if step != self.step {
            self.step = step;
            let index = usize::try_from(step).unwrap_or(0);
            let force_x = self.forces_n.get(index).copied().unwrap_or(0.0);
            // Forces are limited by the command line's own range check in the hand; a refused load leaves the old one.
            let _ = self.hand.set(&Load {
                step,
                force_n: [force_x, 0.0, 0.0],
                moment_nm: [0.0; 3],
            });
        }
    }
}

/// Says what happens.
#[derive(Debug)]
pub struct Observer {
    programme: Programme,
    phase: Phase,
    counters: Counters,
    plant_failed: bool,
}

impl Observer {
    /// An observer that has seen nothing yet.
    #[must_use]
    pub fn new(programme: Programme) -> Self {
        Self {
            programme,
            phase: Phase::Listening,
            counters: Counters::default(),
            plant_failed: false,
        }
    }

    /// Looks at one row.
    pub fn see<const N: usize>(&mut self, row: &Row<N>) {
        self.programme.see(row);
        let state = &row.state;
        let tick = state.tick.0;
        if row.welcomed {
            tracing::info!("tick {tick}: session granted (epoch {})", state.epoch.0);
            self.counters = Counters::default();
        }
        if row.refused > 0 {
            tracing::info!(
                "tick {tick}: {} client(s) refused in {:?}",
                row.refused,
                state.phase
            );
        }
        if let Some(cause) = row.ended {
            self.explain_end(row, cause);
        }
        if state.phase != self.phase {
            tracing::info!("tick {tick}: {:?} -> {:?}", self.phase, state.phase);
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
        let (tick, text, left) = (state.tick.0, cause_text(cause), state.ramp_ticks_left);
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
                before.strangers,
                now.strangers,
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
