//! `[position_loop]`: the loop of the server, for drives that take velocities
//! (`drives.interface = "velocity"`).

use gantry_tau_core::control::channel::{LimitValues, Limits};
use gantry_tau_core::control::position_loop::config::{
    LoopConfig, LoopValues, MAX_GAIN_TIMES_LAG, MAX_LAG,
};
use gantry_tau_core::control::position_loop::quick_stop::{QuickStop, travel_margin_m};
use gantry_tau_core::control::session::config::AxisConfig;
use serde::Deserialize;

use super::problems::{Problem, Problems};
use super::{DriveKeys, Interface};

/// Longest latency of command and measurement together, cycles: the references that a loop keeps.
pub const MAX_LATENCY_CYCLES: u8 = MAX_LAG - 1;
/// Smallest acceleration limit of the loop, in largest accelerations of the nominal path: a limiter
/// that acts in normal motion destabilises a loop.
const ACCELERATION_MARGIN: f64 = 1.2;
/// Units of the gain per 1/s: 2^-16 µm/s per nm.
const GAIN_PER_S: f64 = 65.536;
/// Units of a weight per whole.
const WEIGHT: f64 = 1_024.0;
/// Units of the torque feed-forward per (per mille per m/s^2).
const TORQUE_WEIGHT: f64 = 65.536;
/// Limits of the additive torque, per mille per tick: S-0-0081 in magnitude, half of it in a tick.
const TORQUE: LimitValues = LimitValues {
    max: 1_000,
    step: 500,
    accel: 1_000,
    ramp: 100,
};

/// `[position_loop]`. Every key has a default.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PositionLoopKeys {
    /// Velocity per position error, 1/s; absent: by the latency of the drives.
    pub gain_per_s: Option<f64>,
    /// Velocity feed-forward, %.
    pub velocity_feed_forward_percent: f64,
    /// Torque feed-forward, per mille of rated torque per m/s^2: moved mass over rated force. 0:
    /// none.
    pub torque_feed_forward: f64,
    /// Time of the loop's integral, ms; absent: none.
    pub integral_ms: Option<f64>,
    /// Largest integral, mm/s.
    pub integral_max_mm_per_s: f64,
    /// Largest velocity, m/s.
    pub max_m_per_s: f64,
    /// Largest change of the velocity, m/s^2.
    pub max_m_per_s2: f64,
    /// Ramp of a stop, m/s^2.
    pub stop_m_per_s2: f64,
    /// Largest acceleration of the nominal path, m/s^2.
    pub path_m_per_s2: f64,
}

impl Default for PositionLoopKeys {
    fn default() -> Self {
        Self {
            gain_per_s: None,
            velocity_feed_forward_percent: 100.0,
            torque_feed_forward: 40.0,
            integral_ms: None,
            integral_max_mm_per_s: 10.0,
            max_m_per_s: 0.6,
            max_m_per_s2: 20.0,
            stop_m_per_s2: 10.0,
            path_m_per_s2: 10.0,
        }
    }
}

/// Returns the gain for a latency, 1/s: a quarter of the limit of stability and less, without
/// overshoot. 1/900 s is the drive's velocity loop.
#[must_use]
pub fn gain_per_s(latency_cycles: u8) -> f64 {
    0.37 / ((f64::from(latency_cycles) + 1.5) * 1e-3 + 1.0 / 900.0)
}

/// Returns the cycles between a reference and the measurement that belongs to it.
const fn lag(drives: &DriveKeys) -> u8 {
    1_u8.saturating_add(drives.command_delay_cycles)
        .saturating_add(drives.actual_delay_cycles)
}

/// Rounds to a whole number; it saturates.
fn whole(value: f64) -> u16 {
    value.round() as u16
}

/// µm/s, rounded; they saturate.
fn um_s(m_per_s: f64) -> i32 {
    (m_per_s * 1e6).round() as i32
}

/// µm/s per tick of 1 ms, rounded; they saturate.
fn um_s_per_tick(m_per_s2: f64) -> i32 {
    (m_per_s2 * 1e3).round() as i32
}

fn limits<U>(values: LimitValues) -> Result<Limits<U>, Problem> {
    Limits::new(values).map_err(|error| Problem::new("position_loop", error))
}

impl PositionLoopKeys {
    /// Returns the loop's values for these drives, not yet checked.
    ///
    /// # Errors
    /// Limits that contradict each other.
    #[expect(
        clippy::as_conversions,
        clippy::cast_possible_truncation,
        reason = "numbers that were checked; they saturate"
    )]
    pub fn values(&self, drives: &DriveKeys) -> Result<LoopValues, Problem> {
        let step = um_s_per_tick(self.max_m_per_s2);
        let velocity = LimitValues {
            max: um_s(self.max_m_per_s),
            step,
            accel: step.saturating_mul(2),
            ramp: um_s_per_tick(self.stop_m_per_s2),
        };
        let gain = self
            .gain_per_s
            .unwrap_or(gain_per_s(lag(drives).saturating_sub(1)));
        Ok(LoopValues {
            gain: whole(gain * GAIN_PER_S),
            velocity_feed_forward: whole(self.velocity_feed_forward_percent * 0.01 * WEIGHT),
            torque_feed_forward: whole(self.torque_feed_forward * TORQUE_WEIGHT),
            // Per tick of 1 ms.
            integral: self.integral_ms.map_or(0, |ms| whole(WEIGHT / ms)),
            integral_max: um_s(self.integral_max_mm_per_s * 1e-3),
            lag: lag(drives),
            window_nm: (drives.following_error_um * 1e3).round() as i32,
            window_ticks: drives.following_error_ms as u16,
            velocity: limits(velocity)?,
            torque: limits(TORQUE)?,
        })
    }
}

/// Checks the section against drives and axes, and returns the loops' configuration; `None` for
/// drives that take positions, and for those whose loops are wrong.
pub(super) fn check<const N: usize>(
    section: Option<&PositionLoopKeys>,
    drives: Option<&DriveKeys>,
    limits: &[AxisConfig; N],
    problems: &mut Problems,
) -> Option<[LoopConfig; N]> {
    let Some(drives) = drives.filter(|drives| drives.interface == Interface::Velocity) else {
        if section.is_some() {
            let reason = "is for drives that take velocities; set drives.interface = \"velocity\", or remove it";
            problems.add("position_loop", reason);
        }
        return None;
    };
    let keys = &section.cloned().unwrap_or_default();
    // What follows is computed from these numbers.
    if !problems.none_in(|problems| check_ranges(keys, drives, problems)) {
        return None;
    }
    problems.keep(check_gain(keys, drives));
    check_acceleration(keys, problems);
    for (axis, limits) in limits.iter().enumerate() {
        check_axis(keys, drives, axis, limits, problems);
    }
    let config = keys.values(drives).and_then(|values| {
        LoopConfig::new(values).map_err(|error| Problem::new("position_loop", error))
    });
    problems.keep(config).map(|config| [config; N])
}

fn check_ranges(keys: &PositionLoopKeys, drives: &DriveKeys, problems: &mut Problems) {
    let gain = keys.gain_per_s.unwrap_or(1.0);
    let integral_ms = keys.integral_ms.unwrap_or(1.0);
    let percent = keys.velocity_feed_forward_percent;
    for (key, value, lower, upper) in [
        ("gain_per_s", gain, 0.1, 499.0),
        ("velocity_feed_forward_percent", percent, 0.0, 119.0),
        ("torque_feed_forward", keys.torque_feed_forward, 0.0, 499.0),
        ("integral_ms", integral_ms, 1.0, 1_000.0),
        (
            "integral_max_mm_per_s",
            keys.integral_max_mm_per_s,
            0.0,
            1e3,
        ),
        ("max_m_per_s", keys.max_m_per_s, 1e-3, 10.0),
        ("max_m_per_s2", keys.max_m_per_s2, 0.1, 1e3),
        ("stop_m_per_s2", keys.stop_m_per_s2, 0.1, 1e3),
        ("path_m_per_s2", keys.path_m_per_s2, 0.1, 1e3),
    ] {
        problems.range(&format!("position_loop.{key}"), value, lower, upper);
    }
    let most_cycles = QuickStop::MAX_WATCHDOG_CYCLES;
    if !(1..=most_cycles).contains(&drives.watchdog_cycles) {
        let reason = format!(
            "is {}; expected from 1 to {most_cycles} (drives.interface is \"velocity\")",
            drives.watchdog_cycles
        );
        problems.add("drives.watchdog_cycles", reason);
    }
    let error_um = drives.following_error_um;
    problems.range("drives.following_error_um", error_um, 1.0, 16_000.0);
    let latency = drives
        .command_delay_cycles
        .saturating_add(drives.actual_delay_cycles);
    if latency > MAX_LATENCY_CYCLES {
        let reason = format!(
            "is {}, with drives.command_delay_cycles {latency} together; a position loop outside bears {MAX_LATENCY_CYCLES}",
            drives.actual_delay_cycles
        );
        problems.add("drives.actual_delay_cycles", reason);
    }
}

/// The gain times the lag: beyond a half the loop is near its limit of stability.
fn check_gain(keys: &PositionLoopKeys, drives: &DriveKeys) -> Result<(), Problem> {
    let cycles = f64::from(lag(drives)) + 1.0;
    let most_per_s = f64::from(MAX_GAIN_TIMES_LAG) / GAIN_PER_S / cycles;
    match keys.gain_per_s {
        Some(gain) if gain > most_per_s => {
            let reason = format!(
                "is {gain}; with latencies of {} and {} cycles (drives) it must be at most {most_per_s:.1}",
                drives.command_delay_cycles, drives.actual_delay_cycles
            );
            Err(Problem::new("position_loop.gain_per_s", reason))
        }
        _ => Ok(()),
    }
}

fn check_acceleration(keys: &PositionLoopKeys, problems: &mut Problems) {
    if keys.stop_m_per_s2 > keys.max_m_per_s2 {
        let reason = format!(
            "is {}, above position_loop.max_m_per_s2 ({})",
            keys.stop_m_per_s2, keys.max_m_per_s2
        );
        problems.add("position_loop.stop_m_per_s2", reason);
    }
    let least = ACCELERATION_MARGIN * keys.path_m_per_s2;
    if keys.max_m_per_s2 < least {
        let reason = format!(
            "is {}; it must be at least {least}, {ACCELERATION_MARGIN} times position_loop.path_m_per_s2",
            keys.max_m_per_s2
        );
        problems.add("position_loop.max_m_per_s2", reason);
    }
}

/// The path must not be faster than the loop, and a stop must fit between its end and that of the
/// machine.
fn check_axis(
    keys: &PositionLoopKeys,
    drives: &DriveKeys,
    index: usize,
    limits: &AxisConfig,
    problems: &mut Problems,
) {
    let path_m_per_s = f64::from(limits.nominal_step_nm) * 1e-6;
    if path_m_per_s > keys.max_m_per_s {
        let reason = format!(
            "lets the path move at {path_m_per_s} m/s, faster than position_loop.max_m_per_s ({})",
            keys.max_m_per_s
        );
        problems.add(format!("axes.nominal_step_um[{index}]"), reason);
    }
    let own = QuickStop {
        watchdog_cycles: drives.watchdog_cycles,
        quick_stop_m_per_s2: drives.quick_stop_m_per_s2,
    };
    let way_m = own.stopping_distance_m(keys.max_m_per_s);
    let margin_m = travel_margin_m(limits);
    if margin_m < way_m {
        let reason = format!(
            "leaves {:.1} mm beyond nominal_travel_m; a stop by the drives takes {:.1} mm \
             (position_loop.max_m_per_s, drives.watchdog_cycles, drives.quick_stop_m_per_s2)",
            margin_m * 1e3,
            way_m * 1e3
        );
        problems.add(format!("axes.machine_travel_m[{index}]"), reason);
    }
}
