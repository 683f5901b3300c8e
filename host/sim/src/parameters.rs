//! Parameters of a simulation, and errors in them.

use std::fmt;

use gantry_tau_core::model::robot::RobotError;
use gantry_tau_machine::elastic::ElasticError;
use gantry_tau_machine::elastic::springs::Springs;
use gantry_tau_machine::model::{MachineKind, Wrist};
use gantry_tau_machine::robot_file::{RobotFile, RobotFileError, Sensor, Simulation};
use gantry_tau_server::plant::interpolator::{Motion, OutOfRange};

use super::drive::Settings;

/// Parameters of a [`super::machine::SimulatedMachine`] with `N` axes. The sections of its robot
/// file have been checked there.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulationParameters<const N: usize> {
    /// Springs, noise, gauges, jump and home.
    pub simulation: Simulation,
    /// Settings of every drive.
    pub drives: Settings,
    /// Mounting of the force sensor.
    pub sensor: Sensor,
    /// Positions of the axes that put the tool at home, q-units. Where they do not, the search for
    /// the first pose begins beside it.
    pub home_q: [f64; N],
    /// Length of each axis per unit of `q`, m.
    pub metres_per_q: [f64; N],
    /// Motion of the nominal references.
    pub motion: Motion<N>,
}

/// Reason why a simulation is refused. Numbers are named by their field in [`SimulationParameters`]
/// and [`Motion`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SimulationError {
    /// A number is NaN, infinite, or outside its range.
    OutOfRange(OutOfRange),
    /// The deviated compliances are refused.
    Compliances(RobotError),
    /// The springs find no equilibrium at home.
    Springs(ElasticError),
    /// A machine with these masses has no natural frequencies at home.
    NoModes,
    /// A force in x of `jump_force_n` hardly loads arm 3 at home: the jump is impossible there.
    NoJump,
}

impl fmt::Display for SimulationError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OutOfRange(error) => error.fmt(f),
            Self::Compliances(reason) => write!(f, "spring_deviation: {reason}"),
            Self::Springs(reason) => write!(f, "home_m: {reason}"),
            Self::NoModes => {
                f.write_str("masses: the machine has no natural frequencies at home_m")
            }
            Self::NoJump => f.write_str("jump_force_n hardly loads arm 3 at home_m"),
        }
    }
}

impl std::error::Error for SimulationError {}

impl From<OutOfRange> for SimulationError {
    fn from(error: OutOfRange) -> Self {
        Self::OutOfRange(error)
    }
}

impl<const N: usize> SimulationParameters<N> {
    /// Returns the parameters of a robot file's machine.
    ///
    /// # Errors
    /// [`RobotFileError`] for a home that the machine cannot take.
    pub fn from_robot<K: MachineKind<N>>(
        robot: &RobotFile<K, N>,
        motion: Motion<N>,
    ) -> Result<Self, RobotFileError> {
        Ok(Self {
            simulation: robot.simulation.clone(),
            sensor: robot.sensor.clone(),
            drives: robot
                .drives
                .as_ref()
                .map(Settings::from)
                .unwrap_or_default(),
            home_q: robot.home_q()?,
            metres_per_q: robot.metres_per_q,
            motion,
        })
    }
}

/// Returns the springs of a robot file.
pub(crate) fn springs<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
) -> Result<Springs<N>, RobotFileError> {
    let machine = *robot.compliances_for("the simulation needs compliances")?;
    Ok(Springs {
        machine: machine.into(),
        wrist: Wrist::new(&robot.wrist),
    })
}
