//! Checks of the model wing that its solutions and offsets pass last.

use crate::model::compensation::{CompensatorConfig, Correction};
use crate::model::kinematics::KinematicsError;

/// Offsets from `q` to `command` (q-units), within the limits: the last step of every correction.
///
/// # Errors
/// [`KinematicsError::NotFinite`] when an offset is NaN.
pub fn bounded<const N: usize>(
    config: &CompensatorConfig<N>,
    q: &[f64; N],
    command: &[f64; N],
) -> Result<Correction<N>, KinematicsError> {
    config.bounded(q, command)
}
