//! Controllers that fail: the server ramps to zero, and the client says why in one sentence.

use std::process::{Child, Command};

use gantry_tau_core::control::message::{Cause, Phase};
use gantry_tau_core::model::robot::ARMS;
use gantry_tau_server::record::TickRecord;

use super::{folder, python};
use crate::session::{Session, Tool};

/// Trials of this file.
pub(super) const TRIALS: &[(&str, super::Check)] = &[
    (
        "controllers_that_raise_or_return_nonsense_are_left",
        nonsense,
    ),
    ("controllers_that_hang_are_left", hanging),
    (
        "a_controller_that_hangs_in_its_start_is_left",
        hanging_start,
    ),
    (
        "without_patience_of_the_client_the_server_ends_a_hanging_step",
        silence,
    ),
    ("a_step_that_was_not_scheduled_is_not_blamed", not_scheduled),
    (
        "a_step_that_was_not_scheduled_and_fails_is_blamed",
        not_scheduled_and_wrong,
    ),
    ("run_obtains_unless_it_is_told_otherwise", as_a_function),
    ("a_controller_that_ends_the_process_is_ramped_away", ending),
    ("targets_beyond_the_limits_are_cut", beyond),
];

/// States after which a client leaves that is to leave.
pub(super) const STATES: usize = 300;
/// Ticks before a controller fails.
const GOOD: u32 = 60;

/// Starts a controller that holds 20 um on the first axis for [`GOOD`] steps, and then does `bad`,
/// with options of `run`.
pub(super) fn start(session: &Session, bad: &str, options: &str) -> Child {
    start_with(session, "pass", bad, options)
}

/// The same with a body of its method `start`.
fn start_with(session: &Session, body: &str, bad: &str, options: &str) -> Child {
    let script = format!(
        r#"
import os, signal, sys, time
sys.path.insert(0, {folder:?})
import gantry_tau

class Controller:
    steps = 0

    def start(self, welcome):
        {body}

    def step(self, state, wrench):
        self.steps += 1
        if self.steps <= {GOOD}:
            return (20_000, 0, 0)
        {bad}

options = gantry_tau.arguments().parse_args()
gantry_tau.main(Controller(), options, {options})
"#,
        folder = folder().to_str().unwrap(),
    );
    python()
        .args(["-c", &script])
        .arg(session.address())
        .spawn()
        .unwrap()
}

/// Runs a controller that fails, to the end of the ramp; returns the cause for the server and the
/// sentence of the client.
fn failed(bad: &str, options: &str) -> (Cause, String) {
    let mut session = Session::new(Tool::Steps(0.0, 1.0));
    let program = start(&session, bad, options);
    let ended = told(&mut session, program);
    let held = session
        .obtained()
        .iter()
        .filter(|row| row.state.axes[0].offsets.position.0 == 20_000)
        .count();
    assert!(held > 10, "{bad}: no offset was in force");
    session.quit();
    ended
}

/// Returns the cause for the server and the one sentence of the client.
fn told(session: &mut Session, program: Child) -> (Cause, String) {
    let (code, said) = session.end_of(program);
    assert_eq!(code, Some(10), "{said}");
    assert!(
        said.lines().count() == 1 && said.starts_with("gantry_tau: the controller's "),
        "{said}"
    );
    (session.ramped(), said)
}

fn nonsense() {
    for (bad, words) in [
        (
            "raise ValueError('no\\nidea')",
            "raised ValueError: no idea (<string>, line 16); left with Goodbye",
        ),
        ("1 / 0", "raised ZeroDivisionError: division by zero"),
        ("sys.exit(0)", "raised SystemExit: 0"),
        (
            "raise type('Mute', (Exception,), {'__str__': lambda error: 1 / 0})",
            "raised Mute: its text raised ZeroDivisionError (<string>, line 16); left with Goodbye",
        ),
        (
            "return [float('nan'), 0, 0]",
            "returned nan for axis 1: expected a finite number in nm",
        ),
        ("return [0, float('inf'), 0]", "returned inf for axis 2"),
        ("return [0, 0, -float('inf')]", "returned -inf for axis 3"),
        (
            "return [1, 2]",
            "returned 2 targets: expected 3, one per axis",
        ),
        ("return [1, 2, 3, 4]", "returned 4 targets"),
        (
            "return [1, '2', 3]",
            "returned str '2' for axis 2: expected a number in nm",
        ),
        ("return [True, 2, 3]", "returned bool True for axis 1"),
        ("return [1, None, 3]", "returned NoneType None for axis 2"),
        ("return [1j, 0, 0]", "returned complex 1j for axis 1"),
        (
            "return None",
            "returned NoneType None: expected 3 numbers in nm",
        ),
        ("return b'abc'", "returned bytes b'abc': expected"),
        ("return {1, 2, 3}", "returned set {1, 2, 3}: expected"),
        ("return (n for n in iter(int, 1))", "returned generator"),
    ] {
        let (cause, said) = failed(bad, "");
        assert!(said.contains(words), "{bad}: {said}");
        assert!(said.contains("step of tick "), "{said}");
        assert_eq!(cause, Cause::Goodbye, "{bad}");
    }
}

/// The second holds the interpreter's lock whenever it may, the third hangs in the text of its
/// error.
fn hanging() {
    for bad in [
        "time.sleep(3600)",
        "\n        while True: pass",
        "raise type('Mute', (Exception,), {'__str__': lambda error: time.sleep(3600)})",
    ] {
        let (cause, said) = failed(bad, "patience_s=0.3");
        assert!(
            said.contains("has not returned within 0.3 s; left with Goodbye"),
            "{bad}: {said}"
        );
        assert_eq!(cause, Cause::Goodbye, "{bad}");
    }
}

fn hanging_start() {
    let mut session = Session::new(Tool::Steps(0.0, 1.0));
    // Shorter than the handshake of 1000 ticks, 10 ms each.
    let program = start_with(&session, "time.sleep(3600)", "pass", "patience_s=0.3");
    let (cause, said) = told(&mut session, program);
    assert!(
        said.contains("the controller's start has not returned within 0.3 s"),
        "{said}"
    );
    assert_eq!(cause, Cause::Goodbye);
    assert!(session.obtained().is_empty());
    session.quit();
}

fn silence() {
    let (cause, said) = failed("time.sleep(3600)", "patience_s=60.0");
    assert!(
        said.contains(
            "the server ended the session: no command arrived before two consecutive deadlines"
        ),
        "{said}"
    );
    assert_eq!(cause, Cause::ClientLate);
}

/// The process is stopped in a step, and continued when the server has ended the session.
fn not_scheduled() {
    let mut session = Session::new(Tool::Steps(0.0, 1.0));
    let program = start(
        &session,
        "os.kill(os.getpid(), signal.SIGSTOP); return (20_000, 0, 0)",
        "patience_s=60.0",
    );
    assert_eq!(session.ramped(), Cause::ClientLate);
    signal(&program, "-CONT");
    let (code, said) = session.end_of(program);
    assert_eq!(code, Some(6), "{said}");
    let words = "gantry_tau: the server ended the session: no command arrived before two consecutive deadlines (the controller's longest step";
    assert!(
        said.starts_with(words) && said.lines().count() == 1,
        "{said}"
    );
    session.quit();
}

/// The same, and then the step fails: that comes first.
fn not_scheduled_and_wrong() {
    let mut session = Session::new(Tool::Steps(0.0, 1.0));
    let program = start(
        &session,
        "os.kill(os.getpid(), signal.SIGSTOP); raise ValueError('late')",
        "patience_s=60.0",
    );
    assert_eq!(session.ramped(), Cause::ClientLate);
    signal(&program, "-CONT");
    let (_, said) = told(&mut session, program);
    assert!(
        said.contains("raised ValueError: late")
            && said.contains("; the server had ended the session, "),
        "{said}"
    );
    session.quit();
}

/// Numbers of a text, each after its words.
pub(super) fn counted<const N: usize>(said: &str, words: [&str; N]) -> [usize; N] {
    words.map(|words| {
        let (_, rest) = said.split_once(words).unwrap_or_else(|| panic!("{said}"));
        rest.chars()
            .map_while(|digit| usize::try_from(digit.to_digit(10)?).ok())
            .fold(0, |number, digit| 10 * number + digit)
    })
}

/// True for a State of a session that was not ended.
pub(super) const fn is_live(row: &TickRecord<ARMS>) -> bool {
    matches!(
        row.state.phase,
        Phase::Handshake | Phase::Submit | Phase::Obtain
    )
}

/// Asserts that a client that left has heard every State of its session and the one that
/// acknowledges its Goodbye, and no other but such as came with that. `live`: for each tick, true
/// for a State of its session.
pub(super) fn assert_heard(live: impl Iterator<Item = bool>, heard: usize) {
    let since: Vec<bool> = live.skip_while(|is_live| !is_live).collect();
    let least = since.iter().filter(|is_live| **is_live).count() + 1;
    assert!(
        (least.max(STATES + 1)..=since.len()).contains(&heard),
        "{heard} of {least} to {} States",
        since.len()
    );
}

/// `run` as a function, with what it does by default.
fn as_a_function() {
    let mut session = Session::new(Tool::Steps(0.0, 1.0));
    let script = format!(
        "import sys; sys.path.insert(0, sys.argv[1]); import gantry_tau
print(gantry_tau.run(lambda state, wrench: [20_000, 0, 0], server=sys.argv[2], states={STATES}))"
    );
    let mut python = python();
    let program = python
        .args(["-c", &script])
        .arg(folder())
        .arg(session.address())
        .spawn()
        .unwrap();
    let (code, said) = session.end_of(program);
    assert_eq!(session.ramped(), Cause::Goodbye);
    let [heard, sent] = counted(&said, ["Report(states=", "commands="]);
    assert_eq!(
        (code, said),
        (
            Some(0),
            format!("Report(states={heard}, commands={sent}, saturated=0)\n")
        )
    );
    assert_heard(session.rows.iter().map(is_live), heard);
    // The Goodbye is received, too. A State that came with another one has no answer, and the
    // server a tick without a frame.
    let live = session.rows.iter().filter(|row| is_live(row));
    let frames: Vec<u32> = live.map(|row| row.state.counters.received).collect();
    let silent = frames.windows(2).filter(|pair| pair[0] == pair[1]).count();
    let received = session.rows.last().unwrap().state.counters.received;
    assert_eq!(u32::try_from(sent + 1), Ok(received));
    assert!(
        (STATES - silent..=STATES).contains(&sent),
        "{sent} commands, {silent} ticks without one"
    );
    assert_eq!(
        session.obtained().last().unwrap().state.axes[0]
            .offsets
            .position
            .0,
        20_000
    );
    // The first command alone asks for Submit.
    let submitted = session
        .rows
        .iter()
        .filter(|row| row.state.phase == Phase::Submit)
        .count();
    assert_eq!(submitted, 1);
    session.quit();
}

/// Sends a signal, as `kill` names it.
pub(super) fn signal(program: &Child, name: &str) {
    let status = Command::new("kill")
        .args([name, &program.id().to_string()])
        .status();
    assert!(status.unwrap().success());
}

fn ending() {
    let mut session = Session::new(Tool::Steps(0.0, 1.0));
    let program = start(&session, "os._exit(77)", "");
    let (code, said) = session.end_of(program);
    assert_eq!((code, said.as_str()), (Some(77), ""));
    assert_eq!(session.ramped(), Cause::Closed);
    session.quit();
}

fn beyond() {
    let mut session = Session::new(Tool::Steps(0.0, 1.0));
    let mut program = start(&session, "return [1e300, -10**400, 0.6]", "");
    session.until("the limits", |row| {
        row.state.axes.map(|axis| axis.offsets.position.0) == [2_000_000, -2_000_000, 1]
    });
    let asked = session.rows.last().unwrap().state.counters;
    assert_eq!(
        (asked.out_of_range, asked.malformed),
        (0, 0),
        "the client cuts, not the server"
    );
    program.kill().unwrap();
    program.wait().unwrap();
    assert_eq!(session.ramped(), Cause::Closed);
    session.quit();
}
