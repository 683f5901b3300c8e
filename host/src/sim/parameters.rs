//! Parameters of a simulation, and errors in them.

use std::fmt;

use gantry_tau_core::model::robot::RobotError;

use super::drive::Settings;
use crate::elastic::ElasticError;
use crate::robot_file::{Sensor, Simulation};

/// Parameters of a [`super::machine::SimulatedMachine`] with `N` axes. The sections of its robot file have been checked there.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulationParameters<const N: usize> {
    /// Springs, noise, gauges, jump and home.
    pub simulation: Simulation,
    /// Settings of every drive.
    pub drives: Settings,
    /// Mounting of the force sensor.
    pub sensor: Sensor,
    /// Positions of the axes that put the tool at home, q-units. Where they do not, the search for the first pose begins beside it.
    pub home_q: [f64; N],
    /// Length of each axis per unit of `q`, m.
    pub metres_per_q: [f64; N],
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

/// Reason why a simulation is refused. Numbers are named by their field in [`SimulationParameters`] and [`Motion`].
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
