//! The machine as the server's cycle sees it. A real drive implements [`Plant`].

mod failure;
pub mod interpolator;

use std::fmt;

use gantry_tau_core::control::axis::{Actual, InForce, Reference};
use gantry_tau_core::control::position_loop::VelocityReference;
use gantry_tau_core::control::position_loop::quick_stop::QuickStop;
use gantry_tau_core::units::PositionNm;

pub use failure::PlantFailure;

/// A machine with `AXES` axes and `MOTORS` motors. The cycle thread calls `read`, then `write`,
/// once per cycle. A failed `write` must leave the last references in force.
///
/// No call may block, allocate or lock. The first implementation is the simulated machine of the
/// crate `gantry-tau-sim`.
pub trait Plant<const AXES: usize, const MOTORS: usize>: Send {
    /// Error of a call: that of the bus, say. Its text is logged and recorded ([`PlantFailure`]).
    /// [`PlantError`] serves a machine without one of its own.
    type Error: fmt::Display;

    /// Enables the drives, where they stand, at the values in force. Called in the thread of the
    /// cycles, before the first of them; it may block. Drives that need a reset first are left:
    /// `read` must fail then, until [`reset`](Self::reset).
    ///
    /// # Errors
    /// The server must not run. The default does nothing.
    fn start(&mut self) -> Result<(), Self::Error> {
        Ok(())
    }

    /// Reads the values in force at the drives: those of the last references they took. Nominal
    /// reference plus position offset must be the position reference in force; drives that know
    /// only their sum leave the rest of it to the nominal reference. Called before the first cycle,
    /// and in the cycle of every `write` that failed or was withheld: the server goes on from these
    /// values, without a step.
    ///
    /// # Errors
    /// They cannot be read: the server refuses to start, or writes nothing until they can.
    fn in_force(&mut self) -> Result<[InForce; AXES], Self::Error>;

    /// Reads the nominal references of this cycle and the measurements of the drives, `elapsed`
    /// cycles after the last call (1 when on time).
    ///
    /// # Errors
    /// The bus does not answer: the server stops, and the last nominal references stand.
    fn read(&mut self, elapsed: u64) -> Result<Reading<AXES>, Self::Error>;

    /// Writes the reference of every motor. `parts` are the nominal references and offsets that
    /// they are made of, for drives that take them apart. The nominal references need not be those
    /// that were read: after an outage the last ones stand.
    ///
    /// # Errors
    /// The bus does not take them: the server asserts its stop from the next cycle on.
    fn write(
        &mut self,
        references: &[Reference; MOTORS],
        parts: &[InForce; AXES],
    ) -> Result<(), Self::Error>;

    /// Returns the states of the drives at the last `read`, one per axis: of several motors the one
    /// furthest from operation. They are recorded and shown, and nothing acts on them: a drive that
    /// does not follow its references is reported by `read`, which fails. (Hence not a part of
    /// [`Reading`], which is absent when it matters.)
    ///
    /// `None`, the default, for a machine that does not tell.
    fn drives(&self) -> Option<[DriveState; AXES]> {
        None
    }

    /// Acknowledges the faults of the drives. Called before `read` in every cycle in which the
    /// re-arm is pressed in Fault and no stop is held, until the server listens again; `read` must
    /// fail until the drives follow their references.
    ///
    /// A drive without a fault must ignore it. The default does nothing.
    fn reset(&mut self) {}

    /// Returns the time at which the first cycle is to begin, ns of [`now_ns`]: that of a bus whose
    /// drives have a clock. Called once, after [`start`](Self::start). `None`, the default, for any
    /// time.
    ///
    /// [`now_ns`]: crate::realtime::now_ns
    fn first_deadline_ns(&mut self) -> Option<u64> {
        None
    }

    /// Returns the time by which the next cycle is to begin later than a cycle after the last, ns;
    /// at most [`MAX_SHIFT_NS`] in magnitude. Called once after each `write`, of a server whose
    /// ticks come from the clock. 0, the default, for a cycle that follows this computer's clock.
    ///
    /// [`MAX_SHIFT_NS`]: crate::realtime::MAX_SHIFT_NS
    fn deadline_shift_ns(&mut self) -> i64 {
        0
    }
}

/// A machine whose drives take velocities: the position loops are the server's.
pub trait VelocityPlant<const AXES: usize, const MOTORS: usize>: Plant<AXES, MOTORS> {
    /// Writes the velocity reference of every motor; called instead of `write`. `parts` are what
    /// the position references consist of that the loops follow; `None` while the axes come to rest
    /// or stand: the nominal path must then go on from where they stand, and that is what is in
    /// force, without offsets.
    ///
    /// # Errors
    /// The bus does not take them.
    fn write_velocity(
        &mut self,
        velocities: &[VelocityReference; MOTORS],
        parts: Option<&[InForce; AXES]>,
    ) -> Result<(), Self::Error>;

    /// Returns how the drives stop by themselves when no new references come; `None` for a machine
    /// that is configured to take positions: a server with position loops then refuses to start.
    fn quick_stop(&self) -> Option<QuickStop>;
}

/// State of a drive, after the states of CiA 402; the later, the further from operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DriveState {
    /// It follows its references.
    Operating,
    /// It holds its position and waits for references.
    Ready,
    /// It has no power, or moves onto its reference after a reset.
    NotReady,
    /// It brakes by itself.
    QuickStop,
    /// It has stopped by itself and waits for a reset.
    Fault,
}

impl DriveState {
    const ALL: [Self; 5] = [
        Self::Operating,
        Self::Ready,
        Self::NotReady,
        Self::QuickStop,
        Self::Fault,
    ];

    /// Code in the sample `drives`.
    #[must_use]
    pub const fn code(self) -> u8 {
        match self {
            Self::NotReady => 0,
            Self::Ready => 1,
            Self::Operating => 2,
            Self::QuickStop => 3,
            Self::Fault => 4,
        }
    }

    /// Returns the state of a code.
    #[must_use]
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|state| state.code() == code)
    }

    /// Name in recordings: lower case, words joined by `_`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::NotReady => "not_ready",
            Self::Ready => "ready",
            Self::Operating => "operating",
            Self::QuickStop => "quick_stop",
            Self::Fault => "fault",
        }
    }
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

impl<const AXES: usize> Reading<AXES> {
    /// Creates the measurements of a machine without instruments at the tool.
    #[must_use]
    pub const fn of_axes(nominal: [PositionNm; AXES], actual: [Actual; AXES]) -> Self {
        let tool = None;
        Self {
            nominal,
            actual,
            tool,
        }
    }
}

/// Measurements of instruments at the tool. The server records them; it never acts on them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolReading {
    /// Step of the load profile that is applied; 0 when none.
    pub step: u32,
    /// Load on the tool, force (N) then moment (N m) about the tool centre point, world axes.
    pub load: [f64; 6],
    /// Raw sample of the force sensor, force (N) then moment (N m), sensor axes. With a NaN there is
    /// none.
    pub sensor: [f64; 6],
    /// Ticks since the force sensor took it: 0 in this tick, 255 if 255 or more.
    pub sensor_age: u8,
    /// Sample of the accelerometer, linear (m/s^2) then angular acceleration (rad/s^2), its axes;
    /// `None` without one.
    pub acceleration: Option<[f64; 6]>,
    /// Displacement of the tool centre point from its nominal place, metres, world axes; exact in
    /// the simulation.
    pub displacement_m: [f64; 3],
    /// Rotation of the platform from its nominal orientation: rotation vector, rad, world axes.
    pub turn_rad: [f64; 3],
    /// Displacement as the length gauges show it, quantised, metres.
    pub gauges_m: [f64; 3],
}

impl ToolReading {
    /// A tool of which nothing is known: not numbers, as a real machine has them where it has no
    /// instrument.
    pub const UNKNOWN: Self = Self {
        step: 0,
        load: [f64::NAN; 6],
        sensor: [f64::NAN; 6],
        sensor_age: 0,
        acceleration: None,
        displacement_m: [f64::NAN; 3],
        turn_rad: [f64::NAN; 3],
        gauges_m: [f64::NAN; 3],
    };
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
