//! Loads on the tool while a client is in Obtain: force steps, or a load that changes.

use gantry_tau_core::control::message::Phase;
use gantry_tau_core::units::Tick;

use super::load_generator::{Load, LoadGenerator};
use super::load_pattern::LoadPattern;

/// Difference between two steps, N.
const FORCE_STEP_N: f64 = 60.0;
/// Largest number of steps.
const MAX_STEPS: usize = 100;

/// A load while a client is in Obtain, none otherwise.
#[derive(Debug)]
pub struct LoadProfile {
    hand: LoadGenerator,
    job: Job,
    since: Option<Tick>,
}

#[derive(Debug)]
enum Job {
    Steps(Steps),
    Pattern(LoadPattern),
}

/// Force steps in x.
#[derive(Debug)]
struct Steps {
    forces_n: Vec<f64>,
    step_ticks: u64,
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
        let step_ticks = (step_seconds.clamp(0.1, 3_600.0) * 1e3).round().max(1.0) as u64;
        let steps = Steps {
            forces_n,
            step_ticks,
            step: 0,
        };
        Self {
            hand,
            job: Job::Steps(steps),
            since: None,
        }
    }

    /// A load that changes, from the beginning of Obtain on.
    #[must_use]
    pub const fn of(hand: LoadGenerator, pattern: LoadPattern) -> Self {
        Self {
            hand,
            job: Job::Pattern(pattern),
            since: None,
        }
    }

    /// Sets the load for this tick.
    pub fn update(&mut self, phase: Phase, tick: Tick) {
        if phase != Phase::Obtain {
            if self.since.take().is_some() {
                self.hand.release();
                if let Job::Steps(steps) = &mut self.job {
                    steps.step = 0;
                }
            }
            return;
        }
        let begins = self.since.is_none();
        let since = *self.since.get_or_insert(tick);
        match &mut self.job {
            Job::Steps(steps) => {
                if let Some(load) = steps.next(tick.0.saturating_sub(since.0)) {
                    // The command line has checked the range; a refused load leaves the previous one.
                    let _ = self.hand.set(&load);
                }
            }
            Job::Pattern(pattern) if begins => self.hand.begin(*pattern),
            Job::Pattern(_) => {}
        }
    }
}

impl Steps {
    /// Returns the load of another step, if so many ticks after the beginning there is another.
    fn next(&mut self, ticks: u64) -> Option<Load> {
        let number = ticks / self.step_ticks;
        // The list begins with 0 N: it is never empty.
        let step = (number % self.forces_n.len() as u64) as usize;
        if step == self.step {
            return None;
        }
        self.step = step;
        Some(Load {
            step: step as u32,
            force_n: [self.forces_n[step], 0.0, 0.0],
            moment_nm: [0.0; 3],
        })
    }
}
