//! Plays of the fuzzer's kind, and bursts between them.

use arbitrary::{Arbitrary, Unstructured};
use gantry_tau_core::control::axis::{Actual, Offsets};
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::{Capabilities, ClientMessage, Hello, Mode, Phase};
use gantry_tau_core::control::session::fsm::Connection;
use gantry_tau_core::control::wire::encode_client;
use gantry_tau_core::units::{Epoch, OffsetNm, PositionNm, Sequence, TorquePermille, VelocityUmS};
use gantry_tau_proofs::play::{Move, Shares, Who, Word};
use gantry_tau_tests::client::{Noise, enclose};

use super::author::{Author, along, moment, pushing};
use super::{Recording, TICKS};
use crate::firmware::machine::{AXES, Moment, Motion};

/// Bytes that arrive at once.
const BURST: usize = 1_024;

/// Plays of the fuzzer's kind, and bursts between them.
pub(super) fn record() -> Recording {
    let mut stage = Stage {
        author: Author::new(&Motion::L2, along(&Motion::L2, 0)),
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
                // Who was welcomed takes its time.
                Phase::Handshake if self.noise.below(2) == 0 => self.tick(1, false, false, None),
                Phase::Handshake | Phase::Submit | Phase::Obtain => {
                    let obtain = match self.author.phase() {
                        Phase::Handshake => false,
                        Phase::Submit => self.noise.below(3) == 0,
                        _ => true,
                    };
                    // Never nothing: there shall be a way back.
                    let share = i8::try_from(1 + self.noise.below(3)).unwrap();
                    self.answer(obtain, &[[share, 0, 0]; 2]);
                    self.tick(1, false, false, None);
                }
                Phase::SafeDisconnect | Phase::Fault => self.tick(1, false, true, None),
            }
        }
    }

    /// More than is read in a tick: more frames of the owner than core takes, a Stop behind them, a frame of every stranger and no end
    /// of what is no frame.
    fn burst(&mut self) {
        self.strangers.extend(self.author.open(Transport::Stream));
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
            bytes.extend(self.noise.bytes(BURST - bytes.len()));
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
            0 => 9,
            1 => 2,
            _ => 8,
        };
        for ahead in 0..frames {
            let most = self.share_of_limits([99, 99, 99], ahead % 2 == 0);
            let mut command = self.author.command(Mode::Obtain, [most; AXES]);
            // The last is the one that counts, and the reverse: each is better than the one before.
            command.sequence = Sequence(command.sequence.0 + ahead);
            bytes.extend(&*encode_client(&ClientMessage::Command(command)));
        }
        if kind < 2 {
            let epoch = self.author.session().parts().discrete.epoch;
            bytes.extend(&*encode_client::<AXES>(&ClientMessage::Stop(epoch)));
        }
        if kind == 1 {
            bytes.extend(enclose(1, 3, &[0xff; 384]));
        }
        bytes.truncate(BURST);
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
        // A stream comes in pieces, a datagram whole.
        let (one, other) = bytes.split_at(bytes.len() / 3);
        if self.clients[1] == Some(connection) {
            self.author.feed(connection, &bytes);
        } else {
            self.author.feed(connection, one);
            self.author.feed(connection, other);
        }
    }

    fn bytes(&mut self, word: &Word) -> Vec<u8> {
        let session = *self.author.session();
        let offsets = |targets: &Shares| {
            std::array::from_fn(|axis| self.share_of_limits(targets[axis % 2], true))
        };
        match (word.message(&session, offsets), word) {
            (Some(message), _) => encode_client(&message).to_vec(),
            (None, Word::Malformed) => enclose(1, 3, b"no command"),
            (None, Word::Dropped) => enclose(2, 1, b"a client of the next version"),
            (None, Word::Flood) => {
                let command = self
                    .author
                    .command(Mode::Obtain, [Offsets::default(); AXES]);
                encode_client(&ClientMessage::Command(command)).repeat(9)
            }
            (None, _) => self.noise.bytes(64),
        }
    }

    /// Shares of the limits of every channel, in hundredths.
    fn share_of_limits(&mut self, shares: [i8; 3], upwards: bool) -> Offsets {
        let limits = self.author.session().config().parameters().axes[0].limits;
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
        // Beyond a quarter turn for a while: there the plates' sine goes the longest way.
        if tick % 2_000 > 1_800 {
            pose[5] -= 1.66;
        }
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
        let axes = self.author.session().parts().axes;
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
