//! Second half of a tick: each axis carries out the decision with its own channels, limits and
//! travel.

use super::channels::{AxisChannels, limited};
use super::config::{AxisConfig, NominalAccel, Travel};
use super::fsm::Action;
use crate::control::agitation::Agitation;
use crate::control::axis::{Actual, InForce, Offsets, Reference};
use crate::control::message::{AxisFlags, AxisState, Phase};
use crate::units::PositionNm;

/// State of one axis in a session.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Axis {
    /// Channels whose values are in force.
    pub channels: AxisChannels,
    /// Channels that follow in Submit. They reach no drive.
    pub shadow: AxisChannels,
    /// Nominal reference of the last tick.
    pub nominal: PositionNm,
    /// Nominal reference of the tick before.
    pub nominal_before: PositionNm,
    /// Last measurements of the drive; reported only.
    pub actual: Actual,
    /// Agitation of the position offset in Obtain.
    pub agitation: Agitation,
}

/// Command to one axis in a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct AxisCommand {
    /// Action of the channels in force.
    pub action: Action,
    /// The tick is one of Obtain: what the position offset does counts as agitation.
    pub obtains: bool,
    /// Action of the shadow; `None`: it rests at zero.
    pub shadow: Option<Action>,
    /// Target of [`Action::Follow`].
    pub target: Offsets,
    /// Nominal reference of this tick.
    pub nominal: PositionNm,
    /// Flags of the nominal reference that was read.
    pub nominal_flags: AxisFlags,
    /// Measurements of the drive.
    pub actual: Actual,
}

impl Axis {
    /// The invariant, clause by clause: channels and shadow are valid under their limits; before
    /// Obtain the channels rest at zero (T6); outside Submit the shadow rests at zero; outside
    /// Obtain, and without a budget, there is no agitation.
    #[must_use]
    pub fn is_valid(&self, phase: Phase, config: &AxisConfig) -> bool {
        let limits = &config.limits;
        let resting = matches!(phase, Phase::Listening | Phase::Handshake | Phase::Submit);
        self.channels.is_valid(limits)
            && self.shadow.is_valid(limits)
            && (!resting || self.channels.is_at_rest_at_zero())
            && (phase == Phase::Submit || self.shadow.is_at_rest_at_zero())
            && (phase == Phase::Obtain && config.agitation.is_some()
                || self.agitation == Agitation::ZERO)
    }

    /// True if the agitation is beyond its budget.
    #[inline]
    #[must_use]
    pub fn is_agitated(&self, config: &AxisConfig) -> bool {
        (config.agitation.as_ref()).is_some_and(|budget| self.agitation.exceeds(budget))
    }

    /// Returns the reference of the last tick, before the clamp to the travel. `state` becomes the
    /// axis' part of the State.
    #[inline]
    #[must_use]
    pub fn held(&self, state: &mut AxisState) -> Reference {
        let offsets = self.channels.offsets();
        let everywhere = Travel {
            lower: PositionNm(i64::MIN),
            upper: PositionNm(i64::MAX),
        };
        let (reference, _) = drive_reference(self.nominal, &offsets, &everywhere);
        let (shadow, flags) = (self.shadow.offsets(), AxisFlags::default());
        *state = AxisState {
            nominal: self.nominal,
            offsets,
            shadow,
            actual: self.actual,
            flags,
        };
        reference
    }

    /// Returns the values in force after references that the drive took.
    #[inline]
    #[must_use]
    pub fn in_force(&self) -> InForce {
        InForce {
            nominal: self.nominal,
            offsets: self.channels.offsets(),
        }
    }

    /// Carries out a command. Returns the drive's reference; `state` becomes the axis' part of the
    /// State.
    // Not inlined: a copy per axis would leave the tick no registers.
    #[inline(never)]
    pub fn act(
        &mut self,
        command: &AxisCommand,
        config: &AxisConfig,
        state: &mut AxisState,
    ) -> Reference {
        let limits = &config.limits;
        let target = &command.target;
        let change = self.channels.position.change();
        self.channels.act(command.action, target, limits);
        // Without a budget it is zero.
        if let Some(budget) = &config.agitation {
            self.agitation = if command.obtains {
                let changed = self.channels.position.change();
                self.agitation.after(change, changed, budget)
            } else {
                Agitation::ZERO
            };
        }
        self.nominal_before = self.nominal;
        self.nominal = command.nominal;
        self.actual = command.actual;
        // In Submit it is the shadow that approaches its target.
        let offsets = self.channels.offsets();
        let (shadow, limited) = match command.shadow {
            Some(action) => {
                self.shadow.act(action, target, limits);
                let shadow = self.shadow.offsets();
                (shadow, limited(&shadow, action, target))
            }
            None => {
                self.shadow = AxisChannels::ZERO;
                (Offsets::ZERO, limited(&offsets, command.action, target))
            }
        };
        let (reference, clamped) =
            drive_reference(command.nominal, &offsets, &config.machine_travel);
        *state = AxisState {
            nominal: command.nominal,
            offsets,
            shadow,
            actual: command.actual,
            flags: AxisFlags(limited.0 | clamped.0 | command.nominal_flags.0),
        };
        reference
    }
}

/// Returns the drive's reference: `clamp(nominal + offset, travel)`, and a flag if the clamp
/// changed it. A clamp never enlarges a difference, so for a fixed travel the position changes by
/// at most |change of nominal| + |change of offset| (T3).
#[inline]
#[must_use]
pub fn drive_reference(
    nominal: PositionNm,
    offsets: &Offsets,
    travel: &Travel,
) -> (Reference, AxisFlags) {
    let wanted = nominal.0.saturating_add(i64::from(offsets.position.0));
    // Not `clamp`, which would panic on reversed ends; the configuration refuses those.
    let position = wanted.max(travel.lower.0).min(travel.upper.0);
    let flags = AxisFlags::default().with(AxisFlags::TRAVEL, position != wanted);
    let reference = Reference {
        position: PositionNm(position),
        velocity_offset: offsets.velocity,
        torque_offset: offsets.torque,
    };
    (reference, flags)
}

/// True if the nominal reference moved further than its limit in `cycles` cycles.
#[inline]
#[must_use]
pub fn nominal_stepped(from: PositionNm, to: PositionNm, axis: &AxisConfig, cycles: u32) -> bool {
    let limit = u64::from(axis.nominal_step_nm).wrapping_mul(u64::from(cycles));
    from.0.abs_diff(to.0) > limit
}

/// True if the second difference of an axis' nominal reference is beyond its limit.
#[inline]
#[must_use]
pub fn nominal_accelerated(axis: &Axis, to: PositionNm, limit: NominalAccel) -> bool {
    // Exact for positions within 2^61; a path beyond them has stepped.
    let change = to.0.wrapping_sub(axis.nominal.0);
    let last = axis.nominal.0.wrapping_sub(axis.nominal_before.0);
    change.wrapping_sub(last).unsigned_abs() > u64::from(limit.nm.get())
}

#[cfg(test)]
mod tests {
    use core::num::NonZeroU32;

    use proptest::prelude::*;

    use super::*;
    use crate::control::fixture::{axis, limits};

    /// Positions of all magnitudes, many of them near each other.
    fn position() -> impl Strategy<Value = i64> {
        prop_oneof![
            any::<i64>(),
            -1_000..1_000_i64,
            Just(i64::MIN),
            Just(i64::MAX)
        ]
    }

    proptest! {
        /// Against wider integers.
        #[test]
        fn a_step_of_the_path_is_beyond_its_limit_exactly(
            from in position(),
            to in position(),
            limit in prop_oneof![0..1_000_u32, any::<u32>()],
            cycles in prop_oneof![1..4_u32, any::<u32>()],
        ) {
            let config = axis(limits(1_000, 100, 200, 10), 1_000, limit);
            let moved = (i128::from(to) - i128::from(from)).abs();
            let most = i128::from(limit) * i128::from(cycles);
            let found = nominal_stepped(PositionNm(from), PositionNm(to), &config, cycles);
            prop_assert_eq!(found, moved > most);
            // At the limit, and a nanometre beyond.
            for (beyond, is_far) in [(0, false), (1, true)] {
                let Ok(end) = i64::try_from(i128::from(from) + most + beyond) else {
                    continue;
                };
                let found = nominal_stepped(PositionNm(from), PositionNm(end), &config, cycles);
                prop_assert_eq!(found, is_far);
            }
        }

        /// Against wider integers.
        #[test]
        fn an_acceleration_of_the_path_is_beyond_its_limit_exactly(
            places in [-(1_i64 << 61)..=1 << 61, -(1_i64 << 61)..=1 << 61, -(1_i64 << 61)..=1 << 61],
            nm in prop_oneof![1..1_000_u32, 1..=u32::MAX],
        ) {
            let limit = NominalAccel { nm: NonZeroU32::new(nm).unwrap(), is_fault: false };
            let second = |places: [i64; 3]| {
                let [before, last, now] = places.map(i128::from);
                (now - 2 * last + before).abs()
            };
            let found = |[before, last, now]: [i64; 3]| {
                let axis = Axis {
                    nominal: PositionNm(last),
                    nominal_before: PositionNm(before),
                    ..Axis::default()
                };
                nominal_accelerated(&axis, PositionNm(now), limit)
            };
            prop_assert_eq!(found(places), second(places) > i128::from(nm));
            let [before, last, _] = places;
            for (beyond, is_far) in [(0, false), (1, true)] {
                let now = 2 * i128::from(last) - i128::from(before) + i128::from(nm) + beyond;
                if let Ok(now) = i64::try_from(now) {
                    prop_assert_eq!(found([before, last, now]), is_far);
                }
            }
        }
    }
}
