//! The second half of a tick, for one axis: whatever it is ordered to do, T1, T2, T3 and T5.

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::channel::{Channel, Limits};
use gantry_tau_core::control::message::AxisLimits;
use gantry_tau_core::control::session::act::{Axis, AxisCommand, drive_reference};
use gantry_tau_core::control::session::channels::AxisChannels;
use gantry_tau_core::control::session::config::{AxisConfig, MAX_POSITION_NM};
use gantry_tau_core::control::session::fsm::Action;
use gantry_tau_core::units::PositionNm;

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
    /// All there are.
    pub const ALL: [Self; 3] = [Self::Position, Self::Velocity, Self::Torque];

    /// Of an axis' channels.
    #[must_use]
    pub const fn of(self, channels: &AxisChannels) -> Channel {
        match self {
            Self::Position => channels.position,
            Self::Velocity => channels.velocity,
            Self::Torque => channels.torque,
        }
    }

    /// Of an axis' limits.
    #[must_use]
    pub const fn limits(self, limits: &AxisLimits) -> Limits {
        match self {
            Self::Position => limits.position,
            Self::Velocity => limits.velocity,
            Self::Torque => limits.torque,
        }
    }
}

/// T1, T2, T3 for one channel in force of an axis, whatever the command; what the drive receives is what the channel says.
///
/// # Panics
/// When one of them does not hold.
pub fn order_is_bounded(before: &Axis, command: &AxisCommand, config: &AxisConfig, kind: Kind) {
    let mut after = *before;
    let (reference, _) = after.act(command, config);
    let limits = kind.limits(&config.limits);
    let (old, new) = (kind.of(&before.channels), kind.of(&after.channels));
    crate::channel::change_is_bounded(old, new, &limits);
    match kind {
        Kind::Position => {
            let travel = &config.machine_travel;
            let inside = travel.lower <= reference.position && reference.position <= travel.upper;
            assert!(inside, "T3: inside the travel");
        }
        Kind::Velocity => assert!(
            reference.velocity_offset.0 == new.value(),
            "the drive receives the channel"
        ),
        Kind::Torque => assert!(
            i32::from(reference.torque_offset.0) == new.value(),
            "the drive receives the channel"
        ),
    }
    if command.action == Action::Ramp {
        crate::channel::is_ramp_step(old, new, &limits);
    }
}

/// The shadow stays within its limits, whatever the command, and rests at zero where it is told nothing.
///
/// # Panics
/// When it does not hold.
pub fn shadow_is_bounded(before: &Axis, command: &AxisCommand, config: &AxisConfig, kind: Kind) {
    let mut after = *before;
    let _ = after.act(command, config);
    let limits = kind.limits(&config.limits);
    let new = kind.of(&after.shadow);
    assert!(new.is_valid(&limits), "the invariant of the shadow is kept");
    assert!(
        command.shadow.is_some() || new == Channel::ZERO,
        "the shadow rests"
    );
}

/// T3: what reaches a drive is inside the machine's travel, whatever the nominal reference and the offset; and it is
/// nominal plus offset wherever the nominal reference keeps to its own travel and the offset to `M`.
///
/// # Panics
/// When it does not hold.
pub fn reference_is_inside_travel(axis: &AxisConfig, nominal: PositionNm, offsets: &Offsets) {
    let travel = &axis.machine_travel;
    let (reference, _) = drive_reference(nominal, offsets, travel);
    let inside = travel.lower <= reference.position && reference.position <= travel.upper;
    assert!(inside, "T3: inside the travel");
    let own = &axis.nominal_travel;
    let within = own.lower <= nominal && nominal <= own.upper;
    if within && axis.limits.position.admits(offsets.position.0) {
        let sum = i128::from(nominal.0) + i128::from(offsets.position.0);
        assert!(
            i128::from(reference.position.0) == sum,
            "T3: only a faulty nominal clamps"
        );
    }
}

/// T3: from one tick to the next, with a fixed travel, the reference moves the way that nominal plus offset move, and no further:
/// so by at most |change of nominal| + |change of offset|. `|nominal| <= 2^61` nm.
///
/// # Panics
/// When it does not hold.
pub fn reference_moves_no_further(
    axis: &AxisConfig,
    (from, to): (PositionNm, PositionNm),
    (before, after): (&Offsets, &Offsets),
) {
    let bounded = |nominal: PositionNm| nominal.0.unsigned_abs() <= MAX_POSITION_NM.unsigned_abs();
    if !bounded(from) || !bounded(to) {
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
