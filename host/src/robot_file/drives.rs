//! `[drives]`: the drives of the simulated machine, and what a real one must be set to.

use serde::Deserialize;

use super::Problem;
use super::check::range;
use super::sections::{Axes, Motors};
use crate::sim::drive::encoder::Encoder;
use crate::sim::drive::profile::{Friction, Interface, Profile, Settings};
use crate::sim::drive::supervision::Limits;
use crate::sim::drive::{MAX_DELAY, RATED_FORCE_N, TORQUE_LIMIT};

/// Largest additive torque, per mille of rated torque (S-0-0081).
const MOST_TORQUE_PERMILLE: i16 = 1_000;

/// `[drives]`. Every key has a default.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Drives {
    /// Kind of drive.
    pub profile: Profile,
    /// Quantity that it follows.
    pub interface: Interface,
    /// Cycles from a command to its effect.
    pub command_delay_cycles: u8,
    /// Cycles from a measurement to its report.
    pub actual_delay_cycles: u8,
    /// Cycles without new data until the quick stop.
    pub watchdog_cycles: u32,
    /// Deceleration of the quick stop, m/s^2.
    pub quick_stop_m_per_s2: f64,
    /// Following error that is tolerated for any time, um.
    pub following_error_um: f64,
    /// Time outside of it until the quick stop, ms.
    pub following_error_ms: u32,
    /// Counts of the encoder per turn of the motor.
    pub encoder_counts_per_turn: u32,
    /// Way of the cart per turn of the motor, m.
    pub metres_per_turn: f64,
    /// Torque with which the motors of a pair push against each other, per mille of rated torque.
    pub bias_permille: u32,
    /// Play between each motor and its cart, um.
    pub backlash_um: f64,
    /// Velocity feed-forward, %; absent: 100.
    pub velocity_feed_forward_percent: f64,
    /// Time of the position loop's integral, ms; absent: that of the profile.
    pub position_integral_ms: Option<f64>,
    /// Time for which three times the rated torque can be held, s; absent: that of the profile.
    pub peak_seconds: Option<f64>,
    /// Coulomb friction of a cart in motion, N per motor.
    pub friction_n: f64,
    /// Force that moves a cart that stands, N per motor; absent: the friction in motion.
    pub stiction_n: Option<f64>,
}

impl Default for Drives {
    fn default() -> Self {
        Self {
            profile: Profile::Ax5000,
            interface: Interface::Position,
            command_delay_cycles: 1,
            actual_delay_cycles: 1,
            watchdog_cycles: 3,
            quick_stop_m_per_s2: 10.0,
            following_error_um: 2_000.0,
            following_error_ms: 10,
            encoder_counts_per_turn: 1 << 20,
            metres_per_turn: 0.01,
            bias_permille: 0,
            backlash_um: 0.0,
            velocity_feed_forward_percent: 100.0,
            position_integral_ms: None,
            peak_seconds: None,
            friction_n: 0.0,
            stiction_n: None,
        }
    }
}

impl Drives {
    /// Returns the settings of each drive.
    #[must_use]
    pub fn settings(&self) -> Settings {
        let integral_ms = self.position_integral_ms.or(self.profile.position_integral_ms());
        Settings {
            interface: self.interface,
            position_integral_s: integral_ms.map(|ms| ms * 1e-3),
            feed_forward: self.velocity_feed_forward_percent * 0.01,
            command_delay_cycles: self.command_delay_cycles,
            actual_delay_cycles: self.actual_delay_cycles,
            limits: Some(Limits {
                watchdog_cycles: self.watchdog_cycles,
                window_nm: whole_nm(self.following_error_um),
                // A cycle is a millisecond.
                window_cycles: self.following_error_ms,
            }),
            quick_stop_m_per_s2: self.quick_stop_m_per_s2,
            encoder: Some(Encoder::new(self.encoder_counts_per_turn, self.metres_per_turn)),
            peak_s: Some(self.peak_seconds.unwrap_or(self.profile.peak_s())),
            friction: Friction { sliding_n: self.friction_n, breakaway_n: self.stiction_n.unwrap_or(self.friction_n) },
            bias: f64::from(self.bias_permille) * 1e-3,
            backlash_m: self.backlash_um * 1e-6,
        }
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

/// Checks the section against the machine.
pub(super) fn check<const N: usize>(drives: &Drives, axes: &Axes<N>, motors: &Motors) -> Result<(), Problem> {
    let d = drives;
    for (key, cycles) in
        [("command_delay_cycles", d.command_delay_cycles), ("actual_delay_cycles", d.actual_delay_cycles)]
    {
        range(&format!("drives.{key}"), cycles.into(), 0.0, MAX_DELAY.into())?;
    }
    range("drives.watchdog_cycles", d.watchdog_cycles.into(), 1.0, 1e3)?;
    range("drives.quick_stop_m_per_s2", d.quick_stop_m_per_s2, 0.1, 100.0)?;
    range("drives.following_error_um", d.following_error_um, 1.0, 1e6)?;
    range("drives.following_error_ms", d.following_error_ms.into(), 1.0, 1e4)?;
    range("drives.encoder_counts_per_turn", d.encoder_counts_per_turn.into(), 256.0, f64::from(1 << 30))?;
    range("drives.metres_per_turn", d.metres_per_turn, 1e-4, 10.0)?;
    range("drives.bias_permille", d.bias_permille.into(), 0.0, 1e3)?;
    range("drives.backlash_um", d.backlash_um, 0.0, 1e3)?;
    range("drives.friction_n", d.friction_n, 0.0, RATED_FORCE_N)?;
    if let Some(stiction_n) = d.stiction_n {
        range("drives.stiction_n", stiction_n, d.friction_n, TORQUE_LIMIT * RATED_FORCE_N)?;
    }
    let most_percent = d.profile.most_feed_forward_percent();
    range("drives.velocity_feed_forward_percent", d.velocity_feed_forward_percent, 0.0, most_percent)?;
    range("drives.peak_seconds", d.peak_seconds.unwrap_or(d.profile.peak_s()), 0.0, 60.0)?;
    check_position_integral(d)?;
    check_bias(d, motors)?;
    check_offsets(d, axes)
}

fn check_position_integral(drives: &Drives) -> Result<(), Problem> {
    let key = "drives.position_integral_ms";
    match (drives.position_integral_ms, drives.profile.position_integral_ms()) {
        (Some(_), None) => {
            let name = drives.profile.name();
            Err(Problem::new(key, format!("is given, but the position loop of an {name} has no integral; remove it")))
        }
        (Some(ms), Some(_)) => range(key, ms, 1.0, 200.0),
        (None, _) => Ok(()),
    }
}

fn check_bias(drives: &Drives, motors: &Motors) -> Result<(), Problem> {
    let of_axis = |axis: usize| motors.axis_of_motor.iter().filter(|of| **of == axis).count();
    let has_pair = motors.axis_of_motor.iter().any(|axis| of_axis(*axis) == 2);
    if drives.bias_permille > 0 && !has_pair {
        let reason = "is for two motors on one axis, and motors.axis_of_motor has no such pair; set it to 0";
        return Err(Problem::new("drives.bias_permille", reason));
    }
    Ok(())
}

/// Checks that the drives take the offsets that the limits allow.
fn check_offsets<const N: usize>(drives: &Drives, axes: &Axes<N>) -> Result<(), Problem> {
    let name = drives.profile.name();
    // With velocities the server's loop adds them.
    let takes_velocities = drives.profile.takes_velocity_offsets() || drives.interface == Interface::Velocity;
    for (index, max) in axes.velocity.max_um_s.0.iter().enumerate() {
        if *max > 0 && !takes_velocities {
            let reason = format!("is {max}, but an {name} (drives.profile) takes no velocity offsets; set it to 0");
            return Err(Problem::new(format!("axes.velocity.max_um_s[{index}]"), reason));
        }
    }
    for (index, max) in axes.torque.max_permille.0.iter().enumerate() {
        if *max > MOST_TORQUE_PERMILLE {
            let reason =
                format!("is {max}, but an {name} (drives.profile) takes torque offsets up to {MOST_TORQUE_PERMILLE}");
            return Err(Problem::new(format!("axes.torque.max_permille[{index}]"), reason));
        }
    }
    Ok(())
}
