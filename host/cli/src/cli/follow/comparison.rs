//! Position loops inside the drives and outside of them, compared on the simulated
//! machine `[T 6.2.2, 7.2]`.
//!
//! Every loop takes the carts to 0.5 m/s at 2 m/s^2 and back to rest, and then takes a step of 300
//! N.

mod page;
mod run;
mod table;

use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::position_loop::MAX_LATENCY_CYCLES;
use gantry_tau_machine::robot_file::{RobotFile, RobotFileError};
use gantry_tau_sim::drive::MAX_DELAY;
use gantry_tau_system::output::{Output, WriteError};
use serde::Serialize;

/// Speed of the path, m/s.
pub(super) const SPEED_M_PER_S: f64 = 0.5;
/// Acceleration of the path, m/s^2.
pub(super) const ACCELERATION_M_PER_S2: f64 = 2.0;
/// Step of the force on each motor of the axis that takes most, N.
pub(super) const FORCE_STEP_N: f64 = 300.0;
/// Share by which the mass of the torque feed-forward is wrong in one of the runs.
pub(super) const MASS_ERROR: f64 = 0.2;
/// Latencies of the table, cycles of the command and of the measurement.
const LATENCIES: [Latency; 4] = [
    Latency::new(0, 0),
    Latency::new(1, 0),
    Latency::new(1, 1),
    Latency::new(2, 2),
];

/// Cycles from a command to its effect, and from a measurement to its report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub(super) struct Latency {
    /// Cycles of the command.
    pub command_cycles: u8,
    /// Cycles of the measurement.
    pub actual_cycles: u8,
}

impl Latency {
    /// Creates a latency.
    #[must_use]
    pub(super) const fn new(command_cycles: u8, actual_cycles: u8) -> Self {
        Self {
            command_cycles,
            actual_cycles,
        }
    }
}

impl std::fmt::Display for Latency {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} + {}", self.command_cycles, self.actual_cycles)
    }
}

/// A text that is not a latency.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "expected D,U: cycles of command and measurement, each from 0 to {MAX_DELAY}, together at most {MAX_LATENCY_CYCLES}"
)]
pub(super) struct ParseLatencyError;

impl std::str::FromStr for Latency {
    type Err = ParseLatencyError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::read(text).ok_or(ParseLatencyError)
    }
}

impl Latency {
    fn read(text: &str) -> Option<Self> {
        let (command, actual) = text.split_once(',')?;
        let command_cycles = delay(command)?;
        let actual_cycles = delay(actual)?;
        let together = command_cycles.saturating_add(actual_cycles);
        (together <= MAX_LATENCY_CYCLES).then_some(Self {
            command_cycles,
            actual_cycles,
        })
    }
}

fn delay(text: &str) -> Option<u8> {
    let cycles = text.trim().parse().ok();
    cycles.filter(|cycles| *cycles <= MAX_DELAY)
}

/// Options of the comparison.
#[derive(Clone, Debug)]
pub(super) struct FollowOptions<K, const N: usize> {
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
pub(super) enum FollowError {
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

/// Numbers of one loop. Lags are the largest against the reference that could have acted, µm;
/// `None` where a loop has no such thing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct LoopNumbers {
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
    /// Largest lag of the tool centre point with velocity feed-forward. `None` without masses.
    pub tool_um: Option<f64>,
    /// Largest displacement of the cart by the force step.
    pub pushed_um: f64,
    /// Time after which it stays below 1 µm, ms.
    pub settled_ms: u32,
}

/// Results of a comparison.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct FollowResults {
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
    pub(super) fn inside(&self) -> Option<&LoopNumbers> {
        self.loops.iter().find(|row| row.latency.is_none())
    }

    /// Returns the loop outside that the page shows.
    #[must_use]
    pub(super) fn outside(&self) -> Option<&LoopNumbers> {
        self.loops
            .iter()
            .find(|row| row.latency == Some(self.shown))
    }
}

/// Runs all loops, and writes the page and the numbers. Returns the table as text.
///
/// # Errors
/// [`FollowError`].
pub(super) fn run<K: MachineKind<N>, const N: usize, const M: usize>(
    options: &FollowOptions<K, N>,
) -> Result<String, FollowError> {
    // A path that cannot be written is found before the runs, not after them.
    for output in std::iter::once(&options.report).chain(&options.json) {
        output.check(false)?;
    }
    let bench = run::FollowBench::<K, N, M>::new(&options.robot)?;
    let mut latencies = LATENCIES.to_vec();
    if !latencies.contains(&options.latency) {
        latencies.push(options.latency);
    }
    let mut loops = vec![bench.inside()?];
    for latency in latencies {
        loops.push(bench.outside(latency)?);
    }
    let shown = loops
        .iter()
        .find(|one| one.latency == Some(options.latency));
    let results = FollowResults {
        machine: options.robot.name.clone(),
        shown: options.latency,
        loops: loops.iter().map(run::Measured::numbers).collect(),
    };
    let text = table::render(&results);
    if let (Some(inside), Some(outside)) = (loops.first(), shown) {
        options.report.write(&page::render(
            &results,
            &text,
            &bench.reference_mm(),
            [inside, outside],
        ))?;
    }
    if let Some(output) = &options.json {
        let json = serde_json::to_string_pretty(&results)
            .map_err(|error| FollowError::Machine(error.to_string()))?;
        output.write(&json)?;
    }
    Ok(text)
}
