//! One axis: an AX5000-like cascade, its motor and its cart `[T 4.1.7, Fig. 4.6]`.
//!
//! ```text
//! position reference --(-)-- P --(+)--(-)-- PI --(+)-- current loop -- motor + cart -- position
//!        |                       |             |            |
//!        '--- derivative --------'        torque offset   load of the machine
//!                velocity offset
//! ```
//!
//! The reference is interpolated linearly over the cycle, as the drive's fine interpolation does. PI current control against
//! the winding is a closed first-order loop here: far above everything the cycle can see. Lengths are metres along the guideway;
//! forces are newtons there; "torque" is force over rated force.

use gantry_tau_core::control::axis::{Actual, Reference};
use gantry_tau_core::units::{CrossingError, Metres, PositionNm, TorquePermille, VelocityUmS};

/// Length of a cycle, s.
pub const CYCLE_S: f64 = 1e-3;
/// Integration steps per cycle.
pub const SUBSTEPS: u32 = 16;
/// Length of an integration step, s.
const SUBSTEP_S: f64 = CYCLE_S / 16.0;

/// Mass of cart and motor, the motor's inertia reflected to the guideway, kg.
const MASS_KG: f64 = 40.0;
/// Force at rated torque, N.
pub const RATED_FORCE_N: f64 = 1000.0;
/// Torque limit, in rated torques.
pub const TORQUE_LIMIT: f64 = 3.0;
/// Position loop: velocity per position error, 1/s.
const POSITION_GAIN: f64 = 150.0;
/// Velocity loop: acceleration per velocity error, 1/s.
const VELOCITY_GAIN: f64 = 900.0;
/// Velocity loop: time of its integral, s.
const VELOCITY_INTEGRAL_S: f64 = 4.5e-3;
/// Share of the way the current loop goes in one step: `1 - exp(-62.5 µs / 160 µs)`.
const CURRENT_SHARE: f64 = 0.323_4;
/// Viscous friction, N s/m.
const FRICTION: f64 = 200.0;

/// State of one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// End of the reference in force, m.
    reference_m: f64,
    velocity_offset: VelocityUmS,
    torque_offset: TorquePermille,
    /// Position of the fine interpolation, m.
    interpolated_m: f64,
    position_m: f64,
    velocity_m_per_s: f64,
    force_n: f64,
    /// Integral part of the velocity loop, N.
    integral_n: f64,
}

impl Drive {
    /// Creates a drive at rest at `reference`.
    #[must_use]
    pub fn at_rest(reference: &Reference) -> Self {
        let position_m = reference.position.to_metres().0;
        Self {
            reference_m: position_m,
            velocity_offset: reference.velocity_offset,
            torque_offset: reference.torque_offset,
            interpolated_m: position_m,
            position_m,
            velocity_m_per_s: 0.0,
            force_n: 0.0,
            integral_n: 0.0,
        }
    }

    /// Takes what is to be followed in the next cycle.
    pub fn command(&mut self, reference: &Reference) {
        self.reference_m = reference.position.to_metres().0;
        self.velocity_offset = reference.velocity_offset;
        self.torque_offset = reference.torque_offset;
    }

    /// Runs one cycle, under `load_n` newtons that push the cart along its guideway.
    pub fn advance(&mut self, load_n: f64) {
        let start_m = self.interpolated_m;
        let way_m = self.reference_m - start_m;
        let feed_forward = way_m / CYCLE_S + f64::from(self.velocity_offset.0) * 1e-6;
        for substep in 0..SUBSTEPS {
            // Reference and position at the start of the step: at constant speed the error is then zero.
            let share = f64::from(substep) / f64::from(SUBSTEPS);
            self.interpolated_m = start_m + way_m * share;
            self.substep(feed_forward, load_n);
        }
        self.interpolated_m = self.reference_m;
    }

    /// Integrates controllers, then motor and cart.
    fn substep(&mut self, feed_forward_m_per_s: f64, load_n: f64) {
        let position_error_m = self.interpolated_m - self.position_m;
        let velocity_reference = POSITION_GAIN * position_error_m + feed_forward_m_per_s;
        let velocity_error = velocity_reference - self.velocity_m_per_s;
        let proportional_n = MASS_KG * VELOCITY_GAIN * velocity_error;
        let offset_n = f64::from(self.torque_offset.0) * 1e-3 * RATED_FORCE_N;
        let limit_n = TORQUE_LIMIT * RATED_FORCE_N;
        // The integral stops at the limit, so that it does not wind up.
        let grown_n = self.integral_n + proportional_n * (SUBSTEP_S / VELOCITY_INTEGRAL_S);
        self.integral_n = grown_n.clamp(-limit_n, limit_n);
        let wanted_n = (proportional_n + self.integral_n + offset_n).clamp(-limit_n, limit_n);

        self.force_n += (wanted_n - self.force_n) * CURRENT_SHARE;
        let sum_n = self.force_n + load_n - FRICTION * self.velocity_m_per_s;
        self.velocity_m_per_s += sum_n / MASS_KG * SUBSTEP_S;
        self.position_m += self.velocity_m_per_s * SUBSTEP_S;
    }

    /// Motor side of the axis, m.
    #[must_use]
    pub const fn position_m(&self) -> f64 {
        self.position_m
    }
}

/// Returns the report of all drives of one axis: the mean over its motors, which share cart and load.
///
/// # Errors
/// [`CrossingError`] if the axis has run out of the range of positions, or has no motor.
pub fn report<'a>(drives: impl Iterator<Item = &'a Drive> + Clone) -> Result<Actual, CrossingError> {
    let mean = |of: fn(&Drive) -> f64| mean(drives.clone().map(of));
    Ok(Actual {
        position: PositionNm::from_metres(Metres(mean(|drive| drive.position_m)))?,
        velocity: velocity(mean(|drive| drive.velocity_m_per_s))?,
        torque: torque(mean(|drive| drive.force_n / RATED_FORCE_N))?,
    })
}

/// Returns the mean; NaN of nothing.
pub(super) fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / count
}

/// Nearest integer, halves away from zero; an error when not finite or beyond 2^53. Through the one crossing of [`gantry_tau_core::units`].
fn nearest(value: f64) -> Result<i64, CrossingError> {
    PositionNm::from_metres(Metres(value * 1e-9)).map(|nm| nm.0)
}

/// m/s to µm/s; beyond ± 2.1 km/s it reports the end of the range, as a drive does.
fn velocity(metres_per_second: f64) -> Result<VelocityUmS, CrossingError> {
    let um_per_s = nearest(metres_per_second * 1e6)?.clamp(i32::MIN.into(), i32::MAX.into());
    Ok(VelocityUmS(um_per_s as i32))
}

/// Fraction of rated torque to per mille; beyond ± 32 times rated it reports the end of the range.
fn torque(fraction: f64) -> Result<TorquePermille, CrossingError> {
    let permille = nearest(fraction * 1e3)?.clamp(i16::MIN.into(), i16::MAX.into());
    Ok(TorquePermille(permille as i16))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reports_are_rounded_and_saturate() {
        assert_eq!(nearest(2.5), Ok(3));
        assert_eq!(velocity(-0.001_234_4), Ok(VelocityUmS(-1234)));
        assert_eq!(velocity(1e6), Ok(VelocityUmS(i32::MAX)));
        assert_eq!(torque(-0.25), Ok(TorquePermille(-250)));
        assert_eq!(torque(1e3), Ok(TorquePermille(i16::MAX)));
        assert_eq!(torque(f64::NAN), Err(CrossingError::NotFinite));
    }

    fn reference(nm: i64) -> Reference {
        Reference { position: PositionNm(nm), velocity_offset: Default::default(), torque_offset: Default::default() }
    }

    fn actual(drive: &Drive) -> Actual {
        report(std::iter::once(drive)).unwrap()
    }

    fn error_nm(drive: &Drive, nm: i64) -> i64 {
        (actual(drive).position.0 - nm).abs()
    }

    #[test]
    fn settles_after_a_step() {
        let pushed = Reference { torque_offset: TorquePermille(200), ..reference(0) };
        // By one over the gain of the position loop.
        let shifted = Reference { velocity_offset: VelocityUmS(150), ..reference(0) };
        for (of, reference_after, load_n, cycles, (nm, within_nm), permille) in [
            ("the reference", reference(20_000), 0.0, 60, (20_000, 100), None),
            ("the load", reference(0), 300.0, 80, (0, 100), Some(-300)),
            ("the torque offset, absorbed by the position loop", pushed, 0.0, 100, (0, 100), Some(0)),
            ("the velocity offset", shifted, 0.0, 200, (1_000, 10), None),
        ] {
            let mut drive = Drive::at_rest(&reference(0));
            drive.command(&reference_after);
            for _ in 0..cycles {
                drive.advance(load_n);
                assert!(actual(&drive).position.0 < 40_000, "{of}: {drive:?}");
            }
            assert!(error_nm(&drive, nm) < within_nm, "{of}: {drive:?}");
            assert!(permille.is_none_or(|permille| actual(&drive).torque.0 == permille), "{of}: {drive:?}");
        }
    }

    #[test]
    fn follows_motion_closely() {
        let mut drive = Drive::at_rest(&reference(0));
        let mut worst = 0;
        for cycle in 1..1000_i64 {
            // Up to 0.5 m/s, at 2 m/s^2.
            let nm = if cycle < 250 { cycle * cycle * 1000 } else { 250 * 250 * 1000 + (cycle - 250) * 500_000 };
            drive.command(&reference(nm));
            drive.advance(0.0);
            worst = worst.max(error_nm(&drive, nm));
        }
        assert!(worst < 100_000, "{worst} nm");
        assert!(error_nm(&drive, 250 * 250 * 1000 + 749 * 500_000) < 1000);
    }

    #[test]
    fn overload_is_limited_and_recovered_from() {
        let mut drive = Drive::at_rest(&reference(0));
        for _ in 0..20 {
            drive.advance(1.2 * TORQUE_LIMIT * RATED_FORCE_N);
            assert!(actual(&drive).torque.0 >= -3000);
        }
        for _ in 0..400 {
            drive.advance(0.0);
        }
        assert!(error_nm(&drive, 0) < 100, "{drive:?}");
    }
}
