//! T8 on stable Rust: every kind at 1, 3 and 6 axes, full sizes, streams with noise, random cuts.

use gantry_tau_core::control::axis::{Actual, Offsets};
use gantry_tau_core::control::channel::Limits;
use gantry_tau_core::control::message::{
    AxisFlags, AxisLimits, AxisState, Capabilities, Cause, ClientMessage, Command, Counters, Hello, Mode, Phase,
    Refusal, ServerMessage, State, Welcome,
};
use gantry_tau_core::control::wire::{Body, Collector, FrameError, MAX_FRAME, Stage, encode_client, encode_server};
use gantry_tau_core::units::{Epoch, OffsetNm, PositionNm, Sequence, Tick, TorquePermille, VelocityUmS};
use gantry_tau_proofs::wire::{
    body_is_canonical, body_survives, chunk_is_collected, cut_chunk_is_collected_alike, cut_frame_is_judged_alike,
    cutting_changes_nothing, feed_is_judged, frame_is_parsed, message_is_canonical, sealed, sealed_frame_is_judged,
};
use proptest::collection::vec;
use proptest::prelude::*;

use crate::any::checked;

/// Endless random numbers: a message is drawn from them field by field.
struct Draw(u64);

impl Draw {
    fn u64(&mut self) -> u64 {
        // SplitMix64.
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }
    fn bytes<const K: usize>(&mut self) -> [u8; K] {
        std::array::from_fn(|_| self.u64().to_le_bytes()[0])
    }
    fn u32(&mut self) -> u32 {
        u32::from_le_bytes(self.bytes())
    }
    fn i32(&mut self) -> i32 {
        i32::from_le_bytes(self.bytes())
    }
    fn i16(&mut self) -> i16 {
        i16::from_le_bytes(self.bytes())
    }
    fn one_of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[usize::from(self.bytes::<1>()[0]) % choices.len()]
    }
    fn offsets(&mut self) -> Offsets {
        Offsets {
            position: OffsetNm(self.i32()),
            velocity: VelocityUmS(self.i32()),
            torque: TorquePermille(self.i16()),
        }
    }
    fn position(&mut self) -> PositionNm {
        PositionNm(i64::from_le_bytes(self.bytes()))
    }
    fn limits<U: std::fmt::Debug>(&mut self) -> Limits<U> {
        let small = |n: u32| i32::try_from(n >> 3).unwrap();
        let ramp = small(self.u32()) / 4 + 1;
        let step = ramp + small(self.u32()) / 4;
        let max = small(self.u32());
        let accel = step + ramp;
        checked(max, step, accel, ramp)
    }
    fn hello(&mut self) -> Hello {
        let [axes, low, high] = self.bytes();
        Hello { axes, capabilities: Capabilities(u16::from_le_bytes([low, high])) }
    }
    fn command<const N: usize>(&mut self) -> Command<N> {
        Command {
            epoch: Epoch(self.u64()),
            sequence: Sequence(self.u64()),
            echo: Tick(self.u64()),
            mode: self.one_of(&[Mode::Submit, Mode::Obtain]),
            targets: std::array::from_fn(|_| self.offsets()),
        }
    }
    fn welcome<const N: usize>(&mut self) -> Welcome<N> {
        Welcome {
            epoch: Epoch(self.u64()),
            tick: Tick(self.u64()),
            cycle_us: self.u32(),
            echo_window: self.one_of(&[0, 1, 255]),
            capabilities: self.hello().capabilities,
            kinematics_checksum: self.u32(),
            limits: std::array::from_fn(|_| AxisLimits {
                position: self.limits(),
                velocity: Limits::DISABLED,
                torque: self.limits(),
            }),
        }
    }
    fn counters(&mut self) -> Counters {
        Counters {
            received: self.u32(),
            missed: self.u32(),
            late: self.u32(),
            duplicate: self.u32(),
            stale: self.u32(),
            malformed: self.u32(),
            out_of_range: self.u32(),
            limited: self.u32(),
            clamped: self.u32(),
            non_owner: self.u32(),
            longest_miss_run: u16::from_le_bytes(self.bytes()),
        }
    }
    fn axis(&mut self) -> AxisState {
        AxisState {
            nominal: self.position(),
            offsets: self.offsets(),
            shadow: self.offsets(),
            actual: Actual {
                position: self.position(),
                velocity: VelocityUmS(self.i32()),
                torque: TorquePermille(self.i16()),
            },
            flags: AxisFlags::from_bits(self.bytes::<1>()[0] & AxisFlags::ALL.bits()).unwrap(),
        }
    }
    fn state<const N: usize>(&mut self) -> State<N> {
        State {
            tick: Tick(self.u64()),
            epoch: Epoch(self.u64()),
            accepted: Sequence(self.u64()),
            phase: self.one_of(&[Phase::Listening, Phase::Submit, Phase::Obtain, Phase::Fault]),
            cause: self.one_of(&[Cause::None, Cause::Stop, Cause::Flood, Cause::Restart]),
            on_time_of_100: self.bytes::<1>()[0],
            arrival_us: u16::from_le_bytes(self.bytes()),
            ramp_ticks_left: self.u32(),
            counters: self.counters(),
            axes: std::array::from_fn(|_| self.axis()),
        }
    }
    fn refusal(&mut self) -> Refusal {
        let (ticks_left, byte) = (self.u32(), self.bytes::<1>()[0]);
        self.one_of(&[
            Refusal::Busy,
            Refusal::Ramping { ticks_left },
            Refusal::Faulted { ticks_left },
            Refusal::Version { supported: byte },
            Refusal::Axes { expected: byte },
            Refusal::Capability { needed: Capabilities(u16::from(byte)) },
            Refusal::Unavailable,
        ])
    }
    /// One frame of every kind.
    fn frames<const N: usize>(&mut self) -> [Vec<u8>; 7] {
        [
            encode_client::<N>(&ClientMessage::Hello(self.hello())),
            encode_client::<N>(&ClientMessage::Command(self.command())),
            encode_client::<N>(&ClientMessage::Goodbye(Epoch(self.u64()))),
            encode_client::<N>(&ClientMessage::Stop(Epoch(self.u64()))),
            encode_server::<N>(&ServerMessage::Welcome(self.welcome())),
            encode_server::<N>(&ServerMessage::State(self.state())),
            encode_server::<N>(&ServerMessage::Refusal(self.refusal())),
        ]
        .map(|frame| frame.to_vec())
    }
}

fn draw() -> impl Strategy<Value = Draw> {
    any::<u64>().prop_map(Draw)
}

impl std::fmt::Debug for Draw {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Draw({:#x})", self.0)
    }
}

fn every_body_survives<const N: usize>(draw: &mut Draw) {
    body_survives(&draw.hello());
    body_survives(&draw.command::<N>());
    body_survives(&Epoch(draw.u64()));
    body_survives(&draw.welcome::<N>());
    body_survives(&draw.state::<N>());
    body_survives(&draw.refusal());
}

/// Bytes that are a body, but for one byte.
fn damaged_bodies_are_canonical<const N: usize>(draw: &mut Draw, at: usize, value: u8) {
    fn damaged<B: Body>(body: &B, at: usize, value: u8) {
        let mut bytes = vec![0; B::LENGTH];
        body.write(&mut bytes).unwrap();
        body_is_canonical::<B>(&bytes).unwrap();
        bytes[at % B::LENGTH] = value;
        let _judged = body_is_canonical::<B>(&bytes);
    }
    damaged(&draw.hello(), at, value);
    damaged(&draw.command::<N>(), at, value);
    damaged(&draw.welcome::<N>(), at, value);
    damaged(&draw.state::<N>(), at, value);
    damaged(&draw.refusal(), at, value);
}

/// A collector that holds the first bytes of a frame, or of noise.
fn collector(bytes: &[u8], held: usize) -> Option<Collector> {
    let mut whole = [0; MAX_FRAME];
    let held = held % (bytes.len() + 1);
    whole[..held].copy_from_slice(&bytes[..held]);
    Collector::from_parts(whole, held)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1_000))]

    #[test]
    fn bodies_survive(mut draw in draw()) {
        every_body_survives::<1>(&mut draw);
        every_body_survives::<3>(&mut draw);
        every_body_survives::<6>(&mut draw);
    }

    #[test]
    fn bodies_are_canonical(mut draw in draw(), at in 0..400usize, value: u8) {
        damaged_bodies_are_canonical::<1>(&mut draw, at, value);
        damaged_bodies_are_canonical::<3>(&mut draw, at, value);
        damaged_bodies_are_canonical::<6>(&mut draw, at, value);
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
            prop_assert_eq!(frame_is_parsed(&frame).is_ok(), frame == good);
            prop_assert_eq!(canonical, frame == good);
        }
    }

    #[test]
    fn chunks_are_collected(
        mut draw in draw(), kind in 0..7usize, held in 0..MAX_FRAME, length in 0..500usize, cut in 0..500usize,
        noise in vec(any::<u8>(), 0..20),
    ) {
        let mut stream = draw.frames::<6>()[kind].to_vec();
        let collector = collector(&stream, held).unwrap();
        stream.extend_from_slice(&noise);
        let chunk = &stream[collector.held().len()..];
        let chunk = &chunk[..length % (chunk.len() + 1)];
        for at in 0..stream.len() {
            prop_assert!(chunk_is_collected(&collector, chunk, at).is_ok());
            cut_chunk_is_collected_alike(&collector, chunk, cut % (chunk.len() + 1), at);
        }
    }

    #[test]
    fn cut_frames_are_judged_alike(mut draw in draw(), kind in 0..7usize, cut in 0..MAX_FRAME, damage: bool, next in vec(any::<u8>(), 0..6)) {
        let mut frame = draw.frames::<6>()[kind].clone();
        let length = frame.len();
        if damage {
            frame[length - 1] ^= 1;
        }
        prop_assert_eq!(cut_frame_is_judged_alike(&frame, cut % length, &next), !damage);
    }

    #[test]
    fn feeds_are_judged(mut draw in draw(), kind in 0..7usize, held in 0..MAX_FRAME, noise in vec(any::<u8>(), 0..20), broken: bool) {
        let mut stream = draw.frames::<6>()[kind].to_vec();
        let collector = collector(&stream, held).unwrap();
        if broken {
            let last = stream.len() - 1;
            stream[last] ^= 1;
        }
        stream.extend_from_slice(&noise);
        let chunk = stream[collector.held().len()..].to_vec();
        for stage in [Stage::Collecting, Stage::Returned, Stage::Broken(FrameError::Magic)] {
            let _returned = feed_is_judged(&collector, stage, &chunk);
        }
    }

    #[test]
    fn sealed_frames_are_judged(
        mut draw in draw(), version in prop_oneof![9 => Just(1_u8), 1 => any::<u8>()],
        kind in prop_oneof![9 => 0..9_u8, 1 => any::<u8>()], body in prop::option::of(vec(any::<u8>(), 0..400)),
        at in 0..400usize, value: u8, cut: u16, bit: u16,
    ) {
        for frame in draw.frames::<3>() {
            // The seal of this crate is that of core.
            let own = frame[6..frame.len() - 4].to_vec();
            prop_assert_eq!(&sealed(1, frame[3], &own)[..], &frame[..]);
            let mut body = body.clone().unwrap_or(own);
            let length = body.len().max(1);
            if let Some(byte) = body.get_mut(at % length) {
                *byte = value;
            }
            sealed_frame_is_judged(version, if version == 1 { frame[3] } else { kind }, &body, cut, bit);
        }
    }

    #[test]
    fn any_bytes_are_judged(bytes in vec(any::<u8>(), 0..500), lengths in vec(any::<u8>(), 1..9)) {
        let _judged = frame_is_parsed(&bytes);
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
