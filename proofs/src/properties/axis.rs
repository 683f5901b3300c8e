//! Second half of a tick, for one axis and any command: T1, T2, T3 and T5.

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::channel::{Channel, LimitValues, Limits};
use gantry_tau_core::control::message::{AxisLimits, AxisState};
use gantry_tau_core::control::session::config::{AxisConfig, MAX_POSITION_NM, NominalAccel};
use gantry_tau_core::units::{ChannelUnit, PositionNm};
use gantry_tau_core::verification::control::{
    Action, Axis, AxisChannels, AxisCommand, drive_reference, nominal_accelerated, nominal_stepped,
};

/// Limits of the three channels of an axis.
pub(crate) fn limit_values(limits: &AxisLimits) -> [LimitValues; 3] {
    [
        limits.position.values(),
        limits.velocity.values(),
        limits.torque.values(),
    ]
}

/// Offsets as the counts of the three channels.
pub(crate) fn counts(offsets: &Offsets) -> [i64; 3] {
    [
        offsets.position.0.into(),
        offsets.velocity.0.into(),
        offsets.torque.0.into(),
    ]
}

/// One of the three channels of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Position offset.
    Position,
    /// Velocity offset.
    Velocity,
    /// Torque offset.
    Torque,
}

impl Kind {
    /// All three.
    pub const ALL: [Self; 3] = [Self::Position, Self::Velocity, Self::Torque];

    /// Checks one channel of an axis, before and after a step, with its limits.
    pub fn check(
        self,
        (before, after): (&AxisChannels, &AxisChannels),
        limits: &AxisLimits,
        property: &impl ChannelProperty,
    ) {
        match self {
            Self::Position => property.check(before.position, after.position, &limits.position),
            Self::Velocity => property.check(before.velocity, after.velocity, &limits.velocity),
            Self::Torque => property.check(before.torque, after.torque, &limits.torque),
        }
    }
}

/// Property of a channel of any unit, before and after a step.
pub trait ChannelProperty {
    /// Panics when the property does not hold.
    fn check<U: ChannelUnit>(&self, before: Channel<U>, after: Channel<U>, limits: &Limits<U>);
}

/// T1, T2, T3 and the invariant.
#[derive(Clone, Copy, Debug)]
pub struct Bounded;

impl ChannelProperty for Bounded {
    fn check<U: ChannelUnit>(&self, before: Channel<U>, after: Channel<U>, limits: &Limits<U>) {
        crate::properties::channel::change_is_bounded(before, after, limits);
    }
}

/// T5.
#[derive(Clone, Copy, Debug)]
pub struct Ramped;

impl ChannelProperty for Ramped {
    fn check<U: ChannelUnit>(&self, before: Channel<U>, after: Channel<U>, limits: &Limits<U>) {
        crate::properties::channel::is_ramp_step(before, after, limits);
    }
}

/// The invariant alone; at zero without a command.
struct Shadow {
    commanded: bool,
}

impl ChannelProperty for Shadow {
    fn check<U: ChannelUnit>(&self, _: Channel<U>, after: Channel<U>, limits: &Limits<U>) {
        assert!(
            after.is_valid(limits),
            "the invariant of the shadow is kept"
        );
        let rests = after.count() == 0 && after.change() == 0;
        assert!(self.commanded || rests, "the shadow rests");
    }
}

/// T1, T2, T3 for one channel in force of an axis, under any command; and the drive receives what
/// the channel says, on top of this tick's nominal reference.
///
/// Composed as: `axis_position_is_bounded`, `axis_velocity_is_bounded`, `axis_torque_is_bounded`.
pub fn order_is_bounded(before: &Axis, command: &AxisCommand, config: &AxisConfig, kind: Kind) {
    let mut after = *before;
    let reference = after.act(command, config, &mut AxisState::default());
    let channels = (&before.channels, &after.channels);
    kind.check(channels, &config.limits, &Bounded);
    if command.action == Action::Ramp {
        kind.check(channels, &config.limits, &Ramped);
    }
    let travel = &config.machine_travel;
    let inside = travel.lower <= reference.position && reference.position <= travel.upper;
    assert!(inside, "T3: inside the travel");
    let offsets = after.channels.offsets();
    let sum = i128::from(command.nominal.0) + i128::from(offsets.position.0);
    let clamped = sum.max(travel.lower.0.into()).min(travel.upper.0.into());
    assert!(
        i128::from(reference.position.0) == clamped,
        "T3: the reference is nominal plus offset, clamped to the travel"
    );
    assert!(
        reference.velocity_offset == offsets.velocity && reference.torque_offset == offsets.torque,
        "the drive receives the channel"
    );
    assert!(
        i32::from(offsets.torque.0) == after.channels.torque.count(),
        "the torque channel fits its unit"
    );
    assert!(
        after.nominal == command.nominal,
        "T3: the nominal reference is noted"
    );
}

/// The shadow stays within its limits under any command, and rests at zero without one.
pub fn shadow_is_bounded(before: &Axis, command: &AxisCommand, config: &AxisConfig, kind: Kind) {
    let mut after = *before;
    let _ = after.act(command, config, &mut AxisState::default());
    let shadow = Shadow {
        commanded: command.shadow.is_some(),
    };
    kind.check((&before.shadow, &after.shadow), &config.limits, &shadow);
}

/// T3: what reaches a drive is inside the machine's travel for any nominal reference and any
/// offset; and it is nominal plus offset wherever the nominal reference keeps to its own travel and
/// the offset to `M`.
pub fn reference_is_inside_travel(axis: &AxisConfig, nominal: PositionNm, offsets: &Offsets) {
    let travel = &axis.machine_travel;
    let (reference, _) = drive_reference(nominal, offsets, travel);
    let inside = travel.lower <= reference.position && reference.position <= travel.upper;
    assert!(inside, "T3: inside the travel");
    let own = &axis.nominal_travel;
    let within = own.lower <= nominal && nominal <= own.upper;
    if within && axis.limits.position.admits(offsets.position) {
        let sum = i128::from(nominal.0) + i128::from(offsets.position.0);
        assert!(
            i128::from(reference.position.0) == sum,
            "T3: only a faulty nominal clamps"
        );
    }
}

/// True if `|nominal| <= 2^61` nm.
fn is_bounded(nominal: PositionNm) -> bool {
    nominal.0.unsigned_abs() <= MAX_POSITION_NM.unsigned_abs()
}

/// T3: from one tick to the next, with a fixed travel, the reference moves the way that nominal
/// plus offset move, and no further: so by at most |change of nominal| + |change of offset|.
/// `|nominal| <= 2^61` nm.
pub fn reference_moves_no_further(
    axis: &AxisConfig,
    (from, to): (PositionNm, PositionNm),
    (before, after): (&Offsets, &Offsets),
) {
    if !is_bounded(from) || !is_bounded(to) {
        return;
    }
    let travel = &axis.machine_travel;
    let (first, _) = drive_reference(from, before, travel);
    let (second, _) = drive_reference(to, after, travel);
    let wanted_first = from.0 + i64::from(before.position.0);
    let wanted_second = to.0 + i64::from(after.position.0);
    let moved = second.position.0 - first.position.0;
    let wanted = wanted_second - wanted_first;
    let no_further = if wanted >= 0 {
        0 <= moved && moved <= wanted
    } else {
        wanted <= moved && moved <= 0
    };
    assert!(
        no_further,
        "T3: no further than nominal and offset together"
    );
}

/// A nominal reference stepped exactly if it moved further than its limit in one cycle, by wider
/// integers.
pub fn step_is_exact(from: PositionNm, to: PositionNm, config: &AxisConfig) {
    let moved = (i128::from(to.0) - i128::from(from.0)).unsigned_abs();
    assert!(
        nominal_stepped(from, to, config, 1) == (moved > config.nominal_step_nm.into()),
        "T3: beyond the limit exactly if it moved further"
    );
}

/// A nominal reference that stands is within any limit, over any cycles.
///
/// Composed as: `nominal_that_stands_is_within`.
pub fn standing_is_within(at: PositionNm, config: &AxisConfig, cycles: u32) {
    assert!(
        !nominal_stepped(at, at, config, cycles),
        "T9: what stands has not stepped"
    );
}

/// A nominal reference accelerated more than its limit exactly if its second difference is beyond
/// it, by wider integers: three in a row, `|nominal| <= 2^61` nm.
pub fn acceleration_is_exact(places: [PositionNm; 3], limit: NominalAccel) {
    if !places.into_iter().all(is_bounded) {
        return;
    }
    let [before, last, now] = places.map(|place| place.0);
    let axis = Axis {
        nominal: PositionNm(last),
        nominal_before: PositionNm(before),
        ..Axis::default()
    };
    let [before, last, wide_now] = [before, last, now].map(i128::from);
    let second_difference = (wide_now - last) - (last - before);
    let is_beyond = second_difference.unsigned_abs() > limit.nm.get().into();
    assert!(
        nominal_accelerated(&axis, PositionNm(now), limit) == is_beyond,
        "T3: beyond the limit exactly if the second difference is"
    );
}
