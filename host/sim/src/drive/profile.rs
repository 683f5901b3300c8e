//! Settings of a drive.

pub use gantry_tau_machine::drive_cascade::{
    CURRENT_SHARE, MASS_KG, MOTOR_MASS_KG, POSITION_GAIN, VELOCITY_GAIN, VELOCITY_INTEGRAL_S,
    VISCOUS_FRICTION,
};
pub use gantry_tau_machine::robot_file::{DriveKeys, Interface};

use super::encoder::Encoder;
use super::supervision::Limits;

/// Largest deceleration of a quick stop by default, m/s^2.
const QUICK_STOP_M_PER_S2: f64 = 10.0;

/// Coulomb friction of a guideway, N.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Friction {
    /// In motion.
    pub sliding_n: f64,
    /// Smallest force that moves what stands, at least that in motion.
    pub breakaway_n: f64,
}

/// Settings of a drive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Quantity that it follows.
    pub interface: Interface,
    /// Gain of the position loop: velocity per position error, 1/s.
    pub position_gain_per_s: f64,
    /// Time of the position loop's integral, s; `None` for a P loop.
    pub position_integral_s: Option<f64>,
    /// Velocity feed-forward, 1 for the velocity of the reference.
    pub feed_forward: f64,
    /// Cycles from a command to its effect, at most [`super::MAX_DELAY`].
    pub command_delay_cycles: u8,
    /// Cycles from a measurement to its report, at most [`super::MAX_DELAY`].
    pub actual_delay_cycles: u8,
    /// Watchdog and following error; `None`: a drive that never stops by itself.
    pub limits: Option<Limits>,
    /// Deceleration of the quick stop, m/s^2.
    pub quick_stop_m_per_s2: f64,
    /// Encoder; `None`: position and velocity are known exactly.
    pub encoder: Option<Encoder>,
    /// Time for which the torque limit can be held, s; `None`: for ever.
    pub peak_s: Option<f64>,
    /// Coulomb friction.
    pub friction: Friction,
    /// Torque with which the motors of a pair push against each other, in rated torques.
    pub bias: f64,
    /// Play between each motor and its cart, m.
    pub backlash_m: f64,
    /// Mass in front of the spring of the axis, for each motor, kg: half of it is the motor.
    pub body_kg: f64,
}

impl Settings {
    /// Drives that know no failure, no latency and no encoder: those of a robot file without
    /// `[drives]`.
    pub const IDEAL: Self = Self {
        interface: Interface::Position,
        position_gain_per_s: POSITION_GAIN,
        position_integral_s: None,
        feed_forward: 1.0,
        command_delay_cycles: 0,
        actual_delay_cycles: 0,
        limits: None,
        quick_stop_m_per_s2: QUICK_STOP_M_PER_S2,
        encoder: None,
        peak_s: None,
        friction: Friction {
            sliding_n: 0.0,
            breakaway_n: 0.0,
        },
        bias: 0.0,
        backlash_m: 0.0,
        body_kg: MASS_KG,
    };

    /// True if motors and cart of an axis with this number of motors are bodies of their own.
    #[must_use]
    pub fn has_cart(&self, motors: usize) -> bool {
        self.backlash_m > 0.0 || motors > 1 && self.bias > 0.0
    }
}

impl From<&DriveKeys> for Settings {
    fn from(drives: &DriveKeys) -> Self {
        let integral_ms = drives
            .position_integral_ms
            .or(drives.profile.position_integral_ms());
        Self {
            interface: drives.interface,
            position_gain_per_s: drives.position_gain_per_s,
            position_integral_s: integral_ms.map(|ms| ms * 1e-3),
            feed_forward: drives.velocity_feed_forward_percent * 0.01,
            command_delay_cycles: drives.command_delay_cycles,
            actual_delay_cycles: drives.actual_delay_cycles,
            limits: Some(Limits {
                watchdog_cycles: drives.watchdog_cycles,
                window_nm: whole_nm(drives.following_error_um),
                // A cycle is a millisecond.
                window_cycles: drives.following_error_ms,
            }),
            quick_stop_m_per_s2: drives.quick_stop_m_per_s2,
            encoder: Some(Encoder::new(
                drives.encoder_counts_per_turn,
                drives.metres_per_turn,
            )),
            peak_s: Some(drives.peak_seconds.unwrap_or(drives.profile.peak_s())),
            friction: Friction {
                sliding_n: drives.friction_n,
                breakaway_n: drives.stiction_n.unwrap_or(drives.friction_n),
            },
            bias: f64::from(drives.bias_permille) * 1e-3,
            backlash_m: drives.backlash_um * 1e-6,
            body_kg: MASS_KG,
        }
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self::IDEAL
    }
}

/// Returns micrometres as the nearest nanometre.
#[expect(
    clippy::as_conversions,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a length that was checked; it saturates"
)]
fn whole_nm(um: f64) -> u64 {
    (um * 1e3).round() as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn play_or_a_pair_that_pushes_makes_a_cart_a_body() {
        for (backlash_m, bias, motors, expected) in [
            (0.0, 0.0, 1, false),
            (0.0, 0.0, 2, false),
            (1e-6, 0.0, 1, true),
            (1e-6, 0.0, 2, true),
            (0.0, 0.1, 1, false),
            (0.0, 0.1, 2, true),
        ] {
            let settings = Settings {
                backlash_m,
                bias,
                ..Settings::IDEAL
            };
            assert_eq!(
                settings.has_cart(motors),
                expected,
                "{backlash_m} {bias} {motors}"
            );
        }
    }
}
