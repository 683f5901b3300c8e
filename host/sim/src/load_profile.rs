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

#[cfg(test)]
mod tests {
    use super::super::load_generator::load_generator;
    use super::*;

    /// Steps from 0 to the largest, each 0.5 s long, again and again; from the beginning again in the
    /// next Obtain.
    #[test]
    fn steps_follow_each_other_in_obtain() {
        let (hand, mut tool) = load_generator();
        let mut profile = LoadProfile::new(hand, 120.0, 0.5);
        for (phase, tick, force_n) in [
            (Phase::Submit, 10, 0.0),
            (Phase::Obtain, 1_000, 0.0),
            (Phase::Obtain, 1_499, 0.0),
            (Phase::Obtain, 1_500, 60.0),
            (Phase::Obtain, 1_999, 60.0),
            (Phase::Obtain, 2_000, 120.0),
            (Phase::Obtain, 2_500, 0.0),
            (Phase::Obtain, 3_000, 60.0),
            (Phase::SafeDisconnect, 3_001, 0.0),
            (Phase::Obtain, 4_000, 0.0),
            (Phase::Obtain, 4_500, 60.0),
        ] {
            profile.update(phase, Tick(tick));
            assert_eq!(tool.load().force_n, [force_n, 0.0, 0.0], "{tick}");
        }
    }

    #[test]
    fn without_a_force_there_is_one_step() {
        for force_max_n in [0.0, -60.0] {
            let (hand, mut tool) = load_generator();
            let mut profile = LoadProfile::new(hand, force_max_n, 0.1);
            for tick in [0, 100, 200] {
                profile.update(Phase::Obtain, Tick(tick));
                assert_eq!(tool.load(), Load::default());
            }
        }
    }
}
