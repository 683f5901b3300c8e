//! Frames and streams of them, as clients and servers send them.

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::client::{Client, Requirements};
use gantry_tau_core::control::endpoint::{Endpoint, Transport};
use gantry_tau_core::control::message::{ClientMessage, Command, Mode, Refusal, ServerMessage};
use gantry_tau_core::control::session::config::Config;
use gantry_tau_core::control::session::{Session, Start};
use gantry_tau_core::control::wire::{encode_client, encode_server};
use gantry_tau_core::units::{Epoch, EpochRange, OffsetNm, PositionNm, Sequence, Tick};
use gantry_tau_tests::server_fixture::{on_time, parameters, taken};

use super::Seed;

/// The worked example of `wire.md`, or the same for so many axes.
pub(crate) fn command<const N: usize>(sequence: u64) -> Vec<u8> {
    let positions = [-100_000, 2_500, 0, 1, -1, i32::MAX];
    let command = Command::<N> {
        epoch: Epoch(7),
        sequence: Sequence(sequence),
        echo: Tick(958 + sequence),
        mode: Mode::Obtain,
        targets: std::array::from_fn(|axis| Offsets::position(OffsetNm(positions[axis]))),
    };
    encode_client(&ClientMessage::Command(command)).to_vec()
}

/// Frames of a session of so many axes: Hello, Welcome, a State of Obtain, Goodbye, Stop.
fn session<const N: usize>() -> [Vec<u8>; 5] {
    let nominal = [PositionNm(624_500_000); N];
    let session =
        Session::new(Config::new(parameters()).unwrap(), &Start::at_rest(nominal)).unwrap();
    let mut server = Endpoint::<N>::new(session, EpochRange::VOLATILE);
    let connection = server.open(Transport::Stream).unwrap();
    let mut client = Client::<N>::new(Transport::Stream, Requirements::default());
    let hello = client.hello().unwrap();
    let (mut said, mut heard) = (hello.clone(), Vec::new());
    for _ in 0..4 {
        server.feed(connection, &said);
        taken(server.tick(&on_time(nominal)));
        while let Some((_, frame)) = server.poll_transmit() {
            assert!(matches!(client.feed(frame).poll_event(), Some(Ok(_))));
            heard.push(frame.to_vec());
        }
        said = client
            .answer(Mode::Obtain, &[Offsets::position(OffsetNm(-100_000)); N])
            .unwrap()
            .frame;
    }
    let (stop, goodbye) = (client.stop().unwrap(), client.goodbye().unwrap());
    [
        hello.to_vec(),
        heard.remove(0),
        heard.pop().unwrap(),
        goodbye.to_vec(),
        stop.to_vec(),
    ]
}

/// One frame of every kind.
fn frames() -> Vec<(&'static str, Vec<u8>)> {
    let [hello, welcome, state, goodbye, stop] = session::<3>();
    let [_, welcome_six_axes, state_six_axes, ..] = session::<6>();
    let ramping = ServerMessage::<3>::Refusal(Refusal::Ramping { ticks_left: 2_373 });
    vec![
        ("hello", hello),
        ("command", command::<3>(42)),
        ("command_one_axis", command::<1>(42)),
        ("command_six_axes", command::<6>(42)),
        ("goodbye", goodbye),
        ("stop", stop),
        ("welcome", welcome),
        ("welcome_six_axes", welcome_six_axes),
        ("state", state),
        ("state_six_axes", state_six_axes),
        ("refusal", encode_server(&ramping).to_vec()),
    ]
}

/// A stream in pieces of these lengths.
fn cut(lengths: &[u8], stream: &[u8]) -> Vec<u8> {
    let count = u8::try_from(lengths.len()).unwrap();
    [&[count], lengths, stream].concat()
}

/// Streams for the deframer: how many chunk lengths, these (less 1), and the stream.
pub(crate) fn streams() -> Vec<Seed> {
    let frames = frames();
    let [hello, goodbye, stop] = ["hello", "goodbye", "stop"].map(|name| {
        let (_, frame) = frames.iter().find(|(known, _)| *known == name).unwrap();
        frame
    });
    let session = [&hello[..], &command::<3>(42), &command::<3>(43), goodbye].concat();
    let mut bad_checksum = command::<3>(42);
    *bad_checksum.last_mut().unwrap() ^= 1;
    let mut of_the_next_version = hello.clone();
    of_the_next_version[2] = 2;
    let mut too_long = hello.clone();
    too_long[5] = 2;
    let mut seeds: Vec<Seed> = (frames.iter())
        .map(|(name, frame)| ((*name).to_owned(), cut(&[0, 6], frame)))
        .collect();
    for (name, lengths, stream) in [
        ("session", &[0, 6][..], &session),
        ("session_byte_by_byte", &[0][..], &session),
        ("session_in_one_piece", &[255][..], &session),
        ("checksum_wrong", &[30][..], &bad_checksum),
        ("version_of_the_future", &[2][..], &of_the_next_version),
        ("longer_than_any_body", &[3][..], &too_long),
        (
            "noise_after_a_frame",
            &[9][..],
            &[&stop[..], b"noise"].concat(),
        ),
    ] {
        seeds.push((name.to_owned(), cut(lengths, stream)));
    }
    seeds
}

/// A body to be sealed, with a place to cut and a bit to flip.
fn seal(version: u8, kind: u8, body: &[u8]) -> Vec<u8> {
    let (cut, bit) = (9_u16.to_le_bytes(), 77_u16.to_le_bytes());
    [&[version, kind][..], &cut, &bit, body].concat()
}

/// Bodies for the frame target: version, kind, where it is cut, which bit flips, body.
pub(crate) fn sealed() -> Vec<Seed> {
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
