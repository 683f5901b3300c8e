//! Commands and reports of one axis, in the units of the reference path.

use crate::units::{OffsetNm, PositionNm, TorquePermille, VelocityUmS};

/// External offsets of one axis, added to the references that its drive receives anyway.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Offsets {
    /// Added to the position reference (object 60B0h of CiA 402).
    pub position: OffsetNm,
    /// Added to the velocity reference (object 60B1h).
    pub velocity: VelocityUmS,
    /// Added to the torque reference (object 60B2h).
    pub torque: TorquePermille,
}

impl Offsets {
    /// All three at zero.
    pub const ZERO: Self = Self {
        position: OffsetNm(0),
        velocity: VelocityUmS(0),
        torque: TorquePermille(0),
    };

    /// A position offset; velocity and torque at zero.
    #[must_use]
    pub const fn position(position: OffsetNm) -> Self {
        Self {
            position,
            ..Self::ZERO
        }
    }
}

/// Measurements of a drive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Actual {
    /// Position of the motor side of the axis.
    pub position: PositionNm,
    /// Velocity.
    pub velocity: VelocityUmS,
    /// Torque.
    pub torque: TorquePermille,
}

impl Actual {
    /// All three at zero.
    pub const ZERO: Self = Self {
        position: PositionNm(0),
        velocity: VelocityUmS(0),
        torque: TorquePermille(0),
    };
}

/// References that a drive receives, once per cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Reference {
    /// Position reference: nominal plus offset, inside the machine's travel.
    pub position: PositionNm,
    /// Additive velocity reference.
    pub velocity_offset: VelocityUmS,
    /// Additive torque reference.
    pub torque_offset: TorquePermille,
}

impl Reference {
    /// Position zero, without velocity and torque.
    pub(crate) const ZERO: Self = Self {
        position: PositionNm(0),
        velocity_offset: VelocityUmS(0),
        torque_offset: TorquePermille(0),
    };
}

/// Values in force at the drive of one axis: those of the last references it took.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct InForce {
    /// Nominal reference, without offset.
    pub nominal: PositionNm,
    /// Offsets.
    pub offsets: Offsets,
}

impl InForce {
    /// A nominal reference without offsets.
    #[must_use]
    pub const fn at(nominal: PositionNm) -> Self {
        Self {
            nominal,
            offsets: Offsets::ZERO,
        }
    }
}
