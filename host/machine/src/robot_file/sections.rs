//! Sections of a robot file, as they are written.

use gantry_tau_core::model::sensor;
use nalgebra::Matrix3;
use serde::Deserialize;

use super::drives::DriveKeys;
use super::ethercat::Ethercat;
use super::learned::{Calibrated, Identified, Play};
use super::masses::MassKeys;
use super::matrix;
use super::position_loop::PositionLoopKeys;
use super::read::TableReader;
use crate::accelerometer::{Accelerometer, MeasuredAxes};
use crate::model::{CorrectionKind, WristJoint};

/// Sections of every kind of machine.
pub(super) struct Sections<const N: usize> {
    pub(super) axes: Axes<N>,
    pub(super) motors: Motors,
    pub(super) sensor: Sensor,
    pub(super) client: ClientKeys,
    pub(super) drives: Option<DriveKeys>,
    pub(super) position_loop: Option<PositionLoopKeys>,
    pub(super) ethercat: Option<Ethercat>,
    pub(super) masses: Option<MassKeys>,
    pub(super) simulation: Simulation,
    pub(super) calibrated: Option<Calibrated>,
    pub(super) identified: Option<Identified>,
    pub(super) play: Option<Play>,
    pub(super) wrist: Vec<WristJoint>,
}

impl<const N: usize> Sections<N> {
    pub(super) const NAMES: [&'static str; 13] = [
        "axes",
        "motors",
        "sensor",
        "client",
        "drives",
        "position_loop",
        "ethercat",
        "masses",
        "simulation",
        "calibrated",
        "identified",
        "play",
        "wrist",
    ];

    /// Reads all sections. `None` only if the built-in machine's cannot be read either.
    pub(super) fn read(reader: &mut TableReader<'_, '_>) -> Option<Self> {
        Some(Self {
            axes: reader.section("axes")?,
            motors: reader.section("motors")?,
            sensor: reader.section("sensor")?,
            client: reader.section("client")?,
            drives: reader.optional("drives"),
            position_loop: reader.optional("position_loop"),
            ethercat: reader.optional("ethercat"),
            masses: reader.optional("masses"),
            simulation: reader.section("simulation")?,
            calibrated: reader.optional("calibrated"),
            identified: reader.optional("identified"),
            play: reader.optional("play"),
            wrist: reader.optional("wrist").unwrap_or_default(),
        })
    }
}

/// One entry per axis. serde reads arrays of a fixed length, not of a generic one.
#[derive(Deserialize)]
#[serde(try_from = "Vec<T>")]
pub(super) struct Each<T, const N: usize>(pub(super) [T; N]);

/// A list of another length than the machine has axes.
#[derive(Debug, thiserror::Error)]
#[error("has {entries} entries, the machine has {axes} axes")]
pub(super) struct EntriesError {
    entries: usize,
    axes: usize,
}

impl<T, const N: usize> TryFrom<Vec<T>> for Each<T, N> {
    type Error = EntriesError;

    fn try_from(entries: Vec<T>) -> Result<Self, EntriesError> {
        let entries = <[T; N]>::try_from(entries);
        entries.map(Self).map_err(|entries| EntriesError {
            entries: entries.len(),
            axes: N,
        })
    }
}

/// `[axes]`. Travels are `[lower, upper]`, m; a step is a change per tick.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Axes<const N: usize> {
    pub(super) nominal_travel_m: Each<[f64; 2], N>,
    pub(super) machine_travel_m: Each<[f64; 2], N>,
    pub(super) metres_per_q: Each<f64, N>,
    pub(super) nominal_step_um: Each<f64, N>,
    /// Largest second difference of the nominal reference, whole nanometres; absent: it is not
    /// looked at.
    pub(super) nominal_accel_um: Option<Each<f64, N>>,
    #[serde(default)]
    pub(super) nominal_accel_is_fault: bool,
    pub(super) position: Position<N>,
    pub(super) velocity: Velocity<N>,
    pub(super) torque: Torque<N>,
}

/// `[axes.position]`: the limits `M`, `S`, `A`, `rho` of the position offset, whole nanometres.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Position<const N: usize> {
    pub(super) max_um: Each<f64, N>,
    pub(super) step_um: Each<f64, N>,
    pub(super) accel_um: Each<f64, N>,
    pub(super) ramp_um: Each<f64, N>,
    /// Agitation budget, whole µm/s; absent: none.
    pub(super) agitation_um_per_s: Option<Each<u32, N>>,
}

/// `[axes.velocity]`, as [`Position`].
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Velocity<const N: usize> {
    pub(super) max_um_s: Each<i32, N>,
    pub(super) step_um_s: Each<i32, N>,
    pub(super) accel_um_s: Each<i32, N>,
    pub(super) ramp_um_s: Each<i32, N>,
}

/// `[axes.torque]`, per mille of rated torque, as [`Position`].
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Torque<const N: usize> {
    pub(super) max_permille: Each<i16, N>,
    pub(super) step_permille: Each<i16, N>,
    pub(super) accel_permille: Each<i16, N>,
    pub(super) ramp_permille: Each<i16, N>,
    pub(super) rated_n: Option<Each<f64, N>>,
}

/// `[motors]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motors {
    /// Axis of each motor, counted from 0; every axis has one.
    pub axis_of_motor: Vec<usize>,
}

impl Motors {
    /// Number of motors of each axis.
    #[must_use]
    pub fn per_axis<const N: usize>(&self) -> [f64; N] {
        std::array::from_fn(|axis| self.sum_on(axis, self.axis_of_motor.iter().map(|_| 1.0)))
    }

    /// Sum of what the motors of an axis have, one number per motor.
    pub(super) fn sum_on(&self, axis: usize, each: impl Iterator<Item = f64>) -> f64 {
        let of_axis = self.axis_of_motor.iter().zip(each);
        of_axis
            .filter(|(of, _)| **of == axis)
            .map(|(_, value)| value)
            .sum()
    }
}

/// `[sensor]`: the force sensor on the platform.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sensor {
    /// Platform axes from sensor axes, by rows.
    pub rotation: [[f64; 3]; 3],
    /// From the tool centre point to the sensor's origin, platform axes, m.
    pub lever_m: [f64; 3],
    /// Tool that the sensor carries; without it the weight is part of the tare.
    #[serde(default)]
    pub tool: ToolKeys,
    /// Filter of the load; absent: [`FilterKey::Auto`] with `[masses]`, else
    /// [`FilterKey::FirstOrder`].
    pub filter: Option<FilterKey>,
    /// Cut-off of the low-pass, Hz.
    pub cutoff_hz: f64,
    /// Number of notches of [`FilterKey::Auto`], at most
    /// [`MAX_NOTCHES`](gantry_tau_core::model::load_filter::MAX_NOTCHES).
    #[serde(default = "default_notches")]
    pub notches: u8,
    /// Their Q.
    #[serde(default = "default_notch_q")]
    pub notch_q: f64,
    /// Samples that the tare averages.
    pub tare_samples: u32,
    /// Accelerometer on the platform, if there is one; needs `[masses]`.
    pub accelerometer: Option<AccelerometerKeys>,
}

/// Filter of the load.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FilterKey {
    /// Low-pass of first order.
    FirstOrder,
    /// Butterworth low-pass of second order.
    SecondOrder,
    /// The same with notches at the natural frequencies of the machine where it is; needs
    /// `[masses]`.
    Auto,
}

/// Number of notches by default.
pub const DEFAULT_NOTCHES: u8 = 2;
/// Q of a notch by default: wide enough for frequencies that are 20 % wrong.
pub const DEFAULT_NOTCH_Q: f64 = 0.7;

fn default_notches() -> u8 {
    DEFAULT_NOTCHES
}

fn default_notch_q() -> f64 {
    DEFAULT_NOTCH_Q
}

/// `[sensor.tool]`: the weight that the sensor carries.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ToolKeys {
    /// Its weight, a force, world axes, N.
    pub weight_n: [f64; 3],
    /// From the tool centre point to its centre of gravity, platform axes, m.
    pub centre_m: [f64; 3],
}

/// `[sensor.accelerometer]`: an accelerometer on the platform, which takes the tool's inertia out of
/// the measured load.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AccelerometerKeys {
    /// From the tool centre point to its place, platform axes, m.
    pub place_m: [f64; 3],
    /// Components that it measures: 3, the linear acceleration; 6, the angular one as well.
    pub axes: u8,
    /// Platform axes from its axes, by rows; absent: they are the same.
    #[serde(default = "same_axes")]
    pub rotation: [[f64; 3]; 3],
    /// Share of the tool's inertia that is taken out of the load, 0 to 1.
    #[serde(default = "default_share")]
    pub share: f64,
    /// It shows gravity, as +9.81 m/s^2 upwards; false for one without a steady part.
    #[serde(default = "default_shows_gravity")]
    pub gravity: bool,
}

/// Leaves a margin for a tool that is lighter than in the file.
fn default_share() -> f64 {
    0.9
}

fn default_shows_gravity() -> bool {
    true
}

fn same_axes() -> [[f64; 3]; 3] {
    Matrix3::identity().into()
}

impl From<AccelerometerKeys> for Accelerometer {
    fn from(keys: AccelerometerKeys) -> Self {
        Self {
            rotation: matrix(keys.rotation),
            place_m: keys.place_m.into(),
            axes: match keys.axes {
                6 => MeasuredAxes::Six,
                _ => MeasuredAxes::Three,
            },
            share: keys.share,
            shows_gravity: keys.gravity,
        }
    }
}

impl From<ToolKeys> for sensor::Tool {
    fn from(ToolKeys { weight_n, centre_m }: ToolKeys) -> Self {
        Self {
            weight_n: weight_n.into(),
            centre_m: centre_m.into(),
        }
    }
}

impl Sensor {
    /// Platform axes from sensor axes.
    #[must_use]
    pub fn rotation_matrix(&self) -> Matrix3<f64> {
        matrix(self.rotation)
    }
}

/// `[client]`: the compensating client.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClientKeys {
    /// Share of the computed correction that is asked for, 0 to 1.
    pub gain: f64,
    /// Method of computation; absent: exactly with identified springs, else to first order.
    pub correction: Option<CorrectionKind>,
    /// Leave Obtain when the targets oscillate.
    #[serde(default = "default_leave_on_oscillation")]
    pub leave_on_oscillation: bool,
    /// Loads that are compensated before the sensor reads them.
    #[serde(default)]
    pub feed_forward: FeedForwardKey,
}

/// Loads that a client compensates before the sensor reads them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FeedForwardKey {
    /// None.
    #[default]
    None,
    /// The inertia of the nominal motion; needs `[masses]`.
    Inertia,
    /// The same, and the torques of the drives for it; needs `axes.torque.rated_n` as well.
    InertiaAndTorque,
}

fn default_leave_on_oscillation() -> bool {
    true
}

/// Of a micromechanical accelerometer: 2 mg.
fn default_acceleration_noise() -> f64 {
    0.02
}

/// `[simulation]`: the simulated machine.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Simulation {
    /// Seed of deviations and noise.
    pub seed: u64,
    /// Each true compliance is the nominal one times
    /// `1 + uniform(-spring_deviation..spring_deviation)`.
    pub spring_deviation: f64,
    /// Standard deviation of the sensor's forces, N.
    pub force_noise_n: f64,
    /// Standard deviation of the sensor's moments, N m.
    pub moment_noise_nm: f64,
    /// Standard deviation of the accelerometer's linear accelerations, m/s^2; of the angular ones ten
    /// times as many rad/s^2.
    #[serde(default = "default_acceleration_noise")]
    pub acceleration_noise_m_per_s2: f64,
    /// One step of the length gauges, m.
    pub gauge_resolution_m: f64,
    /// Force in x at which the platform leaves cart 3, N.
    pub jump_force_n: f64,
    /// The play it crosses then, m.
    pub jump_gap_m: f64,
    /// Home of the tool centre point, world axes, m.
    pub home_m: [f64; 3],
    /// Difference of the machine that a simulated tracker sees from this file, mm: standard
    /// deviation of each coordinate of a joint, and of a length; guideways and axes turn by as many
    /// mrad. The machine of `serve` is that of the file.
    #[serde(default)]
    pub geometry_mm: f64,
    /// Standard deviation of each coordinate of the point that a gauge of a campaign touches, mm.
    #[serde(default)]
    pub gauge_point_mm: f64,
    /// Standard deviation of each turn of its plunger, mrad.
    #[serde(default)]
    pub gauge_axis_mrad: f64,
    /// Force by which the play closes below the one that it opened at, N in x.
    #[serde(default)]
    pub jump_hysteresis_n: f64,
    /// Standard deviation of the drift of each gauge in each series of a campaign, um per minute.
    #[serde(default)]
    pub drift_um_per_min: f64,
}
