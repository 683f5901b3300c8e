//! Position loop of one axis whose drive takes velocities `[T 6.2.2, 7.2]`: proportional, integral,
//! and feed-forward of velocity and torque.
//!
//! ```text
//! reference --+-- delay by the lag --(-)-- gain --(+)-- channel --> velocity
//!             |                       |            |
//!             |                    actual          |
//!             +-- derivative --- weight -----------+
//!             '-- second derivative --- weight --- channel --> torque
//! ```
//!
//! The actual value is compared with the reference that belongs to it, `lag` ticks old. Without
//! this alignment the feed-forward leaves the velocity times the misalignment.
//!
//! With velocities a drive that gets no more references goes on moving. So the loop stops by
//! itself, with the ramp of its channel, when it is not allowed to run, does not know the position,
//! or for too long the following error was outside its window or its limits cut the velocity (a
//! limiter that acts in normal motion destabilises a loop). Once stopped it runs again only after
//! [`Enable::Rearm`], from rest, with a reference inside the window.
//!
//! Integers only, no division. For every input (T17 to T20):
//!
//! - the velocity reference stays within `M` of its limits, changes by at most `S`, and its change
//!   by at most `A`;
//! - stopped, it moves by exactly `min(rho, |velocity|)` towards zero;
//! - the trip latches in the tick in which the error was outside for the last `window_ticks` ticks,
//!   or after as many in which the limits cut the velocity;
//! - the proportional term is odd, monotone, and at most gain times error; the integral keeps its
//!   limit and does not wind up.

mod axes;
pub mod config;
pub mod quick_stop;
pub(crate) mod terms;
#[cfg(test)]
mod tests;

use crate::control::axis::Reference;
use crate::control::channel::Channel;
use crate::units::{ChannelUnit, PositionNm, TorquePermille, VelocityUmS};

pub use axes::PositionLoops;
use config::{LoopConfig, LoopValues, MAX_LAG};
use terms::{INTEGRAL_SHIFT, difference, fed_forward, integrate, product, weighted};

/// References that are kept: of this tick, and of [`MAX_LAG`] before it.
#[expect(
    clippy::as_conversions,
    reason = "u8 to usize is lossless; `From` is not const"
)]
const HISTORY: usize = MAX_LAG as usize + 1;

/// Enable signal of one tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub enum Enable {
    /// The axis must come to rest.
    Stop,
    /// A running loop may go on.
    Run,
    /// As [`Enable::Run`]; and a loop that has stopped may run again, if the velocity is zero and
    /// the reference inside the window.
    Rearm,
}

/// Reason for which a loop has stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
#[non_exhaustive]
pub enum LoopStop {
    /// It was not allowed to run.
    NotPermitted,
    /// There was no actual position.
    NoActual,
    /// The following error was outside its window for too long.
    FollowingError,
    /// The limits cut the velocity for too long.
    Limited,
    /// Another axis has stopped.
    OtherAxis,
    /// The drives did not take the last references.
    Refused,
}

/// Input of one tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct LoopInput {
    /// References of the axis, as [`crate::Session`] gives them. The velocity offset is added to
    /// the loop's velocity, the torque offset to its torque, each before the limits.
    pub reference: Reference,
    /// Position that was read in this tick; `None` if there was none.
    pub actual: Option<PositionNm>,
    /// Enable signal.
    pub permit: Enable,
}

/// References that a drive in velocity mode receives, once per cycle (objects 60FFh and 60B2h of
/// CiA 402).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct VelocityReference {
    /// Velocity.
    pub velocity: VelocityUmS,
    /// Additive torque.
    pub torque: TorquePermille,
}

/// Parts of a loop's state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct LoopParts {
    /// Position references, that of the last tick first.
    pub history: [PositionNm; HISTORY],
    /// Integral, in 2^-10 µm/s.
    pub integral: i64,
    /// Velocity reference.
    pub velocity: Channel<VelocityUmS>,
    /// Torque reference.
    pub torque: Channel<TorquePermille>,
    /// Ticks in a row outside the window, up to the trip.
    pub outside: u16,
    /// Ticks in a row in which the limits cut the velocity, up to the trip.
    pub limited: u16,
    /// Reason for which it has stopped; `None` while it runs.
    pub stop: Option<LoopStop>,
}

/// Position loop of one axis.
///
/// ```
/// use gantry_tau_core::control::position_loop::config::{LoopConfig, LoopValues};
/// use gantry_tau_core::control::position_loop::{Enable, LoopInput, PositionLoop};
/// use gantry_tau_core::{LimitValues, Limits, PositionNm, Reference};
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let config = LoopConfig::new(LoopValues {
///     gain: 5_256, // 80.2 1/s
///     velocity_feed_forward: 1_024,
///     lag: 3, // a cycle of latency each way
///     window_nm: 2_000_000,
///     window_ticks: 10,
///     velocity: Limits::new(LimitValues { max: 600_000, step: 10_000, accel: 20_000, ramp: 10_000 })?,
///     ..*LoopConfig::DISABLED.values()
/// })?;
/// let start = PositionNm(0);
/// let mut axis = PositionLoop::at_rest(start);
/// let reference = Reference { position: start, velocity_offset: Default::default(), torque_offset: Default::default() };
/// // It has not run yet, so it waits for a re-arm; then an error of 10 µm asks for 0.8 mm/s.
/// let input = LoopInput { reference, actual: Some(PositionNm(-10_000)), permit: Enable::Rearm };
/// assert_eq!(axis.tick(&config, &input).velocity.0, 802);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct PositionLoop {
    parts: LoopParts,
}

impl PositionLoop {
    /// Creates a loop at rest at a reference. It waits for [`Enable::Rearm`].
    #[must_use]
    pub const fn at_rest(reference: PositionNm) -> Self {
        Self {
            parts: LoopParts {
                history: [reference; HISTORY],
                integral: 0,
                velocity: Channel::ZERO,
                torque: Channel::ZERO,
                outside: 0,
                limited: 0,
                stop: Some(LoopStop::NotPermitted),
            },
        }
    }

    /// Builds a loop from its parts, if they satisfy the invariant.
    #[must_use]
    pub fn from_parts(parts: LoopParts, config: &LoopConfig) -> Option<Self> {
        let axis = Self { parts };
        axis.is_valid(config).then_some(axis)
    }

    /// The invariant, clause by clause: both channels are valid; the integral is within its limit;
    /// a loop that runs has not been outside the window for as long as it takes to trip.
    #[must_use]
    pub fn is_valid(&self, config: &LoopConfig) -> bool {
        let (parts, values) = (&self.parts, config.values());
        let most = u64::from(values.integral_max.unsigned_abs()) << INTEGRAL_SHIFT;
        parts.velocity.is_valid(&values.velocity)
            && parts.torque.is_valid(&values.torque)
            && parts.integral.unsigned_abs() <= most
            && (parts.stop.is_some() || parts.outside < values.window_ticks)
    }

    /// Returns the parts.
    #[must_use]
    pub const fn parts(&self) -> &LoopParts {
        &self.parts
    }

    /// Returns the reason for which the loop has stopped; `None` while it runs.
    #[must_use]
    pub const fn stop(&self) -> Option<LoopStop> {
        self.parts.stop
    }

    /// True if the velocity reference is zero.
    #[must_use]
    pub const fn is_at_rest(&self) -> bool {
        self.parts.velocity.is_zero()
    }

    /// Runs one tick.
    pub fn tick(&mut self, config: &LoopConfig, input: &LoopInput) -> VelocityReference {
        self.keep(input.reference.position);
        if self.is_ready(config, input) {
            self.restart(input.reference.position);
        }
        let error = self.observe(config, input);
        self.act(config, input, error)
    }

    /// True if a loop that has stopped may run again in this tick.
    pub(super) fn is_ready(&self, config: &LoopConfig, input: &LoopInput) -> bool {
        let reference = input.reference.position;
        let is_near =
            |actual: PositionNm| !is_outside(difference(reference.0, actual.0), config.values());
        input.permit == Enable::Rearm
            && self.parts.stop.is_some()
            && self.is_at_rest()
            && input.actual.is_some_and(is_near)
    }

    /// Runs again from a reference.
    pub(super) const fn restart(&mut self, reference: PositionNm) {
        self.parts.history = [reference; HISTORY];
        self.parts.integral = 0;
        self.parts.outside = 0;
        self.parts.limited = 0;
        self.parts.stop = None;
    }

    /// First step of a tick: keeps its reference.
    pub(super) const fn keep(&mut self, reference: PositionNm) {
        let [a, b, c, d, e, f, g, h, i, j, _] = self.parts.history;
        self.parts.history = [reference, a, b, c, d, e, f, g, h, i, j];
    }

    /// Second step of a tick: counts the ticks outside the window, and stops a loop that must not
    /// go on. Returns the following error, nm; zero without an actual position.
    pub(super) fn observe(&mut self, config: &LoopConfig, input: &LoopInput) -> i64 {
        let values = config.values();
        // Of several reasons the first one stands.
        if input.permit == Enable::Stop {
            self.stop_with(LoopStop::NotPermitted);
        }
        let Some(error) = self.following_error(config, input) else {
            self.parts.outside = 0;
            self.stop_with(LoopStop::NoActual);
            return 0;
        };
        self.parts.outside = counted(
            self.parts.outside,
            is_outside(error, values),
            values.window_ticks,
        );
        if self.parts.outside >= values.window_ticks {
            self.stop_with(LoopStop::FollowingError);
        }
        if self.parts.limited >= values.window_ticks {
            self.stop_with(LoopStop::Limited);
        }
        error
    }

    /// Returns the error against the reference that belongs to the actual position, nm; `None`
    /// without an actual position.
    fn following_error(&self, config: &LoopConfig, input: &LoopInput) -> Option<i64> {
        // The lag is within the history: `LoopConfig` checks it.
        let aligned = self.parts.history.get(usize::from(config.values().lag))?;
        Some(difference(aligned.0, input.actual?.0))
    }

    /// Stops a loop that runs.
    pub(super) fn stop_with(&mut self, stop: LoopStop) {
        self.parts.stop = self.parts.stop.or(Some(stop));
    }

    /// Last step of a tick: follows the reference, or ramps to rest.
    pub(super) fn act(
        &mut self,
        config: &LoopConfig,
        input: &LoopInput,
        error: i64,
    ) -> VelocityReference {
        let values = config.values();
        let parts = &mut self.parts;
        if parts.stop.is_some() {
            parts.velocity = parts.velocity.ramp(&values.velocity);
            parts.torque = parts.torque.ramp(&values.torque);
        } else {
            let [now, last, before, ..] = parts.history;
            let change = difference(now.0, last.0);
            let proportional = weighted(error, values.gain);
            // Four terms of less than 2^32: nothing wraps.
            let wanted = proportional
                .wrapping_add(parts.integral >> INTEGRAL_SHIFT)
                .wrapping_add(fed_forward(change, values.velocity_feed_forward))
                .wrapping_add(input.reference.velocity_offset.0.into());
            parts.velocity = parts
                .velocity
                .follow(VelocityUmS(saturated(wanted)), &values.velocity);
            let short = wanted.wrapping_sub(parts.velocity.count().into());
            parts.limited = counted(parts.limited, short != 0, values.window_ticks);
            let growth = product(proportional, values.integral);
            parts.integral = integrate(parts.integral, growth, short, values.integral_max);
            // A disabled torque stays at zero, and its term is not computed.
            parts.torque = if values.torque.max() == 0 {
                Channel::ZERO
            } else {
                let bend = change.wrapping_sub(difference(last.0, before.0));
                let torque = weighted(bend, values.torque_feed_forward)
                    .wrapping_add(input.reference.torque_offset.0.into());
                parts.torque.follow(
                    TorquePermille::saturating_from(saturated(torque)),
                    &values.torque,
                )
            };
        }
        VelocityReference {
            velocity: parts.velocity.value(),
            torque: parts.torque.value(),
        }
    }
}

/// True if an error is outside the window.
fn is_outside(error: i64, values: &LoopValues) -> bool {
    error.saturating_abs() > values.window_nm.into()
}

/// Returns the ticks in a row after one more that counts, or does not; at most `most`.
fn counted(ticks: u16, counts: bool, most: u16) -> u16 {
    if counts {
        ticks.saturating_add(1).min(most)
    } else {
        0
    }
}

/// Cuts to the range of `i32`.
fn saturated(value: i64) -> i32 {
    i32::try_from(value).unwrap_or(if value < 0 { i32::MIN } else { i32::MAX })
}
