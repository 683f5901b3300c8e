//! Programs that are slower than the server: core's pacer in lock-step with a session, and the port
//! of `gantry-tau pace`.

use std::io::{BufRead, BufReader, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use gantry_tau_client::pace::PaceOptions;
use gantry_tau_core::Offsets;
use gantry_tau_core::control::client::{Client, Event, Requirements};
use gantry_tau_core::control::endpoint::{Endpoint, Transport};
use gantry_tau_core::control::keys::{Key, Role};
use gantry_tau_core::control::message::{Mode, Phase, State};
use gantry_tau_core::control::pacer::{Paced, Pacer, Settings, Target};
use gantry_tau_core::control::session::config::Config;
use gantry_tau_core::control::session::{Connection, Session, Start};
use gantry_tau_core::units::{EpochRange, OffsetNm, PositionNm, Tick};
use gantry_tau_server::server::TickSource;
use gantry_tau_tests::DEADLINE;
use gantry_tau_tests::pacing::Pacing;
use gantry_tau_tests::server_fixture::{LOOPBACK, on_time, parameters, taken};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};

const N: usize = 3;
/// Kind of a Command (wire.md), the fourth byte of its frame.
const COMMAND: u8 = 3;

/// A session in memory and its client.
struct Pair {
    endpoint: Endpoint<N>,
    connection: Connection,
    client: Client<N>,
}

impl Pair {
    fn greeted() -> Self {
        let config = Config::new(parameters::<N>()).unwrap();
        let session = Session::new(config, &Start::at_rest([PositionNm(0); N])).unwrap();
        let mut endpoint = Endpoint::new(session, EpochRange::VOLATILE);
        let connection = endpoint.open(Transport::Stream).unwrap();
        let mut client = Client::new(Transport::Stream, Requirements::default());
        let hello = client.hello().unwrap();
        endpoint.feed(connection, &hello);
        Self {
            endpoint,
            connection,
            client,
        }
    }

    /// One tick, and its State.
    fn tick(&mut self) -> State<N> {
        taken(self.endpoint.tick(&on_time([PositionNm(0); N])));
        let mut newest = None;
        while let Some((_, bytes)) = self.endpoint.poll_transmit() {
            let mut received = self.client.feed(bytes);
            while let Some(event) = received.poll_event() {
                match event.unwrap() {
                    Event::State(state) => newest = Some(state),
                    Event::Welcomed(_) => {}
                    other => panic!("{other:?}"),
                }
            }
        }
        newest.unwrap_or_else(|| panic!("no State"))
    }

    fn answer(&mut self, mode: Mode, targets: &[Offsets; N]) {
        let answer = self.client.answer(mode, targets).unwrap();
        self.endpoint.feed(self.connection, &answer.frame);
    }
}

/// A program at 30 Hz, up to 60 ms late, of whose lines a tenth is lost.
struct Jittery {
    random: ChaCha8Rng,
    /// Lines under way: when they come, and what they say.
    lines: Vec<(u64, Target<N>)>,
}

impl Jittery {
    fn wanted(at: u64) -> [OffsetNm; N] {
        // To and fro by 300 µm, with 0.4 µm per tick.
        [0, 500, 1_000].map(|later| {
            let place = i32::try_from((at + later) % 3_000).unwrap();
            OffsetNm(400 * ((place - 1_500).abs() - 750))
        })
    }

    /// Lines that come in this tick.
    fn lines(&mut self, now: u64) -> Vec<Target<N>> {
        if now % 33 == 0 && !self.random.random_bool(0.1) {
            let target = Target {
                at: Tick(now),
                offsets: Self::wanted(now),
            };
            self.lines
                .push((now + self.random.random_range(0..=60), target));
        }
        let (come, under_way) = (self.lines.drain(..)).partition(|(at, _)| *at <= now);
        self.lines = under_way;
        Vec::into_iter(come).map(|(_, target)| target).collect()
    }
}

#[test]
fn a_program_at_30_hz_is_never_limited_and_never_ended() {
    let settings = Settings {
        latency_ticks: 66 + 60,
        hold_ticks: 500,
        give_up_ticks: 2_000,
        horizon_ticks: 10_000,
    };
    let mut pair = Pair::greeted();
    let limits = parameters::<N>().axes.map(|axis| axis.limits.position);
    let mut state = pair.tick();
    let mut pacer = Pacer::<N>::new(limits, settings, state.tick).unwrap();
    let mut program = Jittery {
        random: ChaCha8Rng::seed_from_u64(30),
        lines: Vec::new(),
    };
    let mut asks = Mode::Submit;
    for _ in 0..1_000_000 {
        for target in program.lines(state.tick.0) {
            let _ = pacer.push(target);
        }
        // Obtain begins at zero.
        if state.phase == Phase::Submit && asks == Mode::Submit {
            asks = Mode::Obtain;
        }
        let Paced::Targets(targets) = pacer.tick(state.tick) else {
            panic!("given up at {:?}", state.tick)
        };
        if state.phase == Phase::Handshake {
            pacer.restart(&[OffsetNm(0); N]);
        }
        pair.answer(asks, &targets.map(Offsets::position));
        state = pair.tick();
        assert!(
            matches!(state.phase, Phase::Submit | Phase::Obtain),
            "{state:?}"
        );
        assert_eq!(state.counters.limited, 0, "{:?}", state.tick);
    }
    assert_eq!(state.phase, Phase::Obtain);
    assert!(
        state
            .axes
            .iter()
            .any(|axis| axis.offsets.position.0.abs() > 100_000)
    );
}

/// A program: ten lines in any language.
struct Program(BufReader<TcpStream>);

impl Program {
    fn connect(address: SocketAddr) -> Self {
        let stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(DEADLINE)).unwrap();
        Self(BufReader::new(stream))
    }

    fn say(&mut self, line: &str) {
        writeln!(self.0.get_mut(), "{line}").unwrap();
    }

    /// Next line; `None` at the end.
    fn line(&mut self) -> Option<Value> {
        let mut line = String::new();
        let read = self.0.read_line(&mut line).unwrap();
        (read > 0).then(|| serde_json::from_str(&line).unwrap())
    }

    fn row(&mut self) -> Value {
        let mut error = Value::Null;
        loop {
            let Some(line) = self.line() else {
                panic!("no row, but {error}")
            };
            if line["error"].is_null() {
                return line;
            }
            error = line["error"].clone();
        }
    }

    fn error(&mut self) -> String {
        loop {
            let line = self.line().expect("an error line");
            if let Some(error) = line["error"].as_str() {
                return error.to_owned();
            }
        }
    }

    fn t(&mut self) -> f64 {
        self.row()["t"].as_f64().unwrap()
    }

    /// Wants offsets at a time.
    fn want(&mut self, mode: &str, t: f64, um: [f64; N]) {
        self.say(&json!({ "mode": mode, "t": t, "offset_um": um }).to_string());
    }

    /// Wants offsets, and waits until a row is as expected. In lock-step the server may be far ahead of
    /// the row that was read last: a target that was too late is sent again.
    fn reach(&mut self, mode: &str, um: [f64; N], is_reached: impl Fn(&Value) -> bool) -> Value {
        let mut t = f64::NEG_INFINITY;
        loop {
            let row = self.row();
            if is_reached(&row) {
                return row;
            }
            let now = row["t"].as_f64().unwrap();
            if now > t + 1.0 {
                t = now + 9.0;
                self.want(mode, t, um);
            }
        }
    }
}

#[test]
fn a_program_moves_the_machine_and_the_next_one_begins_at_zero() {
    let key = Key::new(&[7; 32], Role::Control);
    for (transport, key) in [(Transport::Stream, None), (Transport::Datagram, Some(key))] {
        let pacing = Pacing::over(transport, key, TickSource::Lockstep);
        let report = pacing.with(&pacing.options(), |address| {
            for _ in 0..2 {
                let mut program = Program::connect(address);
                assert_eq!(program.row()["offset_um"], json!([0.0, 0.0, 0.0]));
                let um = [10.0, -5.0, 0.0];
                let row = program.reach("obtain", um, |row| row["offset_um"] == json!(um));
                assert_eq!(row["phase"], "obtain");
                assert_eq!(row["limited"], 0);
                assert_eq!(row["nominal_mm"].as_array().unwrap().len(), N);
                program.reach("submit", [0.0; N], |row| row["phase"] == "submit");
            }
        });
        assert_eq!(report.programs, 2);
    }
}

#[test]
fn every_program_begins_in_submit() {
    let pacing = Pacing::new(TickSource::Lockstep);
    // A row of each tick, that of the handshake too.
    let options = PaceOptions {
        period: Duration::from_millis(1),
        ..pacing.options()
    };
    let report = pacing.with(&options, |address| {
        for _ in 0..10 {
            let row = Program::connect(address).row();
            assert_eq!(row["phase"], "submit");
        }
    });
    assert_eq!(report.programs, 10);
}

#[test]
fn a_server_in_lock_step_is_answered_once_per_cycle_of_the_clock() {
    let pacing = Pacing::new(TickSource::Lockstep);
    let options = PaceOptions {
        period: Duration::from_millis(1),
        is_hurried: false,
        ..pacing.options()
    };
    pacing.with(&options, |address| {
        let mut program = Program::connect(address);
        let (since, begun) = (Instant::now(), program.t());
        while program.t() < begun + 0.5 {}
        // Rows that were on their way, and the cycle that a late answer makes up for.
        let passed = since.elapsed() + Duration::from_millis(50);
        assert!(passed >= Duration::from_millis(500), "{passed:?}");
    });
}

#[test]
fn a_line_that_cannot_be_used_costs_an_error_line_and_nothing_else() {
    let pacing = Pacing::new(TickSource::Lockstep);
    let long = "x".repeat(10_000);
    let cases = [
        ("half a line", "expected value"),
        ("{}", "missing field `mode`"),
        (
            r#"{"mode":"obtain","t":1e9,"offset_um":[0,0,0]}"#,
            "too far in the future",
        ),
        (
            r#"{"mode":"obtain","t":0,"offset_um":[0,0,0]}"#,
            "has been played",
        ),
        (
            r#"{"mode":"obtain","t":-1,"offset_um":[0,0,0]}"#,
            "t: -1 is no time of the server",
        ),
        (
            r#"{"mode":"obtain","t":NaN,"offset_um":[0,0,0]}"#,
            "expected value",
        ),
        (
            r#"{"mode":"obtain","t":1,"offset_um":[0,0]}"#,
            "offset_um: 2 numbers for 3 axes",
        ),
        (
            r#"{"mode":"obtain","t":1,"offset_um":[0,1e300,0]}"#,
            "of axis 2 is not within ±",
        ),
        (
            r#"{"mode":"obtain","t":1,"offset_um":[0,0,0],"x":1}"#,
            "unknown field `x`",
        ),
        (
            r#"{"mode":"go","t":1,"offset_um":[0,0,0]}"#,
            "unknown variant `go`",
        ),
        (&long, "a line of more than 4096 bytes"),
    ];
    let report = pacing.with(&pacing.options(), |address| {
        let mut program = Program::connect(address);
        // Behind the latency, so that the time 0 has been played.
        while program.t() < 0.1 {}
        for (line, expected) in cases {
            program.say(line);
            let error = program.error();
            assert!(error.contains(expected), "{line}: {error}");
        }
        for _ in 0..3 {
            assert_eq!(program.row()["phase"], "submit", "after refused lines");
        }
        let mut other = Program::connect(address);
        assert_eq!(other.error(), "another program is served");
        assert_eq!(other.line(), None);
        let um = [1.0, 0.0, 0.0];
        program.reach("obtain", um, |row| row["offset_um"] == json!(um));
    });
    assert_eq!(report.programs, 1);
    assert!(
        report.refused >= u64::try_from(cases.len()).unwrap(),
        "{report:?}"
    );
}

#[test]
fn a_silent_program_is_given_up_and_the_next_is_served() {
    let pacing = Pacing::new(TickSource::Lockstep);
    let options = PaceOptions {
        hold: Duration::from_millis(50),
        give_up: Duration::from_secs(10),
        ..pacing.options()
    };
    let report = pacing.with(&options, |address| {
        let mut silent = Program::connect(address);
        let t = silent.t() + 9.0;
        silent.want("submit", t, [0.0; N]);
        assert_eq!(
            silent.error(),
            "no target for 10000 ms: the session is ended"
        );
        assert_eq!(silent.line(), None);
        // One that only listens is not silent, nor one whose first target was refused.
        let mut next = Program::connect(address);
        let t = next.t();
        next.want("obtain", t + 1e6, [0.0; N]);
        assert!(next.error().contains("too far in the future"));
        while next.t() < t + 20.0 {}
    });
    assert_eq!((report.programs, report.silent), (2, 1));
}

/// Carries datagrams between a client and a server, but for commands that are to be lost.
struct LossyRelay {
    address: SocketAddr,
    loses: Arc<AtomicBool>,
}

impl LossyRelay {
    /// Starts its two threads, which end with the test's process.
    fn to(server: SocketAddr) -> Self {
        let near = UdpSocket::bind(LOOPBACK).unwrap();
        let far = UdpSocket::bind(LOOPBACK).unwrap();
        far.connect(server).unwrap();
        let relay = Self {
            address: near.local_addr().unwrap(),
            loses: Arc::default(),
        };
        let client = Arc::new(Mutex::new(None));
        let (back, out) = (near.try_clone().unwrap(), far.try_clone().unwrap());
        let (from, loses) = (Arc::clone(&client), Arc::clone(&relay.loses));
        thread::spawn(move || {
            let mut bytes = [0; 2_048];
            while let Ok((length, peer)) = near.recv_from(&mut bytes) {
                *from.lock().unwrap() = Some(peer);
                let is_command = bytes[3] == COMMAND;
                if !(is_command && loses.swap(false, Ordering::Relaxed)) {
                    out.send(&bytes[..length]).unwrap();
                }
            }
        });
        thread::spawn(move || {
            let mut bytes = [0; 2_048];
            while let Ok(length) = far.recv(&mut bytes) {
                let peer = client.lock().unwrap().unwrap();
                back.send_to(&bytes[..length], peer).unwrap();
            }
        });
        relay
    }
}

#[test]
fn a_command_that_is_lost_limits_a_few_steps_and_no_more() {
    let pacing = Pacing::over(Transport::Datagram, None, TickSource::Lockstep);
    let relay = LossyRelay::to(pacing.address());
    let options = PaceOptions {
        server: relay.address.into(),
        period: Duration::from_millis(1),
        latency: Duration::from_secs(1),
        is_hurried: false,
        ..pacing.options()
    };
    pacing.with(&options, |address| {
        let mut program = Program::connect(address);
        let t = program.t();
        // As fast as the limits allow, for hundreds of ticks.
        program.want("obtain", t, [0.0; N]);
        program.want("obtain", t + 0.001, [1_000.0, 0.0, 0.0]);
        let position = |row: &Value| row["offset_um"][0].as_f64().unwrap();
        while position(&program.row()) < 300.0 {}
        relay.loses.store(true, Ordering::Relaxed);
        // It begins again where it is, with what the program sends from then on.
        program.want("obtain", t + 2.0, [1_000.0, 0.0, 0.0]);
        let mut row = program.row();
        while position(&row) < 1_000.0 {
            row = program.row();
        }
        let limited = row["limited"].as_u64().unwrap();
        assert!(!relay.loses.load(Ordering::Relaxed), "none was lost");
        assert!((1..10).contains(&limited), "{limited} steps");
    });
}

#[test]
fn a_server_that_is_not_there_is_an_error_line() {
    let pacing = Pacing::new(TickSource::Lockstep);
    let closed = TcpListener::bind(LOOPBACK).unwrap().local_addr().unwrap();
    let options = PaceOptions {
        server: closed.into(),
        ..pacing.options()
    };
    pacing.with(&options, |address| {
        let mut program = Program::connect(address);
        assert!(program.error().contains("cannot be reached"));
        assert_eq!(program.line(), None);
    });
}
