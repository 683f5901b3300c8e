//! Position loops of all axes. They run and stop together: some of them moved and some not could be a pose that the machine does not have.

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
}

/// Loops as read from a file, before [`PositionLoops::is_valid`] has judged them.
#[cfg(feature = "serde")]
#[derive(serde::Deserialize)]
struct Unchecked<const N: usize> {
    #[serde(with = "crate::serde_array")]
    config: [LoopConfig; N],
    #[serde(with = "crate::serde_array")]
    axes: [PositionLoop; N],
}

#[cfg(feature = "serde")]
impl<const N: usize> TryFrom<Unchecked<N>> for PositionLoops<N> {
    type Error = &'static str;

    fn try_from(Unchecked { config, axes }: Unchecked<N>) -> Result<Self, Self::Error> {
        Self::from_parts(config, axes).ok_or("the state of the position loops contradicts their configuration")
    }
}

impl<const N: usize> PositionLoops<N> {
    /// Creates loops at rest at these references. They wait for [`super::Permit::Rearm`].
    #[must_use]
    pub fn at_rest(config: [LoopConfig; N], references: [PositionNm; N]) -> Self {
        Self { config, axes: references.map(PositionLoop::at_rest) }
    }

    /// Builds loops from their parts, if they satisfy the invariant.
    #[must_use]
    pub fn from_parts(config: [LoopConfig; N], axes: [PositionLoop; N]) -> Option<Self> {
        let loops = Self { config, axes };
        loops.is_valid().then_some(loops)
    }

    /// The invariant, clause by clause: every loop is valid; all of them run, or none.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let all_valid = zip(&self.axes, &self.config).all(|(axis, config)| axis.is_valid(config));
        all_valid && (self.is_running() || each(&self.axes).all(|axis| axis.stop().is_some()))
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

    /// Returns the index of the first axis that has stopped by itself, and the reason; `None` while the axes run.
    #[must_use]
    pub fn stop(&self) -> Option<(usize, LoopStop)> {
        let stops = || each(&self.axes).map(PositionLoop::stop).enumerate();
        let mut all = stops().filter_map(|(index, stop)| Some((index, stop?)));
        all.find(|(_, stop)| *stop != LoopStop::OtherAxis)
    }

    /// Runs one tick of all axes.
    pub fn tick(&mut self, inputs: &[LoopInput; N]) -> [VelocityReference; N] {
        let Self { config, axes } = self;
        let ready = (0..N).all(|index| match (axes.get(index), config.get(index), inputs.get(index)) {
            (Some(axis), Some(config), Some(input)) => axis.is_ready(config, input),
            _ => false,
        });
        let mut errors = [0_i32; N];
        for (axis, ((config, input), error)) in axes.iter_mut().zip(config.iter().zip(inputs).zip(&mut errors)) {
            if ready {
                axis.restart(input.reference.position);
            }
            *error = axis.observe(config, input);
        }
        if each(axes).any(|axis| axis.stop().is_some()) {
            axes.iter_mut().for_each(PositionLoop::stop_with_others);
        }
        let mut references = [VelocityReference::default(); N];
        let inputs = inputs.iter().zip(&errors);
        for ((reference, axis), (config, (input, error))) in
            references.iter_mut().zip(axes).zip(config.iter().zip(inputs))
        {
            *reference = axis.act(config, input, *error);
        }
        references
    }
}
