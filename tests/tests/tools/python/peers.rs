//! Servers and their sensors that are gone, taken, stopped, or talk nonsense.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use gantry_tau_core::control::client::GOODBYE_STATES;
use gantry_tau_core::control::message::{
    AxisLimits, AxisState, Capabilities, Cause, Counters, Phase, Refusal, ServerMessage, State,
    Welcome,
};
use gantry_tau_core::control::wire::encode_server;
use gantry_tau_core::model::robot::ARMS;
use gantry_tau_core::units::{Epoch, Sequence, Tick};
use gantry_tau_server::plant::Reading;
use gantry_tau_tests::client_cases::Cases;
use gantry_tau_tests::server_fixture::LOOPBACK;

use super::failures;
use super::{folder, python};
use crate::firmware::program;
use crate::session::{Session, Tool};

/// Trials of this file.
pub(super) const TRIALS: &[(&str, super::Check)] = &[
    ("a_second_client_is_refused", second),
    ("the_end_by_the_server_is_told", stopped),
    ("ctrl_c_leaves_with_goodbye", interrupted),
    ("ctrl_c_before_the_welcome_leaves", interrupted_early),
    (
        "an_end_by_the_server_is_told_beside_the_own_goodbye",
        ended_beside_goodbye,
    ),
    (
        "servers_that_are_gone_or_talk_nonsense_are_told",
        strange_servers,
    ),
    (
        "servers_that_drip_or_hear_no_goodbye_are_left",
        slow_servers,
    ),
    ("a_server_of_six_axes_is_asked_again", six_axes),
    ("constants_are_those_of_the_core", constants),
    ("sensors_that_are_gone_or_silent_are_told", strange_sensors),
    (
        "every_case_of_the_shared_list_ends_as_it_says",
        shared_cases,
    ),
];

/// Lengths of frames of a client with three axes, bytes.
const HELLO: usize = 16;
const COMMAND: usize = 70;
const GOODBYE: usize = 20;
/// Holds 20 um for ever.
const HOLD: &str = "return (20_000, 0, 0)";

fn second() {
    let mut session = Session::new(Tool::Steps(0.0, 1.0));
    let owner = failures::start(&session, HOLD, "");
    session.until("Obtain", |row| row.state.phase == Phase::Obtain);
    let newcomer = failures::start(&session, HOLD, "");
    let (code, said) = session.end_of(newcomer);
    assert_eq!(
        (code, said.as_str()),
        (
            Some(4),
            "gantry_tau: refused: another client owns the session\n"
        )
    );
    assert_eq!(session.rows.last().unwrap().state.phase, Phase::Obtain);
    failures::signal(&owner, "-INT");
    assert_eq!(session.end_of(owner).0, Some(0));
    session.quit();
}

fn stopped() {
    let mut session = Session::new(Tool::Steps(0.0, 1.0));
    let owner = failures::start(&session, HOLD, "");
    session.until("an offset", |row| {
        row.state.axes[0].offsets.position.0 == 20_000
    });
    session.press_stop();
    let (code, said) = session.end_of(owner);
    assert_eq!(
        (code, said.as_str()),
        (
            Some(6),
            "gantry_tau: the server ended the session: stopped\n"
        )
    );
    assert_eq!(session.ramped(), Cause::Stop);
    session.quit();
}

fn interrupted() {
    let mut session = Session::new(Tool::Steps(0.0, 1.0));
    let owner = failures::start(&session, HOLD, "");
    session.until("an offset", |row| {
        row.state.axes[0].offsets.position.0 == 20_000
    });
    failures::signal(&owner, "-INT");
    let (code, said) = session.end_of(owner);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.starts_with("left with Goodbye after "), "{said}");
    assert_eq!(session.ramped(), Cause::Goodbye);
    session.quit();
}

/// The constant offset with these arguments.
fn constant_offset(arguments: &[&str]) -> Child {
    python()
        .arg(folder().join("examples/constant_offset.py"))
        .args(arguments)
        .spawn()
        .unwrap()
}

fn interrupted_early() {
    let listener = TcpListener::bind(LOOPBACK).unwrap();
    let program = constant_offset(&[&listener.local_addr().unwrap().to_string()]);
    let (mut stream, _) = listener.accept().unwrap();
    stream.read_exact(&mut [0; HELLO]).unwrap();
    failures::signal(&program, "-INT");
    let output = program.wait_with_output().unwrap();
    let said = [output.stdout, output.stderr]
        .map(|bytes| String::from_utf8(bytes).unwrap())
        .concat();
    assert_eq!(
        (output.status.code(), said.as_str()),
        (Some(0), "left before a session was granted\n")
    );
}

/// The server ends the session for another reason while the Goodbye is on its way.
fn ended_beside_goodbye() {
    let over = state(8, Phase::SafeDisconnect, Cause::ClientLate);
    let script = vec![
        (HELLO, [granted(), live(6)].concat()),
        (COMMAND, live(7)),
        (COMMAND + GOODBYE, over),
    ];
    let (code, said) = end(&[&answering(script), "--states", "2"]);
    let words = "gantry_tau: the server ended the session: no command arrived before two consecutive deadlines\n";
    assert_eq!((code, said.as_str()), (Some(6), words));
}

/// Runs the constant offset to its end; returns exit code and sentence.
fn end(arguments: &[&str]) -> (Option<i32>, String) {
    let output = constant_offset(arguments).wait_with_output().unwrap();
    (
        output.status.code(),
        String::from_utf8(output.stderr).unwrap(),
    )
}

/// A server that reads so many bytes and answers with others, again and again, and then does
/// something else.
fn scripted(
    script: Vec<(usize, Vec<u8>)>,
    then: impl FnOnce(TcpStream) + Send + 'static,
) -> String {
    let listener = TcpListener::bind(LOOPBACK).unwrap();
    let address = listener.local_addr().unwrap().to_string();
    std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        for (length, answer) in script {
            stream.read_exact(&mut vec![0; length]).unwrap();
            stream.write_all(&answer).unwrap();
        }
        then(stream);
    });
    address
}

/// A server that answers, and closes.
fn answering(script: Vec<(usize, Vec<u8>)>) -> String {
    scripted(script, |mut stream| {
        // A close with bytes unread would be a reset.
        stream.shutdown(Shutdown::Write).unwrap();
        let _ = stream.read_to_end(&mut Vec::new());
    })
}

/// A server that answers, and then sends `rest` in pieces, one every 20 ms.
fn dripping(script: Vec<(usize, Vec<u8>)>, rest: Vec<u8>, piece: usize) -> String {
    scripted(script, move |mut stream| {
        for bytes in rest.chunks(piece) {
            if stream.write_all(bytes).is_err() {
                return;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    })
}

/// A Welcome of tick 5.
fn granted() -> Vec<u8> {
    let welcome = Welcome {
        epoch: Epoch(1),
        tick: Tick(5),
        cycle_us: 1_000,
        echo_window: 0,
        capabilities: Capabilities::NONE,
        kinematics_checksum: 0,
        limits: [AxisLimits::DISABLED; 3],
    };
    encode_server(&ServerMessage::<3>::Welcome(welcome)).to_vec()
}

/// A State of a session.
fn live(tick: u64) -> Vec<u8> {
    state(tick, Phase::Handshake, Cause::None)
}

/// A State of that session.
fn state(tick: u64, phase: Phase, cause: Cause) -> Vec<u8> {
    let state = State {
        tick: Tick(tick),
        epoch: Epoch(1),
        accepted: Sequence(0),
        phase,
        cause,
        on_time_of_100: 100,
        arrival_us: 0,
        ramp_ticks_left: 0,
        counters: Counters::default(),
        sensor: None,
        axes: [AxisState::default(); 3],
    };
    encode_server(&ServerMessage::State(state)).to_vec()
}

fn strange_servers() {
    let refusal = encode_server(&ServerMessage::<3>::Refusal(Refusal::Ramping {
        ticks_left: 17,
    }));
    let mut broken = refusal.to_vec();
    broken[9] ^= 1;
    let granted = granted();
    let live = state(6, Phase::Handshake, Cause::None);
    let again = [&granted[..], &live, &live].concat();
    // All at once, as a client reads them that was not scheduled: not the controller is to blame.
    let late = [
        &granted[..],
        &live,
        &state(7, Phase::SafeDisconnect, Cause::ClientLate),
    ]
    .concat();
    let cases: [(Vec<u8>, i32, &str); 9] = [
        (
            granted.clone(),
            7,
            "the server vanished: it closed the connection",
        ),
        (
            late,
            6,
            "the server ended the session: no command arrived before two consecutive deadlines",
        ),
        (
            [&granted[..], &live].concat(),
            7,
            "the server vanished: it closed the connection",
        ),
        (
            again,
            5,
            "expected a State of epoch 1 and tick 7 or later, got epoch 1, tick 6",
        ),
        (
            Vec::new(),
            7,
            "the server vanished: it closed the connection",
        ),
        (
            refusal.to_vec(),
            4,
            "refused: offsets are still ramping to zero; try again in 17 ticks",
        ),
        (
            broken,
            5,
            "incompatible server: the stream is broken (the checksum does not match)",
        ),
        (
            b"HTTP/1.1 400 Bad Request".to_vec(),
            5,
            "incompatible server: the stream is broken (magic b'HT'",
        ),
        (
            refusal[..9].to_vec(),
            7,
            "the server vanished: it closed the connection",
        ),
    ];
    for (answer, code, words) in cases {
        let (found, said) = end(&[&answering(vec![(HELLO, answer)])]);
        assert_eq!(found, Some(code), "{said}");
        assert!(said.contains(words) && said.lines().count() == 1, "{said}");
    }
    let gone = TcpListener::bind(LOOPBACK)
        .unwrap()
        .local_addr()
        .unwrap()
        .to_string();
    for address in [gone.as_str(), "127.0.0.1", "127.0.0.1:none"] {
        let (code, said) = end(&[address]);
        assert_eq!(code, Some(3), "{said}");
        assert!(
            said.contains(&format!("the server at {address} cannot be reached: ")),
            "{said}"
        );
        assert_eq!(said.lines().count(), 1, "{said}");
    }
}

/// Time passes, and bytes come, but no whole State and no end of the session.
fn slow_servers() {
    // Longer than the wait of 3 s, at 20 ms for a byte or a State, and not as long as the frame
    // that has begun.
    let dripped = [0; 200];
    let welcome = [&granted()[..], &live(6)].concat();
    let header_of_a_state = live(7)[..8].to_vec();
    let states: Vec<u8> = (9..4_000).flat_map(live).collect();
    let length = live(9).len();
    for (script, rest, piece, words) in [
        (
            vec![(HELLO, granted()[..8].to_vec())],
            dripped[..165].to_vec(),
            1,
            "the server vanished: it does not answer",
        ),
        (
            vec![(HELLO, welcome.clone()), (COMMAND, header_of_a_state)],
            dripped.to_vec(),
            1,
            "the server vanished: it has been silent for too long",
        ),
        (
            vec![
                (HELLO, welcome),
                (COMMAND, live(7)),
                (COMMAND + GOODBYE, live(8)),
            ],
            states,
            length,
            "the server vanished: it has not acknowledged the Goodbye within 100 States",
        ),
    ] {
        let (code, said) = end(&[&dripping(script, rest, piece), "--states", "2"]);
        assert_eq!(code, Some(7), "{said}");
        assert!(said.contains(words) && said.lines().count() == 1, "{said}");
    }
}

/// It begins with a Hello for three.
fn six_axes() {
    let state = tempfile::tempdir().unwrap();
    let mut serve = Command::new(program::build());
    serve.args([
        "serve",
        "--robot",
        "f1",
        "--pace",
        "lockstep",
        "--listen",
        "127.0.0.1:0",
    ]);
    let recording = state.path().join("run.csv");
    serve
        .arg("--record")
        .arg(&recording)
        .env("XDG_STATE_HOME", state.path())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null());
    let mut server = serve.spawn().unwrap();
    let mut lines = BufReader::new(server.stdout.take().unwrap()).lines();
    let listening = lines
        .find_map(|line| Some(line.unwrap().split_once("listening on ")?.1.to_owned()))
        .unwrap();
    let address = listening.split_once(';').unwrap().0;
    let program = constant_offset(&[
        address,
        "--offset-um",
        "1,2,3,4,5,6",
        "--states",
        &failures::STATES.to_string(),
    ]);
    let output = program.wait_with_output().unwrap();
    let said = [output.stdout, output.stderr]
        .map(|bytes| String::from_utf8(bytes).unwrap())
        .concat();
    failures::signal(&server, "-TERM");
    assert_eq!(server.wait().unwrap().code(), Some(0));
    let [heard] = failures::counted(&said, ["left with Goodbye after "]);
    assert!(
        said.contains("States (0 with a saturated target); "),
        "{said}"
    );
    let phases = phases(&recording);
    let live = phases
        .iter()
        .map(|phase| ["Handshake", "Submit", "Obtain"].contains(&phase.as_str()));
    failures::assert_heard(live, heard);
}

/// Phases of a recording, row by row.
fn phases(recording: &Path) -> Vec<String> {
    let csv = std::fs::read_to_string(recording).unwrap();
    let mut rows = csv.lines().map(|line| line.split(','));
    let column = rows
        .next()
        .unwrap()
        .position(|name| name == "state")
        .unwrap();
    rows.map(|mut row| row.nth(column).unwrap().to_owned())
        .collect()
}

/// Numbers and texts of the client in Python.
fn constants() {
    let script = "import sys, json; sys.path.insert(0, sys.argv[1]); from gantry_tau import client as g
print(json.dumps([g.PHASES, g.CAUSES, g.LIVE, g.GOODBYE_STATES, g.SILENCE_S, g.SAMPLE_STATES, g.FIRST_SAMPLE_STATES, g.CEILING_NM]))";
    let output = python()
        .args(["-c", script])
        .arg(folder())
        .output()
        .unwrap();
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let phases: Vec<&str> = Phase::ALL.iter().map(|phase| phase.name()).collect();
    let causes: Vec<String> = Cause::ALL.iter().map(Cause::to_string).collect();
    let live = ["Handshake", "Submit", "Obtain"];
    // The last four are private to the client in Rust: seconds, States, States, nm.
    let expected = serde_json::json!([
        phases,
        causes,
        live,
        GOODBYE_STATES,
        3.0,
        100,
        1_000,
        10_000_000
    ]);
    assert_eq!(found, expected);
}

/// The list that the client in Rust is run against, too.
fn shared_cases() {
    let cases = Cases::read();
    let program = format!(
        "import sys; sys.path.insert(0, sys.argv.pop(1)); import gantry_tau\n\
         gantry_tau.main(lambda state, wrench: [0, 0, 0], checksum={})",
        cases.checksum
    );
    for case in &cases.cases {
        let (address, serving) = cases.serve(case);
        let client = python()
            .args(["-c", &program])
            .arg(folder())
            .arg(address.to_string())
            .output()
            .unwrap();
        let sent = serving.join().unwrap();
        let said = String::from_utf8(client.stderr).unwrap();
        Cases::check(
            case,
            u8::try_from(client.status.code().unwrap()).unwrap(),
            &said,
            &sent,
        );
    }
}

/// A controller that needs a force sensor, or takes it as it comes; says the first and the last sample.
fn with_force(session: &Session, needs_wrench: &str, states: &str) -> Child {
    let script = format!(
        "import sys; sys.path.insert(0, sys.argv.pop(1)); import gantry_tau
seen = [None]
def step(state, wrench):
    if wrench != seen[-1]:
        seen.append(wrench)
    return [0, 0, 0]
options = gantry_tau.arguments().parse_args()
try:
    gantry_tau.main(step, options, needs_wrench={needs_wrench})
finally:
    print(seen[1:2], seen[-1])"
    );
    python()
        .args(["-c", &script])
        .arg(folder())
        .args([&session.address(), "--states", states])
        .spawn()
        .unwrap()
}

/// Conduct of a sensor, by tick: its sample, with NaN none, and the age of it.
type Lie = fn(u64) -> ([f64; 6], u8);

/// Sample of an honest sensor.
const HONEST: [f64; 6] = [1.5, -2.0, 3.0, 0.25, -0.125, 0.5];

fn strange_sensors() {
    // With what a controller sees first: a sample, or none at all. It has begun by tick 3 000.
    let lies: [(Lie, &str); 5] = [
        (|_| ([f64::NAN; 6], 0), "[] None"),
        (|_| ([1e300, 0.0, 0.0, 0.0, 0.0, 0.0], 0), "[] None"),
        (|_| (HONEST, 255), "[] None"),
        (
            |tick| {
                (
                    HONEST,
                    u8::try_from(tick.saturating_sub(3_000)).unwrap_or(255),
                )
            },
            "[(1.5, -2.0, 3.0, 0.25, -0.125, 0.5)] None",
        ),
        (
            |tick| (if tick < 3_000 { HONEST } else { [f64::NAN; 6] }, 0),
            "[(1.5, -2.0, 3.0, 0.25, -0.125, 0.5)] None",
        ),
    ];
    for (lie, seen) in lies {
        let speak = move |tick, reading: &mut Reading<ARMS>| {
            let tool = reading.tool.as_mut().unwrap();
            (tool.sensor, tool.sensor_age) = lie(tick);
        };
        let mut session = Session::lying(speak);
        let program = with_force(&session, "True", "100000");
        let (code, said) = session.end_of(program);
        assert_eq!(code, Some(8), "{said}");
        let words = "no force samples: no usable one has come for too long";
        assert!(said.contains(words), "{said}");
        assert_eq!(session.ramped(), Cause::Goodbye);
        session.quit();
        // Who does not need it goes on, and has no old sample.
        let mut session = Session::lying(speak);
        let program = with_force(&session, "False", "5000");
        let (code, said) = session.end_of(program);
        assert_eq!(code, Some(0), "{said}");
        assert!(said.contains(seen), "{said}");
        assert_eq!(session.ramped(), Cause::Goodbye);
        session.quit();
    }
}
