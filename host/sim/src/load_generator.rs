//! Load on the tool, set by another thread while the cycle runs: the ratchet strap of `[T 4.2.9]`.
//!
//! The cycle never waits: while a load is being set it keeps the one before. A load is taken over
//! whole or not at all.

use std::fmt;
use std::sync::{Arc, Mutex, PoisonError, TryLockError};

use gantry_tau_core::model::statics::Wrench;

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

/// Sets the load on the tool, from any thread.
#[derive(Debug)]
pub struct LoadGenerator {
    shared: Arc<Mutex<Load>>,
}

/// Reads the load on the tool, in the cycle.
#[derive(Debug)]
pub struct AppliedLoad {
    shared: Arc<Mutex<Load>>,
    last: Load,
}

/// Creates a load generator and the load it applies, which is zero.
#[must_use]
pub fn load_generator() -> (LoadGenerator, AppliedLoad) {
    let last = Load::default();
    let shared = Arc::new(Mutex::new(last));
    (
        LoadGenerator {
            shared: Arc::clone(&shared),
        },
        AppliedLoad { shared, last },
    )
}

impl LoadGenerator {
    /// Applies `load` from the next cycle on.
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
        *self.shared.lock().unwrap_or_else(PoisonError::into_inner) = *load;
        Ok(())
    }

    /// Releases the tool: zero load.
    pub fn release(&mut self) {
        // Zero is always accepted.
        let _ = self.set(&Load::default());
    }
}

impl AppliedLoad {
    /// Returns the present load; while one is being set, the load before. It never waits.
    pub fn load(&mut self) -> Load {
        match self.shared.try_lock() {
            Ok(load) => self.last = *load,
            Err(TryLockError::Poisoned(load)) => self.last = *load.into_inner(),
            Err(TryLockError::WouldBlock) => {}
        }
        self.last
    }
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
