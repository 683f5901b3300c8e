//! Agitation of an axis: a budget for the second differences of its position offset.
//!
//! In every tick of Obtain the magnitude of the second difference (the change of the offset's
//! change, nm per tick²) is added to a sum, and `r` is taken from it, but not below zero. A sum
//! above `B = 1000 r` ends the session in the next tick. Every Obtain begins with a sum of zero, and
//! the ramp after a session does not count. For every client (T33):
//!
//! - the second differences of any `n` ticks of Obtain, from its first tick on and before the one
//!   that takes the sum above `B`, sum up to at most `B + r n`;
//! - a tick with a second difference of at most `r` does not raise the sum: a client that keeps to
//!   that is never ended by it.
//!
//! At 1 kHz a sine of amplitude `a` µm at `f` Hz needs an `r` of `0.0251 a f²` nm per tick: slow
//! corrections pass, and a client that shakes the machine is ended. The budget bounds what any
//! client can pump into the machine. It does not make a loop stable.

use core::num::NonZeroU32;

/// Budget of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct AgitationBudget {
    /// `r`: agitation per tick that can go on for ever, nm; 1 to [`Self::MAX_NM_PER_TICK`].
    pub nm_per_tick: NonZeroU32,
}

impl AgitationBudget {
    /// Largest `r`, nm per tick: 1 m/s at 1 kHz.
    pub const MAX_NM_PER_TICK: u32 = 1_000_000;
    /// `B` in ticks of `r`.
    const LIMIT_TICKS: u32 = 1_000;

    /// Returns the budget with this `r`, nm per tick; `None` for zero.
    #[must_use]
    pub const fn new(nm_per_tick: u32) -> Option<Self> {
        match NonZeroU32::new(nm_per_tick) {
            Some(nm_per_tick) => Some(Self { nm_per_tick }),
            None => None,
        }
    }

    /// True if `r` is in its range.
    #[inline]
    #[must_use]
    pub const fn is_valid(&self) -> bool {
        self.nm_per_tick.get() <= Self::MAX_NM_PER_TICK
    }

    /// Returns `B`, nm.
    #[inline]
    #[must_use]
    pub const fn limit_nm(&self) -> u32 {
        // At most 10^9: it does not saturate.
        self.nm_per_tick.get().saturating_mul(Self::LIMIT_TICKS)
    }
}

/// Sum of second differences, less `r` for each tick, nm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Agitation(pub u32);

impl Agitation {
    /// The sum at the beginning of Obtain, and outside of it.
    pub const ZERO: Self = Self(0);

    /// Returns the sum after a tick that took the change of the offset `from` one value `to`
    /// another.
    #[inline]
    #[must_use]
    pub const fn after(self, from: i32, to: i32, budget: &AgitationBudget) -> Self {
        // A sum that saturates is above every `B`.
        let sum = self.0.saturating_add(to.abs_diff(from));
        Self(sum.saturating_sub(budget.nm_per_tick.get()))
    }

    /// True above `B`: the session is over.
    #[inline]
    #[must_use]
    pub const fn exceeds(self, budget: &AgitationBudget) -> bool {
        self.0 > budget.limit_nm()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BUDGET: AgitationBudget = AgitationBudget::new(100).unwrap();

    /// The sum after ticks with these changes of the offset, from rest.
    fn sum_of(changes: impl IntoIterator<Item = i32>) -> u32 {
        let rest = (Agitation::ZERO, 0);
        let (sum, _) = changes
            .into_iter()
            .fold(rest, |(sum, from), to| (sum.after(from, to, &BUDGET), to));
        sum.0
    }

    #[test]
    fn second_differences_count_whatever_their_sign() {
        assert_eq!(sum_of([5_000]), 4_900);
        assert_eq!(sum_of([-5_000]), 4_900);
        assert_eq!(sum_of([5_000, -5_000]), 14_800, "a reversal counts twice");
        assert_eq!(
            sum_of([5_000, 5_000, 5_000]),
            4_700,
            "steady motion does not"
        );
        assert_eq!(sum_of((1..2_000).map(|tick| 100 * tick)), 0, "within r");
        assert_eq!(sum_of([150, 150, 150]), 0, "not below zero");
        assert_eq!(
            sum_of([150, 150, 150, 250]),
            0,
            "quiet ticks are not saved up"
        );
        let far = sum_of([i32::MAX, i32::MIN, i32::MAX]);
        assert_eq!(far, u32::MAX - 100, "the sum saturates");
    }

    #[test]
    fn a_sum_above_a_thousand_r_exceeds_the_budget() {
        assert!(!Agitation(100_000).exceeds(&BUDGET));
        assert!(Agitation(100_001).exceeds(&BUDGET));
        let most = AgitationBudget::new(AgitationBudget::MAX_NM_PER_TICK).unwrap();
        assert!(most.is_valid());
        assert_eq!(most.limit_nm(), 1_000_000_000);
        let more = AgitationBudget::new(AgitationBudget::MAX_NM_PER_TICK + 1).unwrap();
        assert!(!more.is_valid());
        assert_eq!(AgitationBudget::new(0), None);
    }
}
