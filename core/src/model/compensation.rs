//! Configuration and output of the compensators `[T 5.2.3]`.
//!
//! A load moves the tool by `dT_links` through the links, and each cart by `r = c tau`. Both are
//! taken off the reference: `q_cmd = IK(T - dT_links) - r`. The thesis says "adding": with the load
//! counted as applied *by the environment to the platform*, the displacement has the load's
//! direction, and its negative cancels it. The wrong sign doubles the error.
//!
//! Measured load fed back through an estimated compliance is positive feedback against a stiff
//! workpiece: stable while the estimate stays below the machine's compliance plus the workpiece's.
//! Hence a gain of at most 1, and limits.
//!
//! [`l2::Compensator`](super::l2::Compensator) and [`f1::Compensator`](super::f1::Compensator) have
//! two maps each, to first order (`correct`), which is cheap, and exact (`correct_exact_at`). Both
//! maps end in the same bounded step. Instructions per cycle are counted in
//! `tests/benches/instructions/counts.toml`.

use core::fmt;

use crate::model::kinematics::KinematicsError;
use crate::model::robot::SCALE_RANGE;
use crate::units::{Metres, OffsetNm, PositionNm};
use crate::zip::zip;

/// Gain, limits and units of a compensator, not yet checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CompensatorConfig<const N: usize> {
    /// Share of the computed displacement that is corrected, 0 to 1.
    pub gain: f64,
    /// Largest magnitude of each axis' offset; zero means zero.
    pub limits: [OffsetNm; N],
    /// Length of one unit of each `q`, m.
    pub metres_per_q: [f64; N],
}

impl<const N: usize> CompensatorConfig<N> {
    pub(super) fn check(&self) -> Result<(), CompensatorError> {
        if !(0.0..=1.0).contains(&self.gain) {
            return Err(CompensatorError::Gain);
        }
        let (lower, upper) = SCALE_RANGE;
        for (axis, (limit, scale)) in zip(&self.limits, &self.metres_per_q).enumerate() {
            if limit.0 < 0 {
                return Err(CompensatorError::Limit { axis });
            }
            if !(lower..=upper).contains(scale) {
                return Err(CompensatorError::MetresPerQ { axis });
            }
        }
        Ok(())
    }

    /// Converts nominal positions to q-units.
    #[inline]
    #[must_use]
    pub fn q_of(&self, nominal: &[PositionNm; N]) -> [f64; N] {
        let mut q = nominal.map(|position| position.to_metres().0);
        for (q, scale) in q.iter_mut().zip(&self.metres_per_q) {
            *q /= scale;
        }
        q
    }

    /// Returns the offsets from `q` to `command` (q-units), within the limits: the last step of
    /// every correction.
    ///
    /// Any numbers, and any configuration, lead to offsets within the limits or to an error.
    ///
    /// # Errors
    /// [`KinematicsError::NotFinite`] when an offset is NaN. Infinities are cut.
    #[inline]
    pub(crate) fn bounded(
        &self,
        q: &[f64; N],
        command: &[f64; N],
    ) -> Result<Correction<N>, KinematicsError> {
        let mut offsets = [OffsetNm(0); N];
        let mut saturated = [false; N];
        for index in 0..N {
            // Every array has N elements.
            let (Some(q), Some(command), Some(scale), Some(limit), Some(offset), Some(cut)) = (
                q.get(index),
                command.get(index),
                self.metres_per_q.get(index),
                self.limits.get(index),
                offsets.get_mut(index),
                saturated.get_mut(index),
            ) else {
                continue;
            };
            // Its only error is NaN.
            (*offset, *cut) = OffsetNm::from_metres_within(Metres((command - q) * scale), *limit)
                .map_err(|_| KinematicsError::NotFinite)?;
        }
        Ok(Correction { offsets, saturated })
    }

    /// As [`bounded`](Self::bounded), for a map without gain: the share `gain` of the way from `q`
    /// to `exact`.
    ///
    /// # Errors
    /// As [`bounded`](Self::bounded).
    pub(super) fn bounded_share(
        &self,
        q: &[f64; N],
        exact: &[f64; N],
    ) -> Result<Correction<N>, KinematicsError> {
        let mut command = *q;
        for (command, exact) in command.iter_mut().zip(exact) {
            *command += self.gain * (exact - *command);
        }
        self.bounded(q, &command)
    }
}

/// Error in the configuration of a compensator.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CompensatorError {
    /// `gain` is not from 0 to 1.
    Gain,
    /// A limit is negative.
    Limit {
        /// Index of the axis.
        axis: usize,
    },
    /// `metres_per_q` is not finite or outside [`SCALE_RANGE`].
    MetresPerQ {
        /// Index of the axis.
        axis: usize,
    },
}

impl fmt::Display for CompensatorError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Gain => f.write_str("gain must be from 0 to 1"),
            Self::Limit { axis } => write!(f, "limits[{axis}] must not be negative"),
            Self::MetresPerQ { axis } => {
                let (lower, upper) = SCALE_RANGE;
                write!(
                    f,
                    "metres_per_q[{axis}] must be from {lower:e} to {upper:e}"
                )
            }
        }
    }
}

impl core::error::Error for CompensatorError {}

/// Position offsets of one cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Correction<const N: usize> {
    /// Offset of each axis, within its limit.
    pub offsets: [OffsetNm; N],
    /// True where the limit reduced the offset.
    pub saturated: [bool; N],
}

impl<const N: usize> Correction<N> {
    /// Zero offsets.
    pub const ZERO: Self = Self {
        offsets: [OffsetNm(0); N],
        saturated: [false; N],
    };
}
