//! Units of the two number worlds, and the one crossing between them.
//!
//! The *reference path* (anything that can reach a drive) is integer: nanometres, µm/s, per mille
//! of rated torque, ticks. The *float path* (kinematics, statics, compensation) is `f64` in SI
//! units. [`PositionNm::from_nanometres`] and [`PositionNm::to_metres`] are the only ways across;
//! every other conversion of a position is built on them. A [`WrenchSample`] is not on the reference
//! path: it is told to a client.
//!
//! ```
//! use gantry_tau_core::units::{CrossingError, Metres, PositionNm};
//! assert_eq!(PositionNm::from_metres(Metres(1.25)), Ok(PositionNm(1_250_000_000)));
//! assert_eq!(PositionNm::from_metres(Metres(f64::NAN)), Err(CrossingError::NotFinite));
//! ```

mod wrench;

use core::fmt;

pub use wrench::WrenchSample;

/// Declares integers of a unit.
macro_rules! counts {
    ($($(#[$doc:meta])* $name:ident($count:ty);)*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
        #[cfg_attr(kani, derive(kani::Arbitrary))]
        pub struct $name(pub $count);
    )*};
}

counts! {
    /// Absolute position of an axis, in nanometres (1 nm steps, ± 9.2e9 m).
    PositionNm(i64);
    /// Offset added to a position reference, in nanometres (1 nm steps, ± 2.1 m).
    OffsetNm(i32);
    /// Velocity, in micrometres per second (as object 60B1h of CiA 402 with that unit configured).
    VelocityUmS(i32);
    /// Torque, in per mille of the drive's rated torque (as object 60B2h of CiA 402).
    TorquePermille(i16);
    /// Force, in millinewtons (1 mN steps, ± 2 147 kN).
    ForceMn(i32);
    /// Moment, in micronewton metres (1 µN m steps, ± 2 147 N m).
    MomentUnm(i32);
    /// Number of a server cycle. It never wraps: 2^64 cycles of 1 ms are 584 million years.
    Tick(u64);
    /// Number of a session. Taken from an [`EpochRange`], so that no old frame can ever match.
    Epoch(u64);
    /// Number of a command within its session, counted by the client from 1.
    Sequence(u64);
}

/// Epochs that no other run of the server has given or will give: reserved in a persisted counter
/// before the server starts.
///
/// ```
/// use gantry_tau_core::units::{Epoch, EpochRange};
/// let stored = 4_096; // read from storage; 8192 is written back before the server starts
/// let epochs = EpochRange { first: Epoch(stored + 1), last: Epoch(8_192) };
/// assert_eq!(epochs.after(Epoch(0)), Some(Epoch(4_097)));
/// assert_eq!(epochs.after(Epoch(4_097)), Some(Epoch(4_098)));
/// assert_eq!(epochs.after(Epoch(8_192)), None);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct EpochRange {
    /// First epoch of the range.
    pub first: Epoch,
    /// Last epoch of the range; smaller than `first` for an empty range.
    pub last: Epoch,
}

impl EpochRange {
    /// Every epoch there is: for tests and simulations, whose frames end with them.
    pub const VOLATILE: Self = Self {
        first: Epoch(1),
        last: Epoch(u64::MAX),
    };

    /// Returns the first epoch of the range above `used`; `None` when the range is used up.
    #[inline]
    #[must_use]
    pub fn after(&self, used: Epoch) -> Option<Epoch> {
        let next = Epoch(used.0.checked_add(1)?).max(self.first);
        (next <= self.last).then_some(next)
    }
}

/// Unit of a [`crate::control::channel::Channel`]: [`OffsetNm`], [`VelocityUmS`] or
/// [`TorquePermille`].
pub trait ChannelUnit: Copy + Eq + sealed::Sealed {
    /// Returns the count.
    fn count(self) -> i32;
    /// Returns the value of this count, cut to the unit's range.
    fn saturating_from(count: i32) -> Self;
}

mod sealed {
    /// Closed list of the units that a channel can have.
    pub trait Sealed {}
    impl Sealed for super::OffsetNm {}
    impl Sealed for super::VelocityUmS {}
    impl Sealed for super::TorquePermille {}
}

impl ChannelUnit for OffsetNm {
    #[inline]
    fn count(self) -> i32 {
        self.0
    }

    #[inline]
    fn saturating_from(count: i32) -> Self {
        Self(count)
    }
}

impl ChannelUnit for VelocityUmS {
    #[inline]
    fn count(self) -> i32 {
        self.0
    }

    #[inline]
    fn saturating_from(count: i32) -> Self {
        Self(count)
    }
}

impl ChannelUnit for TorquePermille {
    #[inline]
    fn count(self) -> i32 {
        i32::from(self.0)
    }

    #[inline]
    fn saturating_from(count: i32) -> Self {
        let end = if count < 0 { i16::MIN } else { i16::MAX };
        Self(i16::try_from(count).unwrap_or(end))
    }
}

/// Length on the float path, in metres.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Metres(pub f64);

/// Largest magnitude the crossing accepts, in nanometres: 2^53, about 9 007 km.
/// Up to here every integer is an `f64`, so nothing but the product `metres * 1e9` is rounded.
pub const CROSSING_LIMIT_NM: i64 = 9_007_199_254_740_992;

/// 2^31, from which on no integer is an `i32`.
const I32_END: f64 = 2_147_483_648.0;

/// [`CROSSING_LIMIT_NM`] as the float it is exactly.
const CROSSING_LIMIT_NM_F64: f64 = 9_007_199_254_740_992.0;

/// Nanometres per metre.
const NM_PER_METRE: f64 = 1e9;

/// Error of the crossing from float to integer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CrossingError {
    /// The value is NaN or infinite.
    NotFinite,
    /// The value is finite but larger in magnitude than `limit_nm` nanometres.
    OutOfRange {
        /// Largest magnitude that would have been accepted, in nanometres.
        limit_nm: i64,
    },
}

impl fmt::Display for CrossingError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFinite => f.write_str("value is not finite"),
            Self::OutOfRange { limit_nm } => write!(f, "value is beyond {limit_nm} nm"),
        }
    }
}

impl core::error::Error for CrossingError {}

impl PositionNm {
    /// Float to integer: rounds to the nearest nanometre, halves away from zero.
    ///
    /// Exact to half a nanometre plus one ulp of the product `metres * 1e9`.
    ///
    /// # Errors
    /// [`CrossingError::NotFinite`] for NaN and infinities; [`CrossingError::OutOfRange`] from
    /// [`CROSSING_LIMIT_NM`] on.
    #[inline]
    pub fn from_metres(value: Metres) -> Result<Self, CrossingError> {
        match Self::from_nanometres(value.0 * NM_PER_METRE) {
            // The product of an infinity is one, and fails as such; the product of a huge finite
            // value may be one too.
            Err(_) if !value.0.is_finite() => Err(CrossingError::NotFinite),
            crossed => crossed,
        }
    }

    /// Float to integer, for a count of nanometres: the nearest whole one, halves away from zero.
    /// Nothing is rounded but this.
    ///
    /// # Errors
    /// [`CrossingError::NotFinite`] for NaN; [`CrossingError::OutOfRange`] from
    /// [`CROSSING_LIMIT_NM`] on, infinities included.
    #[inline]
    pub fn from_nanometres(count: f64) -> Result<Self, CrossingError> {
        // NaN is not within.
        let within = count.abs() < CROSSING_LIMIT_NM_F64;
        if !within {
            return Err(if count.is_nan() {
                CrossingError::NotFinite
            } else {
                CrossingError::OutOfRange {
                    limit_nm: CROSSING_LIMIT_NM,
                }
            });
        }
        #[expect(clippy::as_conversions, reason = "the guard above keeps it inside i64")]
        let truncated = count as i64;
        let rest = count - Self(truncated).as_f64();
        // Below 2^53 there is nothing to wrap.
        Ok(Self(truncated.wrapping_add(carry(rest))))
    }

    /// Integer to float. Exact to half an ulp; total.
    #[inline]
    #[must_use]
    pub fn to_metres(self) -> Metres {
        Metres(self.as_f64() / NM_PER_METRE)
    }

    /// The count of nanometres as a float, rounded to nearest.
    #[inline]
    #[expect(
        clippy::as_conversions,
        reason = "i64 to f64 is total; the standard library has no `From` because it may round"
    )]
    fn as_f64(self) -> f64 {
        self.0 as f64
    }
}

impl OffsetNm {
    /// Float to integer, as [`PositionNm::from_metres`], for offsets.
    ///
    /// # Errors
    /// As [`PositionNm::from_metres`]; [`CrossingError::OutOfRange`] already from ± 2^31 nm on.
    #[inline]
    pub fn from_metres(value: Metres) -> Result<Self, CrossingError> {
        let wide = PositionNm::from_metres(value)?;
        i32::try_from(wide.0)
            .map(Self)
            .map_err(|_| CrossingError::OutOfRange {
                limit_nm: i64::from(i32::MAX),
            })
    }

    /// Float to integer, cut to at most `limit` in magnitude (a negative limit is zero), and
    /// whether it was cut.
    ///
    /// The last thing done is to compare integers: the limit holds for every float.
    ///
    /// # Errors
    /// [`CrossingError::NotFinite`] for NaN. Infinities are cut.
    #[inline]
    pub fn from_metres_within(value: Metres, limit: Self) -> Result<(Self, bool), CrossingError> {
        let (nm, is_cut) =
            nearest_within(value.0 * NM_PER_METRE, limit.0).ok_or(CrossingError::NotFinite)?;
        Ok((Self(nm), is_cut))
    }

    /// Integer to float; total.
    #[inline]
    #[must_use]
    pub fn to_metres(self) -> Metres {
        PositionNm(i64::from(self.0)).to_metres()
    }
}

/// Returns the nearest whole number, halves away from zero, cut to at most `limit` in magnitude (a
/// negative limit is zero), and whether it was cut. `None` for NaN.
fn nearest_within(count: f64, limit: i32) -> Option<(i32, bool)> {
    let highest = limit.max(0);
    let lowest = highest.wrapping_neg();
    let nearest = if count.abs() < I32_END {
        #[expect(clippy::as_conversions, reason = "the guard above keeps it inside i32")]
        let truncated = count as i32;
        truncated.checked_add(carry(count - f64::from(truncated)))
    } else {
        None
    };
    match nearest {
        Some(nearest) => Some((
            nearest.max(lowest).min(highest),
            !(lowest..=highest).contains(&nearest),
        )),
        None if count > 0.0 => Some((highest, true)),
        None if count < 0.0 => Some((lowest, true)),
        None => None,
    }
}

/// Returns what the rest behind a truncated number adds to the nearest one.
fn carry<T: From<i8>>(rest: f64) -> T {
    T::from(if rest >= 0.5 {
        1
    } else if rest <= -0.5 {
        -1
    } else {
        0
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounds_to_the_nearest_nanometre() {
        for (metres, nm) in [
            (0.0, 0),
            (-0.0, 0),
            (0.4e-9, 0),
            (0.6e-9, 1),
            (-0.6e-9, -1),
            (1e-7, 100),
            (1.25, 1_250_000_000),
            (-0.416_820_228_882_484_93, -416_820_229),
        ] {
            assert_eq!(PositionNm::from_metres(Metres(metres)), Ok(PositionNm(nm)));
        }
    }

    #[test]
    fn refuses_what_is_not_a_position() {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert_eq!(
                PositionNm::from_metres(Metres(bad)),
                Err(CrossingError::NotFinite)
            );
        }
        for far in [1e7, -1e7, f64::MAX, f64::MIN] {
            assert_eq!(
                PositionNm::from_metres(Metres(far)),
                Err(CrossingError::OutOfRange {
                    limit_nm: CROSSING_LIMIT_NM
                })
            );
        }
        assert_eq!(
            OffsetNm::from_metres(Metres(2.2)),
            Err(CrossingError::OutOfRange {
                limit_nm: i64::from(i32::MAX)
            })
        );
    }

    /// The cut crossing against the wide one, about every border.
    #[test]
    fn a_cut_count_is_the_nearest_one_or_the_limit() {
        let ends = [
            0.0,
            1.0,
            2_000_000.0,
            2_147_483_647.0,
            2_147_483_648.0,
            9e15,
            1e300,
        ];
        let offs = [0.0, 0.25, 0.499_999_999_999_999_94, 0.5, 0.75, 1.0, 1.5];
        let limits = [i32::MIN, -1, 0, 1, 2_000_000, i32::MAX - 1, i32::MAX];
        for end in ends {
            for off in offs {
                for count in [end + off, end - off, -end + off, -end - off] {
                    let wide = PositionNm::from_nanometres(count)
                        .map_or(if count > 0.0 { i64::MAX } else { i64::MIN }, |whole| {
                            whole.0
                        });
                    for limit in limits {
                        let most = i64::from(limit.max(0));
                        let cut = wide.clamp(-most, most);
                        let expected = (i32::try_from(cut).unwrap(), cut != wide);
                        assert_eq!(
                            nearest_within(count, limit),
                            Some(expected),
                            "{count} {limit}"
                        );
                    }
                }
            }
        }
        for (count, expected) in [(f64::INFINITY, 7), (f64::NEG_INFINITY, -7)] {
            assert_eq!(nearest_within(count, 7), Some((expected, true)));
        }
        assert_eq!(nearest_within(f64::NAN, 7), None);
    }
}
