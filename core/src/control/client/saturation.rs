//! Targets cut to the limits that the server stated.

use crate::control::axis::Offsets;
use crate::control::channel::Limits;
use crate::control::message::AxisLimits;
use crate::units::ChannelUnit;

/// Targets of an axis that were cut to their limits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Saturated {
    /// The position target was beyond its `M`.
    pub position: bool,
    /// The velocity target was beyond its `M`.
    pub velocity: bool,
    /// The torque target was beyond its `M`.
    pub torque: bool,
}

impl Saturated {
    /// True if one of the three was cut.
    #[inline]
    #[must_use]
    pub const fn any(self) -> bool {
        self.position || self.velocity || self.torque
    }
}

/// Returns the targets nearest to the wanted ones within the limits, and flags for those that
/// differ.
pub(super) fn saturate(targets: &Offsets, limits: &AxisLimits) -> (Offsets, Saturated) {
    let cut = Offsets {
        position: nearest(targets.position, &limits.position),
        velocity: nearest(targets.velocity, &limits.velocity),
        torque: nearest(targets.torque, &limits.torque),
    };
    let saturated = Saturated {
        position: cut.position != targets.position,
        velocity: cut.velocity != targets.velocity,
        torque: cut.torque != targets.torque,
    };
    (cut, saturated)
}

fn nearest<U: ChannelUnit>(target: U, limits: &Limits<U>) -> U {
    let max = limits.max();
    // Not `clamp`, which panics on reversed ends: `M >= 0` holds, but the compiler cannot see it.
    U::saturating_from(target.count().max(max.saturating_neg()).min(max))
}
