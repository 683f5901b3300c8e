//! Servers and sensors that drip, fall silent or flood: a client waits for each step once, and is
//! asked to leave in every wait.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use gantry_tau_client::{ClientError, Connection};
use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::client::{Event, Requirements};
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::{
    AxisLimits, AxisState, Capabilities, Cause, Counters, Mode, Phase, ServerMessage, State,
    Welcome,
};
use gantry_tau_core::control::wire::encode_server;
use gantry_tau_core::units::{Epoch, Sequence, Tick};
use gantry_tau_server::links::accelerometer::AccelerometerReader;
use gantry_tau_server::links::gauges::{GaugeReader, HEAD};
use gantry_tau_tests::DEADLINE;
use gantry_tau_tests::server_fixture::LOOPBACK;

/// Patience of the clients.
const PATIENCE: Duration = Duration::from_millis(500);
/// A wait that a test must not sit through.
const FOR_EVER: Duration = Duration::from_secs(3_600);
/// Pause between two dripped bytes: less than any wait for a byte.
const DRIP: Duration = Duration::from_millis(50);

fn welcome() -> Vec<u8> {
    let welcome = Welcome {
        epoch: Epoch(7),
        tick: Tick(5),
        cycle_us: 1_000,
        echo_window: 0,
        capabilities: Capabilities::NONE,
        kinematics_checksum: 0,
        limits: [AxisLimits::DISABLED; 3],
    };
    encode_server(&ServerMessage::<3>::Welcome(welcome)).to_vec()
}

fn state(tick: u64) -> Vec<u8> {
    let state = State {
        tick: Tick(tick),
        epoch: Epoch(7),
        accepted: Sequence(0),
        phase: Phase::Handshake,
        cause: Cause::None,
        on_time_of_100: 100,
        arrival_us: 0,
        ramp_ticks_left: 0,
        counters: Counters::default(),
        sensor: None,
        axes: [AxisState::default(); 3],
    };
    encode_server(&ServerMessage::State(state)).to_vec()
}

/// A server that takes a client, sends `first` once it has heard something, then drips `rest`; and
/// counts the dripped bytes.
struct Dripping {
    address: SocketAddr,
    dripped: Arc<AtomicUsize>,
    thread: JoinHandle<()>,
}

impl Dripping {
    fn new(first: Vec<u8>, rest: Vec<u8>) -> Self {
        let listener = TcpListener::bind(LOOPBACK).unwrap();
        let address = listener.local_addr().unwrap();
        let dripped = Arc::<AtomicUsize>::default();
        let count = Arc::clone(&dripped);
        let thread = std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            stream.read_exact(&mut [0; 16]).unwrap();
            stream.write_all(&first).unwrap();
            for byte in rest {
                std::thread::sleep(DRIP);
                if stream.write_all(&[byte]).is_err() {
                    return;
                }
                count.fetch_add(1, Ordering::Relaxed);
            }
            // Held open until the client leaves.
            let _ = stream.read_to_end(&mut Vec::new());
        });
        Self {
            address,
            dripped,
            thread,
        }
    }

    fn client<'q>(&self, patience: Duration, quit: &'q AtomicBool) -> Connection<'q, 3> {
        let requirements = Requirements::default();
        Connection::open_unless(
            quit,
            Transport::Stream,
            self.address,
            patience,
            requirements,
        )
        .unwrap()
    }

    /// Ends the server; returns the number of bytes that were dripped while the client waited.
    fn dripped(self, client: Connection<'_, 3>) -> usize {
        let dripped = self.dripped.load(Ordering::Relaxed);
        drop(client);
        self.thread.join().unwrap();
        dripped
    }
}

/// Found by attack: a Welcome that came byte by byte held the client for 19 s, for each byte ended
/// a wait.
#[test]
fn a_dripped_welcome_is_waited_for_once() {
    let mut welcome = welcome();
    welcome.pop();
    let (server, quit) = (
        Dripping::new(Vec::new(), welcome.clone()),
        AtomicBool::new(false),
    );
    let mut client = server.client(PATIENCE, &quit);
    let error = client.greet().unwrap_err();
    assert!(matches!(error, ClientError::Vanished(_)), "{error}");
    let dripped = server.dripped(client);
    assert!(
        dripped < welcome.len(),
        "the client waited for all of {dripped} bytes"
    );
}

/// As found: States went on and on, or came byte by byte, and the Goodbye was not heard.
#[test]
fn a_goodbye_that_is_not_acknowledged_is_waited_for_once() {
    let drip: Vec<u8> = (7..).flat_map(state).take(1_000).collect();
    let (server, quit) = (
        Dripping::new([welcome(), state(6)].concat(), drip.clone()),
        AtomicBool::new(false),
    );
    let mut client = server.client(PATIENCE, &quit);
    client.greet().unwrap();
    let Event::State(_) = client.next_event().unwrap() else {
        panic!("not a State")
    };
    client.answer(Mode::Submit, &[Offsets::ZERO; 3]).unwrap();
    let error = client.leave().unwrap_err();
    assert!(
        error
            .to_string()
            .contains("has not acknowledged the Goodbye"),
        "{error}"
    );
    assert_eq!(error.exit_code(), 7);
    let dripped = server.dripped(client);
    assert!(
        dripped < drip.len(),
        "the client waited for all of {dripped} bytes"
    );
}

/// A client that is asked to leave waits for nothing: neither for a Welcome nor for a State.
#[test]
fn every_wait_ends_when_the_client_is_asked_to_leave() {
    let mut half = welcome();
    half.truncate(20);
    for first in [
        Vec::new(),
        half,
        welcome(),
        [welcome(), state(6), state(7)[..20].to_vec()].concat(),
    ] {
        let (server, quit) = (Dripping::new(first, Vec::new()), AtomicBool::new(false));
        let mut client = server.client(FOR_EVER, &quit);
        std::thread::scope(|scope| {
            let waiting = scope.spawn(|| {
                let _ = client.greet()?;
                loop {
                    client.next_event()?;
                }
            });
            // Whether it waits already or not.
            std::thread::sleep(Duration::from_millis(200));
            quit.store(true, Ordering::Relaxed);
            let ended: Result<(), ClientError> = waiting.join().unwrap();
            assert!(matches!(ended, Err(ClientError::Quit)), "{ended:?}");
        });
        server.dripped(client);
    }
}

/// A peer that sends `bytes` as fast as they are taken, and then holds the connection.
fn flooding(bytes: Vec<u8>) -> (SocketAddr, JoinHandle<()>) {
    let listener = TcpListener::bind(LOOPBACK).unwrap();
    let address = listener.local_addr().unwrap();
    let flood = std::thread::spawn(move || {
        let (mut stream, _): (TcpStream, _) = listener.accept().unwrap();
        stream.set_write_timeout(Some(DEADLINE)).unwrap();
        let _ = stream.write_all(&bytes).map(|()| stream.read(&mut [0]));
    });
    (address, flood)
}

/// Bytes that a visit to a stream of records reads at most.
const VISIT: usize = 16 * 16_384;
/// Bytes of a flood: many visits.
const FLOOD: usize = 16 * VISIT;

/// Checks that each visit takes a bounded number of records, the last of which counts, and that the
/// last of all is found.
fn assert_bounded(record: usize, mut latest: impl FnMut() -> Option<u64>) {
    let last = u64::try_from(FLOOD / record).unwrap();
    let most = u64::try_from(VISIT / record + 1).unwrap();
    let mut before = 0;
    gantry_tau_tests::wait_for("the last record", || {
        let tick = latest().unwrap_or(0);
        assert!(
            tick >= before && tick - before <= most,
            "{tick} after {before} in one visit"
        );
        before = tick;
        tick == last
    });
}

/// Found by attack: a sensor (which had a port then) that sends faster than it is read kept the client in one call, and
/// cost it its session.
#[test]
fn a_visit_to_an_accelerometer_or_to_gauges_that_flood_is_bounded() {
    let quit = AtomicBool::new(false);
    let records = (1..)
        .take(FLOOD / 56)
        .flat_map(|tick: u64| [&tick.to_le_bytes()[..], &[0; 48]].concat());
    let (address, flood) = flooding(records.collect());
    let mut reader = AccelerometerReader::connect(address, &quit).unwrap();
    assert_bounded(56, || reader.latest().unwrap().map(|sample| sample.tick));
    drop(reader);
    flood.join().unwrap();
    // Gauges without any gauge: the shortest records there are.
    let records = (1..)
        .take(FLOOD / HEAD)
        .flat_map(|tick: u64| [tick.to_le_bytes(), [0; 8]].concat());
    let (address, flood) = flooding(records.collect());
    let mut reader = GaugeReader::connect(address, &quit).unwrap();
    assert_bounded(HEAD, || {
        reader.latest().unwrap().map(|lengths| lengths.tick)
    });
    drop(reader);
    flood.join().unwrap();
}
