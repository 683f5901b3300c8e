//! Sections of a robot file, as they are written.

use gantry_tau_core::units::PositionNm;
use nalgebra::Matrix3;
use serde::{Deserialize, Deserializer};

use super::matrix;

/// Reads one entry per axis. serde reads arrays of a fixed length, not of a generic one.
fn each<'de, D: Deserializer<'de>, T: Deserialize<'de>, const N: usize>(deserializer: D) -> Result<[T; N], D::Error> {
    let entries = Vec::deserialize(deserializer)?;
    entries.try_into().map_err(|entries: Vec<T>| {
        let count = entries.len();
        serde::de::Error::custom(format!("has {count} entries, the machine has {N} axes"))
    })
}

/// `[axes]`: one entry per axis.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Axes<const N: usize> {
    /// Range of the nominal path, `[lower, upper]`, m.
    #[serde(deserialize_with = "each")]
    pub nominal_travel_m: [[f64; 2]; N],
    /// Range of the machine, `[lower, upper]`, m: wider than the nominal travel by at least the position offset's limit.
    #[serde(deserialize_with = "each")]
    pub machine_travel_m: [[f64; 2]; N],
    /// Length of one unit of `q`, m: `|v_i|`.
    #[serde(deserialize_with = "each")]
    pub metres_per_q: [f64; N],
    /// Largest step of the nominal reference, µm per tick.
    #[serde(deserialize_with = "each")]
    pub nominal_step_um: [f64; N],
    /// Limits of the position offset.
    pub position: PositionSection<N>,
    /// Limits of the velocity offset.
    pub velocity: VelocitySection<N>,
    /// Limits of the torque offset.
    pub torque: TorqueSection<N>,
}

/// `[axes.position]`, µm per tick where a rate; whole nanometres.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PositionSection<const N: usize> {
    /// Largest magnitude, µm; 0 disables the channel.
    #[serde(deserialize_with = "each")]
    pub max_um: [f64; N],
    /// Largest change per tick, µm.
    #[serde(deserialize_with = "each")]
    pub step_um: [f64; N],
    /// Largest change of the change, µm.
    #[serde(deserialize_with = "each")]
    pub accel_um: [f64; N],
    /// Change per tick on the way back to zero, µm.
    #[serde(deserialize_with = "each")]
    pub ramp_um: [f64; N],
}

/// `[axes.velocity]`, µm/s.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VelocitySection<const N: usize> {
    /// Largest magnitude, µm/s; 0 disables the channel.
    #[serde(deserialize_with = "each")]
    pub max_um_s: [i32; N],
    /// Largest change per tick, µm/s.
    #[serde(deserialize_with = "each")]
    pub step_um_s: [i32; N],
    /// Largest change of the change, µm/s.
    #[serde(deserialize_with = "each")]
    pub accel_um_s: [i32; N],
    /// Change per tick on the way back to zero, µm/s.
    #[serde(deserialize_with = "each")]
    pub ramp_um_s: [i32; N],
}

/// `[axes.torque]`, per mille of rated torque.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TorqueSection<const N: usize> {
    /// Largest magnitude, ‰; 0 disables the channel.
    #[serde(deserialize_with = "each")]
    pub max_permille: [i16; N],
    /// Largest change per tick, ‰.
    #[serde(deserialize_with = "each")]
    pub step_permille: [i16; N],
    /// Largest change of the change, ‰.
    #[serde(deserialize_with = "each")]
    pub accel_permille: [i16; N],
    /// Change per tick on the way back to zero, ‰.
    #[serde(deserialize_with = "each")]
    pub ramp_permille: [i16; N],
}

/// `[motors]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motors {
    /// Axis of each motor, counted from 0; every axis has one.
    pub axis_of_motor: Vec<usize>,
}

/// `[sensor]`: the force sensor on the platform.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sensor {
    /// World axes from sensor axes, by rows.
    pub rotation: [[f64; 3]; 3],
    /// From the tool centre point to the sensor's origin, world axes, m.
    pub lever_m: [f64; 3],
    /// Cut-off of the low-pass, Hz.
    pub cutoff_hz: f64,
    /// Samples that the tare averages.
    pub tare_samples: u32,
}

impl Sensor {
    /// World axes from sensor axes.
    #[must_use]
    pub fn rotation_matrix(&self) -> Matrix3<f64> {
        matrix(&self.rotation)
    }
}

/// `[client]`: the compensating client.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Client {
    /// Share of the computed correction that is asked for, 0 to 1.
    pub gain: f64,
}

/// `[simulation]`: the simulated machine.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Simulation {
    /// Seed of deviations and noise.
    pub seed: u64,
    /// Each true compliance is the nominal one times `1 + uniform(-spring_deviation..spring_deviation)`.
    pub spring_deviation: f64,
    /// Standard deviation of the sensor's forces, N.
    pub force_noise_n: f64,
    /// Standard deviation of the sensor's moments, N m.
    pub moment_noise_nm: f64,
    /// One step of the length gauges, m.
    pub gauge_resolution_m: f64,
    /// Force in x at which the platform leaves cart 3, N.
    pub jump_force_n: f64,
    /// The play it crosses then, m.
    pub jump_gap_m: f64,
    /// Home of the tool centre point, world axes, m.
    pub home_m: [f64; 3],
}

/// The four limits of one channel, in the channel's integer unit (nm, µm/s or ‰): `0 <= max`, `0 < ramp <= step`, `step + ramp <= accel`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChannelLimits {
    /// Largest magnitude; 0 disables the channel.
    pub max: i32,
    /// Largest change per tick.
    pub step: i32,
    /// Largest change of the change.
    pub accel: i32,
    /// Change per tick on the way back to zero.
    pub ramp: i32,
}

/// Everything about one axis, in the units of the reference path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AxisLimits {
    /// Lower and upper end of the nominal travel.
    pub nominal_travel: (PositionNm, PositionNm),
    /// Lower and upper end of the machine's travel.
    pub machine_travel: (PositionNm, PositionNm),
    /// Largest step of the nominal reference per tick, nm.
    pub nominal_step_nm: i64,
    /// Position offset, nm.
    pub position: ChannelLimits,
    /// Velocity offset, µm/s.
    pub velocity: ChannelLimits,
    /// Torque offset, ‰.
    pub torque: ChannelLimits,
}
