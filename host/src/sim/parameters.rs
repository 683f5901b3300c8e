//! Parameters of a simulation, and errors in them.

use std::fmt;

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::model::robot::RobotError;
use nalgebra::{Matrix3, Vector3};

use super::elastic::ElasticError;

/// Longest list of waypoints.
pub const MAX_WAYPOINTS: usize = 100_000;

/// Parameters of a [`super::machine::SimulatedMachine`] with `N` axes.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulationParameters<const N: usize> {
    /// Seed of the spring deviations and of the sensor's noise.
    pub seed: u64,
    /// Largest relative deviation of a true compliance from its nominal value, `0 <= deviation < 1`; each is drawn uniformly.
    pub spring_deviation: f64,
    /// Standard deviation of the sensor's forces, N.
    pub force_noise_n: f64,
    /// Standard deviation of the sensor's moments, N m.
    pub moment_noise_nm: f64,
    /// Reading of the unloaded sensor: force (N) then moment (N m), sensor axes. Weight and zero error; a client tares it.
    pub sensor_bias: [f64; 6],
    /// One step of the length gauges, m.
    pub gauge_resolution_m: f64,
    /// Force in x on the tool at the home pose at which the force of cluster 3 changes sign, N.
    pub jump_force_n: f64,
    /// Play of the joint of arm 3, m; 0 for a machine without the jump.
    pub jump_gap_m: f64,
    /// Position of the tool at the start, world axes, m; the platform is unturned.
    pub home_m: [f64; 3],
    /// Positions of the axes that put it there, q-units. Where they do not, the search for the first pose begins beside it.
    pub home_q: [f64; N],
    /// Sensor axes to world axes; the columns are the sensor's axes.
    pub sensor_rotation: Matrix3<f64>,
    /// From the tool centre point to the sensor's origin, world axes, m.
    pub sensor_lever_m: Vector3<f64>,
    /// Length of each axis per unit of `q`, m.
    pub metres_per_q: [f64; N],
    /// Offsets that the drives have in force at the start: those a killed server left behind.
    pub initial_offsets: [Offsets; N],
    /// True if the offsets in force can be read from the drives; otherwise a server refuses to start.
    pub offsets_readable: bool,
    /// Motion of the nominal references.
    pub motion: Motion<N>,
}

/// Motion of the nominal references.
#[derive(Clone, Debug, PartialEq)]
pub enum Motion<const N: usize> {
    /// They stay at home.
    Hold,
    /// From home through the waypoints and the same way back, repeatedly.
    BackAndForth {
        /// Axis positions in metres, home not included.
        waypoints_m: Vec<[f64; N]>,
        /// Largest speed of an axis, m/s.
        speed_m_per_s: f64,
        /// Largest acceleration of an axis, m/s^2.
        acceleration_m_per_s2: f64,
        /// Rest at home and at every waypoint, cycles.
        dwell_cycles: u32,
    },
}

impl<const N: usize> SimulationParameters<N> {
    /// Returns a machine like the thesis' `[T 4.2, 5.2]` with its tool at `home_m` (world axes, metres) and its axes at `home_q`:
    /// true springs within 15 % of the nominal ones, the jump at 360 N, gauges of 0.5 µm, a sensor along the world axes, one metre per unit of `q`.
    #[must_use]
    pub fn at_home(home_m: [f64; 3], home_q: [f64; N]) -> Self {
        Self {
            seed: 1,
            spring_deviation: 0.15,
            force_noise_n: 0.5,
            moment_noise_nm: 0.02,
            sensor_bias: [0.0; 6],
            gauge_resolution_m: 0.5e-6,
            jump_force_n: 360.0,
            jump_gap_m: 40e-6,
            home_m,
            home_q,
            sensor_rotation: Matrix3::identity(),
            sensor_lever_m: Vector3::zeros(),
            metres_per_q: [1.0; N],
            initial_offsets: [Offsets::default(); N],
            offsets_readable: true,
            motion: Motion::Hold,
        }
    }
}

/// Reason why a simulation is refused. Numbers are named by their field in [`SimulationParameters`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SimulationError {
    /// A number is NaN, infinite, or outside its range.
    OutOfRange {
        /// Name of the parameter.
        parameter: &'static str,
        /// Smallest value accepted.
        lower: f64,
        /// Largest value accepted.
        upper: f64,
    },
    /// A matrix is not a rotation.
    NotARotation {
        /// Name of the parameter.
        parameter: &'static str,
    },
    /// An axis has no motor.
    NoMotor {
        /// Index of the axis, from 0.
        axis: usize,
    },
    /// The deviated compliances are refused.
    Compliances(RobotError),
    /// The springs find no equilibrium at home.
    Springs(ElasticError),
    /// A force in x of `jump_force_n` hardly loads arm 3 at home: the jump is impossible there.
    NoJump,
}

impl fmt::Display for SimulationError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OutOfRange { parameter, lower, upper } => {
                write!(f, "{parameter} must be from {lower:e} to {upper:e}")
            }
            Self::NotARotation { parameter } => write!(f, "{parameter} is not a rotation"),
            Self::NoMotor { axis } => write!(f, "axis {axis} (from 0) has no motor"),
            Self::Compliances(reason) => write!(f, "spring_deviation: {reason}"),
            Self::Springs(reason) => write!(f, "home_m: {reason}"),
            Self::NoJump => f.write_str("jump_force_n hardly loads arm 3 at home_m"),
        }
    }
}

impl std::error::Error for SimulationError {}

/// Checks `lower <= value <= upper`; NaN is refused.
pub(super) fn check(parameter: &'static str, value: f64, lower: f64, upper: f64) -> Result<(), SimulationError> {
    if (lower..=upper).contains(&value) { Ok(()) } else { Err(SimulationError::OutOfRange { parameter, lower, upper }) }
}
