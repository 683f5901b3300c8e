//! The machine as the server's cycle sees it. A real drive implements [`Plant`].

use gantry_tau_core::control::axis::{Actual, InForce, Reference};
use gantry_tau_core::units::PositionNm;

/// A machine with `AXES` axes and `MOTORS` motors. The cycle thread calls `read`, then `write`, once per cycle.
/// A failed `write` must leave the last references in force.
///
/// No call may block, allocate or lock. The first implementation is the simulated machine of [`crate::sim`].
pub trait Plant<const AXES: usize, const MOTORS: usize>: Send {
    /// Reads the values in force at the drives: those of the last references they took. Nominal reference plus position offset must be the
    /// position reference in force; drives that know only their sum leave the rest of it to the nominal reference.
    /// Called before the first cycle, and after every failed `write`: the server goes on from these values, without a step.
    ///
    /// # Errors
    /// [`PlantError`] when they cannot be read: the server refuses to start, or writes nothing until they can.
    fn in_force(&mut self) -> Result<[InForce; AXES], PlantError>;

    /// Reads the nominal references of this cycle and the measurements of the drives, `elapsed` cycles after the last call (1 when on time).
    ///
    /// # Errors
    /// [`PlantError`] when the bus does not answer: the server stops, and the last nominal references stand.
    fn read(&mut self, elapsed: u64) -> Result<Reading<AXES>, PlantError>;

    /// Writes the reference of every motor. `parts` are the nominal references and offsets that they are made of, for drives that
    /// take them apart. The nominal references need not be those that were read: after an outage the last ones stand.
    ///
    /// # Errors
    /// [`PlantError`] when the bus does not take them: the server asserts its stop from the next cycle on.
    fn write(&mut self, references: &[Reference; MOTORS], parts: &[InForce; AXES]) -> Result<(), PlantError>;
}

/// Measurements of one cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading<const AXES: usize> {
    /// Nominal references of this cycle, from the interpolator of the path.
    pub nominal: [PositionNm; AXES],
    /// Measurements of the drives.
    pub actual: [Actual; AXES],
    /// Measurements at the tool, if the machine has such instruments.
    pub tool: Option<ToolReading>,
}

/// Measurements of instruments at the tool. The server records them; it never acts on them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolReading {
    /// Step of the load profile that is applied; 0 when none.
    pub step: u32,
    /// Load on the tool, force (N) then moment (N m) about the tool centre point, world axes.
    pub load: [f64; 6],
    /// Raw sample of the force sensor, force (N) then moment (N m), sensor axes.
    pub sensor: [f64; 6],
    /// Displacement of the tool centre point from its nominal place, metres, world axes; exact in the simulation.
    pub displacement_m: [f64; 3],
    /// Rotation of the platform from its nominal orientation: rotation vector, rad, world axes.
    pub turn_rad: [f64; 3],
    /// Displacement as the length gauges show it, quantised, metres.
    pub gauges_m: [f64; 3],
}

/// Error of a call to a [`Plant`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the machine could not {operation}: {reason}")]
pub struct PlantError {
    /// The failed operation: "read the drives", say.
    pub operation: &'static str,
    /// The reason.
    pub reason: &'static str,
}
