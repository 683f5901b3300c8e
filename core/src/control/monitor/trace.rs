//! Rules of one channel, from sample to sample. Arithmetic in `i64`: differences of differences of
//! `i32` values fit.

use super::violation::Rule;
use crate::control::channel::Limits;

/// A rule that a sample broke, with the two numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Breach {
    /// Rule.
    pub rule: Rule,
    /// Allowed magnitude, or demanded value.
    pub limit: i64,
    /// Value found.
    pub found: i64,
}

/// Limits of a channel as numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Bounds {
    /// M.
    pub max: i64,
    /// S.
    pub step: i64,
    /// A.
    pub accel: i64,
    /// rho.
    pub ramp: i64,
}

impl Bounds {
    /// Reads the limits of a channel.
    #[must_use]
    pub fn of<U>(limits: &Limits<U>) -> Self {
        Self {
            max: limits.max().into(),
            step: limits.step().into(),
            accel: limits.accel().into(),
            ramp: limits.ramp().into(),
        }
    }
}

/// Last sample of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Trace {
    /// Value.
    pub value: i64,
    /// Change in the tick before the sample; `None` if that tick was not seen.
    pub change: Option<i64>,
}

/// Motion that the phase demands of a channel in one tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Motion {
    /// Any within `S` and `A`.
    Free,
    /// None.
    Hold,
    /// One ramp step.
    Ramp,
}

impl Trace {
    /// A channel at rest.
    #[must_use]
    pub const fn at_rest(value: i64) -> Self {
        Self {
            value,
            change: Some(0),
        }
    }

    /// Checks `value`, at most `steps` steps of the channel after `before`, and makes it the last
    /// sample.
    ///
    /// # Errors
    /// The first broken rule.
    pub fn advance(
        before: &mut Option<Self>,
        value: i64,
        steps: u64,
        motion: Motion,
        bounds: &Bounds,
    ) -> Result<(), Breach> {
        let last = before.replace(Self {
            value,
            change: None,
        });
        let result = within(Rule::Max, bounds.max, value);
        let Some(last) = last else { return result };
        let change = value.saturating_sub(last.value);
        if steps != 1 {
            // Lost steps: only their sum is known.
            if let (0, Some(now)) = (steps, before) {
                now.change = last.change;
            }
            let most = i64::try_from(steps).unwrap_or(i64::MAX);
            return result.and(within(Rule::Step, bounds.step.saturating_mul(most), change));
        }
        *before = Some(Self {
            value,
            change: Some(change),
        });
        result?;
        within(Rule::Step, bounds.step, change)?;
        match motion {
            Motion::Free => {}
            Motion::Hold => exactly(Rule::Hold, 0, change)?,
            Motion::Ramp => exactly(Rule::Ramp, ramp_change(last.value, bounds.ramp), change)?,
        }
        match last.change {
            Some(earlier) => within(Rule::Accel, bounds.accel, change.saturating_sub(earlier)),
            None => Ok(()),
        }
    }
}

/// Returns the change of one ramp step.
fn ramp_change(value: i64, ramp: i64) -> i64 {
    if value > 0 {
        ramp.min(value).saturating_neg()
    } else {
        ramp.min(value.saturating_neg())
    }
}

/// Checks that a magnitude is within its limit.
pub(super) fn within(rule: Rule, limit: i64, found: i64) -> Result<(), Breach> {
    if found.saturating_abs() <= limit {
        Ok(())
    } else {
        Err(Breach { rule, limit, found })
    }
}

/// Checks that a value is the demanded one.
pub(super) fn exactly(rule: Rule, limit: i64, found: i64) -> Result<(), Breach> {
    if found == limit {
        Ok(())
    } else {
        Err(Breach { rule, limit, found })
    }
}
