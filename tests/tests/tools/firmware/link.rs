//! A real client drives the emulated target: the unchanged program over TCP, through a cable that
//! is pulled.
//!
//!     client - relay (pulls the cable) - proxy (records) - emulator - firmware
//!
//! Nothing depends on speed: a tick is an answer. Three records must agree: the target's log, the
//! proxy's States, and the clients' recordings and exit codes.

mod journal;
pub(crate) mod program;
mod proxy;
mod target;
mod verdict;

use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::time::Duration;

use gantry_tau::faults::plan::FaultPlan;
use gantry_tau::faults::relay::Relay;
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::{self, Phase, Refusal, ServerMessage};
use gantry_tau_tests::client::Client;

use super::emulator::{self, Build};
use program::Running;
use proxy::Proxy;
use target::Target;
use verdict::Log;

/// Axes of the F1.
const AXES: usize = 6;

/// A State of the target.
type State = message::State<AXES>;

/// Longest wait before the test fails.
const PATIENCE: Duration = Duration::from_secs(60);
/// Ticks in Obtain until the offsets have settled.
const SETTLED: u64 = 400;

/// Submit, Obtain, a pulled cable, the ramp, and another client that obtains again and leaves.
/// Further clients are refused.
pub(crate) fn a_real_client_drives_the_target() {
    let image = emulator::images(Build::M7, &["--features", "link", "--bin", "link"]).join("link");
    let program = program::build();
    let target = Target::serve(Build::M7, &image, 2);
    let cell = Cell {
        program: &program,
        place: emulator::place("link"),
        proxy: Proxy::before(target.address),
        target,
    };
    let ramping = cell.lose_a_client();
    cell.let_a_client_leave();
    let (code, lines) = cell.target.end();
    let states = cell.proxy.states();
    println!("{}", lines.join("\n"));
    assert_eq!(code, Some(0), "the target found broken references");

    let log = Log(&lines);
    assert_eq!((log.total("sessions"), log.total("broken_ticks")), (2, 0));
    verdict::check_phases(&log, &states);
    verdict::check_refusals(&log, &states, ramping);
    let (lost, received) = verdict::check_session(&log, &states, 1, "ClientLate");
    verdict::check_pulled_cable(&lost);
    // The answer to the last State was on the cable, or had arrived.
    let rows = verdict::check_recording(&cell.place.join("lost.csv"), &lost);
    assert!(
        (received..=received + 1).contains(&rows),
        "{rows} rows, {received} received"
    );
    // The Goodbye answers no State.
    let (left, received) = verdict::check_session(&log, &states, 2, "Goodbye");
    let rows = verdict::check_recording(&cell.place.join("left.csv"), &left);
    assert_eq!(received, rows + 1);
}

/// Target and proxy.
struct Cell<'a> {
    program: &'a Path,
    place: PathBuf,
    proxy: Proxy,
    target: Target,
}

fn obtains(state: &State, epoch: u64) -> bool {
    state.epoch.0 == epoch && state.phase == Phase::Obtain
}

impl Cell<'_> {
    fn client(&self, name: &str, server: SocketAddr) -> Running {
        let server = server.to_string();
        let recording = self.place.join(format!("{name}.csv"));
        let arguments = [
            "client",
            "--robot",
            "f1",
            &server,
            "--record",
            recording.to_str().unwrap(),
        ];
        Running::start(self.program, &self.place, name, &arguments)
    }

    /// Waits until the session of this epoch is in Obtain, and its offsets have settled.
    fn await_settled(&self, epoch: u64) {
        let first = self
            .proxy
            .await_state("Obtain", |state| obtains(state, epoch));
        self.proxy.await_state("offsets at rest", |state| {
            obtains(state, epoch) && state.tick.0 >= first.tick.0 + SETTLED
        });
    }

    /// Submit, Obtain, a pulled cable, the ramp. Returns the ticks of ramp in the refusal of
    /// another client.
    fn lose_a_client(&self) -> u32 {
        let any = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let (relay, _) = Relay::spawn(
            any,
            self.proxy.address,
            Transport::Stream,
            FaultPlan::default(),
        )
        .unwrap();
        let mut client = self.client("lost", relay.address);
        self.proxy
            .await_state("Obtain", |state| state.phase == Phase::Obtain);
        let (code, said) = self.client("busy", self.proxy.address).end();
        assert_eq!(code, Some(4), "{said}");
        assert!(said.contains("another client owns the session"), "{said}");
        self.await_settled(1);
        assert!(client.process.is_running());

        relay.cut();
        self.proxy
            .await_state("the ramp", |state| state.phase == Phase::SafeDisconnect);
        let mut other = Client::<AXES>::connect(self.proxy.address);
        other.say_hello();
        let answer = other.receive();
        let Some(ServerMessage::Refusal(Refusal::Ramping { ticks_left })) = answer else {
            panic!("let in during the ramp: {answer:?}");
        };
        self.proxy.await_state("the ramp's end", |state| {
            state.phase == Phase::SafeDisconnect && state.ramp_ticks_left == 0
        });
        let (code, said) = client.end();
        assert_eq!(code, Some(7), "{said}");
        assert!(said.contains("the server vanished"), "{said}");
        ticks_left
    }

    /// Another client obtains again, and leaves.
    fn let_a_client_leave(&self) {
        assert!(self.target.await_line("phase=Listening").is_some());
        let client = self.client("left", self.proxy.address);
        self.await_settled(2);
        client.process.interrupt();
        let (code, said) = client.end();
        assert_eq!(code, Some(0), "{said}");
    }
}
