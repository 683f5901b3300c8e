//! News that are told once, and at most once in a second: a cable that flaps fills no log.

/// Cycles between two reports about the same.
const CYCLES_PER_REPORT: u32 = 1_000;

/// The last thing that was told about something.
#[derive(Debug)]
pub(super) struct Told<T> {
    last: Option<T>,
    cycles: u32,
}

impl<T> Default for Told<T> {
    fn default() -> Self {
        Self {
            last: None,
            cycles: CYCLES_PER_REPORT,
        }
    }
}

impl<T: Copy + PartialEq> Told<T> {
    /// Returns what is to be told in this cycle; `None` for what is as it was told last, what was told
    /// less than a second ago, and what a bus has not got.
    pub(super) fn news(&mut self, now: Option<T>) -> Option<T> {
        self.cycles = self.cycles.saturating_add(1);
        let news = now.filter(|now| self.last != Some(*now))?;
        if self.cycles < CYCLES_PER_REPORT {
            return None;
        }
        (self.last, self.cycles) = (Some(news), 0);
        Some(news)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_is_told_once_and_at_most_once_in_a_second() {
        let mut told = Told::default();
        assert_eq!(told.news(None), None);
        assert_eq!(told.news(Some(true)), Some(true));
        // It flaps: the state at the end of the second is told.
        let told_in_a_second = (0..999).filter(|cycle| told.news(Some(cycle % 2 == 0)).is_some());
        assert_eq!(told_in_a_second.count(), 0);
        assert_eq!(told.news(Some(true)), None, "as it was told");
        assert_eq!(told.news(Some(false)), Some(false));
        assert_eq!(told.news(Some(false)), None);
    }
}
