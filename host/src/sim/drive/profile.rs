//! The two drives of the thesis as numbers, and the settings of a drive.
//!
//! | | AX5000 | AX2000 |
//! |---|---|---|
//! | position loop | P | PI, 50 ms |
//! | additive velocity (S-0-0037) | yes | no |
//! | velocity feed-forward (S-0-0296) | 0 to 120 %, 100 by default | 0 to 200 %, 100 by default |
//! | peak current | 7 s | 5 s |
//!
//! Sources: the thesis, 4.1.7 and 6.2.4; Beckhoff's parameter lists (S- and P-numbers) and the function manual of the AX5000 (I*t); for the
//! AX2000 its ASCII commands (`GPTN`: 1 to 200 ms, cannot be switched off; `GPFFV`) and its data sheet. Gains, masses and friction are ASSUMED.

use serde::Deserialize;

use super::encoder::Encoder;
use super::supervision::Limits;

/// Mass of cart and motor, the motor's inertia reflected to the guideway, kg.
pub(super) const MASS_KG: f64 = 40.0;
/// Part of it that turns with the motor, in front of the play, kg.
pub(super) const MOTOR_MASS_KG: f64 = 20.0;
/// Force at rated torque, N.
pub const RATED_FORCE_N: f64 = 1000.0;
/// Torque limit, in rated torques.
pub const TORQUE_LIMIT: f64 = 3.0;
/// Position loop: velocity per position error, 1/s.
pub const POSITION_GAIN: f64 = 150.0;
/// Velocity loop: acceleration per velocity error, 1/s.
pub(super) const VELOCITY_GAIN: f64 = 900.0;
/// Velocity loop: time of its integral, s.
pub(super) const VELOCITY_INTEGRAL_S: f64 = 4.5e-3;
/// Share of the way the current loop goes in one step: `1 - exp(-62.5 µs / 160 µs)`.
pub(super) const CURRENT_SHARE: f64 = 0.323_4;
/// Viscous friction, N s/m.
pub(super) const VISCOUS_FRICTION: f64 = 200.0;
/// Largest deceleration of a quick stop by default, m/s^2.
const QUICK_STOP_M_PER_S2: f64 = 10.0;

/// Kind of drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Profile {
    /// Beckhoff AX5000.
    Ax5000,
    /// Beckhoff AX2000.
    Ax2000,
}

impl Profile {
    /// Name of the drive.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ax5000 => "AX5000",
            Self::Ax2000 => "AX2000",
        }
    }

    /// True if it adds a velocity to the one of its position loop.
    #[must_use]
    pub const fn takes_velocity_offsets(self) -> bool {
        matches!(self, Self::Ax5000)
    }

    /// Time of the position loop's integral by default, ms; `None` for a P loop.
    #[must_use]
    pub const fn position_integral_ms(self) -> Option<f64> {
        match self {
            Self::Ax5000 => None,
            Self::Ax2000 => Some(50.0),
        }
    }

    /// Largest velocity feed-forward, %.
    #[must_use]
    pub const fn most_feed_forward_percent(self) -> f64 {
        match self {
            Self::Ax5000 => 120.0,
            Self::Ax2000 => 200.0,
        }
    }

    /// Time for which the torque limit can be held, s; then rated torque is the limit.
    #[must_use]
    pub const fn peak_s(self) -> f64 {
        match self {
            Self::Ax5000 => 7.0,
            Self::Ax2000 => 5.0,
        }
    }
}

/// Quantity that a drive follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Interface {
    /// Positions; the position loop is the drive's.
    Position,
    /// Velocities: the velocity offset of a reference is all of it, and its position is ignored.
    Velocity,
}

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
}

impl Settings {
    /// Drives that know no failure, no latency and no encoder: those of a robot file without `[drives]`.
    pub const IDEAL: Self = Self {
        interface: Interface::Position,
        position_integral_s: None,
        feed_forward: 1.0,
        command_delay_cycles: 0,
        actual_delay_cycles: 0,
        limits: None,
        quick_stop_m_per_s2: QUICK_STOP_M_PER_S2,
        encoder: None,
        peak_s: None,
        friction: Friction { sliding_n: 0.0, breakaway_n: 0.0 },
        bias: 0.0,
        backlash_m: 0.0,
    };

    /// True if motors and cart of an axis with this number of motors are bodies of their own.
    #[must_use]
    pub fn has_cart(&self, motors: usize) -> bool {
        self.backlash_m > 0.0 || motors > 1 && self.bias > 0.0
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self::IDEAL
    }
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
            let settings = Settings { backlash_m, bias, ..Settings::IDEAL };
            assert_eq!(settings.has_cart(motors), expected, "{backlash_m} {bias} {motors}");
        }
    }
}
