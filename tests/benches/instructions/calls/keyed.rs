//! A server with keys: its tick, a grant, and what strangers cost.

use std::hint::black_box;

use gantry_tau_core::control::client::{Client, Event, Requirements};
use gantry_tau_core::control::endpoint::{Budget, Endpoint, Greeted, Transport};
use gantry_tau_core::control::keys::{Key, Keyring, Role, SessionOf};
use gantry_tau_core::control::message::{
    Capabilities, ClientMessage, Command, Hello, KeyedHello, Mode, Phase,
};
use gantry_tau_core::control::session::Connection;
use gantry_tau_core::control::wire::{FrameBytes, Kind, TAG_LEN, enclose, encode_client};
use gantry_tau_core::units::{Epoch, EpochRange, Sequence, Tick};
use gantry_tau_core::{OffsetNm, Offsets, PositionNm, Session, Start};
use gantry_tau_tests::server_fixture;

use super::measured;
use crate::setup::{Server, on_time};

const SECRET: [u8; 32] = [1; 32];
const PEER: [u8; 18] = [7; 18];
const NONCE: [u8; 16] = [9; 16];

/// A server of six axes with keys, in Listening.
fn listening() -> Endpoint<6> {
    let unkeyed = Server::<6, 9>::in_obtain([0, 0, 1, 1, 2, 2, 3, 4, 5]);
    let config = *unkeyed.endpoint.session().config();
    let start = Start::at_rest([PositionNm(0); 6]);
    let session = Session::new(config, &start).unwrap();
    let mut keyring = Keyring::new(&[0x55; 32]);
    keyring.add(Key::new(&SECRET, Role::Control)).unwrap();
    Endpoint::keyed(session, EpochRange::VOLATILE, keyring, Budget::default())
}

/// Ticks, and returns the frames that are sent.
fn tick(endpoint: &mut Endpoint<6>) -> Vec<Vec<u8>> {
    server_fixture::taken(endpoint.tick(&on_time()));
    let mut frames = Vec::new();
    while let Some((_, frame)) = endpoint.poll_transmit() {
        frames.push(frame.to_vec());
    }
    frames
}

fn client() -> Client<6> {
    let key = Key::new(&SECRET, Role::Control);
    Client::keyed(Transport::Datagram, Requirements::default(), key, NONCE)
}

/// The Hello with the cookie of this server, which is granted.
fn last_hello(endpoint: &mut Endpoint<6>, client: &mut Client<6>) -> FrameBytes {
    let Greeted::Answer(challenge) = endpoint.greet(&PEER, &client.hello().unwrap()) else {
        panic!("not challenged");
    };
    let event = client.feed(challenge).poll_event();
    assert_eq!(event, Some(Ok(Event::Challenged)));
    client.hello().unwrap()
}

/// A server in Obtain, its connection, and the next frame of its client.
fn in_obtain() -> (Endpoint<6>, Connection, FrameBytes) {
    let (mut endpoint, mut client) = (listening(), client());
    let hello = last_hello(&mut endpoint, &mut client);
    let Greeted::Peer(connection) = endpoint.greet(&PEER, &hello) else {
        panic!("no place");
    };
    let targets = [Offsets::position(OffsetNm(123_456)); 6];
    let mut answer = None;
    for _ in 0..20 {
        for frame in tick(&mut endpoint) {
            let _ = client.feed(&frame).poll_event();
        }
        answer = client.answer(Mode::Obtain, &targets);
        if endpoint.session().phase() == Phase::Obtain {
            break;
        }
        if let Some(answer) = &answer {
            endpoint.feed(connection, &answer.frame);
        }
    }
    (endpoint, connection, answer.unwrap().frame)
}

/// One tick with the client's command, States with tags.
pub(super) fn tick_with_states() {
    let (mut endpoint, connection, frame) = in_obtain();
    let (frame, input) = black_box((frame, on_time()));
    measured(|| {
        endpoint.feed(connection, &frame);
        black_box(server_fixture::taken(endpoint.tick(&input)));
        while let Some((_, bytes)) = endpoint.poll_transmit() {
            black_box(bytes);
        }
    });
}

/// The same for a client that has declined the tags of States.
pub(super) fn tick_with_commands() {
    let mut endpoint = listening();
    let key = Key::new(&SECRET, Role::Control);
    let cookie = {
        let mut keyring = Keyring::new(&[0x55; 32]);
        keyring.add(key.clone()).unwrap();
        keyring.cookie(&PEER, &NONCE, Epoch(1), Tick(0))
    };
    let hello = Hello {
        axes: 6,
        capabilities: Capabilities::NONE,
    };
    let (id, nonce) = (key.id(), NONCE);
    let mut frame = enclose(
        Kind::KeyedHello,
        &KeyedHello {
            hello,
            key: id,
            nonce,
            cookie,
        },
    );
    frame.tag(key.greeting(), &[]);
    let Greeted::Peer(connection) = endpoint.greet(&PEER, &frame) else {
        panic!("no place");
    };
    tick(&mut endpoint);
    let welcome = endpoint.session().welcome();
    let session = key.session(&SessionOf {
        nonce,
        cookie,
        epoch: welcome.epoch,
        axes: 6,
        kinematics_checksum: welcome.kinematics_checksum,
    });
    let command = |endpoint: &Endpoint<6>, sequence, mode| {
        let mut frame = encode_client(&ClientMessage::Command(Command {
            epoch: endpoint.session().epoch(),
            sequence: Sequence(sequence),
            echo: endpoint.session().last_tick(),
            mode,
            targets: [Offsets::position(OffsetNm(123_456)); 6],
        }));
        frame.tag(&session, &[]);
        frame
    };
    for (sequence, mode) in [(1, Mode::Submit), (2, Mode::Obtain), (3, Mode::Obtain)] {
        let frame = command(&endpoint, sequence, mode);
        endpoint.feed(connection, &frame);
        tick(&mut endpoint);
    }
    assert_eq!(endpoint.session().phase(), Phase::Obtain);
    let (frame, input) = black_box((command(&endpoint, 4, Mode::Obtain), on_time()));
    measured(|| {
        endpoint.feed(connection, &frame);
        black_box(server_fixture::taken(endpoint.tick(&input)));
        while let Some((_, bytes)) = endpoint.poll_transmit() {
            black_box(bytes);
        }
    });
}

/// The tick of a grant: the Hello, the session's key, Welcome and State.
pub(super) fn grant() {
    let (mut endpoint, mut client) = (listening(), client());
    let hello = last_hello(&mut endpoint, &mut client);
    let (hello, input) = black_box((hello, on_time()));
    measured(|| {
        black_box(endpoint.greet(&PEER, &hello));
        black_box(server_fixture::taken(endpoint.tick(&input)));
        while let Some((_, bytes)) = endpoint.poll_transmit() {
            black_box(bytes);
        }
    });
    assert_eq!(endpoint.session().phase(), Phase::Handshake);
}

/// A Hello whose tag is wrong in its last byte.
pub(super) fn greet_forged() {
    greet_forged_in(TAG_LEN - 1);
}

/// A Hello whose tag is wrong in its first byte.
pub(super) fn greet_forged_in_its_first_byte() {
    greet_forged_in(0);
}

fn greet_forged_in(byte: usize) {
    let mut endpoint = listening();
    let mut forged = client().hello().unwrap().to_vec();
    let tag = forged.len() - TAG_LEN;
    if let Some(wrong) = forged.get_mut(tag + byte) {
        *wrong ^= 1;
    }
    let forged = black_box(forged);
    let greeted = measured(|| endpoint.greet(&PEER, &forged) == Greeted::Nothing);
    assert!(greeted);
}

/// A datagram that is no frame.
pub(super) fn greet_garbage() {
    let mut endpoint = listening();
    let garbage = black_box([0x5a; 68]);
    let greeted = measured(|| endpoint.greet(&PEER, &garbage) == Greeted::Nothing);
    assert!(greeted);
}
