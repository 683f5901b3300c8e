//! Pull of the strap.

use nalgebra::{UnitQuaternion, Vector6};

/// Ticks over which the pull is averaged.
const PULL_TICKS: u32 = 100;
/// Largest difference of a pull from its level: as a share, at least in newtons, at most as a share
/// of the way to the next level.
const SHARE: f64 = 0.1;
const MIN_TOLERANCE_N: f64 = 5.0;
const APART: f64 = 0.4;

/// Pull of the strap, averaged.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Pull {
    sum: Vector6<f64>,
    count: u32,
    /// Force along the direction of the series, N.
    pub(crate) force_n: f64,
    pub(crate) is_at_level: bool,
    /// Rotation of the platform, as it was predicted last.
    pub(crate) rotation: UnitQuaternion<f64>,
}

impl Pull {
    /// Adds a sample. Returns the mean once there are enough, and begins the next.
    pub(crate) fn add(&mut self, seen: &Vector6<f64>) -> Option<Vector6<f64>> {
        self.sum += seen;
        self.count += 1;
        (self.count == PULL_TICKS).then(|| {
            self.count = 0;
            std::mem::take(&mut self.sum) / f64::from(PULL_TICKS)
        })
    }
}

/// Returns the largest difference of a pull from a level: less than half the way to any other level
/// of the series.
pub(crate) fn tolerance_n(levels_n: &[f64], level_n: f64) -> f64 {
    let apart = levels_n.iter().map(|other| (other - level_n).abs());
    let nearest_n = apart
        .filter(|apart| *apart > 0.0)
        .fold(f64::INFINITY, f64::min);
    (SHARE * level_n)
        .max(MIN_TOLERANCE_N)
        .min(APART * nearest_n)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_distinguished() {
        let levels = [0.0, 60.0, 300.0, 320.0, 300.0];
        assert!((tolerance_n(&levels, 0.0) - 5.0).abs() < 1e-12);
        assert!((tolerance_n(&levels, 60.0) - 6.0).abs() < 1e-12);
        assert!(
            (tolerance_n(&levels, 300.0) - 8.0).abs() < 1e-12,
            "nearer than half the way to 320"
        );
        assert!((tolerance_n(&[0.0, 1.0], 1.0) - 0.4).abs() < 1e-12);
    }
}
