//! One bounded reference value: gate and ramp. Position, velocity and torque offset of every axis
//! are instances of it.
//!
//! Integers only, one step per tick, three verbs: [`Channel::hold`], [`Channel::follow`],
//! [`Channel::ramp`]. For every verb and every target, with [`Limits`] `M`, `S`, `A`, `rho` and a
//! valid channel:
//!
//! - the value changes by at most `S` per tick (T1), the change by at most `A` (T2), the magnitude
//!   stays at most `M` (T3);
//! - `ramp` moves by exactly `min(rho, |value|)` towards zero and never past it (T5).

use core::fmt;
use core::marker::PhantomData;
use core::num::NonZeroU32;

use crate::units::ChannelUnit;

/// Limits of a channel as four numbers, not yet checked: in the channel's unit, per tick and per
/// tick squared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct LimitValues {
    /// M: largest magnitude; 0 disables the channel.
    pub max: i32,
    /// S: largest change per tick.
    pub step: i32,
    /// A: largest change of the change per tick.
    pub accel: i32,
    /// rho: change per tick of the ramp to zero.
    pub ramp: i32,
}

/// Limits of a channel with values in `U`, checked once.
///
/// ```
/// use gantry_tau_core::control::channel::{LimitValues, Limits, LimitsError};
/// use gantry_tau_core::units::OffsetNm;
/// // At most 2 mm, 5 µm per tick, and 0.1 µm per tick on the way back to zero.
/// let values = LimitValues { max: 2_000_000, step: 5_000, accel: 10_000, ramp: 100 };
/// let limits = Limits::<OffsetNm>::new(values)?;
/// assert_eq!(limits.step(), 5_000);
/// let hasty = Limits::<OffsetNm>::new(LimitValues { ramp: 6_000, ..values });
/// assert_eq!(hasty, Err(LimitsError::RampAboveStep { ramp: 6_000, step: 5_000 }));
/// # Ok::<(), LimitsError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(
    feature = "serde",
    serde(try_from = "LimitValues", into = "LimitValues", bound = "U: Copy")
)]
pub struct Limits<U> {
    max: u32,
    step: u32,
    accel: u32,
    ramp: NonZeroU32,
    unit: PhantomData<U>,
}

impl<U> From<Limits<U>> for LimitValues {
    fn from(limits: Limits<U>) -> Self {
        limits.values()
    }
}

impl<U> TryFrom<LimitValues> for Limits<U> {
    type Error = LimitsError;

    fn try_from(values: LimitValues) -> Result<Self, Self::Error> {
        Self::new(values)
    }
}

/// Error of [`Limits::new`]. Every field carries the refused value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum LimitsError {
    /// `M` is negative. (Zero disables the channel.)
    NegativeMax {
        /// The refused `M`.
        max: i32,
    },
    /// `rho` is zero or negative: an offset could never return.
    RampNotPositive {
        /// The refused `rho`.
        ramp: i32,
    },
    /// `rho > S`: the ramp would be faster than any step may be.
    RampAboveStep {
        /// The refused `rho`.
        ramp: i32,
        /// The `S` it exceeds.
        step: i32,
    },
    /// `S + rho > A`: a channel at full speed could not turn into its ramp within one tick.
    AccelTooSmall {
        /// The refused `A`.
        accel: i32,
        /// The smallest `A` that would do.
        needed: i64,
    },
}

impl fmt::Display for LimitsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NegativeMax { max } => write!(
                f,
                "max is {max}; it must not be negative (0 disables the channel)"
            ),
            Self::RampNotPositive { ramp } => write!(f, "ramp is {ramp}; it must be positive"),
            Self::RampAboveStep { ramp, step } => write!(f, "ramp {ramp} is above step {step}"),
            Self::AccelTooSmall { accel, needed } => {
                write!(f, "accel is {accel}; step + ramp needs at least {needed}")
            }
        }
    }
}

impl core::error::Error for LimitsError {}

impl LimitValues {
    /// Checks the four values as [`Limits::new`] does, and returns `rho`. Not generic, so that the
    /// three units share its code.
    #[expect(
        clippy::as_conversions,
        reason = "i32 to i64 is lossless; `From` is not const"
    )]
    const fn check(self) -> Result<NonZeroU32, LimitsError> {
        let Self {
            max,
            step,
            accel,
            ramp,
        } = self;
        if max < 0 {
            return Err(LimitsError::NegativeMax { max });
        }
        let Some(magnitude) = NonZeroU32::new(ramp.unsigned_abs()) else {
            return Err(LimitsError::RampNotPositive { ramp });
        };
        if ramp < 0 {
            return Err(LimitsError::RampNotPositive { ramp });
        }
        if ramp > step {
            return Err(LimitsError::RampAboveStep { ramp, step });
        }
        let needed = (step as i64).saturating_add(ramp as i64);
        if needed > accel as i64 {
            return Err(LimitsError::AccelTooSmall { accel, needed });
        }
        Ok(magnitude)
    }
}

impl<U> Limits<U> {
    /// The smallest limits there are: `M = 0`, so the channel stays at zero.
    pub const DISABLED: Self = Self {
        max: 0,
        step: 1,
        accel: 2,
        ramp: NonZeroU32::MIN,
        unit: PhantomData,
    };

    /// Checks the four values.
    ///
    /// # Errors
    /// Unless `0 <= M`, `0 < rho <= S` and `S + rho <= A`.
    pub const fn new(values: LimitValues) -> Result<Self, LimitsError> {
        match values.check() {
            Ok(ramp) => Ok(Self {
                max: values.max.unsigned_abs(),
                step: values.step.unsigned_abs(),
                accel: values.accel.unsigned_abs(),
                ramp,
                unit: PhantomData,
            }),
            Err(error) => Err(error),
        }
    }

    /// Returns the four values.
    #[must_use]
    pub fn values(&self) -> LimitValues {
        LimitValues {
            max: self.max(),
            step: self.step(),
            accel: self.accel(),
            ramp: signed(self.ramp.get()),
        }
    }

    /// M: largest magnitude; 0 disables the channel.
    #[must_use]
    pub const fn max(&self) -> i32 {
        signed(self.max)
    }

    /// S: largest change per tick.
    #[must_use]
    pub const fn step(&self) -> i32 {
        signed(self.step)
    }

    /// A: largest change of the change, per tick.
    #[must_use]
    pub const fn accel(&self) -> i32 {
        signed(self.accel)
    }

    /// rho: change per tick of the ramp to zero.
    #[must_use]
    pub const fn ramp(&self) -> u32 {
        self.ramp.get()
    }

    /// True if a value lies within `M`.
    #[inline]
    #[must_use]
    pub fn admits(&self, value: U) -> bool
    where
        U: ChannelUnit,
    {
        value.count().unsigned_abs() <= self.max
    }
}

/// Converts a limit back: it was an `i32`, so nothing wraps.
const fn signed(limit: u32) -> i32 {
    0_i32.wrapping_add_unsigned(limit)
}

#[cfg(kani)]
impl<U> kani::Arbitrary for Limits<U> {
    /// Any limits that validation accepts. Nothing is assumed: refused values become
    /// [`Limits::DISABLED`].
    fn any() -> Self {
        Self::new(kani::any()).unwrap_or(Self::DISABLED)
    }
}

/// Value of a channel and its last change, both counted in `U`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(bound = ""))]
pub struct Channel<U> {
    value: i32,
    change: i32,
    #[cfg_attr(feature = "serde", serde(skip))]
    unit: PhantomData<U>,
}

impl<U> Default for Channel<U> {
    fn default() -> Self {
        Self::ZERO
    }
}

#[cfg(kani)]
impl<U> kani::Arbitrary for Channel<U> {
    fn any() -> Self {
        Self::moved(kani::any(), kani::any())
    }
}

impl<U> Channel<U> {
    /// A channel at zero and at rest; valid under any limits.
    pub const ZERO: Self = Self::moved(0, 0);

    const fn moved(value: i32, change: i32) -> Self {
        Self {
            value,
            change,
            unit: PhantomData,
        }
    }

    /// Returns the last change of the value.
    #[must_use]
    pub const fn change(&self) -> i32 {
        self.change
    }

    /// Returns the count of the value in force.
    #[must_use]
    pub const fn count(&self) -> i32 {
        self.value
    }

    /// True at zero. (The last change may still have been the step that brought it there.)
    #[must_use]
    pub const fn is_zero(&self) -> bool {
        self.value == 0
    }

    /// Keeps the value.
    #[inline]
    #[must_use]
    pub const fn hold(self) -> Self {
        Self::moved(self.value, 0)
    }

    /// Takes one step of the ramp: `min(rho, |value|)` towards zero.
    #[inline]
    #[must_use]
    pub fn ramp(self, limits: &Limits<U>) -> Self {
        let rest = self.value.unsigned_abs();
        self.step(limits.ramp().min(rest), self.value < 0)
    }

    /// Changes the value by at most the way to another one within `M`: nothing wraps.
    #[inline]
    const fn step(&self, step: u32, upwards: bool) -> Self {
        let change = if upwards {
            0_i32.wrapping_add_unsigned(step)
        } else {
            0_i32.wrapping_sub_unsigned(step)
        };
        Self::moved(self.value.wrapping_add(change), change)
    }

    /// Returns the number of ticks that [`Self::ramp`] needs to reach zero: `ceil(|value| / rho)`.
    #[must_use]
    pub fn ramp_ticks_left(&self, limits: &Limits<U>) -> u32 {
        let magnitude = self.value.unsigned_abs();
        if magnitude == 0 {
            // Most channels, most of the time: without a division.
            return 0;
        }
        // A quotient by a nonzero divisor cannot panic; rounding up adds one where a rest remains.
        let whole = magnitude / limits.ramp;
        let rest = magnitude % limits.ramp;
        whole.saturating_add(u32::from(rest != 0))
    }
}

impl<U: ChannelUnit> Channel<U> {
    /// Builds a channel from its parts, if they are valid under `limits`.
    #[inline]
    #[must_use]
    pub fn from_parts(value: U, change: i32, limits: &Limits<U>) -> Option<Self> {
        let channel = Self::moved(value.count(), change);
        channel.is_valid(limits).then_some(channel)
    }

    /// The invariant: the value is within `M`, and the last change was within `S`.
    #[inline]
    #[must_use]
    pub const fn is_valid(&self, limits: &Limits<U>) -> bool {
        self.value.unsigned_abs() <= limits.max && self.change.unsigned_abs() <= limits.step
    }

    /// Returns the value in force.
    #[inline]
    #[must_use]
    pub fn value(&self) -> U {
        // A valid torque channel lies within the i16 range, which the configuration checks: nothing
        // is cut.
        U::saturating_from(self.value)
    }

    /// Approaches `target` (clamped to `M`) as fast as `S` and `A` allow, and never past it.
    #[inline]
    #[must_use]
    pub fn follow(self, target: U, limits: &Limits<U>) -> Self {
        let target = target.count();
        if target == self.value {
            // A valid value is within `M`.
            return self.hold();
        }
        // Not `clamp`, which panics on reversed ends: `M >= 0` holds, but the compiler cannot see
        // it.
        let max = limits.max();
        let target = target.max(max.wrapping_neg()).min(max);
        let within_step = target.abs_diff(self.value).min(limits.step);
        // |change| <= S < A, so the change that `A` allows towards the target is positive, and below 2^32.
        if target > self.value {
            self.step(
                within_step.min(limits.accel.wrapping_add_signed(self.change)),
                true,
            )
        } else {
            self.step(
                within_step.min(limits.accel.wrapping_add_signed(self.change.wrapping_neg())),
                false,
            )
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::fixture;
    use crate::units::OffsetNm;

    /// The thesis profile for positions: 2 mm, 5 µm per tick, ramp 0.1 µm per tick.
    fn limits() -> Limits<OffsetNm> {
        fixture::limits(2_000_000, 5_000, 10_000, 100)
    }

    fn checked(
        max: i32,
        step: i32,
        accel: i32,
        ramp: i32,
    ) -> Result<Limits<OffsetNm>, LimitsError> {
        Limits::new(LimitValues {
            max,
            step,
            accel,
            ramp,
        })
    }

    #[test]
    fn limits_name_what_is_wrong() {
        assert_eq!(
            checked(-1, 2, 4, 1),
            Err(LimitsError::NegativeMax { max: -1 })
        );
        for ramp in [0, -1, i32::MIN] {
            assert_eq!(
                checked(1, 2, 4, ramp),
                Err(LimitsError::RampNotPositive { ramp })
            );
        }
        assert_eq!(
            checked(1, 2, 9, 3),
            Err(LimitsError::RampAboveStep { ramp: 3, step: 2 })
        );
        assert_eq!(
            checked(1, i32::MAX, i32::MAX, 1),
            Err(LimitsError::AccelTooSmall {
                accel: i32::MAX,
                needed: i64::from(i32::MAX) + 1
            })
        );
    }

    #[test]
    fn ramps_to_the_nanometre() {
        let mut channel = Channel::from_parts(OffsetNm(-100_050), 0, &limits()).unwrap();
        assert_eq!(channel.ramp_ticks_left(&limits()), 1001);
        for tick in 1..=1000 {
            channel = channel.ramp(&limits());
            assert_eq!(channel.count(), -100_050 + 100 * tick);
        }
        channel = channel.ramp(&limits());
        assert_eq!((channel.count(), channel.change()), (0, 50));
        channel = channel.ramp(&limits());
        assert_eq!(channel, Channel::ZERO);
    }

    #[test]
    fn follows_as_fast_as_allowed_and_arrives() {
        let mut channel = Channel::ZERO;
        for _ in 0..3 {
            channel = channel.follow(OffsetNm(12_345), &limits());
        }
        assert_eq!((channel.count(), channel.change()), (12_345, 2_345));
        // Full speed ahead, then a target behind: the reversal is spread over two ticks.
        let fast = Channel::from_parts(OffsetNm(0), 5_000, &limits()).unwrap();
        assert_eq!(fast.follow(OffsetNm(i32::MIN), &limits()).change(), -5_000);
        let tight = fixture::limits(2_000_000, 5_000, 5_100, 100);
        assert_eq!(fast.follow(OffsetNm(i32::MIN), &tight).change(), -100);
    }

    #[test]
    fn a_zero_limit_means_zero() {
        let zero = fixture::limits(0, 5, 10, 1);
        assert_eq!(
            Channel::ZERO.follow(OffsetNm(i32::MAX), &zero),
            Channel::ZERO
        );
        assert!(!zero.admits(OffsetNm(1)));
    }
}
