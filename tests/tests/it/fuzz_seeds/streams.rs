//! Frames and streams of them, as clients and servers send them.

use gantry_tau_core::control::axis::{Actual, Offsets};
use gantry_tau_core::control::channel::Limits;
use gantry_tau_core::control::message::{
    AxisLimits, AxisState, Capabilities, ClientMessage, Command, Counters, Hello, Mode, Phase, Refusal, ServerMessage,
    State, Welcome,
};
use gantry_tau_core::control::wire::{encode_client, encode_server};
use gantry_tau_core::units::{Epoch, OffsetNm, PositionNm, Sequence, Tick};

use super::Seed;

const EPOCH: Epoch = Epoch(7);

/// The worked example of `wire.md`, or the same for so many axes.
fn command<const N: usize>(sequence: u64) -> Vec<u8> {
    let positions = [-100_000, 2_500, 0, 1, -1, i32::MAX];
    let targets = std::array::from_fn(|axis| Offsets { position: OffsetNm(positions[axis]), ..Offsets::default() });
    let command = Command::<N> {
        epoch: EPOCH,
        sequence: Sequence(sequence),
        echo: Tick(958 + sequence),
        mode: Mode::Obtain,
        targets,
    };
    encode_client(&ClientMessage::Command(command)).to_vec()
}

fn client(message: &ClientMessage<3>) -> Vec<u8> {
    encode_client(message).to_vec()
}

fn welcome<const N: usize>() -> Vec<u8> {
    let position = gantry_tau_tests::server_fixture::limits(100_000, 1_000, 2_000, 100);
    let limits = AxisLimits { position, velocity: Limits::DISABLED, torque: Limits::DISABLED };
    let welcome = Welcome::<N> {
        epoch: EPOCH,
        tick: Tick(999),
        cycle_us: 1_000,
        echo_window: 0,
        capabilities: Capabilities::NONE,
        kinematics_checksum: 0x1234_5678,
        limits: [limits; N],
    };
    encode_server(&ServerMessage::Welcome(welcome)).to_vec()
}

fn state<const N: usize>() -> Vec<u8> {
    let axis = AxisState {
        nominal: PositionNm(624_500_000),
        actual: Actual { position: PositionNm(624_499_950), ..Actual::default() },
        ..AxisState::default()
    };
    let state = State::<N> {
        tick: Tick(1_000),
        epoch: EPOCH,
        accepted: Sequence(41),
        phase: Phase::Obtain,
        on_time_of_100: 99,
        counters: Counters { received: 41, ..Counters::default() },
        axes: [axis; N],
        ..state_before()
    };
    encode_server(&ServerMessage::State(state)).to_vec()
}

fn state_before<const N: usize>() -> State<N> {
    State {
        tick: Tick(0),
        epoch: Epoch(0),
        accepted: Sequence(0),
        phase: Phase::Listening,
        cause: gantry_tau_core::control::message::Cause::None,
        on_time_of_100: 100,
        arrival_us: 0,
        ramp_ticks_left: 0,
        counters: Counters::default(),
        axes: [AxisState::default(); N],
    }
}

/// One frame of every kind.
fn frames() -> Vec<(&'static str, Vec<u8>)> {
    let hello = Hello { axes: 3, capabilities: Capabilities::LOCKSTEP };
    let ramping = Refusal::Ramping { ticks_left: 2_373 };
    vec![
        ("hello", client(&ClientMessage::Hello(hello))),
        ("command", command::<3>(42)),
        ("command_one_axis", command::<1>(42)),
        ("command_six_axes", command::<6>(42)),
        ("goodbye", client(&ClientMessage::Goodbye(EPOCH))),
        ("stop", client(&ClientMessage::Stop(EPOCH))),
        ("welcome", welcome::<3>()),
        ("welcome_six_axes", welcome::<6>()),
        ("state", state::<3>()),
        ("state_six_axes", state::<6>()),
        ("refusal", encode_server(&ServerMessage::<3>::Refusal(ramping)).to_vec()),
    ]
}

/// Streams for the deframer: how many chunk lengths, these (less 1), and the stream.
pub(crate) fn streams() -> Vec<Seed> {
    let cut = |lengths: &[u8], stream: &[u8]| {
        let count = u8::try_from(lengths.len()).unwrap();
        [&[count], lengths, stream].concat()
    };
    let frames = frames();
    let named = |name: &str| &frames.iter().find(|(known, _)| *known == name).unwrap().1;
    let session = [&named("hello")[..], &command::<3>(42), &command::<3>(43), named("goodbye")].concat();
    let mut bad_checksum = command::<3>(42);
    *bad_checksum.last_mut().unwrap() ^= 1;
    let mut of_the_next_version = named("hello").clone();
    of_the_next_version[2] = 2;
    let mut too_long = named("hello").clone();
    too_long[5] = 2;
    let mut seeds: Vec<Seed> = (frames.iter()).map(|(name, frame)| ((*name).to_owned(), cut(&[0, 6], frame))).collect();
    for (name, lengths, stream) in [
        ("session", &[0, 6][..], &session),
        ("session_byte_by_byte", &[0][..], &session),
        ("session_in_one_piece", &[255][..], &session),
        ("checksum_wrong", &[30][..], &bad_checksum),
        ("version_of_the_future", &[2][..], &of_the_next_version),
        ("longer_than_any_body", &[3][..], &too_long),
        ("noise_after_a_frame", &[9][..], &[&named("stop")[..], b"noise"].concat()),
    ] {
        seeds.push((name.to_owned(), cut(lengths, stream)));
    }
    seeds
}

/// Bodies for the frame target: version, kind, where it is cut, which bit flips, body.
pub(crate) fn sealed() -> Vec<Seed> {
    let seal = |version: u8, kind: u8, body: &[u8]| {
        let (cut, bit) = (9_u16.to_le_bytes(), 77_u16.to_le_bytes());
        [&[version, kind][..], &cut, &bit, body].concat()
    };
    let mut seeds: Vec<Seed> = Vec::new();
    for (name, frame) in frames() {
        let body = &frame[6..frame.len() - 4];
        seeds.push((name.to_owned(), seal(1, frame[3], body)));
    }
    let command = command::<3>(42);
    let body = &command[6..command.len() - 4];
    let mut reserved = body.to_vec();
    reserved[26] = 1;
    for (name, version, kind, body) in [
        ("empty", 1, 1, &[][..]),
        ("kind_unknown", 1, 99, body),
        ("version_of_the_future", 2, 1, body),
        ("reserved_not_zero", 1, 3, &reserved),
        ("longest", 1, 3, &[0; 384]),
        ("longer_than_longest", 1, 3, &[0; 385]),
        ("one_byte_short", 1, 3, &body[1..]),
    ] {
        seeds.push((name.to_owned(), seal(version, kind, body)));
    }
    seeds
}
