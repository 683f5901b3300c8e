//! Recordings: they are made by playing, for what a client says depends on what it is told.

use std::sync::OnceLock;

use arbitrary::{Arbitrary, Unstructured};
use gantry_tau_core::axis::{Actual, Offsets};
use gantry_tau_core::endpoint::Transport;
use gantry_tau_core::message::{Capabilities, ClientMessage, Command, Hello, Mode, Phase};
use gantry_tau_core::session::decide::Connection;
use gantry_tau_core::units::{
    Epoch, OffsetNm, PositionNm, Sequence, Tick, TorquePermille, VelocityUmS,
};
use gantry_tau_core::wire::encode_client;
use gantry_tau_proofs::play::{Move, Shares, Who, Word};
use gantry_tau_tests::client::{Noise, enclose};

use crate::host::{Phases, play};
use crate::machine::{AXES, Answer, Machine, Moment, Motion, Parts, Pose6, Work};
use crate::recording::CHUNK;

/// Ticks of a recording.
pub(crate) const TICKS: u32 = 10_000;

/// What is played on host and target.
pub(crate) struct Recording {
    /// Its name.
    pub(crate) name: &'static str,
    /// As `recording.rs` reads it.
    pub(crate) bytes: Vec<u8>,
    /// The output while it was made.
    pub(crate) output: Vec<u8>,
    /// Of every tick, whether its floats are those of the F1.
    pub(crate) f1: Vec<bool>,
}

/// A calm session with the L2's kinematics, towards the end of which the cable is pulled.
pub(crate) fn calm() -> &'static Recording {
    static MADE: OnceLock<Recording> = OnceLock::new();
    MADE.get_or_init(|| Author::calm("calm", Motion::L2))
}

/// The same with the F1's.
pub(crate) fn calm_f1() -> &'static Recording {
    static MADE: OnceLock<Recording> = OnceLock::new();
    MADE.get_or_init(|| Author::calm("calm_f1", Motion::F1))
}

/// Whatever a client, a stranger, a sensor and a machine can do wrong.
pub(crate) fn hostile() -> &'static Recording {
    static MADE: OnceLock<Recording> = OnceLock::new();
    MADE.get_or_init(Author::hostile)
}

/// All of them.
pub(crate) fn all() -> [&'static Recording; 3] {
    [calm(), calm_f1(), hostile()]
}

/// A recording that never leaves Listening would compare nothing.
pub(crate) fn recordings_show_every_phase() {
    let ticks_in =
        |Phases(phases): &Phases, phase| phases.iter().filter(|one| **one == phase).count();
    for recording in [calm(), calm_f1()] {
        let phases = play(&recording.bytes).phases;
        assert_eq!(phases.0.len(), 10_000);
        assert!(ticks_in(&phases, Phase::Obtain) > 5_000);
        for phase in [Phase::Listening, Phase::Submit, Phase::SafeDisconnect] {
            assert!(
                ticks_in(&phases, phase) > 0,
                "{}: no {phase:?}",
                recording.name
            );
        }
    }
    let phases = play(&hostile().bytes).phases;
    assert!(phases.0.len() >= 10_000);
    for phase in [
        Phase::Listening,
        Phase::Handshake,
        Phase::Submit,
        Phase::Obtain,
        Phase::SafeDisconnect,
        Phase::Fault,
    ] {
        let ticks = ticks_in(&phases, phase);
        println!("hostile: {ticks} ticks in {phase:?}");
        assert!(ticks > 50, "hostile: hardly any {phase:?}");
    }
}

/// Plays live, and writes down what it plays.
struct Author {
    machine: Machine,
    bytes: Vec<u8>,
    /// What happened before the coming tick.
    happened: Vec<u8>,
    happenings: u16,
    opened: u64,
    ticks: u32,
    output: Vec<u8>,
    f1: Vec<bool>,
    next_epoch: u64,
    answer: Option<Answer>,
}

impl Author {
    fn new(motion: &Motion, pose: Pose6) -> Self {
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
            answer: None,
        }
    }

    fn finish(mut self, name: &'static str) -> Recording {
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

    /// A connection; none when there is no room, which is recorded as well.
    fn open(&mut self, transport: Transport) -> Option<Connection> {
        let what = u8::from(transport == Transport::Datagram);
        self.happen(what, Connection(self.opened), &[]);
        let connection = self.machine.server().open(transport).ok();
        self.opened += u64::from(connection.is_some());
        connection
    }

    fn close(&mut self, connection: Connection) {
        self.happen(2, connection, &[]);
        self.machine.server().close(connection);
    }

    fn feed(&mut self, connection: Connection, bytes: &[u8]) {
        assert!(bytes.len() <= CHUNK);
        self.happen(3, connection, bytes);
        self.machine.server().feed(connection, bytes);
    }

    fn say(&mut self, connection: Connection, message: &ClientMessage<AXES>) {
        self.feed(connection, &encode_client(message));
    }

    /// One tick. Returns the connections that are gone.
    fn tick(&mut self, moment: &Moment) -> Vec<Connection> {
        self.bytes.extend(self.happenings.to_le_bytes());
        self.bytes.append(&mut self.happened);
        self.happenings = 0;
        write(&mut self.bytes, moment);
        let (turn, answer) = crate::recording::tick(
            &mut self.machine,
            moment,
            &mut self.output,
            &mut Phases::default(),
        );
        self.ticks += 1;
        self.f1.push(matches!(answer, Answer::F1(_)));
        self.answer = Some(answer);
        if let Some(_welcomed) = turn.output.welcome {
            self.next_epoch += 1;
        }
        turn.close.to_vec()
    }

    fn owner(&mut self) -> Option<Connection> {
        self.machine.server().session().owner()
    }

    fn phase(&mut self) -> Phase {
        self.machine.server().session().phase()
    }

    /// What a client answers to the last State.
    fn command(&mut self, mode: Mode, targets: [Offsets; AXES]) -> Command<AXES> {
        let discrete = self.machine.server().session().parts().discrete;
        Command {
            epoch: discrete.epoch,
            sequence: Sequence(discrete.accepted.0 + 1),
            echo: discrete.tick,
            mode,
            targets,
        }
    }

    /// The correction of the last tick, as offsets.
    fn corrections(&self) -> [Offsets; AXES] {
        let mut targets = [Offsets::default(); AXES];
        let offsets: Vec<OffsetNm> = match self.answer {
            Some(Answer::L2(Ok(answer))) => answer.correction.offsets.to_vec(),
            Some(Answer::F1(Ok(answer))) => answer.correction.offsets.to_vec(),
            _ => Vec::new(),
        };
        for (target, offset) in targets.iter_mut().zip(offsets) {
            target.position = offset;
        }
        targets
    }
}

/// A tick in which nothing is special, without a load.
fn moment(motion: Motion, pose: Pose6) -> Moment {
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
fn along(motion: &Motion, tick: u32) -> Pose6 {
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
fn pushing(tick: u32, noise: &mut Noise) -> [f64; 6] {
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

impl Author {
    /// A client that does everything right, but for a pulled cable; then a second session, which ends with a Goodbye.
    fn calm(name: &'static str, motion: Motion) -> Recording {
        let mut author = Self::new(&motion, along(&motion, 0));
        let mut noise = Noise::new(7);
        let mut client = None;
        while author.ticks < TICKS {
            let tick = author.ticks;
            // Pulled without a word; nobody hears of it for 500 ticks.
            let pulled = (7_000..7_500).contains(&tick);
            match client {
                None if !pulled && author.phase() == Phase::Listening && tick < 9_900 => {
                    client = author.open(Transport::Stream);
                    let hello = Hello {
                        axes: 6,
                        capabilities: Capabilities::NONE,
                    };
                    author.say(client.unwrap(), &ClientMessage::Hello(hello));
                }
                Some(connection) if !pulled => author.answer_calmly(connection, &mut noise),
                _ => {}
            }
            let next_epoch = Epoch(author.next_epoch);
            let gone = author.tick(&Moment {
                next_epoch,
                load: pushing(tick, &mut noise),
                ..moment(motion, along(&motion, tick))
            });
            client = client.filter(|connection| !gone.contains(connection));
        }
        author.finish(name)
    }

    fn answer_calmly(&mut self, connection: Connection, noise: &mut Noise) {
        let tick = self.ticks;
        if tick == 9_900 {
            let epoch = self.machine.server().session().parts().discrete.epoch;
            return self.say(connection, &ClientMessage::Goodbye(epoch));
        }
        let mode = match self.phase() {
            Phase::Submit if tick % 100 == 99 => Mode::Obtain,
            Phase::Obtain => Mode::Obtain,
            _ => Mode::Submit,
        };
        let targets = self.corrections();
        let command = ClientMessage::Command(self.command(mode, targets));
        let bytes = encode_client(&command);
        // In two pieces, wherever they are cut.
        let (one, other) = bytes.split_at(noise.below(bytes.len()));
        self.feed(connection, one);
        self.feed(connection, other);
    }
}

/// The two clients of a play, the strangers, and what the machine does meanwhile.
struct Stage {
    author: Author,
    noise: Noise,
    clients: [Option<Connection>; 2],
    strangers: Vec<Connection>,
    drift: [i64; AXES],
    /// The nominal positions are given, until nothing is at stake.
    astray: bool,
}

impl Author {
    /// Plays of the fuzzer's kind, and bursts between them.
    fn hostile() -> Recording {
        let mut stage = Stage {
            author: Self::new(&Motion::L2, along(&Motion::L2, 0)),
            noise: Noise::new(2_013),
            clients: [None; 2],
            strangers: Vec::new(),
            drift: [0; AXES],
            astray: false,
        };
        while stage.author.ticks < TICKS {
            match stage.noise.below(4) {
                0 => stage.burst(),
                1 => stage.calm_down(),
                _ => {
                    let bytes = stage.noise.bytes(96);
                    let one = Move::arbitrary(&mut Unstructured::new(&bytes)).unwrap();
                    stage.play(&one);
                }
            }
        }
        stage.author.finish("hostile")
    }
}

impl Stage {
    fn play(&mut self, one: &Move) {
        match one {
            Move::Answer {
                obtain,
                targets,
                times,
            } => {
                for _ in 0..times % 40 {
                    self.answer(*obtain, targets);
                    self.tick(1, false, false, None);
                }
            }
            Move::Silence(ticks) => {
                (0..ticks % 8).for_each(|_| self.tick(1, false, false, None));
            }
            Move::Say(who, word) => self.say(*who, word),
            Move::Tick(what) => {
                let jump = what.jump.map(|to| [to; AXES]);
                self.tick(what.elapsed, what.stop, what.rearm, jump);
            }
            Move::Drift([one, other]) => {
                let drift = [*one, *other].map(|share| i64::from(share) * 20_000);
                self.drift = std::array::from_fn(|axis| drift[axis % 2]);
            }
            // Nothing of the firmware's resumes.
            Move::Resume(_) => {}
        }
    }

    /// Whatever state it is in: out of the fault, until a client is in Obtain.
    fn calm_down(&mut self) {
        self.drift = [0; AXES];
        for _ in 0..120 {
            match self.author.phase() {
                Phase::Listening => {
                    let client = self.connection(0);
                    let hello = Word::Hello {
                        axes: 0,
                        capabilities: 0,
                    };
                    if client.is_some() {
                        self.say(Who::One, &hello);
                    }
                    self.tick(1, false, false, None);
                }
                Phase::Handshake | Phase::Submit | Phase::Obtain => {
                    let obtain = self.author.phase() != Phase::Handshake;
                    let share = i8::try_from(self.noise.below(3)).unwrap();
                    self.answer(obtain, &[[share, 0, 0]; 2]);
                    self.tick(1, false, false, None);
                }
                Phase::SafeDisconnect | Phase::Fault => self.tick(1, false, true, None),
            }
        }
    }

    /// As much as fits into a tick: as many frames as are read of the owner and more, a Stop behind them, a frame of as many strangers
    /// as there is room for, and no end of what is no frame.
    fn burst(&mut self) {
        while let Some(stranger) = self.author.open(Transport::Stream) {
            self.strangers.push(stranger);
        }
        let kind = self.noise.below(6);
        for stranger in self.strangers.clone() {
            let mut bytes = match self.noise.below(3) {
                0 => encode_client::<AXES>(&ClientMessage::Hello(Hello {
                    axes: 6,
                    capabilities: Capabilities::NONE,
                }))
                .to_vec(),
                1 => enclose(1, 3, &self.noise.bytes(384)),
                _ => {
                    let command = self
                        .author
                        .command(Mode::Obtain, [Offsets::default(); AXES]);
                    encode_client(&ClientMessage::Command(command)).to_vec()
                }
            };
            bytes.extend(self.noise.bytes(CHUNK - bytes.len()));
            self.author.feed(stranger, &bytes);
        }
        if let Some(owner) = self.author.owner() {
            let bytes = self.burst_of_the_owner(kind);
            self.author.feed(owner, &bytes);
        }
        let jump = (kind == 5).then_some([i64::MAX; AXES]);
        self.tick(1, kind == 4, false, jump);
    }

    fn burst_of_the_owner(&mut self, kind: usize) -> Vec<u8> {
        let mut bytes = Vec::new();
        let frames = match kind {
            // One too many, and a Stop that counts nevertheless.
            0 => 9,
            1 => 2,
            _ => 8,
        };
        for ahead in 0..frames {
            let most = self.share_of_limits([99, 99, 99], ahead % 2 == 0);
            let mut command = self.author.command(Mode::Obtain, [most; AXES]);
            // The last is the one that counts, and the reverse: each is better than the one before.
            command.sequence = Sequence(command.sequence.0 + ahead);
            bytes.extend(encode_client(&ClientMessage::Command(command)));
        }
        if kind < 2 {
            let epoch = self
                .author
                .machine
                .server()
                .session()
                .parts()
                .discrete
                .epoch;
            bytes.extend(encode_client::<AXES>(&ClientMessage::Stop(epoch)));
        }
        if kind == 1 {
            bytes.extend(enclose(1, 3, &[0xff; 384]));
        }
        bytes.truncate(CHUNK);
        bytes
    }

    fn connection(&mut self, client: usize) -> Option<Connection> {
        if self.clients[client].is_none() {
            let transport = [Transport::Stream, Transport::Datagram][client];
            self.clients[client] = self.author.open(transport);
        }
        self.clients[client]
    }

    fn answer(&mut self, obtain: bool, targets: &Shares) {
        let first = self.author.phase() == Phase::Handshake;
        self.say(
            Who::Owner,
            &Word::Command {
                epoch: 0,
                ahead: 1,
                behind: 0,
                obtain: obtain && !first,
                targets: *targets,
            },
        );
    }

    fn say(&mut self, who: Who, word: &Word) {
        let connection = match who {
            Who::Owner => self.author.owner(),
            Who::One => self.connection(0),
            Who::Other => self.connection(1),
        };
        let Some(connection) = connection else {
            return;
        };
        if *word == Word::Closed {
            self.author.close(connection);
            return self.forget(&[connection]);
        }
        let bytes = self.bytes(word);
        // A datagram is never cut.
        let cut = if self.clients[1] == Some(connection) {
            0
        } else {
            bytes.len() / 3
        };
        let (one, other) = bytes.split_at(cut);
        self.author.feed(connection, one);
        self.author.feed(connection, other);
    }

    fn bytes(&mut self, word: &Word) -> Vec<u8> {
        let discrete = self.author.machine.server().session().parts().discrete;
        let epoch_at = |from: &i8| Epoch(discrete.epoch.0.wrapping_add_signed((*from).into()));
        let message: ClientMessage<AXES> = match word {
            Word::Hello { axes, capabilities } => ClientMessage::Hello(Hello {
                axes: axes.wrapping_add(6),
                capabilities: Capabilities(*capabilities),
            }),
            Word::Command {
                epoch,
                ahead,
                behind,
                obtain,
                targets,
            } => ClientMessage::Command(Command {
                epoch: epoch_at(epoch),
                sequence: Sequence(discrete.accepted.0.wrapping_add_signed((*ahead).into())),
                echo: Tick(discrete.tick.0.wrapping_add_signed(-i64::from(*behind))),
                mode: if *obtain { Mode::Obtain } else { Mode::Submit },
                targets: std::array::from_fn(|axis| self.share_of_limits(targets[axis % 2], true)),
            }),
            Word::Goodbye { epoch } => ClientMessage::Goodbye(epoch_at(epoch)),
            Word::Stop { epoch } => ClientMessage::Stop(epoch_at(epoch)),
            Word::Malformed => return enclose(1, 3, b"no command"),
            Word::Dropped => return enclose(2, 1, b"a client of the next version"),
            Word::Broken | Word::Closed => return self.noise.bytes(64),
            Word::Flood => {
                let command = self
                    .author
                    .command(Mode::Obtain, [Offsets::default(); AXES]);
                return encode_client(&ClientMessage::Command(command)).repeat(9);
            }
        };
        encode_client(&message).to_vec()
    }

    /// Shares of the limits of every channel, in hundredths.
    fn share_of_limits(&mut self, shares: [i8; 3], upwards: bool) -> Offsets {
        let limits = self
            .author
            .machine
            .server()
            .session()
            .config()
            .parameters()
            .axes[0]
            .limits;
        let of = |max: i32, share: i8| {
            let value = i64::from(max) * i64::from(share) / 100;
            i32::try_from(if upwards { value } else { -value }).unwrap()
        };
        let [position, velocity, torque] = shares;
        Offsets {
            // A hundredth of it takes hundreds of ticks on the way back: most are small, and one in fifty is not.
            position: OffsetNm(if self.noise.below(50) == 0 {
                of(limits.position.max(), position)
            } else {
                of(limits.position.max() / 100, position)
            }),
            velocity: VelocityUmS(of(limits.velocity.max(), velocity)),
            torque: TorquePermille(of(limits.torque.max(), torque).try_into().unwrap()),
        }
    }

    fn tick(&mut self, elapsed: u32, stop: bool, rearm: bool, jump: Option<[i64; AXES]>) {
        let tick = self.author.ticks;
        // Back from astray is a step of the nominal, a fault; so is every change between the machines. Mostly it is the L2.
        if matches!(self.author.phase(), Phase::Listening | Phase::Fault) {
            self.astray = false;
        }
        self.astray |= self.drift.iter().any(|drift| *drift != 0);
        let motion = match jump {
            Some(_) => self.given(jump),
            None if self.astray => self.given(None),
            None if tick % 2_000 > 1_600 => Motion::F1,
            None => Motion::L2,
        };
        let mut load = pushing(tick, &mut self.noise);
        let mut pose = along(&motion, tick);
        let odd = [f64::NAN, f64::INFINITY, -1e300, 1e5, 1e-310, 3.0];
        match self.noise.below(60) {
            0 => load[self.noise.below(6)] = odd[self.noise.below(6)],
            1 => pose[self.noise.below(6)] = odd[self.noise.below(6)],
            2 => pose[self.noise.below(3)] += 0.7,
            _ => {}
        }
        let arrival_us = u16::try_from(self.noise.below(1_000)).unwrap();
        let gone = self.author.tick(&Moment {
            elapsed,
            stop,
            rearm,
            next_epoch: Epoch(self.author.next_epoch),
            arrival_us,
            load,
            ..moment(motion, pose)
        });
        self.forget(&gone);
    }

    fn given(&mut self, jump: Option<[i64; AXES]>) -> Motion {
        let actual = Actual {
            position: PositionNm(i64::MIN),
            velocity: VelocityUmS(i32::MAX),
            torque: TorquePermille(i16::MIN),
        };
        let axes = self.author.machine.server().session().parts().axes;
        let drifted =
            std::array::from_fn(|axis| axes[axis].nominal.0.saturating_add(self.drift[axis]));
        Motion::Given {
            nominal: jump.unwrap_or(drifted).map(PositionNm),
            actual: [actual; AXES],
        }
    }

    fn forget(&mut self, gone: &[Connection]) {
        for client in &mut self.clients {
            *client = client.filter(|connection| !gone.contains(connection));
        }
        self.strangers
            .retain(|connection| !gone.contains(connection));
    }
}
