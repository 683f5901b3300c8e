//! Replay: recorded inputs run again from the session before them, every output compared with the recorded one (T11).

use super::{Entry, Output, Session};

/// What a replay found.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Replayed<const N: usize> {
    /// Ticks, from the oldest on, whose outputs agree bit for bit.
    pub agreeing: usize,
    /// What the first tick that does not agree gave this time; `None` when all agree.
    pub differing: Option<Output<N>>,
}

/// Runs `entries`, oldest first, from the session `before` the oldest, up to the first tick that gives something else.
/// What comes after that tick is not compared: it follows from another state than the recorded one.
#[must_use]
pub fn replay<'a, const N: usize>(
    before: &Session<N>,
    entries: impl IntoIterator<Item = &'a Entry<N>>,
) -> Replayed<N> {
    let mut session = *before;
    let mut agreeing: usize = 0;
    for entry in entries {
        let output = session.tick(&entry.input);
        if output != entry.output {
            return Replayed {
                agreeing,
                differing: Some(output),
            };
        }
        agreeing = agreeing.saturating_add(1);
    }
    Replayed {
        agreeing,
        differing: None,
    }
}
