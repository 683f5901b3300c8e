//! Floats of the simulation to integers of the reference path, all through the one crossing of [`gantry_tau_core::units`].

use gantry_tau_core::units::{CrossingError, Metres, PositionNm, TorquePermille, VelocityUmS};

/// Nearest integer, halves away from zero.
///
/// # Errors
/// [`CrossingError`] when not finite or beyond 2^53.
pub(super) fn nearest(value: f64) -> Result<i64, CrossingError> {
    PositionNm::from_metres(Metres(value * 1e-9)).map(|nm| nm.0)
}

/// m/s to µm/s; beyond ± 2.1 km/s it reports the end of the range, as a drive does.
///
/// # Errors
/// [`CrossingError`] when not finite.
pub(super) fn velocity(metres_per_second: f64) -> Result<VelocityUmS, CrossingError> {
    let um_per_s = nearest(metres_per_second * 1e6)?.clamp(i64::from(i32::MIN), i64::from(i32::MAX));
    Ok(VelocityUmS(i32::try_from(um_per_s).unwrap_or_default()))
}

/// Fraction of rated torque to per mille; beyond ± 32 times rated it reports the end of the range.
///
/// # Errors
/// [`CrossingError`] when not finite.
pub(super) fn torque(fraction: f64) -> Result<TorquePermille, CrossingError> {
    let permille = nearest(fraction * 1e3)?.clamp(i64::from(i16::MIN), i64::from(i16::MAX));
    Ok(TorquePermille(i16::try_from(permille).unwrap_or_default()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounds_and_saturates() {
        assert_eq!(nearest(2.5), Ok(3));
        assert_eq!(velocity(-0.001_234_4), Ok(VelocityUmS(-1234)));
        assert_eq!(velocity(1e6), Ok(VelocityUmS(i32::MAX)));
        assert_eq!(torque(-0.25), Ok(TorquePermille(-250)));
        assert_eq!(torque(1e3), Ok(TorquePermille(i16::MAX)));
        assert_eq!(torque(f64::NAN), Err(CrossingError::NotFinite));
    }
}
