//! Black boxes of the position loops: what the server's own loops were given and what they gave,
//! beside the session's box.
//!
//! | line | content |
//! |---|---|
//! | 1 | `{"format":"gantry-tau position loops","version":1,"axes":3,"ticks":129}` |
//! | 2 | `{"config":[...],"axes":[...],"before":[...]}`: the `PositionLoops` before the oldest tick |
//! | 3 on | `{"accepted":true,"input":[...],"output":[...]}`: one tick, oldest first; as many as line 1 announces, those of the session's box |
//!
//! Written as core's types are; see [`super`].

use gantry_tau_core::control::position_loop::{LoopInput, VelocityReference};
pub use gantry_tau_server::black_box::loops::{LoopsInput, LoopsTick, LoopsWindow};
use serde::{Deserialize, Serialize};

use super::FileError;
use super::json::{Label, Lines, head, json};

/// Label of the files.
const LABEL: Label = Label {
    format: "gantry-tau position loops",
    version: 1,
    what: "a black box of position loops",
};

/// A tick as a line; serde reads arrays of a fixed length, not of a generic one.
#[derive(Serialize, Deserialize)]
struct Line {
    accepted: bool,
    input: Vec<LoopInput>,
    output: Vec<VelocityReference>,
}

/// Returns the text of a file with this window.
#[must_use]
pub fn encode<const N: usize>(window: &LoopsWindow<N>) -> String {
    let mut lines = vec![head(&LABEL, N, window.ticks.len()), json(&window.before)];
    for tick in &window.ticks {
        lines.push(json(&Line {
            accepted: tick.input.accepted,
            input: tick.input.axes.to_vec(),
            output: tick.output.to_vec(),
        }));
    }
    lines.push(String::new());
    lines.join("\n")
}

/// Reads the window of a file; `name` stands for the file in errors.
///
/// # Errors
/// [`FileError`]: the first line that cannot be read.
pub fn decode<const N: usize>(name: &str, bytes: &[u8]) -> Result<LoopsWindow<N>, FileError> {
    let lines = Lines::of(name, bytes, &LABEL);
    let numbers = lines.ticks(N)?;
    let before = lines.read(2)?;
    let ticks = numbers.map(|number| {
        let Line {
            accepted,
            input,
            output,
        } = lines.read(number)?;
        let counts = (input.len(), output.len());
        match (input.try_into(), output.try_into()) {
            (Ok(axes), Ok(output)) => Ok(LoopsTick {
                input: LoopsInput { accepted, axes },
                output,
            }),
            _ => Err(lines.refuse(
                number,
                format!(
                    "has {} inputs and {} outputs, expected {N}",
                    counts.0, counts.1
                ),
            )),
        }
    });
    Ok(LoopsWindow {
        before,
        ticks: ticks.collect::<Result<_, _>>()?,
    })
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
