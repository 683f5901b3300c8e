//! Position loop of one axis, and of several: T17 to T20, as one-step induction: a valid loop, any
//! input, one tick.

use gantry_tau_core::control::channel::{Channel, Limits};
use gantry_tau_core::control::position_loop::config::{LoopConfig, MAX_ERROR_NM};
use gantry_tau_core::control::position_loop::{
    Enable, LoopInput, LoopParts, LoopStop, PositionLoop, PositionLoops, VelocityReference,
};
use gantry_tau_core::units::{ChannelUnit, PositionNm, TorquePermille, VelocityUmS};
use gantry_tau_core::verification::position_loop::{
    INTEGRAL_SHIFT, difference, fed_forward, integrate, product, weighted,
};

/// Largest magnitude of a value that is weighted: the difference of two changes. Its product with
/// any weight does not overflow.
pub const MAX_WEIGHTED: i64 = 2 * MAX_ERROR_NM;
const _: () = assert!(MAX_WEIGHTED <= i64::MAX >> 16, "no product overflows");

/// Runs one tick: the loop after it, and its output.
fn tick(
    before: &PositionLoop,
    config: &LoopConfig,
    input: &LoopInput,
) -> (PositionLoop, VelocityReference) {
    let mut after = *before;
    let reference = after.tick(config, input);
    (after, reference)
}

/// Error of a reference, from its definition: the difference, cut to [`MAX_ERROR_NM`].
fn error(reference: PositionNm, actual: PositionNm) -> i128 {
    let most = i128::from(MAX_ERROR_NM);
    (i128::from(reference.0) - i128::from(actual.0))
        .max(-most)
        .min(most)
}

/// True if the actual value is outside the window of a reference: by their true distance, not by
/// the error, which is cut.
fn is_outside(reference: PositionNm, actual: PositionNm, config: &LoopConfig) -> bool {
    (i128::from(reference.0) - i128::from(actual.0)).abs() > config.values().window_nm.into()
}

/// Reference that belongs to the actual value of a tick: `lag` ticks old.
fn aligned(parts: &LoopParts, config: &LoopConfig, input: &LoopInput) -> PositionNm {
    match config.values().lag {
        0 => input.reference.position,
        lag => parts.history[usize::from(lag) - 1],
    }
}

/// Ticks in a row outside the window after this one, with an actual value.
fn count(parts: &LoopParts, config: &LoopConfig, input: &LoopInput, actual: PositionNm) -> u16 {
    if is_outside(aligned(parts, config, input), actual, config) {
        parts.outside + 1
    } else {
        0
    }
}

/// True if a tick may run a loop again that has stopped: at rest, re-armed, with the reference
/// inside the window.
fn is_released(before: &PositionLoop, config: &LoopConfig, input: &LoopInput) -> bool {
    input.permit == Enable::Rearm
        && before.parts().velocity.count() == 0
        && input
            .actual
            .is_some_and(|actual| !is_outside(input.reference.position, actual, config))
}

/// True if the loop runs in this tick, from the definitions.
fn runs(before: &PositionLoop, config: &LoopConfig, input: &LoopInput) -> bool {
    match (before.stop(), input.actual) {
        (Some(_), _) => is_released(before, config, input),
        (None, Some(actual)) => {
            let most = config.values().window_ticks;
            let trips = count(before.parts(), config, input, actual) >= most
                || before.parts().limited >= most;
            input.permit != Enable::Stop && !trips
        }
        (None, None) => false,
    }
}

/// T17, one channel. A check that fails ends the path, so the theorem stands before the invariant,
/// which implies a part of it.
fn is_bounded<U: ChannelUnit>(before: Channel<U>, after: Channel<U>, limits: &Limits<U>) {
    let change = i64::from(after.count()) - i64::from(before.count());
    assert!(
        change.abs() <= i64::from(limits.step()),
        "T17: |change| <= S"
    );
    let bend = change - i64::from(before.change());
    assert!(
        bend.abs() <= i64::from(limits.accel()),
        "T17: |change of change| <= A"
    );
    assert!(limits.admits(after.value()), "T17: |value| <= M");
    assert!(
        change == i64::from(after.change()),
        "T17: the change is what changed"
    );
}

/// T17: references of velocity and torque change by at most `S`, their changes by at most `A`, and
/// they stay within `M`; and the invariant.
///
/// Composed as: `position_loop_references_are_bounded`.
pub fn references_are_bounded(before: &PositionLoop, config: &LoopConfig, input: &LoopInput) {
    let (after, reference) = tick(before, config, input);
    let from = before.parts();
    let to = after.parts();
    let values = config.values();
    is_bounded(from.velocity, to.velocity, &values.velocity);
    is_bounded(from.torque, to.torque, &values.torque);
    is_given(&after, reference);
    assert!(after.is_valid(config), "T17: the loop stays valid");
}

/// T17: the drive receives the channels.
fn is_given(after: &PositionLoop, reference: VelocityReference) {
    let given = (reference.velocity.0, i32::from(reference.torque.0));
    let bounded = (after.parts().velocity.count(), after.parts().torque.count());
    assert!(given == bounded, "T17: the drive receives what is bounded");
}

/// T18: one step of the ramp, of any channel.
fn is_ramp_step<U>(before: Channel<U>, after: Channel<U>, limits: &Limits<U>) {
    let from = i64::from(before.count());
    let step = from.abs().min(i64::from(limits.ramp()));
    assert!(
        i64::from(after.count()) == from - from.signum() * step,
        "T18: exactly min(rho, |value|) towards zero"
    );
}

/// T18, both channels of a loop.
fn ramps(before: &LoopParts, after: &LoopParts, config: &LoopConfig) {
    is_ramp_step(before.velocity, after.velocity, &config.values().velocity);
    is_ramp_step(before.torque, after.torque, &config.values().torque);
}

/// T18: without a permit or an actual value, or once stopped, the references move by exactly
/// `min(rho, |value|)` towards zero. So any `bound` of the velocity, from above or below, falls by
/// `rho`: it is zero after exactly `ceil(|velocity| / rho)` ticks.
///
/// Composed as: `position_loop_stops_with_its_ramp`.
pub fn stops_with_its_ramp(
    before: &PositionLoop,
    config: &LoopConfig,
    input: &LoopInput,
    bound: u32,
) {
    let (after, _) = tick(before, config, input);
    assert!(
        input.permit != Enable::Stop || after.stop().is_some(),
        "T18: without a permit it stops"
    );
    assert!(
        input.actual.is_some() || after.stop().is_some(),
        "T18: without an actual value it stops"
    );
    if after.stop().is_none() {
        return;
    }
    let rho = config.values().velocity.ramp();
    let (magnitude, left) = (
        before.parts().velocity.count().unsigned_abs(),
        after.parts().velocity.count().unsigned_abs(),
    );
    let lowered = bound.saturating_sub(rho);
    assert!(
        magnitude > bound || left <= lowered,
        "T18: a bound from above falls by rho"
    );
    assert!(
        magnitude < bound || left >= lowered,
        "T18: a bound from below falls by rho"
    );
    ramps(before.parts(), after.parts(), config);
}

/// T19: a loop that runs counts the ticks in a row outside the window, and stops in the tick in
/// which these are `window_ticks`, not before; or in the tick after the limits cut its velocity in
/// so many. The error is that of the reference `lag` ticks old; `place` is any place in the
/// history.
pub fn trips_in_its_tick(
    before: &PositionLoop,
    config: &LoopConfig,
    input: &LoopInput,
    place: usize,
) {
    let (after, _) = tick(before, config, input);
    let (from, to) = (before.parts(), after.parts());
    let restarts = before.stop().is_some() && is_released(before, config, input);
    let expected = match place.checked_sub(1) {
        Some(earlier) if !restarts => from.history[earlier],
        _ => input.reference.position,
    };
    assert!(
        to.history[place] == expected,
        "T19: the last references are kept, that of the tick first"
    );
    let (None, Some(actual)) = (before.stop(), input.actual) else {
        return;
    };
    let count = count(from, config, input, actual);
    assert!(
        to.outside == count,
        "T19: ticks in a row outside the window are counted"
    );
    let expected = match input.permit {
        Enable::Stop => Some(LoopStop::NotPermitted),
        _ if count >= config.values().window_ticks => Some(LoopStop::FollowingError),
        _ => (from.limited >= config.values().window_ticks).then_some(LoopStop::Limited),
    };
    assert!(
        after.stop() == expected,
        "T19: it trips in the last tick of the window, and not before"
    );
}

/// T19: what has stopped runs again exactly when it is re-armed at velocity zero with the reference
/// inside the window, and counts from zero; until then the reason stays.
pub fn is_released_by_a_rearm(before: &PositionLoop, config: &LoopConfig, input: &LoopInput) {
    let (after, _) = tick(before, config, input);
    if before.stop().is_none() {
        return;
    }
    let is_released = is_released(before, config, input);
    let expected = if is_released { None } else { before.stop() };
    assert!(
        after.stop() == expected,
        "T19: only a re-arm at rest with the reference inside the window releases it"
    );
    let begins = after.parts().outside == 0 && after.parts().limited <= 1;
    assert!(!is_released || begins, "T19: it counts from zero again");
}

/// T20: the error is the difference of any two positions, cut to 2^24 nm.
pub fn error_is_exact(reference: PositionNm, actual: PositionNm) {
    let found = difference(reference.0, actual.0);
    assert!(
        i128::from(found) == error(reference, actual),
        "T20: the error is the difference, cut"
    );
}

/// T20: the product of a value and a weight has the sign of the value, or is zero, and is at most
/// 2^16 times the value. `|value| <= 2^25`.
pub fn product_is_bounded(value: i64, weight: u16) {
    assert!(
        is_product_of(value, weight, product(value, weight)),
        "T20: the product has its sign and its bound"
    );
}

/// True if a product has the sign and the bound that are known of it.
#[must_use]
pub fn is_product_of(value: i64, weight: u16, product: i64) -> bool {
    let most = if weight == 0 { 0 } else { value << 16 };
    if value < 0 {
        most <= product && product <= 0
    } else {
        0 <= product && product <= most
    }
}

/// T20: a term is odd, has the sign of its value, and is at most `weight * 2^-16` times it, and
/// less than one unit below. `|value| <= 2^25`.
pub fn term_is_exact(value: i64, weight: u16) {
    let term = weighted(value, weight);
    assert!(value != 0 || term == 0, "T20: a term of zero is zero");
    assert!(weighted(-value, weight) == -term, "T20: a term is odd");
    assert!(
        term == 0 || (term > 0) == (value > 0),
        "T20: a term has the sign of its value"
    );
    let product = product(value.abs(), weight);
    assert!(
        term.abs() << 16 <= product,
        "T20: a term is at most weight times value"
    );
    assert!(
        product < (term.abs() + 1) << 16,
        "T20: a term is less than one unit below weight times value"
    );
}

/// T20: the velocity feed-forward is `weight * 2^-10` times the change, rounded down.
/// `|change| <= 2^25`.
pub fn feed_forward_is_exact(change: i64, weight: u16) {
    let (term, product) = (fed_forward(change, weight), product(change, weight));
    assert!(
        term << 10 <= product && product < (term + 1) << 10,
        "T20: the feed-forward is weight times change, rounded down"
    );
}

/// T20: of two values the larger has no smaller term. `|value| <= 2^25`.
pub fn term_is_monotone(value: i64, larger: i64, weight: u16) {
    let (term, of_larger) = (weighted(value, weight), weighted(larger, weight));
    assert!(
        value > larger || term <= of_larger,
        "T20: a term is monotone"
    );
}

/// T20: of two changes the larger has no smaller velocity feed-forward. `|change| <= 2^25`.
pub fn feed_forward_is_monotone(change: i64, larger: i64, weight: u16) {
    let (term, of_larger) = (fed_forward(change, weight), fed_forward(larger, weight));
    assert!(
        change > larger || term <= of_larger,
        "T20: the feed-forward is monotone"
    );
}

/// T20: an integral within its limit stays within it, does not grow towards what the output is
/// short of, and otherwise grows by what it is given. `|integral| <= most`, `most >= 0`.
pub fn integral_is_bounded(integral: i64, growth: i64, short: i64, most: i32) {
    let after = integrate(integral, growth, short, most);
    let limit = i128::from(most) << INTEGRAL_SHIFT;
    assert!(
        i128::from(after).abs() <= limit,
        "T20: the integral stays within its limit"
    );
    does_not_wind_up(integral, after, short);
    let grown = (i128::from(integral) + i128::from(growth))
        .max(-limit)
        .min(limit);
    let may_grow = growth.signum() != short.signum();
    assert!(
        !may_grow || i128::from(after) == grown,
        "T20: otherwise the integral grows by what it is given"
    );
}

fn does_not_wind_up(integral: i64, after: i64, short: i64) {
    let winds_up = (short > 0 && after > integral) || (short < 0 && after < integral);
    assert!(
        !winds_up,
        "T20: the integral never grows against a saturated output"
    );
}

/// T20, a whole tick: a loop that runs follows the sum of its terms, without overflow; its integral
/// grows by the weighted proportional term, and never against an output that is short of the sum.
pub fn follows_its_terms(before: &PositionLoop, config: &LoopConfig, input: &LoopInput) {
    let Some(actual) = input.actual.filter(|_| runs(before, config, input)) else {
        return;
    };
    let mut from = *before.parts();
    let values = config.values();
    let now = input.reference.position;
    if before.stop().is_some() {
        from.history = [now; 11];
        from.integral = 0;
        from.limited = 0;
    }
    let [last, earlier, ..] = from.history;
    let change = difference(now.0, last.0);
    let error = difference(aligned(&from, config, input).0, actual.0);
    let proportional = weighted(error, values.gain);
    let wanted = proportional
        + (from.integral >> INTEGRAL_SHIFT)
        + fed_forward(change, values.velocity_feed_forward)
        + i64::from(input.reference.velocity_offset.0);
    let growth = product(proportional, values.integral);
    let bend = change - difference(last.0, earlier.0);
    let torque =
        weighted(bend, values.torque_feed_forward) + i64::from(input.reference.torque_offset.0);
    // After these: where products are unknown, the tick must have the same.
    let (after, _) = tick(before, config, input);
    let to = after.parts();
    let target = VelocityUmS(cut(wanted, i32::MIN, i32::MAX));
    assert!(
        to.velocity == from.velocity.follow(target, &values.velocity),
        "T20: the velocity follows its terms"
    );
    let short = wanted - i64::from(to.velocity.count());
    let limited = if short == 0 { 0 } else { from.limited + 1 };
    assert!(
        to.limited == limited,
        "T19: ticks in a row in which the limits cut are counted"
    );
    does_not_wind_up(from.integral, to.integral, short);
    let grown = integrate(from.integral, growth, short, values.integral_max);
    assert!(
        to.integral == grown,
        "T20: the integral grows by the weighted proportional term"
    );
    let target = TorquePermille(cut(torque, i16::MIN, i16::MAX));
    assert!(
        to.torque == from.torque.follow(target, &values.torque),
        "T20: the torque follows its terms"
    );
}

/// Cuts to a range.
fn cut<T: Copy + Into<i64> + TryFrom<i64>>(value: i64, lower: T, upper: T) -> T {
    T::try_from(value).unwrap_or(if value < lower.into() { lower } else { upper })
}

/// Loops of several axes before a tick, and what they get.
#[derive(Clone, Debug)]
pub struct Before<const N: usize> {
    /// Configurations.
    pub config: [LoopConfig; N],
    /// The loops.
    pub axes: [PositionLoop; N],
    /// The loops before the last tick.
    pub earlier: [PositionLoop; N],
    /// Inputs.
    pub inputs: [LoopInput; N],
    /// True if the drives took the references of the last tick.
    pub accepted: bool,
}

impl<const N: usize> Before<N> {
    /// The loops; none if they are not valid.
    #[must_use]
    pub fn loops(&self) -> Option<PositionLoops<N>> {
        PositionLoops::from_parts(self.config, self.axes, self.earlier)
    }

    /// The loops whose references are in force at the drives.
    const fn in_force(&self) -> &[PositionLoop; N] {
        if self.accepted {
            &self.axes
        } else {
            &self.earlier
        }
    }

    /// Runs the tick: the loops after it, and their outputs.
    fn tick(&self) -> (PositionLoops<N>, [VelocityReference; N]) {
        let Some(mut loops) = self.loops() else {
            panic!("the loops are valid")
        };
        let references = loops.tick(&self.inputs, self.accepted);
        (loops, references)
    }
}

/// T18, all axes: they stay valid, so that all run, or none; they run exactly if the drives took
/// the last references and each axis would run by itself.
pub fn axes_run_together<const N: usize>(before: &Before<N>) {
    let (after, _) = before.tick();
    assert!(after.is_valid(), "T18: all axes run, or none");
    let all_run = (0..N).all(|axis| {
        runs(
            &before.axes[axis],
            &before.config[axis],
            &before.inputs[axis],
        )
    });
    assert!(
        after.is_running() == (before.accepted && all_run),
        "T18: if one axis must stop, none runs"
    );
}

/// T17 and T18 at any one of the axes: its references are bounded by those in force, for any
/// refusals of the drives; stopped, it ramps.
pub fn axis_of_many_is_bounded<const N: usize>(before: &Before<N>, axis: usize) {
    let (after, references) = before.tick();
    let config = &before.config[axis];
    let from = &before.in_force()[axis];
    let to = &after.axes()[axis];
    is_bounded(
        from.parts().velocity,
        to.parts().velocity,
        &config.values().velocity,
    );
    is_bounded(
        from.parts().torque,
        to.parts().torque,
        &config.values().torque,
    );
    is_given(to, references[axis]);
    if to.stop().is_some() {
        ramps(from.parts(), to.parts(), config);
    }
}

/// Any one of the axes that run does what it does by itself.
pub fn axis_of_many_acts_alone<const N: usize>(before: &Before<N>, axis: usize) {
    // First: where what an axis does is unknown, the tick of all must do the same.
    let (alone, reference) = tick(
        &before.axes[axis],
        &before.config[axis],
        &before.inputs[axis],
    );
    let all_run = (0..N).all(|axis| {
        runs(
            &before.axes[axis],
            &before.config[axis],
            &before.inputs[axis],
        )
    });
    let (after, references) = before.tick();
    if before.accepted && all_run {
        let same = after.axes()[axis] == alone && references[axis] == reference;
        assert!(same, "an axis that runs does what it does by itself");
    }
}

/// T17, all axes: the references that were in force before the tick are kept, and in force again if
/// the drives refuse those of the tick.
pub fn refused_references_are_not_in_force<const N: usize>(
    before: &Before<N>,
    axis: usize,
    inputs: &[LoopInput; N],
) {
    let (mut after, _) = before.tick();
    let _ = after.tick(inputs, false);
    let config = &before.config[axis];
    let from = &before.in_force()[axis];
    let to = &after.axes()[axis];
    assert!(
        to.stop().is_some(),
        "T18: after refused references it stops"
    );
    ramps(from.parts(), to.parts(), config);
}
