//! Seeded noise.

use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Draws a number of this standard deviation about zero.
pub(crate) fn normal(random: &mut ChaCha8Rng, sd: f64) -> f64 {
    sd * Distribution::<f64>::sample(&StandardNormal, random)
}
