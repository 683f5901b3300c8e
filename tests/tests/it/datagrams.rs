//! The same server over UDP: what is lost stays lost, what is late or twice is only counted, and an unknown sender gets no answer.

use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::time::Duration;

use gantry_tau::server::connections::{Allowed, Listen};
use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::{
    Capabilities, Cause, ClientMessage, Command, Hello, Mode, Phase, Refusal, ServerMessage, State,
};
use gantry_tau_core::control::wire::{Frame, MAX_FRAME, decode_server, encode_client};
use gantry_tau_core::units::{Epoch, EpochRange, OffsetNm, Sequence, Tick};
use gantry_tau_tests::fake_plant::Bus;
use gantry_tau_tests::server_fixture::{LOOPBACK, ServerFixture, parameters};
use gantry_tau_tests::{DEADLINE, wait_for};

/// A client that sends what a test wants it to send.
struct Peer {
    socket: UdpSocket,
    epoch: Epoch,
    sequence: u64,
    tick: Tick,
}

impl Peer {
    fn of(server: SocketAddr) -> Self {
        let socket = UdpSocket::bind(LOOPBACK).unwrap();
        socket.connect(server).unwrap();
        socket.set_read_timeout(Some(DEADLINE)).unwrap();
        Self { socket, epoch: Epoch(0), sequence: 0, tick: Tick(0) }
    }

    fn send(&self, message: &ClientMessage<3>) {
        self.socket.send(&encode_client(message)).unwrap();
    }

    fn say_hello(&self) {
        self.send(&ClientMessage::Hello(Hello { axes: 3, capabilities: Capabilities::NONE }));
    }

    fn receive(&mut self) -> ServerMessage<3> {
        let mut buffer = [0; MAX_FRAME];
        let count = self.socket.recv(&mut buffer).unwrap();
        let message = decode_server(&Frame::parse(&buffer[..count]).unwrap()).unwrap();
        match &message {
            ServerMessage::Welcome(welcome) => self.epoch = welcome.epoch,
            ServerMessage::State(state) => self.tick = state.tick,
            ServerMessage::Refusal(_) => {}
        }
        message
    }

    fn state(&mut self) -> State<3> {
        match self.receive() {
            ServerMessage::State(state) => state,
            other => panic!("not a State: {other:?}"),
        }
    }

    /// Nothing has been sent here: loopback delivers at once.
    fn hears_nothing(&self) {
        self.socket.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
        let error = self.socket.recv(&mut [0; MAX_FRAME]).unwrap_err();
        assert!(matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut), "{error}");
        self.socket.set_read_timeout(Some(DEADLINE)).unwrap();
    }

    /// The answer to the last State.
    fn answer(&mut self, mode: Mode, nm: i32) -> ClientMessage<3> {
        self.sequence += 1;
        ClientMessage::Command(Command {
            epoch: self.epoch,
            sequence: Sequence(self.sequence),
            echo: self.tick,
            mode,
            targets: [Offsets { position: OffsetNm(nm), ..Offsets::default() }; 3],
        })
    }
}

/// One tick with what the peer sends in it: all of it has arrived before.
fn tick(server: &mut ServerFixture<3>, peer: &mut Peer, messages: &[ClientMessage<3>]) -> State<3> {
    for message in messages {
        peer.send(message);
    }
    let wanted = u8::try_from(messages.len()).unwrap();
    let mut seen = 0;
    wait_for("the datagrams", || {
        seen = server.receive();
        seen >= wanted
    });
    server.step();
    peer.state()
}

/// A peer that owns the session and obtains.
fn obtaining() -> (ServerFixture<3>, Peer) {
    let mut server = ServerFixture::over_datagrams();
    let mut peer = Peer::of(server.address());
    peer.say_hello();
    wait_for("the Welcome", || {
        server.receive();
        server.step().welcomed
    });
    assert!(matches!(peer.receive(), ServerMessage::Welcome(_)));
    peer.state();
    for _ in 0..3 {
        let answer = peer.answer(Mode::Submit, 1_000);
        tick(&mut server, &mut peer, &[answer]);
    }
    for _ in 0..10 {
        let answer = peer.answer(Mode::Obtain, 20_000);
        tick(&mut server, &mut peer, &[answer]);
    }
    assert_eq!(server.phase(), Phase::Obtain);
    (server, peer)
}

#[test]
fn one_lost_datagram_is_tolerated_and_the_second_ends_the_session() {
    let (mut server, mut peer) = obtaining();
    server.step();
    assert_eq!(peer.state().phase, Phase::Obtain, "one is lost");
    let answer = peer.answer(Mode::Obtain, 20_000);
    assert_eq!(tick(&mut server, &mut peer, &[answer]).phase, Phase::Obtain);
    server.step();
    server.step();
    assert_eq!(peer.state().phase, Phase::Obtain);
    let state = peer.state();
    assert_eq!(state.phase, Phase::SafeDisconnect);
    assert_eq!(state.cause, Cause::ClientLate);
}

#[test]
fn late_twofold_and_overtaking_datagrams_are_only_counted() {
    let (mut server, mut peer) = obtaining();
    // Of each pair the newer arrives first, and the older twice.
    for _ in 0..20 {
        let old = peer.answer(Mode::Obtain, -500_000);
        let new = peer.answer(Mode::Obtain, 20_000);
        let state = tick(&mut server, &mut peer, &[new, old, old]);
        assert_eq!(state.phase, Phase::Obtain);
    }
    // The target that is far away never acted.
    let state = tick(&mut server, &mut peer, &[]);
    assert!(state.axes.iter().all(|axis| axis.offsets.position == OffsetNm(20_000)));
    // An answer to a State of long ago does not count.
    peer.tick = Tick(peer.tick.0 - 5);
    let late = peer.answer(Mode::Obtain, 0);
    let state = tick(&mut server, &mut peer, &[late]);
    assert_eq!(state.phase, Phase::SafeDisconnect, "two deadlines without an answer");
    assert_eq!(state.cause, Cause::NetworkLate);
}

#[test]
fn broken_datagrams_are_dropped_and_the_session_goes_on() {
    let (mut server, mut peer) = obtaining();
    for round in 0..5 {
        let good = peer.answer(Mode::Obtain, 20_000);
        let frame = encode_client(&good);
        let mut corrupt = frame.to_vec();
        corrupt[10 + round] ^= 0x10;
        peer.socket.send(&corrupt).unwrap();
        peer.socket.send(&frame[..frame.len() / 2]).unwrap();
        peer.socket.send(&[0x47; MAX_FRAME + 200]).unwrap();
        peer.socket.send(&[]).unwrap();
        // Two frames in one datagram are refused.
        peer.socket.send(&[&*frame, &*frame].concat()).unwrap();
        let state = tick(&mut server, &mut peer, &[good]);
        assert_eq!(state.phase, Phase::Obtain);
        assert_eq!(state.counters.missed, 0);
        let rounds = u32::try_from(round).unwrap() + 1;
        assert_eq!(state.counters.malformed, 5 * rounds, "every one is counted");
    }
}

#[test]
fn a_second_peer_is_refused_and_one_that_does_not_greet_hears_nothing() {
    let (mut server, mut peer) = obtaining();
    let mut second = Peer::of(server.address());
    second.say_hello();
    let other = Peer::of(server.address());
    let epoch = peer.epoch;
    other.send(&ClientMessage::Stop(epoch));
    other.send(&ClientMessage::Goodbye(epoch));
    other.socket.send(b"hello").unwrap();
    let answer = peer.answer(Mode::Obtain, 20_000);
    let state = tick(&mut server, &mut peer, &[answer]);
    assert_eq!(state.phase, Phase::Obtain, "another's Stop stops nothing");
    assert_eq!(second.receive(), ServerMessage::Refusal(Refusal::Busy));
    other.hears_nothing();
}

#[test]
fn a_goodbye_said_twice_is_one_end() {
    let (mut server, mut peer) = obtaining();
    let goodbye = ClientMessage::Goodbye(peer.epoch);
    let state = tick(&mut server, &mut peer, &[goodbye, goodbye]);
    assert_eq!((state.phase, state.cause), (Phase::SafeDisconnect, Cause::Goodbye));
    while server.phase() != Phase::Listening {
        server.receive();
        server.step();
    }
    // The place is free again.
    let mut next = Peer::of(server.address());
    next.say_hello();
    wait_for("the Welcome", || {
        server.receive();
        server.step().welcomed
    });
    assert!(matches!(next.receive(), ServerMessage::Welcome(_)));
    assert!(next.epoch > peer.epoch);
}

#[test]
fn more_peers_than_places_do_not_disturb_the_owner() {
    let (mut server, mut peer) = obtaining();
    for _ in 0..30 {
        let crowd: Vec<Peer> = (0..20).map(|_| Peer::of(server.address())).collect();
        crowd.iter().for_each(Peer::say_hello);
        let answer = peer.answer(Mode::Obtain, 20_000);
        let state = tick(&mut server, &mut peer, &[answer]);
        assert_eq!(state.phase, Phase::Obtain);
    }
    assert_eq!(tick(&mut server, &mut peer, &[]).counters.missed, 1);
}

/// Of a flood no more is read per visit than 64 datagrams; beside fewer the owner notices nothing.
#[test]
fn a_flood_of_other_peers_is_bounded_work() {
    let (mut server, mut peer) = obtaining();
    let other = Peer::of(server.address());
    for _ in 0..20 {
        for _ in 0..40 {
            other.socket.send(&[0x55; 64]).unwrap();
        }
        let answer = peer.answer(Mode::Obtain, 20_000);
        assert_eq!(tick(&mut server, &mut peer, &[answer]).phase, Phase::Obtain);
    }
    for _ in 0..100 {
        other.socket.send(&[0x55; 64]).unwrap();
    }
    let answer = peer.answer(Mode::Obtain, 20_000);
    peer.send(&answer);
    // Loopback keeps the order: the owner's is behind a hundred, and a visit ends before it.
    assert_eq!(server.receive(), 0);
    assert_eq!(server.receive(), 1);
    other.hears_nothing();
}

#[test]
fn who_is_not_allowed_is_not_answered() {
    for transport in [Transport::Datagram, Transport::Stream] {
        let listen =
            Listen { transport, allowed: Allowed::only(&["192.0.2.0/24".to_owned()]).unwrap(), ..LOOPBACK.into() };
        let mut server =
            ServerFixture::<3>::listen(parameters(), Bus::default(), EpochRange::VOLATILE, listen).unwrap();
        if transport == Transport::Datagram {
            let peer = Peer::of(server.address());
            peer.say_hello();
            for _ in 0..20 {
                server.receive();
                assert!(!server.step().welcomed);
            }
            peer.hears_nothing();
        } else {
            let mut client = gantry_tau_tests::client::Client::<3>::connect(server.address());
            client.say_hello();
            wait_for("the end of the connection", || {
                server.receive();
                assert!(!server.step().welcomed);
                !client.is_quiet()
            });
        }
    }
}
