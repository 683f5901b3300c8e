//! The machine as the server's cycle sees it: the one place where a real drive would come in.

use std::fmt;

use gantry_tau_core::control::axis::{Actual, Offsets, Reference};
use gantry_tau_core::units::PositionNm;

/// A machine with `AXES` axes and `MOTORS` motors, called by the cycle thread once per cycle: `read`, then `write`.
/// A failed `write` must leave the last references in force.
///
/// Neither call may block, allocate or lock. The simulated machine of [`crate::sim`] is the first implementation.
pub trait Plant<const AXES: usize, const MOTORS: usize>: Send {
    /// The external offsets that the drive interface has in force: those of the last references it took.
    /// Read before the first cycle and after every failed `write`: the server goes on from these, so that it makes no step.
    ///
    /// # Errors
    /// [`PlantError`] when they cannot be read: the server then refuses to start, or writes nothing until they can.
    fn offsets_in_force(&mut self) -> Result<[Offsets; AXES], PlantError>;

    /// Nominal references of this cycle and what the drives measure, `elapsed` cycles after the last call (1 when on time).
    ///
    /// # Errors
    /// [`PlantError`] when the bus does not answer: the server asserts its stop.
    fn read(&mut self, elapsed: u64) -> Result<Reading<AXES>, PlantError>;

    /// References to every motor.
    ///
    /// # Errors
    /// [`PlantError`] when the bus does not take them: the server asserts its stop from the next cycle on.
    fn write(&mut self, references: &[Reference; MOTORS]) -> Result<(), PlantError>;
}

/// One cycle's measurements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading<const AXES: usize> {
    /// Nominal references of this cycle, from whatever interpolates the path.
    pub nominal: [PositionNm; AXES],
    /// What the drives measure.
    pub actual: [Actual; AXES],
    /// What instruments on the tool see, where there are any.
    pub tool: Option<ToolReading>,
}

/// Instruments at the tool; the server records them, it never acts on them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolReading {
    /// Which step of a load programme is applied; 0 when none.
    pub step: u32,
    /// Load on the tool, force (N) then moment (N m) about the tool centre point, world axes.
    pub load: [f64; 6],
    /// Raw sample of the force sensor, force (N) then moment (N m), sensor axes.
    pub sensor: [f64; 6],
    /// Translation of the tool centre point away from its nominal place, metres, world axes: the truth of the simulation.
    pub displacement_m: [f64; 3],
    /// How far the platform is turned away from there: rotation vector, rad, world axes.
    pub turn_rad: [f64; 3],
    /// The same as the length gauges show it, quantised, metres.
    pub gauges_m: [f64; 3],
}

/// Why a plant did not answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlantError {
    /// What was being done.
    pub operation: &'static str,
    /// Why it failed.
    pub reason: &'static str,
}

impl fmt::Display for PlantError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "the machine could not {}: {}",
            self.operation, self.reason
        )
    }
}

impl std::error::Error for PlantError {}
