//! A real client drives the emulated target: the unchanged program over TCP, through a link whose cable is pulled.
//!
//!     client - relay (pulls the cable) - tap (hears, and is the force sensor) - emulator - firmware
//!
//! Nothing here depends on how fast anything is: a tick is an answer. The verdict is that three accounts agree: what the target says
//! about itself, what the tap heard on the way, and what the clients' recordings and exit codes say.

mod program;
mod tap;
mod target;
mod verdict;

use std::net::{Ipv4Addr, SocketAddr};
use std::path::Path;
use std::time::Duration;

use gantry_tau::faults::plan::FaultPlan;
use gantry_tau::faults::relay::Relay;
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::{self, Phase, Refusal, ServerMessage};
use gantry_tau_tests::client::Client;

use super::emulator::{self, Build};

use program::{Folder, Running};
use tap::Tap;
use target::Target;
use verdict::Told;

/// Axes of the F1.
const AXES: usize = 6;

/// A State of the target.
type State = message::State<AXES>;

/// How long anything may take before the test fails.
const PATIENCE: Duration = Duration::from_secs(60);
/// How long to wait before a process is looked at again.
const LOOK: Duration = Duration::from_millis(5);
/// What somebody pulls with, N: offsets of about 0.3 mm.
const PULL_N: f64 = 50.0;
/// Ticks in Obtain until the offsets have settled.
const SETTLED: u64 = 400;

/// Submit, Obtain, a pulled cable, the ramp, and another client that obtains again and leaves. Meanwhile strangers are refused.
pub(crate) fn a_real_client_drives_the_target() {
    let image = emulator::images(Build::M7, &["--features", "link", "--bin", "link"]).join("link");
    let program = program::build();
    let target = Target::serve(Build::M7, &image, 2);
    let cell = Cell {
        program: &program,
        folder: Folder::new("firmware-link"),
        tap: Tap::before(target.address, PULL_N),
        target,
    };
    let ramping = cell.lose_a_client();
    cell.let_a_client_leave();
    let (code, lines) = cell.target.end();
    let states = cell.tap.states();
    println!("{}", lines.join("\n"));
    assert_eq!(code, Some(0), "the target found something broken");

    let told = Told(&lines);
    assert_eq!(told.number("ticks", "", "sessions"), 2);
    assert_eq!(told.number("ticks", "", "broken_ticks"), 0);
    verdict::check_changes(&told, &states);
    verdict::check_refusals(&told, &states, ramping);
    let lost = verdict::check_session(&told, &states, 1, "ClientLate");
    verdict::check_pulled_cable(&lost);
    let left = verdict::check_session(&told, &states, 2, "Goodbye");
    // The answer to the last State was on the cable, or had arrived.
    let received = told.number("counters", "1", "received");
    let rows = verdict::check_recording(&cell.folder.path("lost.csv"), &lost);
    assert!(
        (received..=received + 1).contains(&rows),
        "{rows} rows, {received} received"
    );
    // The Goodbye answers no State.
    let received = told.number("counters", "2", "received");
    let rows = verdict::check_recording(&cell.folder.path("left.csv"), &left);
    assert_eq!(received, rows + 1);
}

/// Everything but the clients.
struct Cell<'a> {
    program: &'a Path,
    folder: Folder,
    tap: Tap,
    target: Target,
}

impl Cell<'_> {
    fn client(&self, name: &str, server: SocketAddr) -> Running {
        let (server, sensor) = (server.to_string(), self.tap.sensor.to_string());
        let recording = self.folder.path(&format!("{name}.csv"));
        let arguments = [
            "client",
            "--robot",
            "f1",
            &server,
            "--sensor",
            &sensor,
            "--record",
            recording.to_str().unwrap(),
        ];
        Running::start(self.program, &self.folder, name, &arguments)
    }

    /// Waits until the session of this epoch has obtained, and its offsets have settled.
    fn await_settled(&self, epoch: u64) {
        let obtains = |state: &State| state.epoch.0 == epoch && state.phase == Phase::Obtain;
        let since = self.tap.await_state("Obtain", obtains).tick.0;
        let settled = |state: &State| obtains(state) && state.tick.0 >= since + SETTLED;
        self.tap.await_state("offsets at rest", settled);
    }

    /// Submit, Obtain, a pulled cable, the ramp. Returns the ticks of ramp that a stranger was told to wait.
    fn lose_a_client(&self) -> u32 {
        let any = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let (relay, _) = Relay::spawn(
            any,
            self.tap.address,
            Transport::Stream,
            FaultPlan::default(),
        )
        .unwrap();
        let mut client = self.client("lost", relay.address);
        self.tap
            .await_state("Obtain", |state| state.phase == Phase::Obtain);
        let (code, said) = self.client("busy", self.tap.address).end();
        assert_eq!(code, Some(4), "{said}");
        assert!(said.contains("another client owns the session"), "{said}");
        self.await_settled(1);
        assert!(client.is_running());

        relay.cut();
        let ramps = |state: &State| state.phase == Phase::SafeDisconnect;
        self.tap.await_state("the ramp", ramps);
        let mut stranger = Client::<AXES>::connect(self.tap.address);
        stranger.say_hello();
        let answer = stranger.receive();
        let Some(ServerMessage::Refusal(Refusal::Ramping { ticks_left })) = answer else {
            panic!("let in during the ramp: {answer:?}");
        };
        self.tap.await_state("the ramp's end", |state| {
            ramps(state) && state.ramp_ticks_left == 0
        });
        let (code, said) = client.end();
        assert_eq!(code, Some(7), "{said}");
        assert!(said.contains("the server vanished"), "{said}");
        ticks_left
    }

    /// Another client obtains again, and says goodbye.
    fn let_a_client_leave(&self) {
        assert!(self.target.await_line("link session=1 ").is_some());
        let client = self.client("left", self.tap.address);
        self.await_settled(2);
        client.interrupt();
        let (code, said) = client.end();
        assert_eq!(code, Some(0), "{said}");
    }
}
