//! The stop by drives themselves, when no new references come.

use crate::control::session::config::AxisConfig;

/// Settings of the drives by which they stop when no new references come.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct QuickStop {
    /// Cycles without new references until the quick stop.
    pub watchdog_cycles: u32,
    /// Deceleration of the quick stop, m/s^2.
    pub quick_stop_m_per_s2: f64,
}

impl QuickStop {
    /// Longest watchdog with which velocities are written, cycles. EtherCAT's default of 100 ms is
    /// 62 mm at 0.5 m/s.
    pub const MAX_WATCHDOG_CYCLES: u32 = 10;

    /// Returns the distance from this velocity (m/s) to rest, m, if nothing more is written:
    /// `v t + v^2 / 2a`.
    #[must_use]
    pub fn stopping_distance_m(&self, velocity_m_per_s: f64) -> f64 {
        let until_watchdog_m = velocity_m_per_s * f64::from(self.watchdog_cycles) * 1e-3;
        until_watchdog_m + velocity_m_per_s * velocity_m_per_s / (2.0 * self.quick_stop_m_per_s2)
    }
}

/// Returns the smallest distance from an end of the path's travel to the machine's, m.
#[must_use]
pub fn travel_margin_m(limits: &AxisConfig) -> f64 {
    let (nominal, machine) = (&limits.nominal_travel, &limits.machine_travel);
    let below_m = nominal.lower.to_metres().0 - machine.lower.to_metres().0;
    let above_m = machine.upper.to_metres().0 - nominal.upper.to_metres().0;
    below_m.min(above_m)
}
