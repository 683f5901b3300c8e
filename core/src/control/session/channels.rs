//! The three channels of an axis as one: each applies the action of the tick with its own limits.

use super::fsm::Action;
use crate::control::axis::Offsets;
use crate::control::channel::Channel;
use crate::control::message::{AxisFlags, AxisLimits};
use crate::units::{OffsetNm, TorquePermille, VelocityUmS};

/// The three channels of an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct AxisChannels {
    /// Position offset, nm.
    pub position: Channel<OffsetNm>,
    /// Velocity offset, µm/s.
    pub velocity: Channel<VelocityUmS>,
    /// Torque offset, per mille.
    pub torque: Channel<TorquePermille>,
}

impl AxisChannels {
    /// All three at zero and at rest.
    pub const ZERO: Self = Self {
        position: Channel::ZERO,
        velocity: Channel::ZERO,
        torque: Channel::ZERO,
    };

    /// Channels at rest at offsets read back from a drive, if these are within the limits.
    #[must_use]
    pub fn at_rest(offsets: &Offsets, limits: &AxisLimits) -> Option<Self> {
        Some(Self {
            position: Channel::from_parts(offsets.position, 0, &limits.position)?,
            velocity: Channel::from_parts(offsets.velocity, 0, &limits.velocity)?,
            torque: Channel::from_parts(offsets.torque, 0, &limits.torque)?,
        })
    }

    /// The invariant: each channel is valid under its limits.
    #[must_use]
    pub const fn is_valid(&self, limits: &AxisLimits) -> bool {
        self.position.is_valid(&limits.position)
            && self.velocity.is_valid(&limits.velocity)
            && self.torque.is_valid(&limits.torque)
    }

    /// True if all three are at zero.
    #[inline]
    #[must_use]
    pub const fn is_zero(&self) -> bool {
        self.position.is_zero() && self.velocity.is_zero() && self.torque.is_zero()
    }

    /// True if all three are at zero and at rest.
    #[inline]
    #[must_use]
    pub fn is_at_rest_at_zero(&self) -> bool {
        *self == Self::ZERO
    }

    /// Returns the values in force.
    #[inline]
    #[must_use]
    pub fn offsets(&self) -> Offsets {
        Offsets {
            position: self.position.value(),
            velocity: self.velocity.value(),
            torque: self.torque.value(),
        }
    }

    /// Returns the number of ramp ticks until all three are zero.
    #[must_use]
    pub fn ramp_ticks_left(&self, limits: &AxisLimits) -> u32 {
        let position = self.position.ramp_ticks_left(&limits.position);
        let velocity = self.velocity.ramp_ticks_left(&limits.velocity);
        let torque = self.torque.ramp_ticks_left(&limits.torque);
        position.max(velocity).max(torque)
    }

    /// Applies one action. Only [`Action::Follow`] reads `targets`.
    #[inline]
    pub fn act(&mut self, action: Action, targets: &Offsets, limits: &AxisLimits) {
        match action {
            Action::Follow | Action::FollowZero => {
                let targets = if action == Action::Follow {
                    targets
                } else {
                    &Offsets::ZERO
                };
                self.position = self.position.follow(targets.position, &limits.position);
                self.velocity = self.velocity.follow(targets.velocity, &limits.velocity);
                self.torque = self.torque.follow(targets.torque, &limits.torque);
            }
            Action::Hold => {
                self.position = self.position.hold();
                self.ramp_pushes(limits);
            }
            Action::Ramp => {
                self.position = self.position.ramp(&limits.position);
                self.ramp_pushes(limits);
            }
        }
    }

    /// Takes one step of the ramps of velocity and torque: holding a push would not hold the
    /// machine.
    #[inline]
    fn ramp_pushes(&mut self, limits: &AxisLimits) {
        self.velocity = self.velocity.ramp(&limits.velocity);
        self.torque = self.torque.ramp(&limits.torque);
    }
}

/// Returns flags for the channels that a follow left short of their targets.
#[inline]
#[must_use]
pub(super) fn limited(reached: &Offsets, action: Action, targets: &Offsets) -> AxisFlags {
    let targets = match action {
        Action::Follow => targets,
        Action::FollowZero => &Offsets::ZERO,
        Action::Hold | Action::Ramp => return AxisFlags::default(),
    };
    AxisFlags::default()
        .with(
            AxisFlags::POSITION_LIMITED,
            reached.position != targets.position,
        )
        .with(
            AxisFlags::VELOCITY_LIMITED,
            reached.velocity != targets.velocity,
        )
        .with(AxisFlags::TORQUE_LIMITED, reached.torque != targets.torque)
}
