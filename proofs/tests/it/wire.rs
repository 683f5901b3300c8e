//! T8 on stable Rust: every kind at 1, 3 and 6 axes, full sizes, streams with noise, random cuts.

use gantry_tau_core::control::axis::{Actual, Offsets};
use gantry_tau_core::control::channel::Limits;
use gantry_tau_core::control::message::{
    AxisFlags, AxisLimits, AxisState, Capabilities, Cause, ClientMessage, Command, Counters, Hello,
    Mode, Phase, Refusal, ServerMessage, State, Welcome,
};
use gantry_tau_core::control::wire::{
    Body, Collector, FrameError, HEADER_LEN, Kind, MAX_FRAME, Notice, PROTOCOL_VERSION, Stage,
    Suite, TRAILER_LEN, encode_client, encode_server,
};
use gantry_tau_core::units::{
    Epoch, ForceMn, MomentUnm, OffsetNm, PositionNm, Sequence, Tick, TorquePermille, VelocityUmS,
    WrenchSample,
};
use gantry_tau_proofs::properties::wire::{
    body_is_canonical, body_survives, chunk_is_collected, cut_frame_is_judged_alike,
    cutting_changes_nothing, feed_is_judged, frame_is_parsed, frame_survives, message_is_canonical,
    notice_is_read, sealed, sealed_frame_is_judged,
};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::test_runner::TestRng;

use crate::any::checked;

/// Endless random numbers: a message is drawn from them field by field.
#[derive(Debug)]
struct Draw(TestRng);

impl Draw {
    fn one_of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.0.random_range(0..choices.len())]
    }
    fn offsets(&mut self) -> Offsets {
        let Self(rng) = self;
        Offsets {
            position: OffsetNm(rng.random()),
            velocity: VelocityUmS(rng.random()),
            torque: TorquePermille(rng.random()),
        }
    }
    fn limits<U: std::fmt::Debug>(&mut self) -> Limits<U> {
        let [max, step, ramp] = std::array::from_fn(|_| self.0.random_range(0..1_i32 << 29));
        let ramp = ramp / 4 + 1;
        let step = ramp + step / 4;
        checked(max, step, step + ramp, ramp)
    }
    fn hello(&mut self) -> Hello {
        Hello {
            axes: self.0.random(),
            capabilities: Capabilities(self.0.random()),
        }
    }
    fn command<const N: usize>(&mut self) -> Command<N> {
        Command {
            epoch: Epoch(self.0.random()),
            sequence: Sequence(self.0.random()),
            echo: Tick(self.0.random()),
            mode: self.one_of(Mode::ALL),
            targets: std::array::from_fn(|_| self.offsets()),
        }
    }
    fn welcome<const N: usize>(&mut self) -> Welcome<N> {
        Welcome {
            epoch: Epoch(self.0.random()),
            tick: Tick(self.0.random()),
            cycle_us: self.0.random(),
            echo_window: self.one_of(&[0, 1, 255]),
            capabilities: Capabilities(self.0.random()),
            kinematics_checksum: self.0.random(),
            limits: std::array::from_fn(|_| AxisLimits {
                position: self.limits(),
                velocity: Limits::DISABLED,
                torque: self.limits(),
            }),
        }
    }
    fn counters(&mut self) -> Counters {
        let Self(rng) = self;
        Counters {
            received: rng.random(),
            missed: rng.random(),
            late: rng.random(),
            duplicate: rng.random(),
            stale: rng.random(),
            malformed: rng.random(),
            out_of_range: rng.random(),
            limited: rng.random(),
            clamped: rng.random(),
            non_owner: rng.random(),
            longest_miss_run: rng.random(),
        }
    }
    fn axis(&mut self) -> AxisState {
        let Offsets {
            velocity, torque, ..
        } = self.offsets();
        AxisState {
            nominal: PositionNm(self.0.random()),
            offsets: self.offsets(),
            shadow: self.offsets(),
            actual: Actual {
                position: PositionNm(self.0.random()),
                velocity,
                torque,
            },
            flags: AxisFlags::from_bits(self.0.random::<u8>() & AxisFlags::ALL.bits()).unwrap(),
        }
    }
    fn sensor(&mut self) -> Option<WrenchSample> {
        self.0.random::<bool>().then(|| WrenchSample {
            age: self.0.random(),
            is_cut: self.0.random(),
            force: std::array::from_fn(|_| ForceMn(self.0.random())),
            moment: std::array::from_fn(|_| MomentUnm(self.0.random())),
        })
    }
    fn state<const N: usize>(&mut self) -> State<N> {
        State {
            tick: Tick(self.0.random()),
            epoch: Epoch(self.0.random()),
            accepted: Sequence(self.0.random()),
            phase: self.one_of(Phase::ALL),
            cause: self.one_of(Cause::ALL),
            on_time_of_100: self.0.random(),
            arrival_us: self.0.random(),
            ramp_ticks_left: self.0.random(),
            counters: self.counters(),
            sensor: self.sensor(),
            axes: std::array::from_fn(|_| self.axis()),
        }
    }
    fn refusal(&mut self) -> Refusal {
        let (ticks_left, byte) = (self.0.random(), self.0.random());
        self.one_of(&[
            Refusal::Busy,
            Refusal::Ramping { ticks_left },
            Refusal::Faulted { ticks_left },
            Refusal::Axes { expected: byte },
            Refusal::Capability {
                needed: Capabilities(u16::from(byte)),
            },
            Refusal::Unavailable,
        ])
    }
    /// One frame of every kind.
    fn frames<const N: usize>(&mut self) -> [Vec<u8>; 7] {
        [
            encode_client::<N>(&ClientMessage::Hello(self.hello())),
            encode_client::<N>(&ClientMessage::Command(self.command())),
            encode_client::<N>(&ClientMessage::Goodbye(Epoch(self.0.random()))),
            encode_client::<N>(&ClientMessage::Stop(Epoch(self.0.random()))),
            encode_server::<N>(&ServerMessage::Welcome(self.welcome())),
            encode_server::<N>(&ServerMessage::State(self.state())),
            encode_server::<N>(&ServerMessage::Refusal(self.refusal())),
        ]
        .map(|frame| frame.to_vec())
    }
}

fn draw() -> impl Strategy<Value = Draw> {
    Just(()).prop_perturb(|(), rng| Draw(rng))
}

/// Every body survives, and is the only one of its bytes; so are the bytes with one of them
/// damaged, if they are a body.
fn bodies_are_canonical<const N: usize>(draw: &mut Draw, at: usize, value: u8) {
    fn judge<B: Body + PartialEq>(kind: Kind, body: &B, at: usize, value: u8) {
        body_survives(body);
        frame_survives(kind, body, at);
        let mut bytes = vec![0; B::LENGTH];
        body.write(&mut bytes).unwrap();
        body_is_canonical::<B>(&bytes).unwrap();
        bytes[at % B::LENGTH] = value;
        let _judged = body_is_canonical::<B>(&bytes);
    }
    judge(Kind::Hello, &draw.hello(), at, value);
    judge(Kind::Command, &draw.command::<N>(), at, value);
    judge(Kind::Stop, &Epoch(draw.0.random()), at, value);
    judge(Kind::Welcome, &draw.welcome::<N>(), at, value);
    judge(Kind::State, &draw.state::<N>(), at, value);
    judge(Kind::Refusal, &draw.refusal(), at, value);
}

/// A collector that holds the first bytes of a frame, or of noise.
fn collector(bytes: &[u8], held: usize) -> Option<Collector> {
    let mut whole = [0; MAX_FRAME];
    let held = held % (bytes.len() + 1);
    whole[..held].copy_from_slice(&bytes[..held]);
    Collector::from_parts(whole, held, Suite::Checksum)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1_000))]

    #[test]
    fn bodies_survive_and_are_canonical(mut draw in draw(), at in 0..400usize, value: u8) {
        bodies_are_canonical::<1>(&mut draw, at, value);
        bodies_are_canonical::<3>(&mut draw, at, value);
        bodies_are_canonical::<6>(&mut draw, at, value);
    }

    #[test]
    fn frames_are_canonical(mut draw in draw(), at in 0..400usize, value in prop::option::of(any::<u8>())) {
        for mut frame in draw.frames::<1>().into_iter().chain(draw.frames::<3>()).chain(draw.frames::<6>()) {
            let good = frame.clone();
            let length = frame.len();
            if let Some(value) = value {
                frame[at % length] = value;
            }
            let canonical = message_is_canonical::<1>(&frame) || message_is_canonical::<3>(&frame) || message_is_canonical::<6>(&frame);
            // A changed byte changes the checksum; what parses is what was encoded.
            prop_assert_eq!(frame_is_parsed(&frame, at).is_ok(), frame == good);
            prop_assert_eq!(canonical, frame == good);
        }
    }

    #[test]
    fn notices_are_read(reason: u8, detail: u8) {
        notice_is_read(Notice { reason, detail });
    }

    #[test]
    fn any_header_is_judged(
        version in prop_oneof![Just(1_u8), Just(PROTOCOL_VERSION), any::<u8>()], kind in prop_oneof![Just(7_u8), any::<u8>()],
        length in prop_oneof![Just(8_u16), 0..500_u16, any::<u16>()], suite in prop_oneof![Just(0_u16), Just(1_u16), any::<u16>()],
        mut held in 0..HEADER_LEN,
    ) {
        let mut header = *b"GT......";
        header[2] = version;
        header[3] = kind;
        header[4..6].copy_from_slice(&length.to_le_bytes());
        header[6..].copy_from_slice(&suite.to_le_bytes());
        let frame = [&header[..], &vec![0; usize::from(length) + TRAILER_LEN]].concat();
        let _judged = frame_is_parsed(&frame, 0);
        let mut whole = [0; MAX_FRAME];
        held %= HEADER_LEN;
        whole[..held].copy_from_slice(&header[..held]);
        let collector = Collector::from_parts(whole, held, Suite::Checksum).unwrap();
        let _judged = chunk_is_collected(&collector, &header[held..], 0);
    }

    #[test]
    fn chunks_are_collected(
        mut draw in draw(), kind in 0..7usize, held in 0..MAX_FRAME, length in 0..500usize, noise in vec(any::<u8>(), 0..20),
        damage: bool,
    ) {
        let mut stream = draw.frames::<6>()[kind].clone();
        let collector = collector(&stream, held).unwrap();
        let last = stream.len() - 1;
        stream[last] ^= u8::from(damage);
        stream.extend_from_slice(&noise);
        let all = &stream[collector.held().len()..];
        let part = &all[..length % (all.len() + 1)];
        for at in 0..stream.len() {
            prop_assert!(chunk_is_collected(&collector, part, at).is_ok());
        }
        for stage in [Stage::Collecting, Stage::Returned, Stage::Broken(FrameError::Magic)] {
            for chunk in [part, all] {
                let _returned = feed_is_judged(&collector, stage, chunk);
            }
        }
    }

    #[test]
    fn cut_frames_are_judged_alike(mut draw in draw(), kind in 0..7usize, cut in 0..MAX_FRAME, damage: bool, next in vec(any::<u8>(), 0..HEADER_LEN)) {
        let mut frame = draw.frames::<6>()[kind].clone();
        let length = frame.len();
        if damage {
            frame[length - 1] ^= 1;
        }
        prop_assert_eq!(cut_frame_is_judged_alike(&frame, cut % length, &next), !damage);
    }

    #[test]
    fn sealed_frames_are_judged(
        mut draw in draw(), version in prop_oneof![9 => Just(PROTOCOL_VERSION), 1 => any::<u8>()],
        kind in prop_oneof![9 => 0..9_u8, 1 => any::<u8>()], body in prop::option::of(vec(any::<u8>(), 0..400)),
        at in 0..400usize, value: u8, cut: u16, bit: u16,
    ) {
        for frame in draw.frames::<3>() {
            // The seal of this crate is that of core.
            let own = frame[HEADER_LEN..frame.len() - TRAILER_LEN].to_vec();
            prop_assert_eq!(&sealed(PROTOCOL_VERSION, frame[3], &own)[..], &frame[..]);
            let mut body = body.clone().unwrap_or(own);
            let length = body.len().max(1);
            if let Some(byte) = body.get_mut(at % length) {
                *byte = value;
            }
            sealed_frame_is_judged(version, if version == PROTOCOL_VERSION { frame[3] } else { kind }, &body, cut, bit);
        }
    }

    #[test]
    fn any_bytes_are_judged(bytes in vec(any::<u8>(), 0..500), lengths in vec(any::<u8>(), 1..9)) {
        let _judged = frame_is_parsed(&bytes, bytes.len() / 2);
        let _canonical = message_is_canonical::<3>(&bytes);
        cutting_changes_nothing(&bytes, &lengths);
    }

    #[test]
    fn a_stream_means_the_same_however_it_is_cut(mut draw in draw(), noise: Vec<u8>, lengths in vec(any::<u8>(), 1..9)) {
        let frames = draw.frames::<6>().into_iter().chain(draw.frames::<1>());
        let mut stream: Vec<u8> = frames.flatten().collect();
        stream.extend_from_slice(&noise);
        cutting_changes_nothing(&stream, &lengths);
    }
}
