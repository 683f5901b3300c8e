//! Load on the tool, set by another thread while the cycle runs: the ratchet strap of `[T 4.2.9]`.
//!
//! The cycle never waits: while a load is being set it keeps the one before. A load is taken over
//! whole or not at all.

use std::fmt;
use std::sync::{Arc, Mutex, PoisonError, TryLockError};

use gantry_tau_core::model::statics::Wrench;
use nalgebra::Vector3;

use super::load_pattern::LoadPattern;

/// Largest magnitude of any component, N or N m.
pub const MAX_LOAD: f64 = 1e5;

/// Load on the tool.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Load {
    /// Step of a load profile; 0 without one.
    pub step: u32,
    /// Force on the tool, N, world axes.
    pub force_n: [f64; 3],
    /// Moment on the tool about the tool centre point, N m, world axes.
    pub moment_nm: [f64; 3],
}

impl Load {
    /// Force and moment.
    #[must_use]
    pub fn wrench(&self) -> Wrench {
        Wrench {
            force_n: self.force_n.into(),
            moment_nm: self.moment_nm.into(),
        }
    }
}

/// A component of the load is not finite or beyond [`MAX_LOAD`]; the load is unchanged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LoadRefused;

impl fmt::Display for LoadRefused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a load component is not within {MAX_LOAD:e} N or N m")
    }
}

impl std::error::Error for LoadRefused {}

/// Load that is set, and one that changes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Loads {
    load: Load,
    pattern: Option<LoadPattern>,
    /// Cycles in which the load is reached.
    glide_cycles: u32,
}

/// Sets the load on the tool, from any thread.
#[derive(Debug)]
pub struct LoadGenerator {
    shared: Arc<Mutex<Loads>>,
    glide_cycles: u32,
}

/// Reads the load on the tool, in the cycle.
#[derive(Debug)]
pub struct AppliedLoad {
    shared: Arc<Mutex<Loads>>,
    last: Loads,
    /// Cycles since the last change.
    cycle: u64,
    /// Load when it came, and now.
    from: Load,
    now: Load,
}

/// Creates a load generator and the load it applies, which is zero.
#[must_use]
pub fn load_generator() -> (LoadGenerator, AppliedLoad) {
    let last = Loads::default();
    let shared = Arc::new(Mutex::new(last));
    (
        LoadGenerator {
            shared: Arc::clone(&shared),
            glide_cycles: 0,
        },
        AppliedLoad {
            shared,
            last,
            cycle: 0,
            from: Load::default(),
            now: Load::default(),
        },
    )
}

impl LoadGenerator {
    /// Lets every load that is set from now on be reached within so many cycles, smoothly, as by a
    /// strap that is tightened: one that jumps makes a machine with masses ring.
    pub const fn glide(&mut self, cycles: u32) {
        self.glide_cycles = cycles;
    }

    /// Applies `load` from the next cycle on, in place of a pattern.
    ///
    /// # Errors
    /// [`LoadRefused`]; then the load before stays.
    pub fn set(&mut self, load: &Load) -> Result<(), LoadRefused> {
        // `contains` refuses NaN.
        if !load
            .wrench()
            .to_array()
            .iter()
            .all(|x| (-MAX_LOAD..=MAX_LOAD).contains(x))
        {
            return Err(LoadRefused);
        }
        self.put(Loads {
            load: *load,
            pattern: None,
            glide_cycles: self.glide_cycles,
        });
        Ok(())
    }

    /// Begins a load that changes with the next cycle, in place of the present one.
    pub fn begin(&mut self, pattern: LoadPattern) {
        self.put(Loads {
            load: Load::default(),
            pattern: Some(pattern),
            glide_cycles: 0,
        });
    }

    fn put(&mut self, loads: Loads) {
        *self.shared.lock().unwrap_or_else(PoisonError::into_inner) = loads;
    }

    /// Releases the tool: zero load.
    pub fn release(&mut self) {
        // Zero is always accepted.
        let _ = self.set(&Load::default());
    }
}

/// A copy has the present load, and no generator yet.
impl Clone for AppliedLoad {
    fn clone(&self) -> Self {
        let shared = *self.shared.lock().unwrap_or_else(PoisonError::into_inner);
        Self {
            shared: Arc::new(Mutex::new(shared)),
            ..*self
        }
    }
}

impl AppliedLoad {
    /// Returns a generator for this load.
    #[must_use]
    pub fn generator(&self) -> LoadGenerator {
        LoadGenerator {
            shared: Arc::clone(&self.shared),
            glide_cycles: 0,
        }
    }

    /// True of a load that changes in a cycle.
    #[must_use]
    pub const fn changes_in_a_cycle(&self) -> bool {
        matches!(self.last.pattern, Some(LoadPattern::Milling(_)))
    }

    /// Returns the load of the next cycle, of one that changes its mean; while a load is being set,
    /// the load before. It never waits.
    pub fn load(&mut self) -> Load {
        let loads = match self.shared.try_lock() {
            Ok(loads) => *loads,
            Err(TryLockError::Poisoned(loads)) => *loads.into_inner(),
            Err(TryLockError::WouldBlock) => self.last,
        };
        if loads == self.last {
            self.cycle = self.cycle.wrapping_add(1);
        } else {
            self.cycle = 0;
            self.from = self.now;
        }
        self.last = loads;
        self.now = match &loads.pattern {
            Some(pattern) => Load {
                force_n: pattern.mean_n(self.cycle).into(),
                ..loads.load
            },
            None => between(&self.from, &loads.load, self.cycle, loads.glide_cycles),
        };
        self.now
    }

    /// Returns what the force is beyond its mean in a step of this cycle, N.
    #[must_use]
    pub fn beyond_mean_n(&self, substep: u32) -> Vector3<f64> {
        match &self.last.pattern {
            Some(pattern) => pattern.force_n(self.cycle, substep) - Vector3::from(self.now.force_n),
            None => Vector3::zeros(),
        }
    }
}

/// Returns the load on the way to another one, with its step: a quintic, whose speed and acceleration
/// are continuous.
fn between(from: &Load, to: &Load, cycle: u64, glide_cycles: u32) -> Load {
    let s = (cycle + 1) as f64 / f64::from(glide_cycles.max(1));
    if s >= 1.0 {
        return *to;
    }
    let share = s * s * s * (10.0 - 15.0 * s + 6.0 * s * s);
    Load {
        step: to.step,
        force_n: mixed(&from.force_n, &to.force_n, share),
        moment_nm: mixed(&from.moment_nm, &to.moment_nm, share),
    }
}

fn mixed(from: &[f64; 3], to: &[f64; 3], share: f64) -> [f64; 3] {
    Vector3::from(*from).lerp(&Vector3::from(*to), share).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn uniform(step: u32) -> Load {
        let value = f64::from(step);
        Load {
            step,
            force_n: [value; 3],
            moment_nm: [value; 3],
        }
    }

    #[test]
    fn what_is_set_is_read() {
        let (mut generator, mut applied) = load_generator();
        assert_eq!(applied.load(), Load::default());
        generator.set(&uniform(3)).unwrap();
        assert_eq!(applied.load(), uniform(3));
        generator.release();
        assert_eq!(applied.load(), Load::default());
    }

    #[test]
    fn a_load_that_glides_has_its_step_at_once_and_arrives() {
        let (mut generator, mut applied) = load_generator();
        generator.glide(100);
        for (step, value) in [(100, 100.0), (0, 0.0)] {
            generator.set(&uniform(step)).unwrap();
            let loads: Vec<Load> = (0..150).map(|_| applied.load()).collect();
            assert!(loads.iter().all(|load| load.step == step));
            let forces: Vec<f64> = loads.iter().map(|load| load.force_n[0]).collect();
            let largest = (forces.windows(2)).map(|pair| (pair[1] - pair[0]).abs());
            // The quintic's largest speed is 1.875.
            assert!(largest.fold(0.0, f64::max) < 1.9);
            assert!((0..99).all(|cycle| forces[cycle] != value) && forces[99] == value);
        }
    }

    #[test]
    fn a_copy_has_the_present_load_and_no_generator() {
        let (mut generator, applied) = load_generator();
        generator.set(&uniform(3)).unwrap();
        let mut copy = applied.clone();
        generator.set(&uniform(5)).unwrap();
        assert_eq!(copy.load(), uniform(3));
        // Its own one moves the first no more.
        let mut own = copy.generator();
        own.set(&uniform(7)).unwrap();
        let mut applied = applied;
        assert_eq!((copy.load(), applied.load()), (uniform(7), uniform(5)));
    }

    #[test]
    fn a_bad_load_changes_nothing() {
        let (mut generator, mut applied) = load_generator();
        generator.set(&uniform(1)).unwrap();
        for bad in [f64::NAN, f64::INFINITY, -2e5] {
            let mut load = uniform(2);
            load.moment_nm[1] = bad;
            assert_eq!(generator.set(&load), Err(LoadRefused));
        }
        assert_eq!(applied.load(), uniform(1));
    }

    #[test]
    fn a_load_is_never_a_mixture() {
        let (mut generator, mut applied) = load_generator();
        std::thread::scope(|scope| {
            scope.spawn(move || {
                for step in 0..50_000 {
                    generator.set(&uniform(step)).unwrap();
                }
            });
            let mut last = 0;
            while last < 49_999 {
                let load = applied.load();
                assert_eq!(load, uniform(load.step));
                assert!(load.step >= last);
                last = load.step;
            }
        });
    }
}
