//! Broken limits: axis, channel, rule, and both numbers.

use core::fmt;

/// One of the three channels of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum ChannelKind {
    /// Position, nm.
    Position,
    /// Velocity, µm/s.
    Velocity,
    /// Torque, per mille of rated torque.
    Torque,
}

impl ChannelKind {
    /// All three, in the order of the wire.
    pub const ALL: [Self; 3] = [Self::Position, Self::Velocity, Self::Torque];

    /// Returns the unit of the channel's values.
    #[must_use]
    pub const fn unit(self) -> &'static str {
        match self {
            Self::Position => "nm",
            Self::Velocity => "um/s",
            Self::Torque => "per mille",
        }
    }
}

impl fmt::Display for ChannelKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Position => "position",
            Self::Velocity => "velocity",
            Self::Torque => "torque",
        })
    }
}

/// Rule that a sample broke.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Rule {
    /// The offset is at most `M`.
    Max,
    /// The offset changes by at most `S` per tick.
    Step,
    /// The change of the offset changes by at most `A` per tick.
    Accel,
    /// The offset moves by exactly `min(rho, |offset|)` towards zero.
    Ramp,
    /// The offset does not move: before Obtain, and for positions in Obtain without a fresh
    /// command.
    Hold,
    /// The offset is zero before Obtain.
    Zero,
    /// The shadow is zero outside Submit, and at most `M` in it.
    Shadow,
    /// The reference is nominal plus offset, clamped to the travel.
    Reference,
    /// The reference lies within the travel.
    Travel,
    /// The position reference changes by at most the change of the nominal reference plus `S`.
    ReferenceStep,
}

/// A broken rule. The monitor goes on from the sample that broke it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Violation {
    /// Index of the axis.
    pub axis: usize,
    /// Channel.
    pub channel: ChannelKind,
    /// Rule.
    pub rule: Rule,
    /// Largest magnitude that the rule allows, or the one value that it demands; in the channel's
    /// unit.
    pub limit: i64,
    /// Value found. Cut to the range of `i64`, as is the limit.
    pub found: i64,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (is, demanded) = match self.rule {
            Rule::Max => ("offset is", "at most"),
            Rule::Step => ("offset changed by", "at most"),
            Rule::Accel => ("change of the offset changed by", "at most"),
            Rule::Ramp => ("offset changed on its ramp by", "exactly"),
            Rule::Hold => ("held offset changed by", "exactly"),
            Rule::Zero => ("offset before Obtain is", "exactly"),
            Rule::Shadow => ("shadow is", "at most"),
            Rule::Reference => ("reference is", "exactly"),
            Rule::Travel => ("reference is", "inside the travel, which ends at"),
            Rule::ReferenceStep => ("reference changed by", "at most"),
        };
        let Self {
            axis,
            channel,
            limit,
            found,
            ..
        } = self;
        let unit = channel.unit();
        write!(
            f,
            "axis {axis}, {channel}: {is} {found} {unit}; expected {demanded} {limit} {unit}"
        )
    }
}

impl core::error::Error for Violation {}
