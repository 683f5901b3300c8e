//! Clock of a campaign.

use crate::experiment::windows::TICK_S;

/// Time since the campaign began: it goes on where the table ended, and stands while the session is
/// lost.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    base_s: f64,
    origin: Option<u64>,
    pub(super) now_s: f64,
}

impl Clock {
    pub(super) const fn from(base_s: f64) -> Self {
        Self {
            base_s,
            origin: None,
            now_s: base_s,
        }
    }

    pub(super) fn at(&mut self, tick: u64) -> f64 {
        let origin = *self.origin.get_or_insert(tick);
        self.now_s = self.base_s + tick.saturating_sub(origin) as f64 * TICK_S;
        self.now_s
    }

    pub(super) const fn pause(&mut self) {
        self.base_s = self.now_s;
        self.origin = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clock_stands_while_the_session_is_lost() {
        let mut clock = Clock::from(100.0);
        clock.at(5_000);
        assert!((clock.at(6_500) - 101.5).abs() < 1e-9);
        clock.pause();
        // Another server counts from elsewhere.
        clock.at(3);
        assert!((clock.at(1_003) - 102.5).abs() < 1e-9);
    }
}
