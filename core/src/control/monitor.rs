//! Run-time check of States and references against limits, for a second processor, a test or a
//! recording.
//!
//! It shares no arithmetic with the channels that it checks. [`Monitor::check_state`] takes States,
//! [`Monitor::check_references`] what is written to the drives, [`Monitor::check_tick`] both and
//! their agreement.
//!
//! | rule | of |
//! |---|---|
//! | offset at most `M`, its change at most `S`, the change of that at most `A` | States, references |
//! | SafeDisconnect and Fault, from the tick that enters them: a step of exactly `min(rho, |offset|)` towards zero | States |
//! | Obtain without a fresh command: position held, velocity and torque on their ramp | States |
//! | Listening, Handshake, Submit: offsets zero, in this tick and before it | States |
//! | shadow zero outside Submit, at most `M` in it | States |
//! | position within the travel, changed by at most the change of the nominal reference plus `S` | references |
//! | reference equal to nominal plus offset, clamped to the travel | both |
//!
//! A monitor that receives every State ([`Monitor::new`]) takes each as one step of the channels: a
//! server that skips cycles takes one step, for any tick number. Over a lossy link
//! ([`Monitor::lossy`]) a difference of `k` ticks is anything between one step and `k` steps: the
//! change is compared with `k * S`; `A`, ramp and hold are not checked across the gap. Feed States
//! in the order of their ticks, as [`crate::control::client::Client`] returns them.
//!
//! ```
//! use gantry_tau_core::control::monitor::Rule;
//! use gantry_tau_core::{AxisLimits, InForce, LimitValues, Limits, Monitor, OffsetNm, Offsets, PositionNm, Reference, Travel};
//! # use gantry_tau_core::units::{TorquePermille, VelocityUmS};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let position = Limits::new(LimitValues { max: 2_000_000, step: 5_000, accel: 10_000, ramp: 100 })?;
//! let limits = AxisLimits { position, ..AxisLimits::DISABLED };
//! let travel = Travel::around_zero(1_000_000_000);
//! let mut monitor = Monitor::<1>::new([limits], Some([travel]));
//! monitor.rebase(&[InForce::at(PositionNm(0))])?;
//! let reference = |nm| Reference { position: PositionNm(nm), velocity_offset: VelocityUmS(0), torque_offset: TorquePermille(0) };
//! monitor.check_references(&[PositionNm(0)], &[reference(4_000)])?;
//! let violation = monitor.check_references(&[PositionNm(0)], &[reference(9_001)]).unwrap_err();
//! assert_eq!((violation.rule, violation.limit, violation.found), (Rule::ReferenceStep, 5_000, 5_001));
//! # Ok(())
//! # }
//! ```

pub(crate) mod axis;
pub(crate) mod trace;
mod violation;

use crate::control::axis::{InForce, Reference};
use crate::control::message::{AxisLimits, Phase, State};
use crate::control::session::config::Travel;
use crate::units::{Epoch, PositionNm, Sequence, Tick};

use axis::{AxisMonitor, Broken, Demand};
use trace::Motion;

pub use violation::{ChannelKind, Rule, Violation};

/// Travel that clamps nothing.
const EVERYWHERE: Travel = Travel {
    lower: PositionNm(i64::MIN),
    upper: PositionNm(i64::MAX),
};

/// Check of a stream of States or references of `N` axes. It goes on after a violation, from the
/// sample that broke a rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Monitor<const N: usize> {
    parts: Parts<N>,
}

/// Parts of a monitor's state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Parts<const N: usize> {
    /// States may be lost on their way to the monitor.
    pub lossy: bool,
    /// The axes.
    pub axes: [AxisMonitor; N],
    /// Part of the last State.
    pub last: Option<Seen>,
}

/// Part of the last State that the rules for the next one depend on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Seen {
    /// Its tick.
    pub tick: Tick,
    /// Its epoch.
    pub epoch: Epoch,
    /// Sequence of the last accepted command.
    pub accepted: Sequence,
}

impl<const N: usize> Monitor<N> {
    /// Creates a monitor that receives every State, or every reference. The first sample is
    /// compared with `M` and its phase only; call [`Self::rebase`] before it where the values in
    /// force at the start are known.
    ///
    /// `travel` is the machine travel; without it, references must be nominal plus offset exactly.
    #[must_use]
    pub fn new(limits: [AxisLimits; N], travel: Option<[Travel; N]>) -> Self {
        let travel = travel.unwrap_or([EVERYWHERE; N]);
        let mut index = 0_usize;
        let axes = limits.map(|limits| {
            let travel = travel.get(index).copied().unwrap_or(EVERYWHERE);
            index = index.wrapping_add(1);
            AxisMonitor::new(&limits, travel)
        });
        Self {
            parts: Parts {
                lossy: false,
                axes,
                last: None,
            },
        }
    }

    /// Creates a monitor that may miss States.
    #[must_use]
    pub fn lossy(limits: [AxisLimits; N], travel: Option<[Travel; N]>) -> Self {
        let Parts { axes, last, .. } = Self::new(limits, travel).parts;
        let lossy = true;
        Self {
            parts: Parts { lossy, axes, last },
        }
    }

    /// Builds a monitor from its parts.
    #[must_use]
    pub(crate) const fn from_parts(parts: Parts<N>) -> Self {
        Self { parts }
    }

    /// Returns the parts of the state.
    #[must_use]
    pub(crate) const fn parts(&self) -> &Parts<N> {
        &self.parts
    }

    /// Goes on from the values in force at the drives, at rest: at the start of the server, and
    /// after a refused write.
    ///
    /// # Errors
    /// A value beyond its `M`. The monitor then keeps its samples, as the server keeps its
    /// channels.
    pub fn rebase(&mut self, in_force: &[InForce; N]) -> Result<(), Violation> {
        first(&mut self.parts.axes, |axis, index| {
            Some(axis.check_in_force(in_force.get(index)?))
        })?;
        self.parts.last = None;
        first(&mut self.parts.axes, |axis, index| {
            axis.rebase(in_force.get(index)?);
            None
        })
    }

    /// Checks the State of a tick.
    ///
    /// # Errors
    /// The first broken rule, by axis and channel.
    pub fn check_state(&mut self, state: &State<N>) -> Result<(), Violation> {
        let demand = self.demand(state);
        self.parts.last = Some(Seen {
            tick: state.tick,
            epoch: state.epoch,
            accepted: state.accepted,
        });
        first(&mut self.parts.axes, |axis, index| {
            Some(axis.check_state(state.axes.get(index)?, state.phase, &demand))
        })
    }

    /// Checks references that are written to the drives, one step after those before. References
    /// that were withheld are not fed.
    ///
    /// # Errors
    /// The first broken rule, by axis and channel.
    pub fn check_references(
        &mut self,
        nominal: &[PositionNm; N],
        references: &[Reference; N],
    ) -> Result<(), Violation> {
        self.references_after(1, nominal, references)
    }

    /// Checks the State of a tick and the references that are written in it.
    ///
    /// # Errors
    /// The first broken rule: of the State, of the references, of their agreement.
    pub fn check_tick(
        &mut self,
        state: &State<N>,
        references: &[Reference; N],
    ) -> Result<(), Violation> {
        let steps = self.demand(state).steps;
        let told = self.check_state(state);
        let nominal = state.axes.map(|axis| axis.nominal);
        let written = self.references_after(steps, &nominal, references);
        let equal = first(&mut self.parts.axes, |axis, index| {
            Some(axis.check_equal(state.axes.get(index)?, references.get(index)?))
        });
        told.and(written).and(equal)
    }

    fn references_after(
        &mut self,
        steps: u64,
        nominal: &[PositionNm; N],
        references: &[Reference; N],
    ) -> Result<(), Violation> {
        first(&mut self.parts.axes, |axis, index| {
            let (nominal, reference) = (*nominal.get(index)?, references.get(index)?);
            Some(axis.check_reference(nominal, reference, steps))
        })
    }

    /// Returns the steps since the last State, at most, and the motion that this one must show.
    fn demand(&self, state: &State<N>) -> Demand {
        let last = self.parts.last;
        let steps = match last {
            _ if !self.parts.lossy => 1,
            Some(last) => state.tick.0.saturating_sub(last.tick.0),
            None => u64::MAX,
        };
        // An accepted command raises the sequence; a new session begins with a phase before Obtain.
        let is_fresh =
            last.is_none_or(|last| (last.epoch, last.accepted) != (state.epoch, state.accepted));
        let (position, rest) = match state.phase {
            Phase::Listening | Phase::Handshake | Phase::Submit => (Motion::Hold, Motion::Hold),
            Phase::Obtain if is_fresh => (Motion::Free, Motion::Free),
            Phase::Obtain => (Motion::Hold, Motion::Ramp),
            Phase::SafeDisconnect | Phase::Fault => (Motion::Ramp, Motion::Ramp),
        };
        Demand {
            steps,
            position,
            rest,
        }
    }
}

/// Checks every axis, and returns the first violation.
fn first<const N: usize>(
    axes: &mut [AxisMonitor; N],
    mut check: impl FnMut(&mut AxisMonitor, usize) -> Option<Result<(), Broken>>,
) -> Result<(), Violation> {
    let mut result = Ok(());
    for index in 0..N {
        let Some(axis) = axes.get_mut(index) else {
            continue;
        };
        if let Some(Err((channel, breach))) = check(axis, index) {
            result = result.and(Err(Violation {
                axis: index,
                channel,
                rule: breach.rule,
                limit: breach.limit,
                found: breach.found,
            }));
        }
    }
    result
}

#[cfg(test)]
mod tests;
