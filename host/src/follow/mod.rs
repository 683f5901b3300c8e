//! `follow`: position loops inside the drives and outside of them, compared on the simulated machine `[T 6.2.2, 7.2]`.
//!
//! Every loop takes the carts to 0.5 m/s at 2 m/s^2 and back to rest, and then takes a step of 300 N.

mod page;
mod run;
mod table;

use serde::Serialize;

use crate::model::MachineKind;
use crate::output::{Output, WriteError};
use crate::robot_file::position_loop::MAX_LATENCY_CYCLES;
use crate::robot_file::{RobotFile, RobotFileError};
use crate::sim::drive::MAX_DELAY;

/// Speed of the path, m/s.
pub const SPEED_M_PER_S: f64 = 0.5;
/// Acceleration of the path, m/s^2.
pub const ACCELERATION_M_PER_S2: f64 = 2.0;
/// Step of the force on each motor of the axis that takes most, N.
pub const FORCE_STEP_N: f64 = 300.0;
/// Share by which the mass of the torque feed-forward is wrong in one of the runs.
pub const MASS_ERROR: f64 = 0.2;
/// Latencies of the table, cycles of the command and of the measurement.
const LATENCIES: [Latency; 4] = [Latency::new(0, 0), Latency::new(1, 0), Latency::new(1, 1), Latency::new(2, 2)];

/// Cycles from a command to its effect, and from a measurement to its report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Latency {
    /// Cycles of the command.
    pub command_cycles: u8,
    /// Cycles of the measurement.
    pub actual_cycles: u8,
}

impl Latency {
    /// Creates a latency.
    #[must_use]
    pub const fn new(command_cycles: u8, actual_cycles: u8) -> Self {
        Self { command_cycles, actual_cycles }
    }
}

impl std::fmt::Display for Latency {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} + {}", self.command_cycles, self.actual_cycles)
    }
}

impl std::str::FromStr for Latency {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let expected = || {
            let most = MAX_LATENCY_CYCLES;
            format!(
                "expected D,U: cycles of command and measurement, each from 0 to {MAX_DELAY}, together at most {most}"
            )
        };
        let (command, actual) = text.split_once(',').ok_or_else(expected)?;
        let cycles = |text: &str| text.trim().parse().ok().filter(|cycles| *cycles <= MAX_DELAY).ok_or_else(expected);
        let latency = Self { command_cycles: cycles(command)?, actual_cycles: cycles(actual)? };
        let together = latency.command_cycles.saturating_add(latency.actual_cycles);
        if together <= MAX_LATENCY_CYCLES { Ok(latency) } else { Err(expected()) }
    }
}

/// Options of the comparison.
#[derive(Clone, Debug)]
pub struct FollowOptions<K, const N: usize> {
    /// The machine.
    pub robot: RobotFile<K, N>,
    /// Latency of the loop that the page shows.
    pub latency: Latency,
    /// Path of the page.
    pub report: Output,
    /// Path of the numbers as JSON, if wanted.
    pub json: Option<Output>,
}

/// Error of a comparison.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FollowError {
    /// The robot file.
    #[error(transparent)]
    Robot(#[from] RobotFileError),
    /// A file.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// The simulated machine.
    #[error("{0}")]
    Machine(String),
}

/// Numbers of one loop. Lags are the largest against the reference that could have acted, µm; `None` where a loop has no such thing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LoopNumbers {
    /// Latency; `None`: the loop is in the drive.
    pub latency: Option<Latency>,
    /// Gain, 1/s.
    pub gain_per_s: f64,
    /// Lag without feed-forward.
    pub plain_um: f64,
    /// Lag with velocity feed-forward, compared with the reference of the same cycle.
    pub misaligned_um: Option<f64>,
    /// Lag with velocity feed-forward, compared with the reference that belongs to the measurement.
    pub velocity_um: f64,
    /// Lag with velocity and torque feed-forward.
    pub torque_um: Option<f64>,
    /// The same with a mass that is wrong by [`MASS_ERROR`].
    pub wrong_mass_um: Option<f64>,
    /// Largest displacement of the cart by the force step.
    pub pushed_um: f64,
    /// Time after which it stays below 1 µm, ms.
    pub settled_ms: u32,
}

/// Results of a comparison.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FollowResults {
    /// Name of the machine.
    pub machine: String,
    /// Latency of the page.
    pub shown: Latency,
    /// The loop in the drive, then the loops outside.
    pub loops: Vec<LoopNumbers>,
}

impl FollowResults {
    /// Returns the loop in the drive.
    #[must_use]
    pub fn inside(&self) -> Option<&LoopNumbers> {
        self.loops.iter().find(|row| row.latency.is_none())
    }

    /// Returns the loop outside that the page shows.
    #[must_use]
    pub fn outside(&self) -> Option<&LoopNumbers> {
        self.loops.iter().find(|row| row.latency == Some(self.shown))
    }
}

/// Runs all loops, and writes the page. Returns the table as text, and the numbers.
///
/// # Errors
/// [`FollowError`].
pub fn run<K: MachineKind<N>, const N: usize, const M: usize>(
    options: &FollowOptions<K, N>,
) -> Result<(String, FollowResults), FollowError> {
    // A path that cannot be written is found before the runs, not after them.
    for output in std::iter::once(&options.report).chain(&options.json) {
        output.check(false)?;
    }
    let bench = run::Bench::<K, N, M>::new(&options.robot)?;
    let mut latencies = LATENCIES.to_vec();
    if !latencies.contains(&options.latency) {
        latencies.push(options.latency);
    }
    let mut loops = vec![bench.inside()?];
    for latency in latencies {
        loops.push(bench.outside(latency)?);
    }
    let shown = loops.iter().find(|one| one.latency == Some(options.latency));
    let results = FollowResults {
        machine: options.robot.name.clone(),
        shown: options.latency,
        loops: loops.iter().map(run::Measured::numbers).collect(),
    };
    let text = table::render(&results);
    if let (Some(inside), Some(outside)) = (loops.first(), shown) {
        options.report.write(&page::render(&results, &text, &bench.reference_mm(), [inside, outside]))?;
    }
    if let Some(output) = &options.json {
        let json = serde_json::to_string_pretty(&results).map_err(|error| FollowError::Machine(error.to_string()))?;
        output.write(&json)?;
    }
    Ok((text, results))
}
