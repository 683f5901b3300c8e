//! `[drives]`: the drives of the simulated machine, and what a real one must be set to.

use serde::Deserialize;

use super::drive_profile::{Interface, MAX_DELAY, Profile, RATED_FORCE_N, TORQUE_LIMIT};
use super::problems::Problems;
use super::sections::{Axes, Motors};
use crate::drive_cascade::POSITION_GAIN;

/// Largest additive torque, per mille of rated torque (S-0-0081).
const MAX_TORQUE_PERMILLE: i16 = 1_000;

/// `[drives]`. Every key has a default.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DriveKeys {
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
    /// Gain of the position loop: velocity per position error, 1/s.
    pub position_gain_per_s: f64,
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

impl Default for DriveKeys {
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
            position_gain_per_s: POSITION_GAIN,
            velocity_feed_forward_percent: 100.0,
            position_integral_ms: None,
            peak_seconds: None,
            friction_n: 0.0,
            stiction_n: None,
        }
    }
}

/// Checks the ranges of the section.
pub(super) fn check(drives: &DriveKeys, problems: &mut Problems) {
    let d = drives;
    let most_n = TORQUE_LIMIT * RATED_FORCE_N;
    let most_percent = d.profile.most_feed_forward_percent();
    let percent = d.velocity_feed_forward_percent;
    let counts = d.encoder_counts_per_turn;
    for (key, value, lower, upper) in [
        (
            "command_delay_cycles",
            d.command_delay_cycles.into(),
            0.0,
            MAX_DELAY.into(),
        ),
        (
            "actual_delay_cycles",
            d.actual_delay_cycles.into(),
            0.0,
            MAX_DELAY.into(),
        ),
        ("watchdog_cycles", d.watchdog_cycles.into(), 1.0, 1e3),
        ("quick_stop_m_per_s2", d.quick_stop_m_per_s2, 0.1, 100.0),
        ("following_error_um", d.following_error_um, 1.0, 1e6),
        ("following_error_ms", d.following_error_ms.into(), 1.0, 1e4),
        (
            "encoder_counts_per_turn",
            counts.into(),
            256.0,
            f64::from(1 << 30),
        ),
        ("metres_per_turn", d.metres_per_turn, 1e-4, 10.0),
        ("bias_permille", d.bias_permille.into(), 0.0, 1e3),
        ("backlash_um", d.backlash_um, 0.0, 1e3),
        ("friction_n", d.friction_n, 0.0, RATED_FORCE_N),
        (
            "stiction_n",
            d.stiction_n.unwrap_or(d.friction_n),
            d.friction_n,
            most_n,
        ),
        ("position_gain_per_s", d.position_gain_per_s, 1.0, 499.0),
        ("velocity_feed_forward_percent", percent, 0.0, most_percent),
        (
            "peak_seconds",
            d.peak_seconds.unwrap_or(d.profile.peak_s()),
            0.0,
            60.0,
        ),
    ] {
        problems.range(&format!("drives.{key}"), value, lower, upper);
    }
    check_position_integral(d, problems);
}

fn check_position_integral(drives: &DriveKeys, problems: &mut Problems) {
    let key = "drives.position_integral_ms";
    let of_profile = drives.profile.position_integral_ms();
    match (drives.position_integral_ms, of_profile) {
        (Some(_), None) => {
            let name = drives.profile.name();
            problems.add(
                key,
                format!("is given, but the position loop of an {name} has no integral; remove it"),
            );
        }
        (Some(ms), Some(_)) => problems.range(key, ms, 1.0, 200.0),
        (None, _) => {}
    }
}

/// Checks the section against the machine.
pub(super) fn check_machine<const N: usize>(
    drives: &DriveKeys,
    axes: &Axes<N>,
    motors: &Motors,
    problems: &mut Problems,
) {
    check_bias(drives, motors, problems);
    check_offsets(drives, axes, problems);
}

fn check_bias(drives: &DriveKeys, motors: &Motors, problems: &mut Problems) {
    let motors = &motors.axis_of_motor;
    let has_pair = motors
        .iter()
        .any(|axis| motors.iter().filter(|of| *of == axis).count() == 2);
    if drives.bias_permille > 0 && !has_pair {
        let reason =
            "is for two motors on one axis, and motors.axis_of_motor has no such pair; set it to 0";
        problems.add("drives.bias_permille", reason);
    }
}

/// Checks that the drives take the offsets that the limits allow.
fn check_offsets<const N: usize>(drives: &DriveKeys, axes: &Axes<N>, problems: &mut Problems) {
    let name = drives.profile.name();
    // With velocities the server's loop adds them.
    let takes_velocities =
        drives.profile.takes_velocity_offsets() || drives.interface == Interface::Velocity;
    for (index, max) in axes.velocity.max_um_s.0.iter().enumerate() {
        if *max > 0 && !takes_velocities {
            let reason = format!(
                "is {max}, but an {name} (drives.profile) takes no velocity offsets; set it to 0"
            );
            problems.add(format!("axes.velocity.max_um_s[{index}]"), reason);
        }
    }
    for (index, max) in axes.torque.max_permille.0.iter().enumerate() {
        if *max > MAX_TORQUE_PERMILLE {
            let reason = format!(
                "is {max}, but an {name} (drives.profile) takes torque offsets up to {MAX_TORQUE_PERMILLE}"
            );
            problems.add(format!("axes.torque.max_permille[{index}]"), reason);
        }
    }
}
