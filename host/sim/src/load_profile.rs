//! Force steps on the tool while a client is in Obtain.

use gantry_tau_core::control::message::Phase;
use gantry_tau_core::units::Tick;

use super::load_generator::{Load, LoadGenerator};

/// Difference between two steps, N.
const FORCE_STEP_N: f64 = 60.0;
/// Largest number of steps.
const MAX_STEPS: usize = 100;

/// Force steps in x while a client is in Obtain, no load otherwise.
#[derive(Debug)]
pub struct LoadProfile {
    hand: LoadGenerator,
    forces_n: Vec<f64>,
    step_ticks: u64,
    since: Option<Tick>,
    step: usize,
}

impl LoadProfile {
    /// Steps of 60 N up to `force_max_n`, each `step_seconds` long, repeated from zero.
    #[must_use]
    pub fn new(hand: LoadGenerator, force_max_n: f64, step_seconds: f64) -> Self {
        let steps = std::iter::successors(Some(0.0), |force| Some(force + FORCE_STEP_N));
        let forces_n = steps
            .take(MAX_STEPS)
            .take_while(|force| *force <= force_max_n.max(0.0))
            .collect();
        Self {
            hand,
            forces_n,
            step_ticks: (step_seconds.clamp(0.1, 3_600.0) * 1e3).round().max(1.0) as u64,
            since: None,
            step: 0,
        }
    }

    /// Sets the load for this tick.
    pub fn update(&mut self, phase: Phase, tick: Tick) {
        if phase != Phase::Obtain {
            if self.since.take().is_some() {
                self.hand.release();
                self.step = 0;
            }
            return;
        }
        let since = *self.since.get_or_insert(tick);
        let number = tick.0.saturating_sub(since.0) / self.step_ticks;
        // The list begins with 0 N: it is never empty.
        let step = (number % self.forces_n.len() as u64) as usize;
        if step != self.step {
            self.step = step;
            // The command line has checked the range; a refused load leaves the previous one.
            let _ = self.hand.set(&Load {
                step: step as u32,
                force_n: [self.forces_n[step], 0.0, 0.0],
                moment_nm: [0.0; 3],
            });
        }
    }
}
