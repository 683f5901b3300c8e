//! Constants of the drives and their motors.

/// Mass of cart and motor, the motor's inertia reflected to the guideway, kg.
pub(super) const MASS_KG: f64 = 40.0;
/// Force at rated torque, N.
pub const RATED_FORCE_N: f64 = 1000.0;
/// Torque limit, in rated torques.
pub const TORQUE_LIMIT: f64 = 3.0;
/// Position loop: velocity per position error, 1/s.
pub(super) const POSITION_GAIN: f64 = 150.0;
/// Velocity loop: acceleration per velocity error, 1/s.
pub(super) const VELOCITY_GAIN: f64 = 900.0;
/// Velocity loop: time of its integral, s.
pub(super) const VELOCITY_INTEGRAL_S: f64 = 4.5e-3;
/// Share of the way the current loop goes in one step: `1 - exp(-62.5 µs / 160 µs)`.
pub(super) const CURRENT_SHARE: f64 = 0.323_4;
/// Viscous friction, N s/m.
pub(super) const FRICTION: f64 = 200.0;
