//! The first rows that are lost on their way out of the cycle.

use crate::record::{Event, EventKind};

/// Watch over rows that are lost: logged once, and returned once as an event.
#[derive(Debug, Default)]
pub struct Losses {
    is_behind: bool,
    is_reported: bool,
}

impl Losses {
    /// Takes what is known in a tick: whoever takes rows from the cycle is behind, the recording
    /// loses rows (which it has logged).
    pub fn see(&mut self, tick: u64, is_behind: bool, recording: bool) -> Option<Event> {
        if is_behind && !self.is_behind {
            tracing::warn!("rows are lost: what publishes and records them does not keep up");
        }
        self.is_behind = is_behind;
        let is_first = (is_behind || recording) && !self.is_reported;
        self.is_reported |= is_first;
        let text = if is_behind {
            "rows are lost: they are not taken in time"
        } else {
            "the recording loses rows"
        };
        is_first.then(|| Event::new(tick, EventKind::RowsLost, 0, text.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Events of the ticks that see this of the rows that are behind, and of the file.
    fn reported(sees: &[[bool; 2]]) -> Vec<String> {
        let mut losses = Losses::default();
        (0..)
            .zip(sees)
            .filter_map(|(tick, [behind, file])| losses.see(tick, *behind, *file))
            .map(|event| format!("{} {}", event.tick, event.text))
            .collect()
    }

    #[test]
    fn the_first_lost_row_is_reported_once() {
        assert_eq!(reported(&[[false, false]; 3]), Vec::<String>::new());
        assert_eq!(
            reported(&[[false, false], [false, true], [true, true], [true, true]]),
            ["1 the recording loses rows"]
        );
        assert_eq!(
            reported(&[[true, false], [true, true]]),
            ["0 rows are lost: they are not taken in time"]
        );
    }
}
