//! Recorder: plays live, and writes down what it plays.

use std::collections::BTreeMap;

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::{Capabilities, Command, Mode, Phase};
use gantry_tau_core::control::session::{Connection, Output, Reading, Session};
use gantry_tau_core::control::wire::Suite;
use gantry_tau_core::units::{OffsetNm, Sequence};
use gantry_tau_tests::client::Noise;

use super::socket::Socket;
use super::{Recording, Serve};
use crate::firmware::host::control_cycle;
use crate::firmware::ingress_budget::IngressBudget;
use crate::firmware::machine::{
    AXES, CycleInput, CycleResult, Machine, Meter, Motion, Parts, Pose6,
};
use crate::firmware::recording::{Observer, Record, Sink, cycle};

/// Plays live, and writes down what it plays.
pub(super) struct Recorder {
    machine: Machine,
    bytes: Vec<u8>,
    /// Cycles so far.
    pub(super) cycles: u32,
    outcome: Vec<u8>,
    f1: Vec<bool>,
    greetings: Vec<bool>,
    serve: Serve,
    sockets: BTreeMap<Connection, Socket>,
    budget: IngressBudget,
    /// The non-owner that is read in this cycle.
    turn: Option<Connection>,
    seen: Seen,
}

/// Results of the last cycle.
#[derive(Default)]
struct Seen {
    closed: Vec<Connection>,
    is_f1: bool,
    corrections: Vec<OffsetNm>,
}

impl Meter for Seen {}

impl Observer for Seen {
    fn computed(&mut self, result: &CycleResult<'_>) {
        self.is_f1 = matches!(result, CycleResult::F1(_));
        self.corrections = match result {
            CycleResult::L2(Ok(result)) => result.correction.offsets.to_vec(),
            CycleResult::F1(Ok(result)) => result.correction.offsets.to_vec(),
            _ => Vec::new(),
        };
    }

    fn ticked(&mut self, _: Option<&Output<AXES>>, closed: &[Connection]) {
        self.closed = closed.to_vec();
    }
}

/// Outcome of one cycle, and its frames.
#[derive(Default)]
struct Outcome {
    bytes: Vec<u8>,
    frames: Vec<(Connection, Vec<u8>)>,
}

impl Sink for Outcome {
    fn write(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
    }

    fn frame(&mut self, to: Connection, frame: &[u8]) {
        self.bytes.frame(to, frame);
        self.frames.push((to, frame.to_vec()));
    }
}

impl Recorder {
    pub(super) fn new(motion: Motion, pose: Pose6, serve: Serve) -> Self {
        let mut input = CycleInput::on_time(motion, pose);
        let nominal = control_cycle().run(&input).nominal();
        let nominal = nominal.unwrap();
        input.tick.reading = Some(Reading::unmeasured(nominal));
        let mut recorder = Self {
            machine: Machine::new(
                Parts::new(control_cycle(), Capabilities::NONE, nominal).unwrap(),
                serve,
            ),
            bytes: Vec::new(),
            cycles: 0,
            outcome: Vec::new(),
            f1: Vec::new(),
            greetings: Vec::new(),
            serve,
            sockets: BTreeMap::new(),
            budget: IngressBudget::default(),
            turn: None,
            seen: Seen::default(),
        };
        recorder.write(&Record::Cycle(&input));
        recorder
    }

    pub(super) fn finish(mut self, name: &'static str) -> Recording {
        self.write(&Record::End);
        Recording {
            name,
            bytes: self.bytes,
            output: self.outcome,
            f1: self.f1,
            greetings: self.greetings,
            serve: self.serve,
        }
    }

    fn write(&mut self, record: &Record<'_>) {
        self.bytes.extend(super::encode(record));
    }

    /// Opens a connection: one per cycle. `None` also if the endpoint is full, which is recorded.
    pub(super) fn open(&mut self, transport: Transport) -> Option<Connection> {
        if !self.budget.accept() {
            return None;
        }
        self.write(&Record::Open(transport));
        let connection = self.machine.server().open(transport).ok()?;
        self.sockets.insert(connection, Socket::new(transport));
        self.turn = self.turn.or(Some(connection));
        Some(connection)
    }

    pub(super) fn close(&mut self, connection: Connection) {
        self.write(&Record::Close(connection));
        self.machine.server().close(connection);
        self.sockets.remove(&connection);
    }

    /// Lets bytes arrive: a piece of a stream, or a datagram.
    pub(super) fn feed(&mut self, connection: Connection, bytes: &[u8]) {
        if let Some(socket) = self.sockets.get_mut(&connection) {
            socket.waiting.push_back(bytes.to_vec());
            self.read(connection);
        }
    }

    /// Reads what has arrived, within the budget: of the owner, and of the non-owner whose turn it
    /// is.
    fn read(&mut self, connection: Connection) {
        let owner = self.owner();
        if owner != Some(connection) && self.turn != Some(connection) {
            return;
        }
        loop {
            let left = self.budget.left(connection, owner);
            let socket = self.sockets.get_mut(&connection);
            let Some(bytes) = socket.and_then(|socket| socket.receive(left)) else {
                return;
            };
            self.budget.count(connection, owner, bytes.len());
            self.write(&Record::Bytes(connection, &bytes));
            self.machine.server().feed(connection, &bytes);
        }
    }

    /// Runs one cycle. Returns the frames that were sent, and the connections that were closed.
    pub(super) fn cycle(
        &mut self,
        input: &CycleInput,
    ) -> (Vec<(Connection, Vec<u8>)>, Vec<Connection>) {
        self.write(&Record::Cycle(input));
        let mut outcome = Outcome::default();
        cycle(&mut self.machine, input, &mut outcome, &mut self.seen);
        self.outcome.extend(outcome.bytes);
        self.cycles += 1;
        self.f1.push(self.seen.is_f1);
        let greets = self.output().is_some_and(|output| {
            output.welcome.is_some() || output.state.phase == Phase::Listening
        });
        let is_keyed = self.machine.server().suite() == Suite::Tag;
        self.greetings.push(greets && is_keyed);
        let closed = self.seen.closed.clone();
        self.sockets
            .retain(|connection, _| !closed.contains(connection));
        self.read_on();
        (outcome.frames, closed)
    }

    /// Begins a cycle: what waited is read first.
    fn read_on(&mut self) {
        self.budget = IngressBudget::default();
        let owner = self.owner();
        let open = self.sockets.keys().copied();
        let others: Vec<Connection> = open.filter(|one| owner != Some(*one)).collect();
        let turn = usize::try_from(self.cycles).unwrap() % others.len().max(1);
        self.turn = others.get(turn).copied();
        for connection in owner.into_iter().chain(self.turn) {
            self.read(connection);
        }
    }

    pub(super) fn session(&mut self) -> &Session<AXES> {
        self.machine.server().session()
    }

    pub(super) fn owner(&mut self) -> Option<Connection> {
        self.session().owner()
    }

    pub(super) fn phase(&mut self) -> Phase {
        self.session().phase()
    }

    /// Output of the last cycle.
    pub(super) fn output(&self) -> Option<&Output<AXES>> {
        self.machine.output()
    }

    /// Returns the command that answers the last State.
    pub(super) fn command(&mut self, mode: Mode, targets: [Offsets; AXES]) -> Command<AXES> {
        let accepted = self.output().map_or(0, |output| output.state.accepted.0);
        let session = self.session();
        Command {
            epoch: session.epoch(),
            sequence: Sequence(accepted + 1),
            echo: session.last_tick(),
            mode,
            targets,
        }
    }

    /// Returns the correction of the last cycle, as offsets.
    pub(super) fn corrections(&self) -> [Offsets; AXES] {
        let mut targets = [Offsets::ZERO; AXES];
        for (target, offset) in targets.iter_mut().zip(&self.seen.corrections) {
            target.position = *offset;
        }
        targets
    }
}

/// Returns a pose on a closed curve around the middle of the workspace, a few centimetres and a
/// tenth of a radian wide.
pub(super) fn along(motion: Motion, cycle: u32) -> Pose6 {
    let turn = f64::from(cycle) * 1e-3;
    let [dx, dy, dz, rx, ry, rz] = [
        (0.05, 1.1),
        (0.04, 0.7),
        (0.03, 1.7),
        (0.02, 0.9),
        (0.1, 0.5),
        (0.1, 1.3),
    ]
    .map(|(amplitude, speed): (f64, f64)| amplitude * (speed * turn).sin());
    let [x, y, z] = match motion {
        Motion::F1 => [0.0, 0.0, 0.3],
        Motion::L2 | Motion::Given => [0.0, 0.5, 0.65],
    };
    [x + dx, y + dy, z + dz, rx, ry, rz]
}

/// Returns the sample of the force sensor of a tool that pushes, with some noise.
pub(super) fn pushing(cycle: u32, noise: &mut Noise) -> [f64; 6] {
    let turn = f64::from(cycle) * 1e-3;
    let [fx, fy, fz, mx, my, mz] = [(); 6].map(|()| noise.below(1_000) as f64 * 1e-3 - 0.5);
    // The tare is taken first. A few newtons: the way back from a micrometre takes ten ticks.
    let push = if cycle < 200 { 0.0 } else { 0.1 };
    [
        push * 150.0 * (2.0 * turn).sin() + fx,
        push * 80.0 * (3.0 * turn).cos() + fy,
        push * 300.0 * (0.5 * turn).sin() + fz,
        push * 5.0 * turn.cos() + 0.1 * mx,
        push * 4.0 * turn.sin() + 0.1 * my,
        push * 3.0 * (2.5 * turn).cos() + 0.1 * mz,
    ]
}
