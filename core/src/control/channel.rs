//! One bounded reference value: gate and ramp. Position, velocity and torque offset of every axis are instances of it.
//!
//! Integers only, one step per tick, three verbs: [`Channel::hold`], [`Channel::follow`], [`Channel::ramp`].
//! Whatever the verb and whatever the target, with [`Limits`] `M`, `S`, `A`, `rho` and a valid channel:
//!
//! - the value changes by at most `S` per tick (T1), the change by at most `A` (T2), the magnitude stays at most `M` (T3);
//! - `ramp` moves by exactly `min(rho, |value|)` towards zero and never past it (T5).

use core::fmt;
use core::num::NonZeroU32;

/// The four limits of a channel, checked once. Units are those of the channel's value, per tick and per tick squared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Limits {
    max: i32,
    step: i32,
    accel: i32,
    ramp: NonZeroU32,
}

/// Why four numbers are not limits. Every field carries the refused value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
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
            Self::NegativeMax { max } => write!(f, "max is {max}, it must not be negative"),
            Self::RampNotPositive { ramp } => write!(f, "ramp is {ramp}, it must be positive"),
            Self::RampAboveStep { ramp, step } => write!(f, "ramp {ramp} is above step {step}"),
            Self::AccelTooSmall { accel, needed } => {
                write!(f, "accel is {accel}, step + ramp needs at least {needed}")
            }
        }
    }
}

impl core::error::Error for LimitsError {}

impl Limits {
    /// The smallest limits there are: `M = 0`, so the channel stays at zero.
    pub const DISABLED: Self = Self {
        max: 0,
        step: 1,
        accel: 2,
        ramp: NonZeroU32::MIN,
    };

    /// `max` (M): largest magnitude, 0 disables; `step` (S): largest change per tick; `accel` (A): largest change of the change;
    /// `ramp` (rho): change per tick on the way back to zero.
    ///
    /// # Errors
    /// Unless `0 <= M`, `0 < rho <= S` and `S + rho <= A`.
    pub const fn new(max: i32, step: i32, accel: i32, ramp: i32) -> Result<Self, LimitsError> {
        if max < 0 {
            return Err(LimitsError::NegativeMax { max });
        }
        let Some(ramp_magnitude) = NonZeroU32::new(ramp.unsigned_abs()) else {
            return Err(LimitsError::RampNotPositive { ramp });
        };
        if ramp < 0 {
            return Err(LimitsError::RampNotPositive { ramp });
        }
        if ramp > step {
            return Err(LimitsError::RampAboveStep { ramp, step });
        }
        #[expect(
            clippy::as_conversions,
            reason = "i32 to i64 is lossless; `From` is not const"
        )]
        let needed = (step as i64).saturating_add(ramp as i64);
        #[expect(
            clippy::as_conversions,
            reason = "i32 to i64 is lossless; `From` is not const"
        )]
        if needed > accel as i64 {
            return Err(LimitsError::AccelTooSmall { accel, needed });
        }
        Ok(Self {
            max,
            step,
            accel,
            ramp: ramp_magnitude,
        })
    }

    /// M: largest magnitude; 0 disables the channel.
    #[inline]
    #[must_use]
    pub const fn max(&self) -> i32 {
        self.max
    }

    /// S: largest change per tick.
    #[inline]
    #[must_use]
    pub const fn step(&self) -> i32 {
        self.step
    }

    /// A: largest change of the change, per tick.
    #[inline]
    #[must_use]
    pub const fn accel(&self) -> i32 {
        self.accel
    }

    /// rho: change per tick of the ramp to zero.
    #[inline]
    #[must_use]
    pub const fn ramp(&self) -> u32 {
        self.ramp.get()
    }

    /// Whether a target lies within `M`.
    #[inline]
    #[must_use]
    pub const fn admits(&self, target: i32) -> bool {
        target.unsigned_abs() <= self.max.unsigned_abs()
    }
}

#[cfg(kani)]
impl kani::Arbitrary for Limits {
    /// Any that validation accepts; nothing is assumed: what it refuses counts as the smallest there are.
    fn any() -> Self {
        let limits = Self::new(kani::any(), kani::any(), kani::any(), kani::any());
        limits.unwrap_or(Self::DISABLED)
    }
}

/// Value of a channel and its last change, both in the channel's unit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Channel {
    value: i32,
    change: i32,
}

impl Channel {
    /// A channel at zero and at rest; valid under any limits.
    pub const ZERO: Self = Self {
        value: 0,
        change: 0,
    };

    /// A channel from its parts, if they are valid under `limits`.
    #[inline]
    #[must_use]
    pub fn from_parts(value: i32, change: i32, limits: &Limits) -> Option<Self> {
        let channel = Self { value, change };
        channel.is_valid(limits).then_some(channel)
    }

    /// The invariant: the value is within `M`, and the last change was within `S`.
    #[inline]
    #[must_use]
    pub const fn is_valid(&self, limits: &Limits) -> bool {
        limits.admits(self.value) && self.change.unsigned_abs() <= limits.step.unsigned_abs()
    }

    /// The value that is in force.
    #[inline]
    #[must_use]
    pub const fn value(&self) -> i32 {
        self.value
    }

    /// The last change of the value.
    #[inline]
    #[must_use]
    pub const fn change(&self) -> i32 {
        self.change
    }

    /// At zero. (The last change may still have been the step that brought it there.)
    #[inline]
    #[must_use]
    pub const fn is_zero(&self) -> bool {
        self.value == 0
    }

    /// Keeps the value.
    #[inline]
    #[must_use]
    pub const fn hold(self) -> Self {
        Self {
            value: self.value,
            change: 0,
        }
    }

    /// Approaches `target` (clamped to `M`) as fast as `S` and `A` allow, and never past it.
    ///
    /// Differences are taken in `i64`: the distance between two `i32` does not fit an `i32`.
    #[inline]
    #[must_use]
    pub fn follow(self, target: i32, limits: &Limits) -> Self {
        let change = i64::from(self.change);
        let accel = i64::from(limits.accel);
        let step = i64::from(limits.step);
        // |change| <= S < A, so zero lies between the two ends and the value never overshoots its target.
        let lowest = change.saturating_sub(accel).max(step.saturating_neg());
        let highest = change.saturating_add(accel).min(step);
        // Not `clamp`, which panics on reversed ends: `M >= 0` holds, but the compiler cannot see it.
        let target = target.max(limits.max.saturating_neg()).min(limits.max);
        let wanted = i64::from(target).saturating_sub(i64::from(self.value));
        let change = narrow(wanted.max(lowest).min(highest));
        Self {
            value: self.value.saturating_add(change),
            change,
        }
    }

    /// One step of the ramp: `min(rho, |value|)` towards zero.
    #[inline]
    #[must_use]
    pub fn ramp(self, limits: &Limits) -> Self {
        let rest = self.value.unsigned_abs();
        let step = narrow(i64::from(limits.ramp().min(rest)));
        let change = if self.value > 0 {
            step.saturating_neg()
        } else {
            step
        };
        Self {
            value: self.value.saturating_add(change),
            change,
        }
    }

    /// Ticks until the ramp is done: `ceil(|value| / rho)`.
    #[inline]
    #[must_use]
    pub fn ramp_ticks_left(&self, limits: &Limits) -> u32 {
        let magnitude = self.value.unsigned_abs();
        // A quotient by a nonzero divisor cannot panic; rounding up is one more where a rest remains.
        let whole = magnitude / limits.ramp;
        let rest = magnitude % limits.ramp;
        whole.saturating_add(u32::from(rest != 0))
    }
}

/// To `i32`. The callers' values lie within ± S, so the fallback is never taken; if it were, the channel would stand still.
#[inline]
fn narrow(value: i64) -> i32 {
    i32::try_from(value).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The thesis profile for positions: 2 mm, 5 µm per tick, ramp 0.1 µm per tick.
    const LIMITS: Limits = match Limits::new(2_000_000, 5_000, 10_000, 100) {
        Ok(limits) => limits,
        Err(_) => panic!("the profile is valid"),
    };

    #[test]
    fn limits_name_what_is_wrong() {
        assert_eq!(
            Limits::new(-1, 2, 4, 1),
            Err(LimitsError::NegativeMax { max: -1 })
        );
        for ramp in [0, -1, i32::MIN] {
            assert_eq!(
                Limits::new(1, 2, 4, ramp),
                Err(LimitsError::RampNotPositive { ramp })
            );
        }
        assert_eq!(
            Limits::new(1, 2, 9, 3),
            Err(LimitsError::RampAboveStep { ramp: 3, step: 2 })
        );
        assert_eq!(
            Limits::new(1, i32::MAX, i32::MAX, 1),
            Err(LimitsError::AccelTooSmall {
                accel: i32::MAX,
                needed: i64::from(i32::MAX) + 1
            })
        );
    }

    #[test]
    fn ramps_to_the_nanometre() {
        let mut channel = Channel::from_parts(-100_050, 0, &LIMITS).unwrap();
        assert_eq!(channel.ramp_ticks_left(&LIMITS), 1001);
        for tick in 1..=1000 {
            channel = channel.ramp(&LIMITS);
            assert_eq!(channel.value(), -100_050 + 100 * tick);
        }
        channel = channel.ramp(&LIMITS);
        assert_eq!((channel.value(), channel.change()), (0, 50));
        channel = channel.ramp(&LIMITS);
        assert_eq!(channel, Channel::ZERO);
    }

    #[test]
    fn follows_as_fast_as_allowed_and_arrives() {
        let mut channel = Channel::ZERO;
        for _ in 0..3 {
            channel = channel.follow(12_345, &LIMITS);
        }
        assert_eq!((channel.value(), channel.change()), (12_345, 2_345));
        // Full speed ahead, then a target behind: the reversal is spread over two ticks.
        let fast = Channel::from_parts(0, 5_000, &LIMITS).unwrap();
        assert_eq!(fast.follow(i32::MIN, &LIMITS).change(), -5_000);
        let tight = Limits::new(2_000_000, 5_000, 5_100, 100).unwrap();
        assert_eq!(fast.follow(i32::MIN, &tight).change(), -100);
    }

    #[test]
    fn a_zero_limit_means_zero() {
        let limits = Limits::new(0, 5, 10, 1).unwrap();
        assert_eq!(Channel::ZERO.follow(i32::MAX, &limits), Channel::ZERO);
        assert!(!limits.admits(1));
    }
}
