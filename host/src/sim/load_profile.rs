//! Load profile: force steps in x while a client is in Obtain, no load otherwise.

use std::time::Duration;

use super::hand::{Hand, Load};

/// Difference between two steps, N.
const FORCE_STEP_N: f64 = 60.0;
/// Largest number of steps.
const MAX_STEPS: usize = 100;

/// Applies force steps to the tool, by ticks.
#[derive(Debug)]
pub struct LoadProfile {
    hand: Hand,
    forces_n: Vec<f64>,
    step_ticks: u64,
    since: Option<u64>,
    step: u32,
}

impl LoadProfile {
    /// Creates steps of 60 N up to `force_max_n`, again and again, each `step_seconds` (0.1 to 3600) long.
    #[must_use]
    pub fn new(hand: Hand, force_max_n: f64, step_seconds: f64) -> Self {
        let steps = std::iter::successors(Some(0.0), |force| Some(force + FORCE_STEP_N));
        let forces_n = steps
            .take(MAX_STEPS)
            .take_while(|force| *force <= force_max_n.max(0.0))
            .collect();
        let step =
            Duration::try_from_secs_f64(step_seconds.clamp(0.1, 3_600.0)).unwrap_or_default();
        Self {
            hand,
            forces_n,
            step_ticks: u64::try_from(step.as_millis()).unwrap_or(u64::MAX).max(1),
            since: None,
            step: 0,
        }
    }

    /// Applies the load of a tick.
    pub fn apply(&mut self, tick: u64, in_obtain: bool) {
        if !in_obtain {
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
            // The command line checks the range; a refused load would leave the last one.
            let _ = self.hand.set(&Load {
                step,
                force_n: [force_x, 0.0, 0.0],
                moment_nm: [0.0; 3],
            });
        }
    }
}
