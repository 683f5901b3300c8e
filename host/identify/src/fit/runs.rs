//! Runs test: signs that follow each other too seldom by the other one are not noise.
//!
//! (A. Wald, J. Wolfowitz, "On a test whether two samples are from the same population", Annals of
//! Mathematical Statistics 11, 1940.)

use super::statistics::{float, normal_below};

/// Runs of equal signs in sequences, with the number to expect of independent signs.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Runs {
    /// Runs that were found.
    pub found: usize,
    /// Number to expect.
    pub expected: f64,
    /// Variance of that number.
    pub variance: f64,
}

impl Runs {
    /// Counts the runs of signs of a sequence.
    #[must_use]
    pub fn of(values: &[f64]) -> Self {
        let signs: Vec<bool> = values.iter().map(|value| *value > 0.0).collect();
        if signs.is_empty() {
            return Self::default();
        }
        let changes = signs.windows(2).filter(|pair| pair[0] != pair[1]).count();
        let positive = float(signs.iter().filter(|sign| **sign).count());
        let all = float(signs.len());
        let both = 2.0 * positive * (all - positive);
        let variance = both * (both - all) / (all * all * (all - 1.0).max(1.0));
        Self {
            found: changes + 1,
            expected: 1.0 + both / all,
            variance: variance.max(0.0),
        }
    }

    /// Adds those of another sequence.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            found: self.found + other.found,
            expected: self.expected + other.expected,
            variance: self.variance + other.variance,
        }
    }

    /// Returns the probability of so few runs, or fewer, of independent signs; 1 where their number
    /// has no variance. Normal, with a continuity correction.
    #[must_use]
    pub fn p(&self) -> f64 {
        if self.variance <= 0.0 {
            return 1.0;
        }
        normal_below((float(self.found) + 0.5 - self.expected) / self.variance.sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Ten signs, five of each: all 252 sequences. Six runs are expected, with a variance of 20/9.
    #[test]
    fn expectation_and_variance_are_those_of_all_sequences() {
        let mut all = Vec::new();
        for bits in 0_u32..1024 {
            if bits.count_ones() == 5 {
                let values: Vec<f64> = (0..10)
                    .map(|bit| if bits >> bit & 1 == 1 { 0.5 } else { -2.0 })
                    .collect();
                all.push(Runs::of(&values));
            }
        }
        assert_eq!(all.len(), 252);
        let mean = all.iter().map(|runs| float(runs.found)).sum::<f64>() / 252.0;
        let variance = all
            .iter()
            .map(|runs| (float(runs.found) - mean).powi(2))
            .sum::<f64>()
            / 252.0;
        assert!((mean - all[0].expected).abs() < 1e-12 && (mean - 6.0).abs() < 1e-12);
        assert!(
            (variance - all[0].variance).abs() < 1e-12 && (variance - 20.0 / 9.0).abs() < 1e-12
        );
        // Two runs or fewer are 2 of 252; the normal law says 0.9 %.
        assert!((Runs { found: 2, ..all[0] }.p() - 2.0 / 252.0).abs() < 2e-3);
    }

    #[test]
    fn a_bow_has_too_few_runs_and_noise_has_not() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut accused = 0;
        for _ in 0..500 {
            let values: Vec<f64> = (0..60).map(|_| random.random_range(-1.0..1.0)).collect();
            accused += u32::from(Runs::of(&values).p() < 0.01);
        }
        // Binomial: of 500 with 1 % more than 13 are 0.1 %.
        assert!(accused <= 13, "{accused}");
        let bow: Vec<f64> = (0..60_u8)
            .map(|place| 0.2 - (f64::from(place) / 30.0 - 1.0).powi(2))
            .collect();
        let runs = Runs::of(&bow);
        assert!(runs.found == 3 && runs.p() < 1e-9);
        let twice = runs.and(runs);
        assert!(twice.found == 6 && twice.p() < runs.p());
    }

    #[test]
    fn one_sign_or_none_tells_nothing() {
        assert!(
            Runs::of(&[]).p() >= 1.0
                && Runs::of(&[1.0]).p() >= 1.0
                && Runs::of(&[1.0, 2.0, 3.0]).p() >= 1.0
        );
    }
}
