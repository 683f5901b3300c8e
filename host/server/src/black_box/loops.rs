//! Black boxes of the position loops: what the server's own loops were given and what they gave,
//! beside the session's box.

use gantry_tau_core::control::position_loop::{LoopInput, PositionLoops, VelocityReference};
use gantry_tau_core::control::session::recorder::Recorder;

use super::HALF;

/// Input of one tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LoopsInput<const N: usize> {
    /// The drives took the references of the tick before.
    pub accepted: bool,
    /// Inputs of the axes.
    pub axes: [LoopInput; N],
}

/// Recorder of the loops; it takes the ticks of the session's.
pub type LoopsBox<const N: usize> =
    Recorder<PositionLoops<N>, LoopsInput<N>, [VelocityReference; N], HALF>;

/// Consecutive ticks of the loops, and the loops before them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LoopsWindow<const N: usize> {
    /// Loops before the oldest tick.
    pub before: PositionLoops<N>,
    /// Ticks, oldest first.
    pub ticks: Vec<LoopsTick<N>>,
}

/// One recorded tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LoopsTick<const N: usize> {
    /// Its input.
    pub input: LoopsInput<N>,
    /// Its output.
    pub output: [VelocityReference; N],
}

impl<const N: usize> LoopsWindow<N> {
    /// Copies the content of a recorder; `None` if it is empty.
    #[must_use]
    pub fn of(recorder: &LoopsBox<N>) -> Option<Self> {
        let before = *recorder.before()?;
        let ticks = recorder.entries().map(|entry| LoopsTick {
            input: entry.input,
            output: entry.output,
        });
        Some(Self {
            before,
            ticks: ticks.collect(),
        })
    }

    /// Runs the ticks again. Returns the number of those, from the oldest on, whose outputs agree
    /// bit for bit, and the output of the first that differs.
    #[must_use]
    pub fn replay(&self) -> (usize, Option<[VelocityReference; N]>) {
        let mut loops = self.before;
        for (agreeing, tick) in self.ticks.iter().enumerate() {
            let output = loops.tick(&tick.input.axes, tick.input.accepted);
            if output != tick.output {
                return (agreeing, Some(output));
            }
        }
        (self.ticks.len(), None)
    }
}
