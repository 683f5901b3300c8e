//! Motor and cart of a drive: current loop, inertia and friction.

use super::SUBSTEP_S;
use super::profile::{CURRENT_SHARE, FRICTION, MASS_KG};

/// State of a motor and its cart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Motor {
    pub(super) position_m: f64,
    pub(super) velocity_m_per_s: f64,
    pub(super) force_n: f64,
}

impl Motor {
    /// Creates a motor at rest at a position, m.
    pub(super) const fn at_rest(position_m: f64) -> Self {
        Self { position_m, velocity_m_per_s: 0.0, force_n: 0.0 }
    }

    /// Integrates a step with this force wanted of the current loop, under a load, N.
    pub(super) fn advance(&mut self, wanted_n: f64, load_n: f64) {
        self.force_n += (wanted_n - self.force_n) * CURRENT_SHARE;
        let sum_n = self.force_n + load_n - FRICTION * self.velocity_m_per_s;
        self.velocity_m_per_s += sum_n / MASS_KG * SUBSTEP_S;
        self.position_m += self.velocity_m_per_s * SUBSTEP_S;
    }
}
