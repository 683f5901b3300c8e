//! The same server over UDP: what is lost stays lost, what is late or twice is only counted, and an
//! unknown sender gets no answer.

use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::{
    Cause, ClientMessage, Mode, Phase, Refusal, ServerMessage, State,
};
use gantry_tau_core::control::wire::{MAX_FRAME, encode_client};
use gantry_tau_core::units::{EpochRange, OffsetNm};
use gantry_tau_server::links::Allowed;
use gantry_tau_server::server::connections::Listen;
use gantry_tau_server::state::StopLatch;
use gantry_tau_tests::client::{Client, hello};
use gantry_tau_tests::fake_plant::Bus;
use gantry_tau_tests::server_fixture::{LOOPBACK, ServerFixture, parameters};
use gantry_tau_tests::session_fixture::SessionFixture;
use gantry_tau_tests::wait_for;

/// Offsets of the owner.
const AT: [i32; 3] = [20_000; 3];

/// One tick with what the owner sends in it: all of it has arrived before.
fn tick(session: &mut SessionFixture<3>, messages: &[ClientMessage<3>]) -> State<3> {
    for message in messages {
        session.client.send(message);
    }
    let wanted = u8::try_from(messages.len()).unwrap();
    wait_for("the datagrams", || session.server.receive() >= wanted);
    session.tick().state
}

/// The owner's answer to the last State.
fn answer(session: &mut SessionFixture<3>, mode: Mode, positions: [i32; 3]) -> ClientMessage<3> {
    ClientMessage::Command(session.client.command(mode, positions))
}

/// One tick with that answer in Obtain.
fn answered(session: &mut SessionFixture<3>) -> State<3> {
    let answer = answer(session, Mode::Obtain, AT);
    tick(session, &[answer])
}

/// A session in Obtain.
fn obtaining() -> SessionFixture<3> {
    let server = ServerFixture::over_datagrams();
    let client = Client::over_datagrams(server.address());
    let mut session = SessionFixture::greeted_by(client, server);
    let submit = answer(&mut session, Mode::Submit, AT);
    tick(&mut session, &[submit]);
    for _ in 0..10 {
        assert_eq!(answered(&mut session).phase, Phase::Obtain);
    }
    session
}

fn other(session: &SessionFixture<3>) -> Client<3> {
    Client::over_datagrams(session.server.address())
}

#[test]
fn one_lost_datagram_is_tolerated_and_the_second_ends_the_session() {
    let mut session = obtaining();
    assert_eq!(session.tick().state.phase, Phase::Obtain, "one is lost");
    assert_eq!(answered(&mut session).phase, Phase::Obtain);
    assert_eq!(session.tick().state.phase, Phase::Obtain);
    let state = session.tick().state;
    assert_eq!(
        (state.phase, state.cause),
        (Phase::SafeDisconnect, Cause::ClientLate)
    );
}

#[test]
fn late_twofold_and_overtaking_datagrams_are_only_counted() {
    let mut session = obtaining();
    // Of each pair the newer arrives first, and the older twice.
    for _ in 0..20 {
        let old = answer(&mut session, Mode::Obtain, [-500_000; 3]);
        let new = answer(&mut session, Mode::Obtain, AT);
        assert_eq!(tick(&mut session, &[new, old, old]).phase, Phase::Obtain);
    }
    // The target that is far away never acted.
    let state = tick(&mut session, &[]);
    assert!(
        state
            .axes
            .iter()
            .all(|axis| axis.offsets.position == OffsetNm(20_000))
    );
    // An answer to a State of long ago does not count.
    session.client.tick.0 -= 5;
    let late = answer(&mut session, Mode::Obtain, [0; 3]);
    let state = tick(&mut session, &[late]);
    assert_eq!(
        state.phase,
        Phase::SafeDisconnect,
        "two deadlines without an answer"
    );
    assert_eq!(state.cause, Cause::NetworkLate);
}

#[test]
fn broken_datagrams_are_dropped_and_the_session_goes_on() {
    let mut session = obtaining();
    for round in 0..5 {
        let good = answer(&mut session, Mode::Obtain, AT);
        let frame = encode_client(&good);
        let mut corrupt = frame.to_vec();
        corrupt[10 + round] ^= 0x10;
        // Two frames in one datagram are refused.
        let two = [&*frame, &*frame].concat();
        for broken in [
            &corrupt[..],
            &frame[..frame.len() / 2],
            &[0x47; MAX_FRAME + 200],
            &[],
            &two,
        ] {
            session.client.send_bytes(broken);
        }
        let state = tick(&mut session, &[good]);
        assert_eq!(state.phase, Phase::Obtain);
        assert_eq!(state.counters.missed, 0);
        let rounds = u32::try_from(round).unwrap() + 1;
        assert_eq!(state.counters.malformed, 5 * rounds, "every one is counted");
    }
}

#[test]
fn a_second_peer_is_refused_and_one_that_does_not_greet_hears_nothing() {
    let mut session = obtaining();
    let mut second = other(&session);
    second.say_hello();
    let mut silent = other(&session);
    silent.send(&ClientMessage::Stop(session.client.epoch));
    silent.send(&ClientMessage::Goodbye(session.client.epoch));
    silent.send_bytes(b"hello");
    assert_eq!(
        answered(&mut session).phase,
        Phase::Obtain,
        "another's Stop stops nothing"
    );
    assert_eq!(
        second.receive(),
        Some(ServerMessage::Refusal(Refusal::Busy))
    );
    assert!(silent.is_quiet());
}

#[test]
fn a_goodbye_said_twice_is_one_end() {
    let mut session = obtaining();
    let epoch = session.client.epoch;
    let goodbye = ClientMessage::Goodbye(epoch);
    let state = tick(&mut session, &[goodbye, goodbye]);
    assert_eq!(
        (state.phase, state.cause),
        (Phase::SafeDisconnect, Cause::Goodbye)
    );
    session
        .server
        .step_until("Listening", |row| row.state.phase == Phase::Listening);
    // The place is free again.
    let next = other(&session);
    let next = SessionFixture::greeted_by(next, session.server);
    assert!(next.client.epoch > epoch);
}

/// Reads what has arrived; returns the number of its bytes.
fn drain(socket: &std::net::UdpSocket) -> usize {
    let (mut bytes, mut datagram) = (0, [0; MAX_FRAME]);
    while let Ok(count) = socket.recv(&mut datagram) {
        bytes += count;
    }
    bytes
}

/// Bytes that one Hello brings to its address, if nothing else is ever sent from there; and the
/// longest Welcome and State.
fn bytes_for_one_hello<const N: usize>() -> (usize, usize) {
    let mut server = ServerFixture::<N>::over_datagrams();
    let victim = std::net::UdpSocket::bind(LOOPBACK).unwrap();
    victim.set_nonblocking(true).unwrap();
    victim.connect(server.address()).unwrap();
    let hello = hello::<N>();
    victim.send(&encode_client(&hello)).unwrap();
    let mut bytes = 0;
    let row = server.step_until("the Welcome", |row| row.welcomed);
    assert_eq!(row.state.phase, Phase::Handshake);
    bytes += drain(&victim);
    let mut cause = Cause::None;
    for _ in 0..1_200 {
        let row = server.step();
        cause = row.ended.unwrap_or(cause);
        bytes += drain(&victim);
    }
    assert_eq!(
        cause,
        Cause::HandshakeTimeout,
        "the handshake is over nevertheless"
    );
    (bytes, 12 + 28 + 48 * N + 12 + 102 + 44 * N)
}

/// Found by attack: a Hello of 14 bytes from a forged address brought 215 784 and 349 276 bytes to
/// it.
#[test]
fn a_forged_hello_brings_one_welcome_and_one_state_to_its_address() {
    let (bytes, most) = bytes_for_one_hello::<3>();
    assert!(bytes > 0 && bytes <= most, "{bytes} of at most {most}");
    let (bytes, most) = bytes_for_one_hello::<6>();
    assert!(bytes > 0 && bytes <= most, "{bytes} of at most {most}");
}

/// The State that a client has to answer may be lost: each further datagram of the client brings
/// the latest one.
#[test]
fn in_the_handshake_a_state_follows_each_frame_that_is_heard() {
    let server = ServerFixture::over_datagrams();
    let client = Client::over_datagrams(server.address());
    let mut session = SessionFixture::<3>::greeted_by(client, server);
    for _ in 0..5 {
        session.server.step();
        assert!(session.client.is_quiet());
        // Over loopback a datagram has arrived when it is sent.
        session.client.send_bytes(b"not a frame");
        session.server.receive();
        session.server.step();
        assert!(session.client.is_quiet(), "what is no frame brings nothing");
        session.client.say_hello();
        session.server.receive();
        let row = session.server.step();
        assert_eq!(session.client.state(), row.state);
    }
    // The answer to it ends the handshake, and from then on there is a State per tick.
    let submit = answer(&mut session, Mode::Submit, AT);
    assert_eq!(tick(&mut session, &[submit]).phase, Phase::Submit);
    session.server.receive();
    assert_eq!(session.tick().state.phase, Phase::Submit, "one miss");
}

#[test]
fn more_peers_than_places_do_not_disturb_the_owner() {
    let mut session = obtaining();
    for _ in 0..30 {
        let mut crowd: Vec<Client<3>> = (0..20).map(|_| other(&session)).collect();
        crowd.iter_mut().for_each(Client::say_hello);
        assert_eq!(answered(&mut session).phase, Phase::Obtain);
    }
    assert_eq!(tick(&mut session, &[]).counters.missed, 1);
}

/// Of a flood no more is read per visit than 64 datagrams; beside fewer the owner notices nothing.
#[test]
fn a_flood_of_other_peers_is_bounded_work() {
    let mut session = obtaining();
    let mut other = other(&session);
    for _ in 0..20 {
        for _ in 0..40 {
            other.send_bytes(&[0x55; 64]);
        }
        assert_eq!(answered(&mut session).phase, Phase::Obtain);
    }
    for _ in 0..100 {
        other.send_bytes(&[0x55; 64]);
    }
    let answer = answer(&mut session, Mode::Obtain, AT);
    session.client.send(&answer);
    // Loopback keeps the order: the owner's is behind a hundred, and a visit ends before it.
    assert_eq!(session.server.receive(), 0);
    assert_eq!(session.server.receive(), 1);
    assert!(other.is_quiet());
}

#[test]
fn who_is_not_allowed_is_not_answered() {
    for transport in [Transport::Datagram, Transport::Stream] {
        let allowed = Allowed::only(&["192.0.2.0/24".to_owned()]).unwrap();
        let listen = Listen {
            transport,
            allowed,
            ..LOOPBACK.into()
        };
        let mut server = ServerFixture::<3>::listen(
            parameters(),
            Bus::default(),
            EpochRange::VOLATILE,
            StopLatch::volatile(),
            listen,
        )
        .unwrap();
        if transport == Transport::Datagram {
            let mut client = Client::<3>::over_datagrams(server.address());
            client.say_hello();
            for _ in 0..20 {
                server.receive();
                assert!(!server.step().welcomed);
            }
            assert!(client.is_quiet());
        } else {
            let mut client = Client::<3>::connect(server.address());
            client.say_hello();
            server.step_until("the end of the connection", |row| {
                assert!(!row.welcomed);
                !client.is_quiet()
            });
        }
    }
}
