//! Lines of the log, from rows that were made.

use gantry_tau_core::units::Epoch;
use gantry_tau_test_support::logged::logged;

use super::*;
use crate::plant::PlantError;

/// A log, and the rows that it saw.
struct Server {
    log: EventLog,
    row: TickRecord<1>,
    lines: String,
}

impl Server {
    fn new() -> Self {
        Self {
            log: EventLog::default(),
            row: TickRecord::listening(),
            lines: String::new(),
        }
    }

    /// Shows the log a tick, changed for this tick alone by `once`.
    fn tick(&mut self, once: impl FnOnce(&mut TickRecord<1>)) -> Vec<Event> {
        self.row.state.tick.0 += 1;
        let mut row = self.row;
        once(&mut row);
        let (events, lines) = logged(|| self.log.see(&row));
        self.lines += &lines;
        events
    }

    /// Takes the lines so far, without their levels' padding and targets.
    fn said(&mut self) -> Vec<String> {
        let text = std::mem::take(&mut self.lines);
        text.lines()
            .map(|line| {
                let (level, rest) = line.trim().split_once(' ').unwrap();
                format!("{level} {}", rest.rsplit_once(": tick ").unwrap().1)
            })
            .collect()
    }

    fn phase(&mut self, phase: Phase) {
        self.row.state.phase = phase;
        self.tick(|_| {});
    }
}

/// A machine that fails for this reason.
fn fails(reason: &'static str) -> impl FnOnce(&mut TickRecord<1>) {
    move |row| {
        row.plant_failed = true;
        row.failure = Some(PlantFailure::of(&PlantError {
            operation: "be read",
            reason,
        }));
    }
}

#[test]
fn a_failure_that_comes_again_is_logged_once_and_counted_until_the_rearm() {
    let mut server = Server::new();
    server.phase(Phase::Fault);
    server.said();
    for reason in [
        "the bus is lost",
        "the bus is lost",
        "a drive is in fault",
        "the bus is lost",
        "the bus is lost",
    ] {
        server.tick(fails(reason));
        // Over two ticks it is one failure.
        server.tick(fails(reason));
        server.tick(|_| {});
    }
    let said = server.said();
    assert_eq!(said.len(), 2, "{said:?}");
    assert!(
        said[0].starts_with("ERROR 2: ") && said[0].contains("the bus is lost"),
        "{said:?}"
    );
    assert!(
        said[1].starts_with("ERROR 8: ") && said[1].contains("a drive is in fault"),
        "{said:?}"
    );
    server.phase(Phase::Listening);
    let said = server.said();
    assert_eq!(
        said,
        [
            "INFO 17: Fault -> Listening",
            "INFO 17: the machine failed 3 more times until the re-arm"
        ]
    );
    // After it the same reason is news.
    server.phase(Phase::Fault);
    server.tick(fails("the bus is lost"));
    assert_eq!(server.said().len(), 2);
    server.tick(|_| {});
    server.phase(Phase::Listening);
    assert_eq!(server.said(), ["INFO 21: Fault -> Listening"]);
}

#[test]
fn a_latch_that_cannot_be_written_is_logged_once_each_time() {
    let mut server = Server::new();
    // A change that is on its way is not news.
    for (ticks, loses) in [
        (1, false),
        (100, true),
        (1, false),
        (150, true),
        (1, false),
        (101, true),
    ] {
        (0..ticks).for_each(|_| drop(server.tick(|row| row.latch_lost = loses)));
    }
    let ticks: Vec<String> = server
        .said()
        .iter()
        .map(|line| line.split(':').next().unwrap().to_owned())
        .collect();
    assert_eq!(ticks, ["ERROR 203", "INFO 253", "ERROR 354"]);
}

#[test]
fn a_quit_is_not_logged_as_a_stop() {
    for (latched, words) in [
        (true, "INFO 2: session ended (epoch 0): stopped;"),
        (false, "the server was asked to end;"),
    ] {
        let mut server = Server::new();
        server.phase(Phase::Obtain);
        server.said();
        server.tick(|row| (row.ended, row.latched) = (Some(Cause::Stop), latched));
        let said = server.said();
        assert!(said[0].contains(words), "{said:?}");
    }
}

#[test]
fn an_end_that_nobody_asked_for_is_a_warning() {
    for (cause, level) in [
        (Cause::Goodbye, "INFO"),
        (Cause::Stop, "INFO"),
        (Cause::Closed, "WARN"),
        (Cause::ClientLate, "WARN"),
        (Cause::Nominal, "WARN"),
    ] {
        let mut server = Server::new();
        for phase in [Phase::Handshake, Phase::Submit, Phase::Obtain] {
            server.phase(phase);
        }
        server.said();
        let events = server.tick(|row| (row.ended, row.latched) = (Some(cause), true));
        assert_eq!(
            (events.len(), events[0].kind, events[0].code),
            (1, EventKind::Ended, cause.code())
        );
        let said = server.said();
        assert!(
            said[0].starts_with(&format!("{level} 4: session ended (epoch 0): {cause}; ")),
            "{said:?}"
        );
    }
}

#[test]
fn each_counter_is_explained_once_in_a_session() {
    type Count = fn(&mut Counters) -> &mut u32;
    let counters: [(Count, &str); 8] = [
        (
            |c| &mut c.missed,
            "no fresh valid command before a deadline",
        ),
        (|c| &mut c.late, "a command came late"),
        (|c| &mut c.duplicate, "a command came twice"),
        (|c| &mut c.stale, "a frame of another epoch"),
        (|c| &mut c.malformed, "a frame with bad content"),
        (|c| &mut c.out_of_range, "a target beyond its limit"),
        (|c| &mut c.clamped, "a reference was clamped"),
        (
            |c| &mut c.non_owner,
            "frames from a connection that does not own",
        ),
    ];
    for (count, text) in counters {
        let mut server = Server::new();
        server.phase(Phase::Submit);
        for _ in 0..2 {
            server.said();
            for number in [0, 1, 2, 2, 3] {
                *count(&mut server.row.state.counters) = number;
                server.tick(|_| {});
            }
            let said = server.said();
            assert_eq!(said.len(), 1, "{said:?}");
            assert!(said[0].contains(text), "{said:?}");
            // Another session.
            server.row.state.counters = Counters::default();
            server.tick(|row| row.welcomed = true);
        }
    }
}

#[test]
fn a_session_that_acts_has_its_grant_in_the_log_whatever_strangers_do() {
    let mut server = Server::new();
    for _ in 0..100 {
        server.tick(|row| row.refused = 1);
    }
    server.row.state.epoch = Epoch(7);
    server.said();
    server.tick(|row| row.welcomed = true);
    server.phase(Phase::Handshake);
    assert!(server.said().is_empty());
    server.phase(Phase::Submit);
    let said = server.said();
    assert_eq!(said[0], "INFO 103: session granted (epoch 7)", "{said:?}");
}

#[test]
fn strangers_cannot_silence_the_machine_nor_a_stop() {
    let mut server = Server::new();
    for _ in 0..100 {
        server.tick(|row| row.refused = 1);
    }
    let refused = server.said();
    assert_eq!(refused.len(), 21, "{refused:?}");
    // No client of this server has caused the ramp of an earlier one.
    server.phase(Phase::SafeDisconnect);
    server.phase(Phase::Listening);
    assert_eq!(
        server.said(),
        [
            "INFO 101: Listening -> SafeDisconnect",
            "INFO 102: SafeDisconnect -> Listening"
        ]
    );
    // A session without a command is caused by a stranger.
    server.tick(|row| row.welcomed = true);
    server.phase(Phase::Handshake);
    assert!(server.said().is_empty());
    server.tick(|row| (row.plant_failed, row.failure) = (true, None));
    server.tick(|row| row.ended = Some(Cause::Stop));
    let said = server.said();
    assert_eq!(said.len(), 2, "{said:?}");
    assert!(
        said[0].starts_with("ERROR 105: the machine did not answer")
            && said[1].starts_with("INFO 106: "),
        "{said:?}"
    );
}
