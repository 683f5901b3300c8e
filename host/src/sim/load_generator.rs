//! Load on the tool, set by another thread while the cycle runs: the ratchet strap of `[T 4.2.9]`.
//!
//! A sequence lock of atomics. The cycle never waits: while a load is being set it reads the one before. There is one [`LoadGenerator`] for
//! each [`AppliedLoad`] and setting takes it mutably, so there is one writer, without a lock. Every word is an atomic: no torn word, no `unsafe`.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering, fence};

/// Largest magnitude of any component, N or N m.
pub const MAX_LOAD: f64 = 1e5;
/// Reads the cycle tries before it keeps the load it had.
const READ_ATTEMPTS: u32 = 4;

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
    /// Force (N) then moment (N m).
    #[must_use]
    pub const fn wrench(&self) -> [f64; 6] {
        let (f, m) = (&self.force_n, &self.moment_nm);
        [f[0], f[1], f[2], m[0], m[1], m[2]]
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

/// Shared words. `sequence` is odd while they change.
#[derive(Debug, Default)]
struct Shared {
    sequence: AtomicU64,
    step: AtomicU32,
    wrench: [AtomicU64; 6],
}

/// Sets the load on the tool, from any thread.
#[derive(Debug)]
pub struct LoadGenerator {
    shared: Arc<Shared>,
}

/// Reads the load on the tool, in the cycle.
#[derive(Debug)]
pub struct AppliedLoad {
    shared: Arc<Shared>,
    last: Load,
}

/// Creates a load generator and the load it applies, which is zero.
#[must_use]
pub fn load_generator() -> (LoadGenerator, AppliedLoad) {
    let shared = Arc::new(Shared::default());
    let generator = LoadGenerator { shared: Arc::clone(&shared) };
    let last = Load::default();
    (generator, AppliedLoad { shared, last })
}

impl LoadGenerator {
    /// Applies `load` from the next cycle on.
    ///
    /// # Errors
    /// [`LoadRefused`]; then the load before stays.
    pub fn set(&mut self, load: &Load) -> Result<(), LoadRefused> {
        let wrench = load.wrench();
        // `contains` refuses NaN.
        if !wrench.iter().all(|x| (-MAX_LOAD..=MAX_LOAD).contains(x)) {
            return Err(LoadRefused);
        }
        let shared = &*self.shared;
        let even = shared.sequence.load(Ordering::Relaxed);
        shared.sequence.store(even.wrapping_add(1), Ordering::Relaxed);
        // No reader sees a new word without the odd sequence before it.
        fence(Ordering::Release);
        shared.step.store(load.step, Ordering::Relaxed);
        for (word, value) in shared.wrench.iter().zip(wrench) {
            word.store(value.to_bits(), Ordering::Relaxed);
        }
        shared.sequence.store(even.wrapping_add(2), Ordering::Release);
        Ok(())
    }

    /// Releases the tool: zero load.
    pub fn release(&mut self) {
        // Zero is always accepted.
        let _ = self.set(&Load::default());
    }
}

impl AppliedLoad {
    /// Returns the present load, all of one `set`. Bounded; during a write, the load before.
    pub fn load(&mut self) -> Load {
        for _ in 0..READ_ATTEMPTS {
            if let Some(load) = self.shared.try_read() {
                self.last = load;
                break;
            }
        }
        self.last
    }
}

impl Shared {
    /// Returns the words if none of them changed while they were read.
    fn try_read(&self) -> Option<Load> {
        let before = self.sequence.load(Ordering::Acquire);
        let step = self.step.load(Ordering::Relaxed);
        let word = |index: usize| f64::from_bits(self.wrench[index].load(Ordering::Relaxed));
        let load = Load { step, force_n: [word(0), word(1), word(2)], moment_nm: [word(3), word(4), word(5)] };
        // The words are read before the sequence is read again.
        fence(Ordering::Acquire);
        let after = self.sequence.load(Ordering::Relaxed);
        (before == after && before % 2 == 0).then_some(load)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn uniform(step: u32) -> Load {
        let value = f64::from(step);
        Load { step, force_n: [value; 3], moment_nm: [value; 3] }
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
