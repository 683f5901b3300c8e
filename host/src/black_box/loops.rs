//! Black boxes of the position loops: what the server's own loops were given and what they gave, beside the session's box.
//!
//! | line | content |
//! |---|---|
//! | 1 | `{"format":"gantry-tau position loops","version":1,"axes":3,"ticks":129}` |
//! | 2 | `{"config":[...],"axes":[...],"before":[...]}`: the [`PositionLoops`] before the oldest tick |
//! | 3 on | `{"accepted":true,"input":[...],"output":[...]}`: one tick, oldest first; as many as line 1 announces, those of the session's box |
//!
//! Written as core's types are; see [`super`].

use gantry_tau_core::control::position_loop::{LoopInput, PositionLoops, VelocityReference};
use gantry_tau_core::control::session::recorder::Recorder;
use serde::{Deserialize, Serialize};

use super::json::{Label, Lines, head, json};
use super::{FileError, HALF};

/// Label of the files.
const LABEL: Label = Label { format: "gantry-tau position loops", version: 1, what: "a black box of position loops" };

/// Input of one tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LoopsInput<const N: usize> {
    /// The drives took the references of the tick before.
    pub accepted: bool,
    /// Inputs of the axes.
    pub axes: [LoopInput; N],
}

/// Recorder of the loops; it takes the ticks of the session's.
pub type LoopsBox<const N: usize> = Recorder<PositionLoops<N>, LoopsInput<N>, [VelocityReference; N], HALF>;

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

/// A tick as a line; serde reads arrays of a fixed length, not of a generic one.
#[derive(Serialize, Deserialize)]
struct Line {
    accepted: bool,
    input: Vec<LoopInput>,
    output: Vec<VelocityReference>,
}

impl<const N: usize> LoopsWindow<N> {
    /// Copies the content of a recorder; `None` if it is empty.
    #[must_use]
    pub fn of(recorder: &LoopsBox<N>) -> Option<Self> {
        let before = *recorder.before()?;
        let ticks = recorder.entries().map(|entry| LoopsTick { input: entry.input, output: entry.output });
        Some(Self { before, ticks: ticks.collect() })
    }

    /// Returns the text of a file with this window.
    #[must_use]
    pub fn encode(&self) -> String {
        let line = |tick: &LoopsTick<N>| {
            let (accepted, input) = (tick.input.accepted, tick.input.axes.to_vec());
            json(&Line { accepted, input, output: tick.output.to_vec() })
        };
        let mut lines = vec![head(&LABEL, N, self.ticks.len()), json(&self.before)];
        lines.extend(self.ticks.iter().map(line));
        lines.push(String::new());
        lines.join("\n")
    }

    /// Reads the window of a file; `name` stands for the file in errors.
    ///
    /// # Errors
    /// [`FileError`]: the first line that cannot be read.
    pub fn decode(name: &str, bytes: &[u8]) -> Result<Self, FileError> {
        let lines = Lines::of(name, bytes, &LABEL);
        let numbers = lines.ticks(N)?;
        let before = lines.read(2)?;
        let ticks = numbers.map(|number| {
            let Line { accepted, input, output } = lines.read(number)?;
            let counts = (input.len(), output.len());
            match (input.try_into(), output.try_into()) {
                (Ok(axes), Ok(output)) => Ok(LoopsTick { input: LoopsInput { accepted, axes }, output }),
                _ => {
                    Err(lines.refuse(number, format!("has {} inputs and {} outputs, expected {N}", counts.0, counts.1)))
                }
            }
        });
        Ok(Self { before, ticks: ticks.collect::<Result<_, _>>()? })
    }

    /// Runs the ticks again. Returns the number of those, from the oldest on, whose outputs agree bit for bit, and the output of the first
    /// that differs.
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

/// True if a file begins as one of position loops.
#[must_use]
pub fn is_of_loops(bytes: &[u8]) -> bool {
    Lines::of("", bytes, &LABEL).is_labelled()
}

/// Reads the number of axes that a file announces; `name` stands for the file in errors.
///
/// # Errors
/// [`FileError`] unless the file begins as a black box of position loops.
pub fn axes(name: &str, bytes: &[u8]) -> Result<usize, FileError> {
    Lines::of(name, bytes, &LABEL).axes()
}
