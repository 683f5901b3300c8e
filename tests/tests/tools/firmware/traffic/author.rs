//! Who writes a recording down.

use std::collections::BTreeMap;

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::endpoint::{Transport, Turn};
use gantry_tau_core::control::message::{Capabilities, ClientMessage, Command, Mode, Phase};
use gantry_tau_core::control::session::Session;
use gantry_tau_core::control::session::fsm::Connection;
use gantry_tau_core::control::wire::encode_client;
use gantry_tau_core::units::{Epoch, OffsetNm, Sequence};
use gantry_tau_tests::client::Noise;

use super::Recording;
use super::socket::Socket;
use crate::firmware::machine::{
    AXES, Answer, MOTORS, Machine, Meter, Moment, Motion, Part, Parts, Pose6, Work,
};
use crate::firmware::reading::Reading;
use crate::firmware::recording::Watch;

/// Plays live, and writes down what it plays.
pub(super) struct Author {
    machine: Machine,
    bytes: Vec<u8>,
    /// What happened before the coming tick.
    happened: Vec<u8>,
    happenings: u16,
    opened: u64,
    /// Ticks so far.
    pub(super) ticks: u32,
    output: Vec<u8>,
    f1: Vec<bool>,
    /// The epoch of the next session.
    pub(super) next_epoch: u64,
    /// What the last tick corrected; nothing without an answer.
    corrections: Vec<OffsetNm>,
    sockets: BTreeMap<Connection, Socket>,
    reading: Reading,
    /// The stranger that is read in this tick.
    turn: Option<Connection>,
}

/// What a tick leads to.
#[derive(Default)]
struct Seen {
    closed: Vec<Connection>,
    welcomed: bool,
    by_f1: bool,
    corrections: Vec<OffsetNm>,
}

impl Meter for Seen {
    fn begin(&mut self) {}
    fn end(&mut self, _: Part) {}
}

impl Watch for Seen {
    fn wait(&mut self) {}
    fn answered(&mut self, answer: &Answer<'_>) {
        self.by_f1 = matches!(answer, Answer::F1(_));
        self.corrections = match answer {
            Answer::L2(Ok(answer)) => answer.correction.offsets.to_vec(),
            Answer::F1(Ok(answer)) => answer.correction.offsets.to_vec(),
            _ => Vec::new(),
        };
    }
    fn turned(&mut self, turn: &Turn<AXES, MOTORS>) {
        self.closed = turn.close.to_vec();
        self.welcomed = turn.output.welcome.is_some();
    }
}

impl Author {
    pub(super) fn new(motion: &Motion, pose: Pose6) -> Self {
        let nominal = Work::new()
            .unwrap()
            .0
            .answer(&moment(*motion, pose))
            .nominal();
        let nominal = nominal.unwrap();
        let mut bytes = Vec::new();
        for position in nominal {
            bytes.extend(position.0.to_le_bytes());
        }
        bytes.extend([0; 4]);
        Self {
            machine: Machine::new(Parts::new(Capabilities::NONE, nominal).unwrap()),
            bytes,
            happened: Vec::new(),
            happenings: 0,
            opened: 0,
            ticks: 0,
            output: Vec::new(),
            f1: Vec::new(),
            next_epoch: 1,
            corrections: Vec::new(),
            sockets: BTreeMap::new(),
            reading: Reading::default(),
            turn: None,
        }
    }

    pub(super) fn finish(mut self, name: &'static str) -> Recording {
        let at = AXES * 8;
        self.bytes[at..at + 4].copy_from_slice(&self.ticks.to_le_bytes());
        Recording {
            name,
            bytes: self.bytes,
            output: self.output,
            f1: self.f1,
        }
    }

    fn happen(&mut self, what: u8, connection: Connection, bytes: &[u8]) {
        self.happenings += 1;
        self.happened.push(what);
        self.happened
            .extend(u32::try_from(connection.0).unwrap().to_le_bytes());
        self.happened
            .extend(u16::try_from(bytes.len()).unwrap().to_le_bytes());
        self.happened.extend(bytes);
    }

    /// A connection. One is taken in per tick; none when there is no room, which is recorded as well.
    pub(super) fn open(&mut self, transport: Transport) -> Option<Connection> {
        if !self.reading.accept() {
            return None;
        }
        let what = u8::from(transport == Transport::Datagram);
        self.happen(what, Connection(self.opened), &[]);
        let connection = self.machine.server().open(transport).ok();
        self.opened += u64::from(connection.is_some());
        self.sockets
            .extend(connection.map(|connection| (connection, Socket::new(transport))));
        self.turn = self.turn.or(connection);
        connection
    }

    pub(super) fn close(&mut self, connection: Connection) {
        self.happen(2, connection, &[]);
        self.machine.server().close(connection);
        self.sockets.remove(&connection);
    }

    /// Bytes arrive: a piece of a stream, or a datagram.
    pub(super) fn feed(&mut self, connection: Connection, bytes: &[u8]) {
        if let Some(socket) = self.sockets.get_mut(&connection) {
            socket.waiting.push_back(bytes.to_vec());
            self.read(connection);
        }
    }

    /// Reads what has arrived as far as it is let in: of the owner, and of the stranger whose turn it is.
    fn read(&mut self, connection: Connection) {
        let owner = self.owner();
        if owner != Some(connection) && self.turn != Some(connection) {
            return;
        }
        loop {
            let left = self.reading.left(connection, owner);
            let socket = self.sockets.get_mut(&connection);
            let Some(bytes) = socket.and_then(|socket| socket.take(left)) else {
                return;
            };
            self.reading.note(connection, owner, bytes.len());
            self.happen(3, connection, &bytes);
            self.machine.server().feed(connection, &bytes);
        }
    }

    pub(super) fn say(&mut self, connection: Connection, message: &ClientMessage<AXES>) {
        self.feed(connection, &encode_client(message));
    }

    /// One tick. Returns the connections that are gone.
    pub(super) fn tick(&mut self, moment: &Moment) -> Vec<Connection> {
        self.bytes.extend(self.happenings.to_le_bytes());
        self.bytes.append(&mut self.happened);
        self.happenings = 0;
        write(&mut self.bytes, moment);
        let mut seen = Seen::default();
        crate::firmware::recording::tick(&mut self.machine, moment, &mut self.output, &mut seen);
        self.ticks += 1;
        self.corrections = seen.corrections;
        self.f1.push(seen.by_f1);
        self.next_epoch += u64::from(seen.welcomed);
        self.sockets
            .retain(|connection, _| !seen.closed.contains(connection));
        self.read_on();
        seen.closed
    }

    /// A new tick: what waited is read first.
    fn read_on(&mut self) {
        self.reading = Reading::default();
        let owner = self.owner();
        let open = self.sockets.keys().copied();
        let strangers: Vec<Connection> = open.filter(|one| owner != Some(*one)).collect();
        let turn = usize::try_from(self.ticks).unwrap() % strangers.len().max(1);
        self.turn = strangers.get(turn).copied();
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

    /// What a client answers to the last State.
    pub(super) fn command(&mut self, mode: Mode, targets: [Offsets; AXES]) -> Command<AXES> {
        let discrete = self.session().parts().discrete;
        Command {
            epoch: discrete.epoch,
            sequence: Sequence(discrete.accepted.0 + 1),
            echo: discrete.tick,
            mode,
            targets,
        }
    }

    /// The correction of the last tick, as offsets.
    pub(super) fn corrections(&self) -> [Offsets; AXES] {
        let mut targets = [Offsets::default(); AXES];
        for (target, offset) in targets.iter_mut().zip(&self.corrections) {
            target.position = *offset;
        }
        targets
    }
}

/// A tick in which nothing is special, without a load.
pub(super) fn moment(motion: Motion, pose: Pose6) -> Moment {
    Moment {
        elapsed: 1,
        stop: false,
        rearm: false,
        next_epoch: Epoch(1),
        arrival_us: 0,
        motion,
        pose,
        load: [0.0; 6],
    }
}

fn write(bytes: &mut Vec<u8>, moment: &Moment) {
    bytes.extend(moment.elapsed.to_le_bytes());
    bytes.extend([u8::from(moment.stop), u8::from(moment.rearm)]);
    bytes.extend(moment.next_epoch.0.to_le_bytes());
    bytes.extend(moment.arrival_us.to_le_bytes());
    match &moment.motion {
        Motion::Given { nominal, actual } => {
            bytes.push(0);
            for position in nominal {
                bytes.extend(position.0.to_le_bytes());
            }
            for actual in actual {
                bytes.extend(actual.position.0.to_le_bytes());
                bytes.extend(actual.velocity.0.to_le_bytes());
                bytes.extend(actual.torque.0.to_le_bytes());
            }
        }
        Motion::L2 => bytes.push(1),
        Motion::F1 => bytes.push(2),
    }
    for number in moment.pose.iter().chain(&moment.load) {
        bytes.extend(number.to_le_bytes());
    }
}

/// Along a closed curve around the middle of the workspace, a few centimetres and a tenth of a radian wide.
pub(super) fn along(motion: &Motion, tick: u32) -> Pose6 {
    let turn = f64::from(tick) * 1e-3;
    let wave = |amplitude: f64, speed: f64| amplitude * (speed * turn).sin();
    let [x, y, z] = match motion {
        Motion::F1 => [0.0, 0.0, 0.3],
        Motion::L2 | Motion::Given { .. } => [0.0, 0.5, 0.65],
    };
    [
        x + wave(0.05, 1.1),
        y + wave(0.04, 0.7),
        z + wave(0.03, 1.7),
        wave(0.02, 0.9),
        wave(0.1, 0.5),
        wave(0.1, 1.3),
    ]
}

/// What a tool that pushes is told by its sensor, with some noise.
pub(super) fn pushing(tick: u32, noise: &mut Noise) -> [f64; 6] {
    let turn = f64::from(tick) * 1e-3;
    let mut small = || noise.below(1_000) as f64 * 1e-3 - 0.5;
    // The tare is taken first. A few newtons: the way back from a micrometre takes ten ticks.
    let push = if tick < 200 { 0.0 } else { 0.1 };
    [
        push * 150.0 * (2.0 * turn).sin() + small(),
        push * 80.0 * (3.0 * turn).cos() + small(),
        push * 300.0 * (0.5 * turn).sin() + small(),
        push * 5.0 * turn.cos() + 0.1 * small(),
        push * 4.0 * turn.sin() + 0.1 * small(),
        push * 3.0 * (2.5 * turn).cos() + 0.1 * small(),
    ]
}
