//! Controllers of a drive: position P or PI, velocity PI, in front of the current loop `[T 4.1.7]`;
//! and the ramp of its quick stop.

use gantry_tau_core::control::axis::Reference;
use gantry_tau_machine::robot_file::{Interface, RATED_FORCE_N};

use super::encoder::Motion;
use super::profile::{MASS_KG, VELOCITY_GAIN, VELOCITY_INTEGRAL_S};
use super::{CYCLE_S, SUBSTEP_S, SUBSTEPS, Settings};

/// State of the controllers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cascade {
    /// Position of the fine interpolation, m.
    interpolated_m: f64,
    /// Integral part of the position loop, m/s.
    position_integral_m_per_s: f64,
    /// Integral part of the velocity loop, N.
    integral_n: f64,
}

/// Motion that is demanded in one cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Demand {
    /// To a reference.
    Follow {
        start_m: f64,
        way_m: f64,
        /// Velocity of the reference, m/s.
        velocity_m_per_s: f64,
        /// Velocity feed-forward, m/s.
        feed_forward_m_per_s: f64,
        /// Torque offset, N.
        offset_n: f64,
    },
    /// To rest, from this velocity at the beginning of the cycle (m/s), with this deceleration
    /// (m/s^2).
    Stop {
        velocity_m_per_s: f64,
        deceleration_m_per_s2: f64,
    },
}

impl Demand {
    /// Returns the demanded velocity at the end of the cycle, m/s.
    pub(super) fn velocity_m_per_s(&self) -> f64 {
        match *self {
            Self::Follow {
                velocity_m_per_s, ..
            } => velocity_m_per_s,
            Self::Stop {
                velocity_m_per_s,
                deceleration_m_per_s2,
            } => ramped(velocity_m_per_s, deceleration_m_per_s2 * CYCLE_S),
        }
    }
}

/// Returns a velocity, nearer to zero by a change.
fn ramped(velocity: f64, change: f64) -> f64 {
    velocity - velocity.clamp(-change, change)
}

impl Cascade {
    /// Creates the controllers at rest at a position, m.
    pub(super) const fn at_rest(position_m: f64) -> Self {
        Self {
            interpolated_m: position_m,
            position_integral_m_per_s: 0.0,
            integral_n: 0.0,
        }
    }

    /// Lets the velocity loop hold this force at rest, N.
    pub(super) const fn hold(&mut self, force_n: f64) {
        self.integral_n = force_n;
    }

    /// Begins again at a position, m. The velocity loop goes on: it holds the load.
    pub(super) const fn restart(&mut self, position_m: f64) {
        *self = Self {
            integral_n: self.integral_n,
            ..Self::at_rest(position_m)
        };
    }

    /// Returns the motion of a cycle to `reference`, at most `reach_m` from where the interpolation
    /// is.
    pub(super) fn follow(
        &self,
        reference: &Reference,
        reach_m: f64,
        settings: &Settings,
    ) -> Demand {
        let offset_m_per_s = f64::from(reference.velocity_offset.0) * 1e-6;
        let start_m = self.interpolated_m;
        let way_m = match settings.interface {
            Interface::Position => {
                (reference.position.to_metres().0 - start_m).clamp(-reach_m, reach_m)
            }
            Interface::Velocity => 0.0,
        };
        let velocity_m_per_s = way_m / CYCLE_S;
        Demand::Follow {
            start_m,
            way_m,
            velocity_m_per_s: velocity_m_per_s + offset_m_per_s,
            feed_forward_m_per_s: velocity_m_per_s * settings.feed_forward + offset_m_per_s,
            offset_n: f64::from(reference.torque_offset.0) * 1e-3 * RATED_FORCE_N,
        }
    }

    /// Returns the force that a step asks of the current loop, N, at most `limit_n`.
    pub(super) fn force_n(
        &mut self,
        demand: &Demand,
        substep: u32,
        (position_m, velocity_m_per_s): Motion,
        limit_n: f64,
        settings: &Settings,
    ) -> f64 {
        let share = f64::from(substep) / f64::from(SUBSTEPS);
        match *demand {
            Demand::Follow {
                start_m,
                way_m,
                feed_forward_m_per_s,
                offset_n,
                ..
            } => {
                // Reference and position at the start of the step: at constant speed the error is
                // then zero.
                self.interpolated_m = start_m + way_m * share;
                let proportional = match settings.interface {
                    Interface::Position => {
                        settings.position_gain_per_s * (self.interpolated_m - position_m)
                    }
                    Interface::Velocity => 0.0,
                };
                let mut reference_m_per_s = proportional + feed_forward_m_per_s;
                if let Some(integral_s) = settings.position_integral_s {
                    self.position_integral_m_per_s += proportional * (SUBSTEP_S / integral_s);
                    reference_m_per_s += self.position_integral_m_per_s;
                }
                self.velocity_loop_n(reference_m_per_s - velocity_m_per_s, offset_n, limit_n)
            }
            Demand::Stop {
                velocity_m_per_s: start_m_per_s,
                deceleration_m_per_s2,
            } => {
                let reference_m_per_s =
                    ramped(start_m_per_s, deceleration_m_per_s2 * share * CYCLE_S);
                self.velocity_loop_n(reference_m_per_s - velocity_m_per_s, 0.0, limit_n)
            }
        }
    }

    fn velocity_loop_n(&mut self, error_m_per_s: f64, offset_n: f64, limit_n: f64) -> f64 {
        let proportional_n = MASS_KG * VELOCITY_GAIN * error_m_per_s;
        // The integral stops at the limit, so that it does not wind up.
        let grown_n = self.integral_n + proportional_n * (SUBSTEP_S / VELOCITY_INTEGRAL_S);
        self.integral_n = grown_n.clamp(-limit_n, limit_n);
        (proportional_n + self.integral_n + offset_n).clamp(-limit_n, limit_n)
    }

    /// Ends the cycle. Returns true if the interpolation is at the reference.
    pub(super) fn end(&mut self, demand: &Demand, reference: &Reference) -> bool {
        let reference_m = reference.position.to_metres().0;
        if let Demand::Follow { start_m, way_m, .. } = *demand {
            let end_m = start_m + way_m;
            // Without the rounding of the sum.
            let is_there = (end_m - reference_m).abs() < 1e-12;
            self.interpolated_m = if is_there { reference_m } else { end_m };
            return is_there;
        }
        false
    }
}
