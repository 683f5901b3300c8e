//! Throttle of lines about peers whose session never had a command: refused, or gone before the
//! first one.
//!
//! Anybody who reaches the port can cause them, several per tick. They are counted by ticks, so
//! that a server in lock-step writes the same.

/// Lines that may follow each other at once.
const BURST: u64 = 20;
/// Ticks per line, on average.
const TICKS_PER_LINE: u64 = 1_000;

/// Lines that were left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct LeftOut {
    lines: u64,
    refused: u64,
    sessions: u64,
}

/// Throttle of lines about strangers.
#[derive(Debug, Default)]
pub(super) struct Strangers {
    /// Tick at which as many lines as were written are due.
    due: u64,
    left_out: LeftOut,
}

impl Strangers {
    /// True if a line may be written in this tick; otherwise it is counted. The summary of earlier
    /// lines comes first.
    pub(super) fn admit(&mut self, tick: u64) -> bool {
        let is_admitted = self.left_out == LeftOut::default() && self.take_room(tick);
        self.left_out.lines += u64::from(!is_admitted);
        is_admitted
    }

    /// Counts refused clients whose line was left out.
    pub(super) fn add_refused(&mut self, count: u8) {
        self.left_out.refused += u64::from(count);
    }

    /// Counts a session whose grant was left out.
    pub(super) fn add_session(&mut self) {
        self.left_out.sessions += 1;
    }

    /// Returns a summary of what was left out, once there is room for it.
    pub(super) fn summary(&mut self, tick: u64) -> Option<String> {
        if self.left_out == LeftOut::default() || !self.take_room(tick) {
            return None;
        }
        let LeftOut {
            lines,
            refused,
            sessions,
        } = std::mem::take(&mut self.left_out);
        Some(format!(
            "{lines} more lines about strangers: {refused} clients refused, {sessions} sessions granted"
        ))
    }

    fn take_room(&mut self, tick: u64) -> bool {
        let due = self.due.max(tick);
        let is_admitted = due - tick < BURST * TICKS_PER_LINE;
        if is_admitted {
            self.due = due.saturating_add(TICKS_PER_LINE);
        }
        is_admitted
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Number of lines that a summary begins with.
    fn count(summary: &str) -> u64 {
        summary.split(' ').next().unwrap().parse().unwrap()
    }

    #[test]
    fn a_burst_and_then_one_line_in_a_thousand_ticks_with_every_other_counted() {
        let mut strangers = Strangers::default();
        let (mut singly, mut summaries, mut counted) = (0, 0, 0);
        for tick in 1..=100_000 {
            for _ in 0..5 {
                singly += u64::from(strangers.admit(tick));
            }
            if let Some(summary) = strangers.summary(tick) {
                summaries += 1;
                counted += count(&summary);
            }
        }
        // 20 at once; after three ticks the 21st is due.
        assert_eq!((singly, summaries), (21, 99));
        // The next summary has the rest.
        assert_eq!(
            singly + counted + count(&strangers.summary(200_000).unwrap()),
            500_000
        );
        assert_eq!(strangers.summary(300_000), None);
        assert!(strangers.admit(300_000));
    }
}
