//! Noise behind the intervals: as stated, or as the residuals show it.

use crate::fit::statistics::{NORMAL_95, float, students_t_95};
use crate::springs::fit::Solution;

/// Noise behind the intervals: as stated, or as the residuals show it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Intervals {
    /// By the residuals.
    pub(super) is_scaled: bool,
}

impl Intervals {
    /// Variance of a reading, in stated ones: the factor of every covariance.
    pub(super) fn variance<const N: usize>(self, solution: &Solution<N>) -> f64 {
        if self.is_scaled {
            solution.rows.chi_squared() / float(solution.degrees())
        } else {
            1.0
        }
    }

    /// Half-width of a central 95 % interval, in standard deviations.
    pub(super) fn reach<const N: usize>(self, solution: &Solution<N>) -> f64 {
        if self.is_scaled {
            students_t_95(solution.degrees())
        } else {
            NORMAL_95
        }
    }
}
