//! The first rows that are lost on their way out of the cycle.

use super::{Event, EventKind};

/// Watch over rows that are lost: told once in the log, and once as an event.
#[derive(Debug, Default)]
pub struct Losses {
    is_behind: bool,
    is_told: bool,
}

impl Losses {
    /// Takes what is known in a tick: whoever takes rows from the cycle is behind, the recording loses rows (which it has logged).
    pub fn see(&mut self, tick: u64, is_behind: bool, recording: bool) -> Option<Event> {
        if is_behind && !self.is_behind {
            tracing::warn!("rows are lost: what publishes and records them does not keep up");
        }
        self.is_behind = is_behind;
        let is_first = (is_behind || recording) && !self.is_told;
        self.is_told |= is_first;
        let text = if is_behind { "rows are lost: they are not taken in time" } else { "the recording loses rows" };
        is_first.then(|| Event { tick, kind: EventKind::RowsLost, code: 0, text: text.to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_lost_row_is_told_once() {
        let told = |sees: &[[bool; 2]]| -> Vec<String> {
            let mut losses = Losses::default();
            let mut tick = 0..;
            sees.iter()
                .filter_map(|[behind, file]| losses.see(tick.next()?, *behind, *file))
                .map(|e| format!("{} {}", e.tick, e.text))
                .collect()
        };
        assert_eq!(told(&[[false, false]; 3]), Vec::<String>::new());
        assert_eq!(told(&[[false, false], [false, true], [true, true], [true, true]]), ["1 the recording loses rows"]);
        assert_eq!(told(&[[true, false], [true, true]]), ["0 rows are lost: they are not taken in time"]);
    }
}
