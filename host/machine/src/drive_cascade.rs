//! Gains, masses and friction of the simulated drives; ASSUMED. The simulation runs them, and the
//! analysis of stability has them as a matrix.

/// Mass of cart and motor of a machine without masses, the motor's inertia reflected to the
/// guideway, kg. The gain of the velocity loop is for this mass on any machine.
pub const MASS_KG: f64 = 40.0;
/// Part of it that turns with the motor, kg.
pub const MOTOR_MASS_KG: f64 = 20.0;
/// Position loop: velocity per position error, 1/s.
pub const POSITION_GAIN: f64 = 150.0;
/// Velocity loop: acceleration per velocity error, 1/s.
pub const VELOCITY_GAIN: f64 = 900.0;
/// Velocity loop: time of its integral, s.
pub const VELOCITY_INTEGRAL_S: f64 = 4.5e-3;
/// Share of the way the current loop goes in one step: `1 - exp(-62.5 µs / 160 µs)`.
pub const CURRENT_SHARE: f64 = 0.323_4;
/// Viscous friction, N s/m.
pub const VISCOUS_FRICTION: f64 = 200.0;
/// Length of a cycle, s.
pub const CYCLE_S: f64 = 1e-3;
/// Integration steps per cycle.
pub const SUBSTEPS: u32 = 16;
/// Length of an integration step, s.
pub const SUBSTEP_S: f64 = CYCLE_S / SUBSTEPS as f64;
