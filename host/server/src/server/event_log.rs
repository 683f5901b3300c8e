//! Log lines for the rows of a server, written outside its cycle, once per event.

mod losses;
mod path;
mod strangers;

use gantry_tau_core::control::message::{Cause, Counters, Phase};

use crate::plant::{DriveState, PlantFailure};
use crate::record::TickRecord;
use crate::record::{Event, EventKind};
pub use losses::Losses;
use path::Path;
use strangers::Strangers;

/// Describes a failure of the machine: its reason, and the axes whose drives do not follow.
fn failure<const N: usize>(row: &TickRecord<N>) -> String {
    let mut text = row.failure.map_or_else(
        || "the machine did not answer".to_owned(),
        |error| error.to_string(),
    );
    for (axis, state) in (1..).zip(row.drives.iter().flatten()) {
        if *state > DriveState::Ready {
            text.push_str(&format!(
                "; axis {axis}: {}",
                state.name().replace('_', " ")
            ));
        }
    }
    text + "; stopped"
}

/// Ticks for which a change of the stop latch may be on its way to the file; a busy disk, or a
/// processor without real-time priority, needs some.
const LATCH_TICKS: u64 = 100;

/// The last change of the stop latch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Latch {
    Written,
    /// Not written since this tick.
    Waits(u64),
    /// The same, and that is logged.
    Logged,
}

/// Logs phase changes, ends of sessions and the first of each kind of trouble; of a failing
/// machine, each reason once until a re-arm. Lines about clients that are refused, or gone before
/// their first command, are throttled; the events that it returns are complete.
#[derive(Debug)]
pub struct EventLog {
    phase: Phase,
    counters: Counters,
    plant_failed: bool,
    /// Failures of the machine that were logged since the last re-arm, and the number of those that
    /// came again.
    failures: Vec<Option<PlantFailure>>,
    failed_again: u64,
    latch: Latch,
    strangers: Strangers,
    path: Path,
    /// The last session had a command, or was stopped; before the first one, the ramp of an earlier
    /// server.
    has_acted: bool,
    /// The grant of the session, if its line was left out.
    grant: Option<String>,
}

impl Default for EventLog {
    fn default() -> Self {
        Self {
            phase: Phase::Listening,
            counters: Counters::default(),
            plant_failed: false,
            failures: Vec::new(),
            failed_again: 0,
            latch: Latch::Written,
            strangers: Strangers::default(),
            path: Path::default(),
            has_acted: true,
            grant: None,
        }
    }
}

impl EventLog {
    /// Logs what has changed since the previous row. Returns what happened to sessions and to the
    /// machine.
    pub fn see<const N: usize>(&mut self, row: &TickRecord<N>) -> Vec<Event> {
        let state = &row.state;
        let tick = state.tick.0;
        if row.welcomed {
            self.counters = Counters::default();
            self.grant = None;
        }
        let mut events = self.session_events(row);
        let mut failed_again = 0;
        if self.phase == Phase::Fault && state.phase != Phase::Fault {
            self.failures.clear();
            failed_again = std::mem::take(&mut self.failed_again);
        }
        if row.plant_failed && !self.plant_failed {
            events.extend(self.failure(row));
        }
        self.has_acted = match state.phase {
            Phase::Submit | Phase::Obtain | Phase::Fault => true,
            _ => self.has_acted && !row.welcomed,
        };
        if let Some(grant) = self.grant.take_if(|_| self.has_acted) {
            tracing::info!("tick {tick}: {grant}");
        }
        for event in &events {
            if !self.is_of_a_stranger(event, row.ended) || self.strangers.admit(tick) {
                self.log(event, row.ended);
            } else if event.kind == EventKind::Refused {
                self.strangers.add_refused(row.refused);
            } else if event.kind == EventKind::Granted {
                self.strangers.add_session();
                self.grant = Some(event.text.clone());
            }
        }
        if row.ended == Some(Cause::Stop) && row.latched {
            tracing::info!(
                "tick {tick}: the stop is latched; type `rearm` when the machine may move"
            );
        }
        if let Some(summary) = self.strangers.summary(tick) {
            tracing::info!("tick {tick}: {summary}");
        }
        if failed_again > 0 {
            tracing::info!(
                "tick {tick}: the machine failed {failed_again} more times until the re-arm"
            );
        }
        self.phase = state.phase;
        self.plant_failed = row.plant_failed;
        self.log_latch(tick, row.latch_lost);
        self.log_counters(tick, &state.counters);
        self.path.see(row);
        events
    }

    /// Events of sessions since the previous row.
    fn session_events<const N: usize>(&self, row: &TickRecord<N>) -> Vec<Event> {
        let (tick, phase) = (row.state.tick.0, row.state.phase);
        let mut events = Vec::new();
        if row.welcomed {
            let mut text = format!("session granted (epoch {})", row.state.epoch.0);
            if let Some(key) = row.key {
                text.push_str(&format!(" to key {key}"));
            }
            events.push(Event::new(tick, EventKind::Granted, 0, text));
        }
        if row.refused > 0 {
            let text = format!("{} client(s) refused in {}", row.refused, phase.name());
            events.push(Event::new(tick, EventKind::Refused, phase.code(), text));
        }
        if let Some(cause) = row.ended {
            let text = self.end(row, cause);
            events.push(Event::new(tick, EventKind::Ended, cause.code(), text));
        }
        if phase != self.phase {
            let text = format!("{} -> {}", self.phase.name(), phase.name());
            events.push(Event::new(tick, EventKind::Phase, phase.code(), text));
        }
        events
    }

    /// The failure of the machine, if it is news: one that fails now and then does so for one
    /// reason, which is logged once until a re-arm.
    fn failure<const N: usize>(&mut self, row: &TickRecord<N>) -> Option<Event> {
        if self.failures.contains(&row.failure) {
            self.failed_again = self.failed_again.saturating_add(1);
            return None;
        }
        self.failures.push(row.failure);
        let tick = row.state.tick.0;
        Some(Event::new(tick, EventKind::MachineFailed, 0, failure(row)))
    }

    /// True if a peer without any right can cause this event.
    fn is_of_a_stranger(&self, event: &Event, ended: Option<Cause>) -> bool {
        match event.kind {
            EventKind::Refused | EventKind::Granted => true,
            EventKind::Ended => {
                !self.has_acted && !matches!(ended, Some(Cause::Stop | Cause::Nominal))
            }
            EventKind::Phase => !self.has_acted,
            EventKind::MachineFailed | EventKind::RowsLost => false,
        }
    }

    /// Logs a stop latch that is not written for some time, and that it is written again.
    fn log_latch(&mut self, tick: u64, is_lost: bool) {
        self.latch = match (self.latch, is_lost) {
            (Latch::Written, true) => Latch::Waits(tick),
            (Latch::Waits(since), true) if tick.saturating_sub(since) >= LATCH_TICKS => {
                tracing::error!(
                    "tick {tick}: the stop latch cannot be written: do not restart the server before a re-arm"
                );
                Latch::Logged
            }
            (Latch::Logged, false) => {
                tracing::info!("tick {tick}: the stop latch is written again");
                Latch::Written
            }
            (_, false) => Latch::Written,
            (latch, true) => latch,
        };
    }

    /// Logs a machine that failed as an error, and an end that was not asked for as a warning.
    fn log(&self, event: &Event, ended: Option<Cause>) {
        let Event {
            tick, kind, text, ..
        } = event;
        let is_asked_for = !self.has_session()
            || matches!(ended, Some(Cause::Goodbye | Cause::Stop))
            || *kind != EventKind::Ended;
        match kind {
            EventKind::MachineFailed => tracing::error!("tick {tick}: {text}"),
            _ if is_asked_for => tracing::info!("tick {tick}: {text}"),
            _ => tracing::warn!("tick {tick}: {text}"),
        }
    }

    /// True if the last row was one of a session.
    const fn has_session(&self) -> bool {
        !matches!(self.phase, Phase::Listening | Phase::SafeDisconnect)
    }

    /// Describes the end of a session, or of what goes on without one.
    fn end<const N: usize>(&self, row: &TickRecord<N>, cause: Cause) -> String {
        let (epoch, counts, left) = (
            row.state.epoch.0,
            row.state.counters,
            row.state.ramp_ticks_left,
        );
        // A quit is the stop that latches nothing.
        let is_quit = cause == Cause::Stop && !row.latched;
        let cause = if is_quit {
            "the server was asked to end".to_owned()
        } else {
            cause.to_string()
        };
        if !self.has_session() {
            return format!("{cause}; {left} ticks of ramp left");
        }
        format!(
            "session ended (epoch {epoch}): {cause}; {left} ticks of ramp left; \
             {} received, {} missed, {} late, {} duplicate, {} stale, {} malformed",
            counts.received,
            counts.missed,
            counts.late,
            counts.duplicate,
            counts.stale,
            counts.malformed
        )
    }

    /// Explains a counter when it leaves zero: once per session.
    fn log_counters(&mut self, tick: u64, now: &Counters) {
        type Of = fn(&Counters) -> u32;
        let texts: [(Of, _); 8] = [
            (
                |c| c.missed,
                "no fresh valid command before a deadline (or the server skipped it)",
            ),
            (|c| c.late, "a command came late"),
            (|c| c.duplicate, "a command came twice"),
            (|c| c.stale, "a frame of another epoch, sequence or tick"),
            (
                |c| c.malformed,
                "a frame with bad content, or not allowed in this phase",
            ),
            (|c| c.out_of_range, "a target beyond its limit"),
            (|c| c.clamped, "a reference was clamped to the travel"),
            (
                |c| c.non_owner,
                "frames from a connection that does not own the session",
            ),
        ];
        for (of, text) in texts {
            if of(&self.counters) == 0
                && of(now) > 0
                && (self.has_acted || self.strangers.admit(tick))
            {
                tracing::info!(
                    "tick {tick}: {text}; further ones of this session are only counted"
                );
            }
        }
        self.counters = *now;
    }
}

#[cfg(test)]
mod tests;
