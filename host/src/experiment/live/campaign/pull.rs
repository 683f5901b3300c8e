//! Pull of the strap, and the clock of a campaign.

use nalgebra::{UnitQuaternion, Vector6};

use crate::experiment::windows::TICK_S;

/// Ticks over which the pull is averaged.
const PULL_TICKS: u32 = 100;
/// Largest difference of a pull from its level: as a share, at least in newtons, at most as a share of the way to the next level.
const SHARE: f64 = 0.1;
const LEAST_N: f64 = 5.0;
const APART: f64 = 0.4;

/// Pull of the strap, averaged.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pull {
    sum: Vector6<f64>,
    count: u32,
    /// Force along the direction of the series, N.
    pub(super) force_n: f64,
    pub(super) is_at_level: bool,
    /// Rotation of the platform, as it was predicted last.
    pub(super) rotation: UnitQuaternion<f64>,
}

impl Pull {
    /// Adds a sample. Returns the mean once there are enough, and begins the next.
    pub(super) fn add(&mut self, seen: &Vector6<f64>) -> Option<Vector6<f64>> {
        self.sum += seen;
        self.count += 1;
        (self.count == PULL_TICKS).then(|| {
            self.count = 0;
            std::mem::take(&mut self.sum) / f64::from(PULL_TICKS)
        })
    }
}

/// Returns the largest difference of a pull from a level: less than half the way to any other level of the series.
pub(super) fn tolerance_n(levels_n: &[f64], level_n: f64) -> f64 {
    let apart = levels_n.iter().map(|other| (other - level_n).abs());
    let nearest_n = apart.filter(|apart| *apart > 0.0).fold(f64::INFINITY, f64::min);
    (SHARE * level_n).max(LEAST_N).min(APART * nearest_n)
}

/// Time since the campaign began: it goes on where the table ended, and stands while the session is lost.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    base_s: f64,
    origin: Option<u64>,
    pub(super) now_s: f64,
}

impl Clock {
    pub(super) const fn from(base_s: f64) -> Self {
        Self { base_s, origin: None, now_s: base_s }
    }

    pub(super) fn at(&mut self, tick: u64) -> f64 {
        let origin = *self.origin.get_or_insert(tick);
        self.now_s = self.base_s + tick.saturating_sub(origin) as f64 * TICK_S;
        self.now_s
    }

    pub(super) const fn pause(&mut self) {
        (self.base_s, self.origin) = (self.now_s, None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_told_apart() {
        let levels = [0.0, 60.0, 300.0, 320.0, 300.0];
        assert!((tolerance_n(&levels, 0.0) - 5.0).abs() < 1e-12);
        assert!((tolerance_n(&levels, 60.0) - 6.0).abs() < 1e-12);
        assert!((tolerance_n(&levels, 300.0) - 8.0).abs() < 1e-12, "nearer than half the way to 320");
        assert!((tolerance_n(&[0.0, 1.0], 1.0) - 0.4).abs() < 1e-12);
    }

    #[test]
    fn the_clock_stands_while_the_session_is_lost() {
        let mut clock = Clock::from(100.0);
        clock.at(5_000);
        assert!((clock.at(6_500) - 101.5).abs() < 1e-9);
        clock.pause();
        // Another server counts from elsewhere.
        clock.at(3);
        assert!((clock.at(1_003) - 102.5).abs() < 1e-9);
    }
}
