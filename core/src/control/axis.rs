//! What one axis is told and what it reports, in the units of the reference path.

use crate::units::{OffsetNm, PositionNm, TorquePermille, VelocityUmS};

/// The external offsets of one axis, added to what its drive is told anyway.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Offsets {
    /// Added to the position reference (object 60B0h of CiA 402).
    pub position: OffsetNm,
    /// Added to the velocity reference (object 60B1h).
    pub velocity: VelocityUmS,
    /// Added to the torque reference (object 60B2h).
    pub torque: TorquePermille,
}

/// What a drive measures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Actual {
    /// Position of the motor side of the axis.
    pub position: PositionNm,
    /// Velocity.
    pub velocity: VelocityUmS,
    /// Torque.
    pub torque: TorquePermille,
}

/// What a drive receives, once per cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Reference {
    /// Position reference: nominal plus offset, inside the machine's travel.
    pub position: PositionNm,
    /// Additive velocity reference.
    pub velocity_offset: VelocityUmS,
    /// Additive torque reference.
    pub torque_offset: TorquePermille,
}
