//! Replay: runs recorded inputs again from the session before them and compares every output with
//! the recorded one (T11).

use super::{Entry, Output, Session};

/// Result of a replay.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Replayed<const N: usize> {
    /// Number of ticks, from the oldest on, whose outputs agree bit for bit.
    pub agreeing: usize,
    /// Replayed output of the first tick that differs; `None` when all agree.
    pub differing: Option<Output<N>>,
}

/// Runs `entries`, oldest first, from the session `before` the oldest, up to the first tick whose
/// output differs. Later ticks are not compared: they follow from another state than the recorded
/// one.
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
