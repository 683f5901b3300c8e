//! Operations of the fuzzer's scenarios, and bursts between them.

use arbitrary::{Arbitrary, Unstructured};
use gantry_tau_core::control::axis::{Actual, InForce, Offsets};
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::{Capabilities, ClientMessage, Hello, Mode, Phase};
use gantry_tau_core::control::session::{Connection, LastWrite, Reading};
use gantry_tau_core::control::wire::{PROTOCOL_VERSION, encode_client};
use gantry_tau_core::units::{OffsetNm, PositionNm, Sequence, TorquePermille, VelocityUmS};
use gantry_tau_proofs::scenario::{ClientAction, Op, Peer, Shares};
use gantry_tau_tests::client::{Noise, enclose};

use super::recorder::{Recorder, along, pushing};
use super::{CYCLES, Recording};
use crate::firmware::machine::{AXES, CycleInput, Motion};
use crate::firmware::no_keys;

/// Measurements that no drive has.
const ACTUAL: Actual = Actual {
    position: PositionNm(i64::MIN),
    velocity: VelocityUmS(i32::MAX),
    torque: TorquePermille(i16::MIN),
};
/// Bytes that arrive at once.
const BURST: usize = 1_024;

/// Operations of the fuzzer's scenarios, and bursts between them.
pub(super) fn record() -> Recording {
    let mut peers = HostilePeers {
        recorder: Recorder::new(Motion::L2, along(Motion::L2, 0), no_keys::server),
        noise: Noise::new(2_013),
        clients: [None; 2],
        others: Vec::new(),
        drift: [0; AXES],
        refused: None,
        is_astray: false,
    };
    while peers.recorder.cycles < CYCLES {
        match peers.noise.below(4) {
            0 => peers.burst(),
            1 => peers.calm_down(),
            _ => {
                let bytes = peers.noise.bytes(96);
                let one = Op::arbitrary(&mut Unstructured::new(&bytes)).unwrap();
                peers.play(&one);
            }
        }
    }
    peers.recorder.finish("hostile")
}

/// The two clients of a scenario, other peers, and the machine meanwhile.
struct HostilePeers {
    recorder: Recorder,
    noise: Noise,
    clients: [Option<Connection>; 2],
    others: Vec<Connection>,
    drift: [i64; AXES],
    /// Shares of the limits in force after a refused write, for the next cycle.
    refused: Option<Shares>,
    /// The nominal positions are given, until Listening or Fault.
    is_astray: bool,
}

impl HostilePeers {
    fn play(&mut self, one: &Op) {
        match one {
            Op::Answer {
                obtain,
                targets,
                times,
            } => {
                for _ in 0..times % 40 {
                    self.answer(*obtain, targets);
                    self.tick(1, false, false, None);
                }
            }
            Op::Silence(ticks) => {
                (0..ticks % 8).for_each(|_| self.tick(1, false, false, None));
            }
            Op::Say(peer, action) => self.say(*peer, action),
            Op::Tick(what) => {
                let jump = what.jump.map(|to| [to; AXES]);
                self.tick(what.elapsed, what.stop, what.rearm, jump);
            }
            Op::Drift([one, other]) => {
                let drift = [*one, *other].map(|share| i64::from(share) * 20_000);
                self.drift = std::array::from_fn(|axis| drift[axis % 2]);
            }
            Op::RefusedWrite(shares) => self.refused = Some(*shares),
        }
    }

    /// Runs cycles until a client is in Obtain, out of a fault as well.
    fn calm_down(&mut self) {
        self.drift = [0; AXES];
        for _ in 0..120 {
            match self.recorder.phase() {
                Phase::Listening => {
                    let client = self.connection(0);
                    let hello = ClientAction::Hello {
                        axes: 0,
                        capabilities: 0,
                    };
                    if client.is_some() {
                        self.say(Peer::One, &hello);
                    }
                    self.tick(1, false, false, None);
                }
                // A welcomed client takes its time.
                Phase::Handshake if self.noise.below(2) == 0 => self.tick(1, false, false, None),
                Phase::Handshake | Phase::Submit | Phase::Obtain => {
                    let obtain = match self.recorder.phase() {
                        Phase::Handshake => false,
                        Phase::Submit => self.noise.below(3) == 0,
                        _ => true,
                    };
                    // Never zero, so that there is a ramp.
                    let share = i8::try_from(1 + self.noise.below(3)).unwrap();
                    self.answer(obtain, &[[share, 0, 0]; 2]);
                    self.tick(1, false, false, None);
                }
                Phase::SafeDisconnect | Phase::Fault => self.tick(1, false, true, None),
            }
        }
    }

    /// Sends more than is read in a cycle: more frames of the owner than core takes, a Stop behind
    /// them, and a frame and noise of every other peer.
    fn burst(&mut self) {
        self.others.extend(self.recorder.open(Transport::Stream));
        let kind = self.noise.below(6);
        for other in self.others.clone() {
            let mut bytes = match self.noise.below(3) {
                0 => encode_client::<AXES>(&ClientMessage::Hello(Hello {
                    axes: 6,
                    capabilities: Capabilities::NONE,
                }))
                .to_vec(),
                1 => enclose(PROTOCOL_VERSION, 3, &self.noise.bytes(384)),
                _ => {
                    let command = self
                        .recorder
                        .command(Mode::Obtain, [Offsets::default(); AXES]);
                    encode_client(&ClientMessage::Command(command)).to_vec()
                }
            };
            bytes.extend(self.noise.bytes(BURST - bytes.len()));
            self.recorder.feed(other, &bytes);
        }
        if let Some(owner) = self.recorder.owner() {
            let bytes = self.burst_of_the_owner(kind);
            self.recorder.feed(owner, &bytes);
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
            let mut command = self.recorder.command(Mode::Obtain, [most; AXES]);
            // Each is newer than the one before: the last counts.
            command.sequence = Sequence(command.sequence.0 + ahead);
            bytes.extend(&*encode_client(&ClientMessage::Command(command)));
        }
        if kind < 2 {
            let epoch = self.recorder.session().epoch();
            bytes.extend(&*encode_client::<AXES>(&ClientMessage::Stop(epoch)));
        }
        if kind == 1 {
            bytes.extend(enclose(PROTOCOL_VERSION, 3, &[0xff; 384]));
        }
        bytes.truncate(BURST);
        bytes
    }

    fn connection(&mut self, client: usize) -> Option<Connection> {
        if self.clients[client].is_none() {
            let transport = [Transport::Stream, Transport::Datagram][client];
            self.clients[client] = self.recorder.open(transport);
        }
        self.clients[client]
    }

    fn answer(&mut self, obtain: bool, targets: &Shares) {
        let first = self.recorder.phase() == Phase::Handshake;
        self.say(
            Peer::Owner,
            &ClientAction::Command {
                epoch: 0,
                ahead: 1,
                behind: 0,
                obtain: obtain && !first,
                targets: *targets,
            },
        );
    }

    fn say(&mut self, peer: Peer, action: &ClientAction) {
        let connection = match peer {
            Peer::Owner => self.recorder.owner(),
            Peer::One => self.connection(0),
            Peer::Other => self.connection(1),
        };
        let Some(connection) = connection else {
            return;
        };
        if *action == ClientAction::Closed {
            self.recorder.close(connection);
            return self.forget(&[connection]);
        }
        let bytes = self.bytes(action);
        // A stream arrives in pieces, a datagram whole.
        let (one, other) = bytes.split_at(bytes.len() / 3);
        if self.clients[1] == Some(connection) {
            self.recorder.feed(connection, &bytes);
        } else {
            self.recorder.feed(connection, one);
            self.recorder.feed(connection, other);
        }
    }

    fn bytes(&mut self, action: &ClientAction) -> Vec<u8> {
        let session = *self.recorder.session();
        let message = action.message(&session, |targets: &Shares| {
            std::array::from_fn(|axis| self.share_of_limits(targets[axis % 2], true))
        });
        match (message, action) {
            (Some(message), _) => encode_client(&message).to_vec(),
            (None, ClientAction::Malformed) => enclose(PROTOCOL_VERSION, 3, b"no command"),
            (None, ClientAction::Dropped) => {
                enclose(PROTOCOL_VERSION + 1, 1, b"a client of the next version")
            }
            (None, ClientAction::Flood) => {
                let command = self
                    .recorder
                    .command(Mode::Obtain, [Offsets::default(); AXES]);
                encode_client(&ClientMessage::Command(command)).repeat(9)
            }
            (None, _) => self.noise.bytes(64),
        }
    }

    /// Returns shares of the limits of every channel, in hundredths.
    fn share_of_limits(&mut self, shares: [i8; 3], upwards: bool) -> Offsets {
        let limits = self.recorder.session().config().parameters().axes[0].limits;
        // The ramp of a hundredth takes hundreds of ticks: only one position in fifty is larger.
        let part = if self.noise.below(50) == 0 { 1 } else { 100 };
        let largest = [
            limits.position.max() / part,
            limits.velocity.max(),
            limits.torque.max(),
        ];
        let [position, velocity, torque] = std::array::from_fn(|channel| {
            let value = i64::from(largest[channel]) * i64::from(shares[channel]) / 100;
            i32::try_from(if upwards { value } else { -value }).unwrap()
        });
        Offsets {
            position: OffsetNm(position),
            velocity: VelocityUmS(velocity),
            torque: TorquePermille(torque.try_into().unwrap()),
        }
    }

    fn tick(&mut self, elapsed: u32, stop: bool, rearm: bool, jump: Option<[i64; AXES]>) {
        let cycle = self.recorder.cycles;
        // Back from astray is a step of the nominal, a fault; so is every change between the
        // machines. Mostly it is the L2.
        if matches!(self.recorder.phase(), Phase::Listening | Phase::Fault) {
            self.is_astray = false;
        }
        self.is_astray |= self.drift.iter().any(|drift| *drift != 0);
        let motion = match jump {
            Some(_) => Motion::Given,
            None if self.is_astray => Motion::Given,
            None if cycle % 2_000 > 1_600 => Motion::F1,
            None => Motion::L2,
        };
        let mut load = pushing(cycle, &mut self.noise);
        let mut pose = along(motion, cycle);
        // Beyond a quarter turn for a while: there the plates' sine goes the longest way.
        if cycle % 2_000 > 1_800 {
            pose[5] -= 1.66;
        }
        let odd = [f64::NAN, f64::INFINITY, -1e300, 1e5, 1e-310, 3.0];
        match self.noise.below(60) {
            0 => load[self.noise.below(6)] = odd[self.noise.below(6)],
            1 => pose[self.noise.below(6)] = odd[self.noise.below(6)],
            2 => pose[self.noise.below(3)] += 0.7,
            _ => {}
        }
        let mut input = CycleInput::on_time(motion, pose);
        input.load = load;
        let last = self.nominal();
        let drifted = std::array::from_fn(|axis| last[axis].saturating_add(self.drift[axis]));
        let nominal = jump.unwrap_or(drifted).map(PositionNm);
        input.tick.reading = (self.noise.below(300) > 0).then_some(Reading {
            nominal,
            actual: [ACTUAL; AXES],
        });
        input.tick.elapsed_cycles = elapsed;
        input.tick.stop = stop;
        input.tick.rearm = rearm;
        input.arrival_us = u16::try_from(self.noise.below(1_000)).unwrap();
        input.fate = self.fate(&last);
        let (_, closed) = self.recorder.cycle(&input);
        self.forget(&closed);
    }

    /// Returns the nominal positions of the last cycle.
    fn nominal(&self) -> [i64; AXES] {
        let output = self.recorder.output();
        output.map_or([0; AXES], |output| {
            output.state.axes.map(|axis| axis.nominal.0)
        })
    }

    /// Returns the fate of the references of the cycle. What cannot be read back, or is beyond its
    /// limits, is mended after some cycles.
    fn fate(&mut self, nominal: &[i64; AXES]) -> LastWrite<AXES> {
        let output = self.recorder.output();
        let is_withheld = output.is_some_and(|output| output.withheld);
        let shares = match self.refused.take() {
            Some(shares) if shares.iter().flatten().all(|share| *share > 0) => {
                return LastWrite::Unknown;
            }
            Some(shares) => shares,
            None if is_withheld && self.noise.below(3) == 0 => [[0; 3]; 2],
            None => return LastWrite::Accepted,
        };
        let in_force = std::array::from_fn(|axis| InForce {
            nominal: PositionNm(nominal[axis]),
            offsets: self.share_of_limits(shares[axis % 2], true),
        });
        LastWrite::Refused { in_force }
    }

    fn forget(&mut self, gone: &[Connection]) {
        for client in &mut self.clients {
            *client = client.filter(|connection| !gone.contains(connection));
        }
        self.others.retain(|connection| !gone.contains(connection));
    }
}
