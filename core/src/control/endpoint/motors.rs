//! Map from axes to motors.

use core::fmt;

use crate::control::axis::Reference;

/// Axis of each motor, for `N` axes. Two motors on one cart (F1) have the same axis, so they always
/// receive the same reference (T10).
///
/// ```
/// use gantry_tau_core::control::endpoint::MotorMap;
/// let pairs = MotorMap::<3, 6>::new([0, 0, 1, 1, 2, 2])?;
/// assert_eq!(pairs.axis_of_motor()[3], 1);
/// assert!(MotorMap::<3, 1>::new([3]).is_err());
/// # Ok::<(), gantry_tau_core::control::endpoint::MotorMapError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct MotorMap<const N: usize, const MOTORS: usize> {
    axis_of_motor: [usize; MOTORS],
}

/// Error of [`MotorMap::new`]: a motor is mapped to an axis that does not exist.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct MotorMapError {
    /// Index of the motor.
    pub motor: usize,
    /// Its axis.
    pub axis: usize,
    /// Number of axes.
    pub axes: usize,
}

impl fmt::Display for MotorMapError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { motor, axis, axes } = self;
        write!(
            f,
            "motor {motor} is mapped to axis {axis}, but there are only {axes} axes (counted from 0)"
        )
    }
}

impl core::error::Error for MotorMapError {}

impl<const N: usize, const MOTORS: usize> MotorMap<N, MOTORS> {
    /// Checks a map from motors to axes.
    ///
    /// # Errors
    /// The first motor whose axis does not exist.
    pub fn new(axis_of_motor: [usize; MOTORS]) -> Result<Self, MotorMapError> {
        for (motor, axis) in axis_of_motor.into_iter().enumerate() {
            if axis >= N {
                return Err(MotorMapError {
                    motor,
                    axis,
                    axes: N,
                });
            }
        }
        Ok(Self { axis_of_motor })
    }

    /// Returns the axis of each motor.
    #[must_use]
    pub const fn axis_of_motor(&self) -> &[usize; MOTORS] {
        &self.axis_of_motor
    }

    /// Returns the reference of each motor. Every axis of a checked map exists, so `None` is never
    /// returned; a reference has no default.
    #[must_use]
    pub fn spread(&self, axes: &[Reference; N]) -> Option<[Reference; MOTORS]> {
        let mut motors = [*axes.first()?; MOTORS];
        for (motor, axis) in motors.iter_mut().zip(&self.axis_of_motor) {
            *motor = *axes.get(*axis)?;
        }
        Some(motors)
    }
}
