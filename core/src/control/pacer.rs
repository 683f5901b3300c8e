//! Targets for a server at 1 kHz, of a program that is slower: its targets have times, and are
//! played a fixed latency later.
//!
//! A slow program says which offsets it wants at which tick, in any order and at any rate.
//! [`Pacer::tick`] is asked once per State, and gives one target per axis: on the straight line
//! between the two that the program wants before and after that time, `latency_ticks` later. A
//! latency of two periods of the program is enough for one that is late by as much as a period.
//!
//! ```text
//! wanted        x---------x---------x---------x
//! now                                |
//! played            x---------x------'            latency_ticks later
//! ```
//!
//! For any targets and times (T32):
//!
//! - what is asked for is what a channel with the server's limits reaches in that tick: a server
//!   that has taken all before limits nothing;
//! - a program that is silent for more than `give_up_ticks` is given up in that tick. Before that,
//!   from `hold_ticks` on, the targets stay where they are.
//!
//! A server that missed a command holds, and is behind what was asked for. [`Pacer::restart`] begins
//! again at the offsets in force; so it does when the mode changes.
//!
//! ```
//! use gantry_tau_core::control::pacer::{Paced, Pacer, Settings, Target};
//! use gantry_tau_core::{LimitValues, Limits, OffsetNm, Tick};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let limits = Limits::new(LimitValues { max: 2_000_000, step: 5_000, accel: 10_000, ramp: 100 })?;
//! let settings = Settings { latency_ticks: 60, hold_ticks: 200, give_up_ticks: 1_000, horizon_ticks: 10_000 };
//! let mut pacer = Pacer::<1>::new([limits], settings, Tick(0))?;
//! pacer.push(Target { at: Tick(10), offsets: [OffsetNm(0)] })?;
//! pacer.push(Target { at: Tick(40), offsets: [OffsetNm(3_000)] })?;
//! for now in 1..=85 {
//!     let Paced::Targets([offset]) = pacer.tick(Tick(now)) else { panic!("given up") };
//!     if now == 85 {
//!         assert_eq!(offset, OffsetNm(1_500)); // half way, 60 ticks later
//!     }
//! }
//! # Ok(())
//! # }
//! ```

mod error;
mod schedule;
#[cfg(test)]
mod tests;

use crate::control::channel::{Channel, Limits};
use crate::units::{OffsetNm, Tick};

pub use error::{SettingsError, TargetError};
use schedule::Schedule;

/// Targets that wait for their time: a second of a program at 30 Hz.
pub const MAX_WAITING: usize = 32;

/// Offsets that a program wants at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Target<const N: usize> {
    /// The server's tick at which they are wanted.
    pub at: Tick,
    /// Position offsets, axis order.
    pub offsets: [OffsetNm; N],
}

/// Times of a pacer, in ticks of the server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Settings {
    /// Ticks between the time of a target and the tick in which it is asked for; at most
    /// [`Settings::MAX_TICKS`].
    pub latency_ticks: u32,
    /// Ticks without a new target after which the targets stay where they are.
    pub hold_ticks: u32,
    /// Ticks without a new target after which the program is given up; at least `hold_ticks`, at
    /// most [`Settings::MAX_TICKS`].
    pub give_up_ticks: u32,
    /// Ticks by which a target may lie in the future; 1 to [`Settings::MAX_TICKS`].
    pub horizon_ticks: u32,
}

impl Settings {
    /// Most ticks of each time: a hundred seconds at 1 kHz.
    pub const MAX_TICKS: u32 = 100_000;

    /// # Errors
    /// The first time that is refused.
    const fn check(&self) -> Result<(), SettingsError> {
        if self.latency_ticks > Self::MAX_TICKS {
            Err(SettingsError::Latency(self.latency_ticks))
        } else if self.give_up_ticks > Self::MAX_TICKS || self.give_up_ticks < self.hold_ticks {
            Err(SettingsError::GiveUp {
                give_up_ticks: self.give_up_ticks,
                hold_ticks: self.hold_ticks,
            })
        } else if self.horizon_ticks == 0 || self.horizon_ticks > Self::MAX_TICKS {
            Err(SettingsError::Horizon(self.horizon_ticks))
        } else {
            Ok(())
        }
    }
}

/// Request of a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Paced<const N: usize> {
    /// Position targets of the next Command, axis order.
    Targets([OffsetNm; N]),
    /// The program is silent: the session is to be ended, with a Goodbye.
    GiveUp,
}

/// Axis of a pacer: the server's limits, and the channel of a server that has taken all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PacedAxis {
    /// Limits of the position channel, as the Welcome states them.
    pub limits: Limits<OffsetNm>,
    /// The channel.
    pub channel: Channel<OffsetNm>,
}

/// Targets of a slow program, as one target per tick. `WAITING` targets wait for their time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pacer<const N: usize, const WAITING: usize = MAX_WAITING> {
    settings: Settings,
    axes: [PacedAxis; N],
    schedule: Schedule<N, WAITING>,
    /// Last tick that was asked for.
    now: Tick,
    /// Ticks since the last target.
    silent: u32,
}

impl<const N: usize, const WAITING: usize> Pacer<N, WAITING> {
    /// Creates a pacer at rest at zero; silence counts from `now` on.
    ///
    /// # Errors
    /// [`SettingsError`]: the first time that is refused.
    pub fn new(
        limits: [Limits<OffsetNm>; N],
        settings: Settings,
        now: Tick,
    ) -> Result<Self, SettingsError> {
        settings.check()?;
        Ok(Self {
            settings,
            axes: limits.map(|limits| PacedAxis {
                limits,
                channel: Channel::ZERO,
            }),
            schedule: Schedule::at(now),
            now,
            silent: 0,
        })
    }

    /// Returns the settings.
    #[must_use]
    pub const fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Returns the axes.
    #[must_use]
    pub const fn axes(&self) -> &[PacedAxis; N] {
        &self.axes
    }

    /// Returns the number of ticks since the last target that was taken.
    #[must_use]
    pub const fn silent_ticks(&self) -> u32 {
        self.silent
    }

    /// Takes a target of the program. One of the same time is replaced.
    ///
    /// # Errors
    /// [`TargetError`]: nothing has changed, and the program stays as silent as it was.
    pub fn push(&mut self, target: Target<N>) -> Result<(), TargetError> {
        let played = self.played(self.now);
        let most = self
            .now
            .0
            .saturating_add(self.settings.horizon_ticks.into());
        if target.at <= played {
            return Err(TargetError::Late {
                ticks: played.0.saturating_sub(target.at.0),
            });
        }
        if target.at.0 > most {
            return Err(TargetError::Far {
                ticks: target.at.0.saturating_sub(most),
            });
        }
        self.schedule.insert(target)?;
        self.silent = 0;
        Ok(())
    }

    /// Returns what to ask for in answer to the State of this tick.
    pub fn tick(&mut self, now: Tick) -> Paced<N> {
        // A tick of before counts as well: silence grows with every call.
        let passed = u32::try_from(now.0.saturating_sub(self.now.0)).unwrap_or(u32::MAX);
        self.silent = self.silent.saturating_add(passed.max(1));
        self.now = now;
        if self.silent > self.settings.give_up_ticks {
            return Paced::GiveUp;
        }
        let played = self.played(now);
        if self.silent > self.settings.hold_ticks {
            self.schedule.rest(played, self.offsets());
        }
        let wanted = self.schedule.play(played);
        for (axis, wanted) in self.axes.iter_mut().zip(wanted) {
            axis.channel = axis.channel.follow(wanted, &axis.limits);
        }
        Paced::Targets(self.offsets())
    }

    /// Begins again from offsets in force, at rest, on a line to the next target that waits. An offset
    /// beyond its limit, which no server has, counts as zero.
    pub fn restart(&mut self, offsets: &[OffsetNm; N]) {
        for (axis, offset) in self.axes.iter_mut().zip(offsets) {
            axis.channel = Channel::from_parts(*offset, 0, &axis.limits).unwrap_or_default();
        }
        self.schedule.stand(self.played(self.now), self.offsets());
    }

    /// Time that is played in a tick.
    fn played(&self, now: Tick) -> Tick {
        Tick(now.0.saturating_sub(self.settings.latency_ticks.into()))
    }

    fn offsets(&self) -> [OffsetNm; N] {
        self.axes.map(|axis| axis.channel.value())
    }
}

#[cfg(kani)]
impl kani::Arbitrary for Settings {
    /// Any settings that are accepted. Nothing is assumed: refused ones become the shortest.
    fn any() -> Self {
        let settings = Self {
            latency_ticks: kani::any(),
            hold_ticks: kani::any(),
            give_up_ticks: kani::any(),
            horizon_ticks: kani::any(),
        };
        let shortest = Self {
            latency_ticks: 0,
            hold_ticks: 0,
            give_up_ticks: 0,
            horizon_ticks: 1,
        };
        settings.check().map_or(shortest, |()| settings)
    }
}

#[cfg(kani)]
impl<const N: usize, const WAITING: usize> kani::Arbitrary for Pacer<N, WAITING> {
    /// Any pacer with valid channels: any targets, in order or not. Nothing is assumed: a channel
    /// that is not valid becomes zero.
    fn any() -> Self {
        let axes = core::array::from_fn(|_| {
            let (limits, channel): (Limits<OffsetNm>, Channel<OffsetNm>) = kani::any();
            let is_valid = channel.is_valid(&limits);
            PacedAxis {
                limits,
                channel: if is_valid { channel } else { Channel::ZERO },
            }
        });
        Self {
            settings: kani::any(),
            axes,
            schedule: kani::any(),
            now: kani::any(),
            silent: kani::any(),
        }
    }
}
