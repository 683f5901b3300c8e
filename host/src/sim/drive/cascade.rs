//! Controllers of a drive: position P, velocity PI, in front of the current loop `[T 4.1.7]`.

use gantry_tau_core::control::axis::Reference;

use super::profile::{MASS_KG, POSITION_GAIN, RATED_FORCE_N, TORQUE_LIMIT, VELOCITY_GAIN, VELOCITY_INTEGRAL_S};
use super::{CYCLE_S, SUBSTEP_S, SUBSTEPS};

/// State of the controllers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cascade {
    /// Position of the fine interpolation, m.
    interpolated_m: f64,
    /// Integral part of the velocity loop, N.
    integral_n: f64,
}

/// Motion that is demanded in one cycle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Demand {
    start_m: f64,
    way_m: f64,
    feed_forward_m_per_s: f64,
    /// Torque offset, N.
    offset_n: f64,
}

impl Cascade {
    /// Creates the controllers at rest at a position, m.
    pub(super) const fn at_rest(position_m: f64) -> Self {
        Self { interpolated_m: position_m, integral_n: 0.0 }
    }

    /// Returns the motion of a cycle that ends at `reference`.
    pub(super) fn demand(&self, reference: &Reference) -> Demand {
        let start_m = self.interpolated_m;
        let way_m = reference.position.to_metres().0 - start_m;
        Demand {
            start_m,
            way_m,
            feed_forward_m_per_s: way_m / CYCLE_S + f64::from(reference.velocity_offset.0) * 1e-6,
            offset_n: f64::from(reference.torque_offset.0) * 1e-3 * RATED_FORCE_N,
        }
    }

    /// Returns the force that a step asks of the current loop, N, for a motor at this position (m) and velocity (m/s).
    pub(super) fn force_n(&mut self, demand: &Demand, substep: u32, position_m: f64, velocity_m_per_s: f64) -> f64 {
        // Reference and position at the start of the step: at constant speed the error is then zero.
        let share = f64::from(substep) / f64::from(SUBSTEPS);
        self.interpolated_m = demand.start_m + demand.way_m * share;
        let position_error_m = self.interpolated_m - position_m;
        let velocity_reference = POSITION_GAIN * position_error_m + demand.feed_forward_m_per_s;
        let velocity_error = velocity_reference - velocity_m_per_s;
        let proportional_n = MASS_KG * VELOCITY_GAIN * velocity_error;
        let limit_n = TORQUE_LIMIT * RATED_FORCE_N;
        // The integral stops at the limit, so that it does not wind up.
        let grown_n = self.integral_n + proportional_n * (SUBSTEP_S / VELOCITY_INTEGRAL_S);
        self.integral_n = grown_n.clamp(-limit_n, limit_n);
        (proportional_n + self.integral_n + demand.offset_n).clamp(-limit_n, limit_n)
    }

    /// Ends the cycle: the interpolation has reached the reference.
    pub(super) fn end(&mut self, reference: &Reference) {
        self.interpolated_m = reference.position.to_metres().0;
    }
}
