//! One bounded channel: T1, T2, T3, T5, as one-step induction: valid, any step (hold, follow,
//! ramp), valid, and the bound.

use gantry_tau_core::control::channel::{Channel, Limits};
use gantry_tau_core::units::{ChannelUnit, OffsetNm};

/// Channel of position offsets; the arithmetic of the others is the same.
pub type Position = Channel<OffsetNm>;

/// T1, T2, T3 and the invariant, for any two values of a channel that follow each other. A check
/// that fails ends the path, so the theorems stand before the invariant, which implies T3.
///
/// Composed as: `axis_position_is_bounded`, `axis_velocity_is_bounded`, `axis_torque_is_bounded`.
pub fn change_is_bounded<U: ChannelUnit>(
    before: Channel<U>,
    after: Channel<U>,
    limits: &Limits<U>,
) {
    let change = i64::from(after.count()) - i64::from(before.count());
    assert!(
        change.abs() <= i64::from(limits.step()),
        "T1: |change| <= S"
    );
    assert!(limits.admits(after.value()), "T3: |value| <= M");
    assert!(after.is_valid(limits), "the invariant is kept");
    assert!(
        change == i64::from(after.change()),
        "the change is what changed"
    );
    let bend = change - i64::from(before.change());
    assert!(
        bend.abs() <= i64::from(limits.accel()),
        "T2: |change of change| <= A"
    );
}

/// A drive receives the count of a valid channel: its unit holds it.
///
/// Composed as: `channel_value_is_its_count`.
pub fn value_is_its_count<U: ChannelUnit>(channel: Channel<U>) {
    assert!(
        channel.value().count() == channel.count(),
        "T3: a valid channel fits its unit"
    );
}

/// T5, for one step.
pub fn ramp_is_exact(before: Position, limits: &Limits<OffsetNm>) {
    is_ramp_step(before, before.ramp(limits), limits);
}

/// T5, for any two values that follow each other: `min(rho, |value|)` towards zero, never past it.
/// The magnitude is the measure that decreases until it is zero.
///
/// Composed as: `axis_position_is_bounded`, `axis_velocity_is_bounded`, `axis_torque_is_bounded`.
pub fn is_ramp_step<U>(before: Channel<U>, after: Channel<U>, limits: &Limits<U>) {
    let (from, to) = (before.count().unsigned_abs(), after.count().unsigned_abs());
    let same_side = after.count() == 0 || (after.count() > 0) == (before.count() > 0);
    assert!(same_side, "T5: never past zero");
    assert!(to < from || from == 0, "T5: the measure decreases");
    assert!(
        to == from - from.min(limits.ramp()),
        "T5: exactly min(rho, |value|)"
    );
}

/// T5's count and T22, without a quotient: a bound of a magnitude before a ramp step, less `rho`,
/// bounds it after, from above and from below. So after `k` steps `|value|` is
/// `max(|value at the beginning| - k rho, 0)`: zero after exactly `ceil(|value| / rho)` of them.
pub fn ramp_lowers_any_bound(before: Position, bound: u32, limits: &Limits<OffsetNm>) {
    let (from, to) = (
        before.count().unsigned_abs(),
        before.ramp(limits).count().unsigned_abs(),
    );
    let lowered = bound.saturating_sub(limits.ramp());
    assert!(
        from > bound || to <= lowered,
        "T22: a bound from above falls by rho"
    );
    assert!(
        from < bound || to >= lowered,
        "T5: a bound from below falls by rho"
    );
}

/// T5, the count: the number of ticks left, `ceil(|value| / rho)`, falls by one per step and is
/// zero exactly at zero. A quotient of two unknowns is beyond the SAT solvers Kani brings along:
/// this one is tested, and has no harness.
pub fn ramp_counts_down(before: Position, limits: &Limits<OffsetNm>) {
    let left = before.ramp_ticks_left(limits);
    let left_after = before.ramp(limits).ramp_ticks_left(limits);
    assert!(left_after == left.saturating_sub(1), "T5: one tick less");
    assert!((left == 0) == before.is_zero(), "T5: done exactly at zero");
}
