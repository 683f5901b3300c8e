//! Time that a plan takes.

use std::fmt;

use crate::fit::statistics::float;

/// Minutes for each pose that gauges move to, each strap that is mounted, each level of force, and
/// each place of a target.
const POSE_MIN: f64 = 15.0;
const STRAP_MIN: f64 = 5.0;
const LEVEL_MIN: f64 = 0.25;
const TARGET_MIN: f64 = 2.5;

/// Time in minutes.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub(super) struct Minutes(f64);

impl Minutes {
    /// Of straps and gauges.
    pub(super) fn of_straps(poses: usize, mountings: usize, levels: usize) -> Self {
        Self(float(poses) * POSE_MIN + float(mountings) * STRAP_MIN + float(levels) * LEVEL_MIN)
    }

    /// Of places of a target.
    pub(super) fn of_places(places: usize) -> Self {
        Self(float(places) * TARGET_MIN)
    }
}

impl fmt::Display for Minutes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let minutes = self.0.round();
        write!(
            f,
            "{:.0} h {:02.0} min",
            (minutes / 60.0).floor(),
            minutes % 60.0
        )
    }
}
