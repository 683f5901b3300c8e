//! Log lines for the rows of a server, written outside its cycle, once per event.

mod losses;
mod strangers;

use gantry_tau_core::control::message::{Cause, Counters, Phase};

use super::cycle::Row;
use crate::plant::{DriveState, PlantError};
pub use losses::Losses;
use strangers::Strangers;

/// Kind of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EventKind {
    /// A session was granted.
    Granted,
    /// Hellos were refused; the code is that of the phase.
    Refused,
    /// A session ended, or a stop came without one; the code is that of the cause.
    Ended,
    /// The phase changed; the code is that of the new one.
    Phase,
    /// The machine did not answer.
    MachineFailed,
    /// A recording, or what publishes, has lost its first row.
    RowsLost,
}

impl EventKind {
    const ALL: [Self; 6] =
        [Self::Granted, Self::Refused, Self::Ended, Self::Phase, Self::MachineFailed, Self::RowsLost];

    /// Code in the sample `session_event`.
    #[must_use]
    pub const fn code(self) -> u8 {
        match self {
            Self::Granted => 0,
            Self::Refused => 1,
            Self::Ended => 2,
            Self::Phase => 3,
            Self::MachineFailed => 4,
            Self::RowsLost => 5,
        }
    }

    /// Name for tables and schemas.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Granted => "granted",
            Self::Refused => "refused",
            Self::Ended => "ended",
            Self::Phase => "phase changed",
            Self::MachineFailed => "machine failed",
            Self::RowsLost => "rows lost",
        }
    }

    /// Kind of a code.
    #[must_use]
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.code() == code)
    }
}

/// Something that happened to a session or to the machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Event {
    /// Tick in which it happened.
    pub tick: u64,
    /// Kind.
    pub kind: EventKind,
    /// Code of the wire for the phase or cause; 0 for kinds without one.
    pub code: u8,
    /// The same in words.
    pub text: String,
}

/// Describes a failure of the machine: its reason, and the axes whose drives do not follow.
fn failure<const N: usize>(row: &Row<N>) -> String {
    let mut text = row.failure.map_or_else(|| "the machine did not answer".to_owned(), |error| error.to_string());
    for (axis, state) in (1..).zip(row.drives.iter().flatten()) {
        if *state > DriveState::Ready {
            text.push_str(&format!("; axis {axis}: {}", state.name().replace('_', " ")));
        }
    }
    text + "; stopped"
}

/// Ticks for which a change of the stop latch may be on its way to the file; a busy disk, or a processor without real-time priority, needs some.
const LATCH_TICKS: u64 = 100;

/// The last change of the stop latch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Latch {
    Written,
    /// Not written since this tick.
    Waits(u64),
    /// The same, and that is told.
    Told,
}

/// Logs phase changes, ends of sessions and the first of each kind of trouble; of a failing machine, each reason once until a re-arm.
/// Lines about clients that are refused, or gone before their first command, are throttled; the events that it returns are complete.
#[derive(Debug)]
pub struct EventLog {
    phase: Phase,
    counters: Counters,
    plant_failed: bool,
    /// Failures of the machine that were logged since the last re-arm, and the number of those that came again.
    failures: Vec<Option<PlantError>>,
    failed_again: u64,
    latch: Latch,
    strangers: Strangers,
    /// The last session had a command, or was stopped; before the first one, the ramp of an earlier server.
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
            has_acted: true,
            grant: None,
        }
    }
}

impl EventLog {
    /// Logs what has changed since the previous row. Returns what happened to sessions and to the machine.
    pub fn see<const N: usize>(&mut self, row: &Row<N>) -> Vec<Event> {
        let state = &row.state;
        let tick = state.tick.0;
        let mut events = Vec::new();
        let mut happened = |kind, code, text: String| events.push(Event { tick, kind, code, text });
        if row.welcomed {
            happened(EventKind::Granted, 0, format!("session granted (epoch {})", state.epoch.0));
            self.counters = Counters::default();
            self.grant = None;
        }
        let (refused, before, now) = (row.refused, self.phase.name(), state.phase.name());
        if refused > 0 {
            happened(EventKind::Refused, state.phase.code(), format!("{refused} client(s) refused in {now}"));
        }
        if let Some(cause) = row.ended {
            happened(EventKind::Ended, cause.code(), self.end(row, cause));
        }
        if state.phase != self.phase {
            happened(EventKind::Phase, state.phase.code(), format!("{before} -> {now}"));
        }
        // A machine that fails now and then does so for one reason: it is told once, until a re-arm.
        let mut failed_again = 0;
        if self.phase == Phase::Fault && state.phase != Phase::Fault {
            self.failures.clear();
            failed_again = std::mem::take(&mut self.failed_again);
        }
        if row.plant_failed && !self.plant_failed {
            if self.failures.contains(&row.failure) {
                self.failed_again = self.failed_again.saturating_add(1);
            } else {
                self.failures.push(row.failure);
                happened(EventKind::MachineFailed, 0, failure(row));
            }
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
                self.strangers.add_refused(refused);
            } else if event.kind == EventKind::Granted {
                self.strangers.add_session();
                self.grant = Some(event.text.clone());
            }
        }
        if let Some(summary) = self.strangers.summary(tick) {
            tracing::info!("tick {tick}: {summary}");
        }
        if failed_again > 0 {
            tracing::info!("tick {tick}: the machine failed {failed_again} more times until the re-arm");
        }
        self.phase = state.phase;
        self.plant_failed = row.plant_failed;
        self.log_latch(tick, row.latch_lost);
        self.log_counters(tick, &state.counters);
        events
    }

    /// True if a peer without any right can cause this event.
    fn is_of_a_stranger(&self, event: &Event, ended: Option<Cause>) -> bool {
        match event.kind {
            EventKind::Refused | EventKind::Granted => true,
            EventKind::Ended => !self.has_acted && !matches!(ended, Some(Cause::Stop | Cause::Nominal)),
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
                Latch::Told
            }
            (Latch::Told, false) => {
                tracing::info!("tick {tick}: the stop latch is written again");
                Latch::Written
            }
            (_, false) => Latch::Written,
            (latch, true) => latch,
        };
    }

    /// Logs a machine that failed as an error, and an end that nobody asked for as a warning.
    fn log(&self, event: &Event, ended: Option<Cause>) {
        let Event { tick, kind, text, .. } = event;
        let is_asked_for =
            !self.has_session() || matches!(ended, Some(Cause::Goodbye | Cause::Stop)) || *kind != EventKind::Ended;
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
    fn end<const N: usize>(&self, row: &Row<N>, cause: Cause) -> String {
        let (epoch, counts, left) = (row.state.epoch.0, row.state.counters, row.state.ramp_ticks_left);
        // A quit is the stop that latches nothing.
        let is_quit = cause == Cause::Stop && !row.latched;
        let cause = if is_quit { "the server was told to end".to_owned() } else { cause.to_string() };
        if !self.has_session() {
            return format!("{cause}; {left} ticks of ramp left");
        }
        format!(
            "session ended (epoch {epoch}): {cause}; {left} ticks of ramp left; \
             {} received, {} missed, {} late, {} duplicate, {} stale, {} malformed",
            counts.received, counts.missed, counts.late, counts.duplicate, counts.stale, counts.malformed
        )
    }

    /// Explains a counter when it leaves zero: once per session.
    fn log_counters(&mut self, tick: u64, now: &Counters) {
        type Of = fn(&Counters) -> u32;
        let texts: [(Of, _); 8] = [
            (|c| c.missed, "no fresh valid command before a deadline (or the server skipped it)"),
            (|c| c.late, "a command came late"),
            (|c| c.duplicate, "a command came twice"),
            (|c| c.stale, "a frame of another epoch, sequence or tick"),
            (|c| c.malformed, "a frame with bad content, or not allowed in this phase"),
            (|c| c.out_of_range, "a target beyond its limit"),
            (|c| c.clamped, "a reference was clamped to the travel"),
            (|c| c.non_owner, "frames from a connection that does not own the session"),
        ];
        for (of, text) in texts {
            if of(&self.counters) == 0 && of(now) > 0 && (self.has_acted || self.strangers.admit(tick)) {
                tracing::info!("tick {tick}: {text}; further ones of this session are only counted");
            }
        }
        self.counters = *now;
    }
}

#[cfg(test)]
mod tests;
