//! Encoder of a motor: whole counts, and the velocity that a drive computes from them.

use super::profile::{MASS_KG, VELOCITY_GAIN};
use super::{CYCLE_S, SUBSTEP_S};

/// Encoder on a motor that moves its cart by a lead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Encoder {
    /// Way of the cart per count, m.
    step_m: f64,
}

impl Encoder {
    /// Creates an encoder with this many counts per turn, on a motor that moves its cart by this
    /// way (m) per turn.
    #[must_use]
    pub fn new(counts_per_turn: u32, metres_per_turn: f64) -> Self {
        Self {
            step_m: metres_per_turn / f64::from(counts_per_turn),
        }
    }

    /// Returns the way of the cart per count, m.
    #[must_use]
    pub const fn step_m(&self) -> f64 {
        self.step_m
    }

    /// Returns the force that one count asks of the velocity loop, N.
    #[must_use]
    pub fn step_n(&self) -> f64 {
        self.step_m / SUBSTEP_S * VELOCITY_GAIN * MASS_KG
    }

    /// Returns the position that it shows, m: the last whole count.
    fn show_m(&self, position_m: f64) -> f64 {
        (position_m / self.step_m).floor() * self.step_m
    }
}

/// Position (m) and velocity (m/s).
pub(super) type Motion = (f64, f64);

/// Readings of an encoder; without one, of an ideal one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Readings {
    encoder: Option<Encoder>,
    /// Last reading of the loops, and last reading for the report, m.
    last_m: f64,
    reported_m: f64,
}

impl Readings {
    /// Creates an encoder on a motor at rest at a position, m.
    pub(super) fn at_rest(encoder: Option<Encoder>, position_m: f64) -> Self {
        let shown_m = encoder.map_or(position_m, |encoder| encoder.show_m(position_m));
        Self {
            encoder,
            last_m: shown_m,
            reported_m: shown_m,
        }
    }

    /// Returns what the loops measure, once per step: the velocity is the change since the last
    /// step.
    pub(super) fn measure(&mut self, (position_m, velocity_m_per_s): Motion) -> Motion {
        let Some(encoder) = &self.encoder else {
            return (position_m, velocity_m_per_s);
        };
        let shown_m = encoder.show_m(position_m);
        let change_m = shown_m - std::mem::replace(&mut self.last_m, shown_m);
        (shown_m, change_m / SUBSTEP_S)
    }

    /// Returns what is reported, once per cycle: the velocity is the change since the last cycle.
    pub(super) fn report(&mut self, (position_m, velocity_m_per_s): Motion) -> Motion {
        let Some(encoder) = &self.encoder else {
            return (position_m, velocity_m_per_s);
        };
        let shown_m = encoder.show_m(position_m);
        let change_m = shown_m - std::mem::replace(&mut self.reported_m, shown_m);
        (shown_m, change_m / CYCLE_S)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_encoder_at_rest_shows_whole_counts_and_no_velocity() {
        let encoder = Encoder::new(1_000, 0.01);
        for (position_m, shown_m) in [(1.000_004, 1.0), (-0.25, -0.25), (-0.250_001, -0.250_01)] {
            let mut readings = Readings::at_rest(Some(encoder), position_m);
            for (shown, velocity) in [
                readings.measure((position_m, 0.0)),
                readings.report((position_m, 0.0)),
            ] {
                assert!((shown - shown_m).abs() < 1e-12, "{shown} {shown_m}");
                assert_eq!(velocity.to_bits(), 0.0_f64.to_bits());
            }
            // Two counts later: per step of the loops, and per cycle.
            let moved_m = position_m + 2.0 * encoder.step_m();
            let (_, of_loops) = readings.measure((moved_m, 0.0));
            let (_, reported) = readings.report((moved_m, 0.0));
            assert!((of_loops * SUBSTEP_S - 2e-5).abs() < 1e-12, "{of_loops}");
            assert!((reported * CYCLE_S - 2e-5).abs() < 1e-12, "{reported}");
        }
        assert_eq!(Readings::at_rest(None, 1.0).report((2.0, 3.0)), (2.0, 3.0));
    }
}
