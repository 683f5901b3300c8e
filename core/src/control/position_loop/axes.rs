//! Position loops of all axes. They run and stop together: some of them moved and some not could be
//! a pose that the machine does not have.

use super::config::LoopConfig;
use super::{LoopInput, LoopStop, PositionLoop, VelocityReference};
use crate::units::PositionNm;
use crate::zip::{each, zip};

/// Position loops of `N` axes, and their configurations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(try_from = "Unchecked<N>"))]
pub struct PositionLoops<const N: usize> {
    #[cfg_attr(feature = "serde", serde(with = "crate::serde_array"))]
    config: [LoopConfig; N],
    #[cfg_attr(feature = "serde", serde(with = "crate::serde_array"))]
    axes: [PositionLoop; N],
    /// The loops before the last tick, whose references are in force if the drives did not take
    /// those of the last.
    #[cfg_attr(feature = "serde", serde(with = "crate::serde_array"))]
    before: [PositionLoop; N],
}

/// Loops as read from a file, before [`PositionLoops::is_valid`] has judged them.
#[cfg(feature = "serde")]
#[derive(serde::Deserialize)]
struct Unchecked<const N: usize> {
    #[serde(with = "crate::serde_array")]
    config: [LoopConfig; N],
    #[serde(with = "crate::serde_array")]
    axes: [PositionLoop; N],
    #[serde(with = "crate::serde_array")]
    before: [PositionLoop; N],
}

#[cfg(feature = "serde")]
impl<const N: usize> TryFrom<Unchecked<N>> for PositionLoops<N> {
    type Error = &'static str;

    fn try_from(
        Unchecked {
            config,
            axes,
            before,
        }: Unchecked<N>,
    ) -> Result<Self, Self::Error> {
        Self::from_parts(config, axes, before)
            .ok_or("the state of the position loops contradicts their configuration")
    }
}

impl<const N: usize> PositionLoops<N> {
    /// Creates loops at rest at these references. They wait for [`super::Enable::Rearm`].
    #[must_use]
    pub fn at_rest(config: [LoopConfig; N], references: [PositionNm; N]) -> Self {
        let axes = references.map(PositionLoop::at_rest);
        Self {
            config,
            axes,
            before: axes,
        }
    }

    /// Builds loops from their parts, those now and those before the last tick, if they satisfy the
    /// invariant.
    #[must_use]
    pub fn from_parts(
        config: [LoopConfig; N],
        axes: [PositionLoop; N],
        before: [PositionLoop; N],
    ) -> Option<Self> {
        let loops = Self {
            config,
            axes,
            before,
        };
        loops.is_valid().then_some(loops)
    }

    /// The invariant, clause by clause: every loop is valid, now and before the last tick; all of
    /// them run, or none.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        are_valid(&self.axes, &self.config)
            && are_valid(&self.before, &self.config)
            && (self.is_running() || each(&self.axes).all(|axis| axis.stop().is_some()))
    }

    /// Returns the loops.
    #[must_use]
    pub const fn axes(&self) -> &[PositionLoop; N] {
        &self.axes
    }

    /// True if the axes follow their references.
    #[must_use]
    pub fn is_running(&self) -> bool {
        each(&self.axes).all(|axis| axis.stop().is_none())
    }

    /// True if every velocity reference is zero.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        each(&self.axes).all(PositionLoop::is_at_rest)
    }

    /// Returns the index of the first axis that has stopped by itself, and the reason; `None` while
    /// the axes run.
    #[must_use]
    pub fn stop(&self) -> Option<(usize, LoopStop)> {
        let stops = each(&self.axes).map(PositionLoop::stop).enumerate();
        stops
            .filter_map(|(index, stop)| Some((index, stop?)))
            .find(|(_, stop)| *stop != LoopStop::OtherAxis)
    }

    /// Runs one tick of all axes.
    ///
    /// `accepted`: the drives took the references of the last tick. If they did not, the loops go
    /// on from those before, and stop: so what is in force at a drive makes no step, even if a
    /// write is refused.
    pub fn tick(&mut self, inputs: &[LoopInput; N], accepted: bool) -> [VelocityReference; N] {
        let Self {
            config,
            axes,
            before,
        } = self;
        if !accepted {
            *axes = *before;
            stop_all(axes, LoopStop::Refused);
        }
        *before = *axes;
        let ready = accepted
            && (0..N).all(
                |index| match (axes.get(index), config.get(index), inputs.get(index)) {
                    (Some(axis), Some(config), Some(input)) => axis.is_ready(config, input),
                    _ => false,
                },
            );
        // Counted, as in `crate::zip`.
        let mut errors = [0_i64; N];
        for index in 0..N {
            if let (Some(axis), Some(config), Some(input), Some(error)) = (
                axes.get_mut(index),
                config.get(index),
                inputs.get(index),
                errors.get_mut(index),
            ) {
                axis.keep(input.reference.position);
                if ready {
                    axis.restart(input.reference.position);
                }
                *error = axis.observe(config, input);
            }
        }
        if each(axes).any(|axis| axis.stop().is_some()) {
            stop_all(axes, LoopStop::OtherAxis);
        }
        let mut references = [VelocityReference::default(); N];
        for index in 0..N {
            if let (Some(axis), Some(config), Some(input), Some(error), Some(reference)) = (
                axes.get_mut(index),
                config.get(index),
                inputs.get(index),
                errors.get(index),
                references.get_mut(index),
            ) {
                *reference = axis.act(config, input, *error);
            }
        }
        references
    }
}

/// True if each loop is valid under its configuration.
fn are_valid<const N: usize>(axes: &[PositionLoop; N], config: &[LoopConfig; N]) -> bool {
    zip(axes, config).all(|(axis, config)| axis.is_valid(config))
}

/// Stops the loops that run.
fn stop_all<const N: usize>(axes: &mut [PositionLoop; N], stop: LoopStop) {
    for index in 0..N {
        if let Some(axis) = axes.get_mut(index) {
            axis.stop_with(stop);
        }
    }
}
