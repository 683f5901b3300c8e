//! Numbers of seeds in tests of statistics.
//!
//! `cargo test` runs a small sample. `GANTRY_TAU_SEEDS=all`, which `.ci/check statistics` sets, runs
//! all seeds of every test, a number runs as many.

/// Seeds of a test.
#[derive(Clone, Copy, Debug)]
pub struct Seeds {
    /// Number of seeds that run.
    pub count: u32,
    all: u32,
}

impl Seeds {
    /// Returns a sample of the seeds, or what `GANTRY_TAU_SEEDS` asks for.
    #[must_use]
    pub fn new(sample: u32, all: u32) -> Self {
        let count = match std::env::var("GANTRY_TAU_SEEDS").as_deref() {
            Err(_) => sample,
            Ok("all") => all,
            Ok(number) => number.parse().expect("GANTRY_TAU_SEEDS: all, or a number"),
        };
        Self { count, all }
    }

    /// Of as many cases as there are seeds, those that run: spread over all.
    pub fn spread<T>(self, cases: impl IntoIterator<Item = T>) -> impl Iterator<Item = T> {
        let step = self.all.div_ceil(self.count.clamp(1, self.all));
        let numbered = (0..step).cycle().zip(cases);
        numbered.filter_map(|(number, case)| (number == 0).then_some(case))
    }

    /// Seeds, from 0 on.
    pub fn iter(self) -> impl Iterator<Item = u64> + Clone {
        0..u64::from(self.count)
    }

    /// Returns a bound for the deviation of a mean over all seeds, widened by as much as a mean over
    /// the sample scatters more.
    #[must_use]
    pub fn widened(self, bound: f64) -> f64 {
        bound * (f64::from(self.all) / f64::from(self.count)).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_is_judged_by_its_own_scatter() {
        let sample = Seeds { count: 8, all: 200 };
        assert_eq!(sample.iter().count(), 8);
        assert!((sample.widened(0.1) - 0.5).abs() < 1e-12);
        let whole = Seeds {
            count: 200,
            all: 200,
        };
        assert_eq!(whole.widened(0.1).to_bits(), 0.1_f64.to_bits());
    }
}
