//! Report of the drives of an axis, in the units of the reference path.

use gantry_tau_core::control::axis::Actual;
use gantry_tau_core::units::{CrossingError, Metres, PositionNm, TorquePermille, VelocityUmS};

use gantry_tau_machine::robot_file::RATED_FORCE_N;

use super::Drive;
use super::encoder::Motion;

/// Measurements at the end of a cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Report {
    pub(super) motion: Motion,
    pub(super) force_n: f64,
}

/// Returns the report of all drives of one axis: the mean over its motors, which share cart and
/// load.
///
/// # Errors
/// [`CrossingError`] if the axis has run out of the range of positions, or has no motor.
pub fn report<'a>(
    drives: impl Iterator<Item = &'a Drive> + Clone,
) -> Result<Actual, CrossingError> {
    let reports = drives.map(Drive::report);
    let position_m = mean(reports.clone().map(|report| report.motion.0));
    let m_per_s = mean(reports.clone().map(|report| report.motion.1));
    Ok(Actual {
        position: PositionNm::from_metres(Metres(position_m))?,
        velocity: velocity(m_per_s)?,
        torque: torque(mean(reports.map(|report| report.force_n / RATED_FORCE_N)))?,
    })
}

/// Returns the mean; NaN of nothing.
pub(crate) fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / count
}

/// Nearest integer, halves away from zero; an error when not finite or beyond 2^53. Through the one
/// crossing of [`gantry_tau_core::units`].
pub(super) fn nearest(value: f64) -> Result<i64, CrossingError> {
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
}
