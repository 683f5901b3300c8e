//! Rules of one axis: its three channels, its shadow, and the reference of its drive.

use super::trace::{Bounds, Breach, Motion, Trace, exactly, within};
use super::violation::{ChannelKind, Rule};
use crate::control::axis::{InForce, Offsets, Reference};
use crate::control::message::{AxisLimits, AxisState, Phase};
use crate::control::session::config::Travel;
use crate::units::PositionNm;

/// Demand of a tick to the channels of an axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Demand {
    /// Steps of the channels since the last sample, at most.
    pub(super) steps: u64,
    /// Motion of the position channel.
    pub(super) position: Motion,
    /// Motion of velocity and torque channel.
    pub(super) rest: Motion,
}

/// Last samples of one axis, and its limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AxisMonitor {
    /// Limits of position, velocity and torque.
    pub bounds: [Bounds; 3],
    /// Travel of the reference.
    pub travel: Travel,
    /// Offsets in the States.
    pub offsets: [Option<Trace>; 3],
    /// Offsets in the references; the position's is unknown where the travel may have clamped it.
    pub written: [Option<Trace>; 3],
    /// Last nominal reference and last position reference of the drive.
    pub reference: Option<(PositionNm, PositionNm)>,
}

/// Broken rule of a channel.
pub(super) type Broken = (ChannelKind, Breach);

impl AxisMonitor {
    pub(super) fn new(limits: &AxisLimits, travel: Travel) -> Self {
        Self {
            bounds: [
                Bounds::of(&limits.position),
                Bounds::of(&limits.velocity),
                Bounds::of(&limits.torque),
            ],
            travel,
            offsets: [None; 3],
            written: [None; 3],
            reference: None,
        }
    }

    /// Checks values read back from the drive against `M`.
    pub(super) fn check_in_force(&self, in_force: &InForce) -> Result<(), Broken> {
        let values = counts(&in_force.offsets);
        all(|index| {
            let (bounds, value) = (self.bounds.get(index)?, *values.get(index)?);
            Some(within(Rule::Max, bounds.max, value))
        })
    }

    /// Goes on from values read back from the drive, at rest.
    pub(super) fn rebase(&mut self, in_force: &InForce) {
        let at_rest = counts(&in_force.offsets).map(|value| Some(Trace::at_rest(value)));
        self.offsets = at_rest;
        self.written = at_rest;
        let reference = self.expected(in_force.nominal, in_force.offsets.position.0.into());
        self.reference = Some((in_force.nominal, PositionNm(narrow(reference))));
    }

    /// Checks an axis of a State.
    pub(super) fn check_state(
        &mut self,
        state: &AxisState,
        phase: Phase,
        demand: &Demand,
    ) -> Result<(), Broken> {
        let moved = self.check_offsets(&state.offsets, demand);
        let is_quiet = matches!(phase, Phase::Listening | Phase::Handshake | Phase::Submit);
        let values = counts(&state.offsets);
        let shadows = counts(&state.shadow);
        let placed = all(|index| {
            let (value, shadow) = (*values.get(index)?, *shadows.get(index)?);
            let reach = match phase {
                Phase::Submit => self.bounds.get(index)?.max,
                _ => 0,
            };
            let zero = if is_quiet {
                exactly(Rule::Zero, 0, value)
            } else {
                Ok(())
            };
            Some(zero.and(within(Rule::Shadow, reach, shadow)))
        });
        // The phase's own rule says more than the step that broke it.
        placed.and(moved)
    }

    fn check_offsets(&mut self, offsets: &Offsets, demand: &Demand) -> Result<(), Broken> {
        let motions = [demand.position, demand.rest, demand.rest];
        let values = counts(offsets);
        let (traces, bounds) = (&mut self.offsets, &self.bounds);
        all(|index| {
            let (trace, bounds) = (traces.get_mut(index)?, bounds.get(index)?);
            let (value, motion) = (*values.get(index)?, *motions.get(index)?);
            Some(Trace::advance(trace, value, demand.steps, motion, bounds))
        })
    }

    /// Checks the references of the drive, at most `steps` steps after the last ones.
    pub(super) fn check_reference(
        &mut self,
        nominal: PositionNm,
        reference: &Reference,
        steps: u64,
    ) -> Result<(), Broken> {
        let position = self
            .check_position(nominal, reference.position, steps)
            .map_err(|breach| (ChannelKind::Position, breach));
        let (traces, bounds) = (&mut self.written, &self.bounds);
        let values = [
            None,
            Some(i64::from(reference.velocity_offset.0)),
            Some(i64::from(reference.torque_offset.0)),
        ];
        let rest = all(|index| {
            let value = (*values.get(index)?)?;
            let (trace, bounds) = (traces.get_mut(index)?, bounds.get(index)?);
            Some(Trace::advance(trace, value, steps, Motion::Free, bounds))
        });
        position.and(rest)
    }

    fn check_position(
        &mut self,
        nominal: PositionNm,
        position: PositionNm,
        steps: u64,
    ) -> Result<(), Breach> {
        let [bounds, ..] = self.bounds;
        let [offset, ..] = &mut self.written;
        let (lower, upper) = (self.travel.lower, self.travel.upper);
        let before = self.reference.replace((nominal, position));
        let distance = i128::from(position.0).saturating_sub(nominal.0.into());
        // Strictly inside the travel nothing was clamped: the distance is the offset.
        let unclamped = if lower < position && position < upper {
            Trace::advance(offset, narrow(distance), steps, Motion::Free, &bounds)
        } else {
            *offset = None;
            Ok(())
        };
        for (end, is_outside) in [(lower, position < lower), (upper, position > upper)] {
            if is_outside {
                return Err(Breach {
                    rule: Rule::Travel,
                    limit: end.0,
                    found: position.0,
                });
            }
        }
        let nearest = self.expected(nominal, bounds.max.saturating_neg());
        let furthest = self.expected(nominal, bounds.max);
        if i128::from(position.0) < nearest || i128::from(position.0) > furthest {
            return Err(Breach {
                rule: Rule::Max,
                limit: bounds.max,
                found: narrow(distance),
            });
        }
        if let Some((old_nominal, old_position)) = before {
            let own = i128::from(nominal.0.abs_diff(old_nominal.0));
            let change = i128::from(position.0).saturating_sub(old_position.0.into());
            let steps = i128::from(bounds.step).saturating_mul(steps.into());
            let limit = own.saturating_add(steps);
            if change.abs() > limit {
                return Err(Breach {
                    rule: Rule::ReferenceStep,
                    limit: narrow(limit),
                    found: narrow(change),
                });
            }
        }
        unclamped
    }

    /// Checks that the references are those of the State.
    pub(super) fn check_equal(
        &self,
        state: &AxisState,
        reference: &Reference,
    ) -> Result<(), Broken> {
        let [position, velocity, torque] = counts(&state.offsets);
        let expected = [
            narrow(self.expected(state.nominal, position)),
            velocity,
            torque,
        ];
        let found = [
            reference.position.0,
            reference.velocity_offset.0.into(),
            reference.torque_offset.0.into(),
        ];
        all(|index| {
            let (expected, found) = (*expected.get(index)?, *found.get(index)?);
            Some(exactly(Rule::Reference, expected, found))
        })
    }

    /// Returns nominal plus offset, clamped to the travel.
    fn expected(&self, nominal: PositionNm, offset: i64) -> i128 {
        let sum = i128::from(nominal.0).saturating_add(offset.into());
        sum.max(self.travel.lower.0.into())
            .min(self.travel.upper.0.into())
    }
}

/// Checks the three channels, and returns the first broken rule; every channel is checked.
fn all(mut check: impl FnMut(usize) -> Option<Result<(), Breach>>) -> Result<(), Broken> {
    let mut result = Ok(());
    for (index, channel) in ChannelKind::ALL.into_iter().enumerate() {
        if let Some(Err(breach)) = check(index) {
            result = result.and(Err((channel, breach)));
        }
    }
    result
}

/// Returns the counts of position, velocity and torque.
fn counts(offsets: &Offsets) -> [i64; 3] {
    [
        offsets.position.0.into(),
        offsets.velocity.0.into(),
        offsets.torque.0.into(),
    ]
}

/// Converts to `i64`, cut to its range.
fn narrow(value: i128) -> i64 {
    let end = if value < 0 { i64::MIN } else { i64::MAX };
    i64::try_from(value).unwrap_or(end)
}
