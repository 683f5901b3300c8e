//! `[position_loop]`: the loop of the server, for drives that take velocities (`drives.interface = "velocity"`).

use gantry_tau_core::control::channel::{LimitValues, Limits};
use gantry_tau_core::control::position_loop::config::{LoopConfig, LoopValues, MAX_GAIN_TIMES_LAG, MAX_LAG};
use gantry_tau_core::control::session::config::AxisConfig;
use serde::Deserialize;

use super::check::range;
use super::{Drives, Problem};
use crate::plant::OwnStop;
use crate::server::velocity_interface::travel_margin_m;
use crate::sim::drive::profile::Interface;

/// Longest latency of command and measurement together, cycles: the references that a loop keeps.
pub const MAX_LATENCY_CYCLES: u8 = MAX_LAG - 1;
/// Smallest acceleration limit of the loop, in largest accelerations of the nominal path: a limiter that acts in normal motion
/// destabilises a loop.
const ACCELERATION_MARGIN: f64 = 1.2;
/// Units of the gain per 1/s: 2^-16 µm/s per nm.
const GAIN_PER_S: f64 = 65.536;
/// Units of a weight per whole.
const WEIGHT: f64 = 1_024.0;
/// Units of the torque feed-forward per (per mille per m/s^2).
const TORQUE_WEIGHT: f64 = 65.536;
/// Limits of the additive torque, per mille per tick: S-0-0081 in magnitude, half of it in a tick.
const TORQUE: LimitValues = LimitValues { max: 1_000, step: 500, accel: 1_000, ramp: 100 };

/// `[position_loop]`. Every key has a default.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PositionLoopKeys {
    /// Velocity per position error, 1/s; absent: by the latency of the drives.
    pub gain_per_s: Option<f64>,
    /// Velocity feed-forward, %.
    pub velocity_feed_forward_percent: f64,
    /// Torque feed-forward, per mille of rated torque per m/s^2: moved mass over rated force. 0: none.
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

/// Returns the gain for a latency, 1/s: a quarter of the limit of stability and less, without overshoot. 1/900 s is the drive's velocity loop.
#[must_use]
pub fn gain_per_s(latency_cycles: u8) -> f64 {
    0.37 / ((f64::from(latency_cycles) + 1.5) * 1e-3 + 1.0 / 900.0)
}

/// Returns the cycles between a reference and the measurement that belongs to it.
const fn lag(drives: &Drives) -> u8 {
    1_u8.saturating_add(drives.command_delay_cycles).saturating_add(drives.actual_delay_cycles)
}

impl PositionLoopKeys {
    /// Returns the loop's values for these drives, not yet checked.
    ///
    /// # Errors
    /// Limits that contradict each other.
    #[expect(
        clippy::as_conversions,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "numbers that were checked; they saturate"
    )]
    pub(crate) fn values(&self, drives: &Drives) -> Result<LoopValues, Problem> {
        let whole = |value: f64| value.round() as u16;
        let um_s = |m_per_s: f64| (m_per_s * 1e6).round() as i32;
        // Per tick of 1 ms.
        let um_s_per_tick = |m_per_s2: f64| (m_per_s2 * 1e3).round() as i32;
        let step = um_s_per_tick(self.max_m_per_s2);
        let velocity = LimitValues {
            max: um_s(self.max_m_per_s),
            step,
            accel: step.saturating_mul(2),
            ramp: um_s_per_tick(self.stop_m_per_s2),
        };
        let gain = self.gain_per_s.unwrap_or(gain_per_s(lag(drives).saturating_sub(1)));
        let refused = |error| Problem::new("position_loop", error);
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
            velocity: Limits::new(velocity).map_err(refused)?,
            torque: Limits::new(TORQUE).map_err(refused)?,
        })
    }
}

/// Checks the section against drives and axes, and returns the loops' configuration; `None` for drives that take positions.
pub(super) fn check<const N: usize>(
    section: Option<&PositionLoopKeys>,
    drives: Option<&Drives>,
    limits: &[AxisConfig; N],
) -> Result<Option<[LoopConfig; N]>, Problem> {
    let Some(drives) = drives.filter(|drives| drives.interface == Interface::Velocity) else {
        let reason = "is for drives that take velocities; set drives.interface = \"velocity\", or remove it";
        return section.map_or(Ok(None), |_| Err(Problem::new("position_loop", reason)));
    };
    let keys = &section.cloned().unwrap_or_default();
    check_ranges(keys, drives)?;
    check_gain(keys, drives)?;
    check_acceleration(keys)?;
    for (axis, limits) in limits.iter().enumerate() {
        check_axis(keys, drives, axis, limits)?;
    }
    let config = LoopConfig::new(keys.values(drives)?).map_err(|error| Problem::new("position_loop", error))?;
    Ok(Some([config; N]))
}

fn check_ranges(keys: &PositionLoopKeys, drives: &Drives) -> Result<(), Problem> {
    let own =
        |name: &str, value: f64, lower: f64, upper: f64| range(&format!("position_loop.{name}"), value, lower, upper);
    own("gain_per_s", keys.gain_per_s.unwrap_or(1.0), 0.1, 499.0)?;
    own("velocity_feed_forward_percent", keys.velocity_feed_forward_percent, 0.0, 119.0)?;
    own("torque_feed_forward", keys.torque_feed_forward, 0.0, 499.0)?;
    own("integral_ms", keys.integral_ms.unwrap_or(1.0), 1.0, 1_000.0)?;
    own("integral_max_mm_per_s", keys.integral_max_mm_per_s, 0.0, 1e3)?;
    own("max_m_per_s", keys.max_m_per_s, 1e-3, 10.0)?;
    own("max_m_per_s2", keys.max_m_per_s2, 0.1, 1e3)?;
    own("stop_m_per_s2", keys.stop_m_per_s2, 0.1, 1e3)?;
    own("path_m_per_s2", keys.path_m_per_s2, 0.1, 1e3)?;
    range("drives.watchdog_cycles", drives.watchdog_cycles.into(), 1.0, OwnStop::MAX_WATCHDOG_CYCLES.into())
        .map_err(|problem| Problem::new(problem.key, problem.reason + " (drives.interface is \"velocity\")"))?;
    range("drives.following_error_um", drives.following_error_um, 1.0, 16_000.0)?;
    let latency = drives.command_delay_cycles.saturating_add(drives.actual_delay_cycles);
    if latency > MAX_LATENCY_CYCLES {
        let reason = format!(
            "is {}, with drives.command_delay_cycles {latency} together; a position loop outside bears {MAX_LATENCY_CYCLES}",
            drives.actual_delay_cycles
        );
        return Err(Problem::new("drives.actual_delay_cycles", reason));
    }
    Ok(())
}

/// The gain times the lag: beyond a half the loop is near its limit of stability.
fn check_gain(keys: &PositionLoopKeys, drives: &Drives) -> Result<(), Problem> {
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

fn check_acceleration(keys: &PositionLoopKeys) -> Result<(), Problem> {
    if keys.stop_m_per_s2 > keys.max_m_per_s2 {
        let reason = format!("is {}, above position_loop.max_m_per_s2 ({})", keys.stop_m_per_s2, keys.max_m_per_s2);
        return Err(Problem::new("position_loop.stop_m_per_s2", reason));
    }
    let least = ACCELERATION_MARGIN * keys.path_m_per_s2;
    if keys.max_m_per_s2 < least {
        let reason = format!(
            "is {}; it must be at least {least}, {ACCELERATION_MARGIN} times position_loop.path_m_per_s2",
            keys.max_m_per_s2
        );
        return Err(Problem::new("position_loop.max_m_per_s2", reason));
    }
    Ok(())
}

/// The path must not be faster than the loop, and a stop must fit between its end and that of the machine.
fn check_axis(keys: &PositionLoopKeys, drives: &Drives, index: usize, limits: &AxisConfig) -> Result<(), Problem> {
    let path_m_per_s = f64::from(limits.nominal_step_nm) * 1e-6;
    if path_m_per_s > keys.max_m_per_s {
        let reason = format!(
            "lets the path move at {path_m_per_s} m/s, faster than position_loop.max_m_per_s ({})",
            keys.max_m_per_s
        );
        return Err(Problem::new(format!("axes.nominal_step_um[{index}]"), reason));
    }
    let own = OwnStop { watchdog_cycles: drives.watchdog_cycles, quick_stop_m_per_s2: drives.quick_stop_m_per_s2 };
    let way_m = own.way_m(keys.max_m_per_s);
    let margin_m = travel_margin_m(limits);
    if margin_m < way_m {
        let reason = format!(
            "leaves {:.1} mm beyond nominal_travel_m; a stop by the drives takes {:.1} mm \
             (position_loop.max_m_per_s, drives.watchdog_cycles, drives.quick_stop_m_per_s2)",
            margin_m * 1e3,
            way_m * 1e3
        );
        return Err(Problem::new(format!("axes.machine_travel_m[{index}]"), reason));
    }
    Ok(())
}
