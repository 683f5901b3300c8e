//! Sessions under a key over real sockets: the client of this repository, strangers and forgers.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream, UdpSocket};
use std::time::Duration;

use gantry_tau_client::{ClientError, Connection};
use gantry_tau_core::Offsets;
use gantry_tau_core::control::client::{Client, Event, Requirements};
use gantry_tau_core::control::endpoint::{CONNECTIONS, Transport};
use gantry_tau_core::control::keys::{Key, Keyring, Role};
use gantry_tau_core::control::message::{Mode, Notice, Phase, Refusal};
use gantry_tau_core::control::wire::{FrameBytes, MAX_FRAME};
use gantry_tau_core::units::OffsetNm;
use gantry_tau_tests::server_fixture::{STEP_NM, ServerFixture};
use gantry_tau_tests::{DEADLINE, wait_for};

const TRANSPORTS: [Transport; 2] = [Transport::Stream, Transport::Datagram];
const SECRET: [u8; 32] = [1; 32];
/// Patience of a client that is not to be answered.
const SHORT: Duration = Duration::from_millis(500);

fn keyring() -> Keyring {
    let mut keyring = Keyring::new(&[0x55; 32]);
    keyring.add(Key::new(&SECRET, Role::Control)).unwrap();
    keyring.add(Key::new(&[2; 32], Role::Read)).unwrap();
    keyring
}

fn key(secret: u8) -> Key {
    Key::new(&[secret; 32], Role::Control)
}

fn connect(
    transport: Transport,
    server: SocketAddr,
    patience: Duration,
    key: Option<Key>,
) -> Connection<'static, 3> {
    let requirements = Requirements::default();
    let link = Connection::open(transport, server, patience, requirements).unwrap();
    link.with_key(key).unwrap()
}

/// Targets at this position.
fn at(position: i32) -> [Offsets; 3] {
    [Offsets::position(OffsetNm(position)); 3]
}

#[test]
fn the_holder_of_the_key_moves_the_machine_and_leaves() {
    for transport in TRANSPORTS {
        let server = ServerFixture::<3>::keyed(transport, keyring()).spawn();
        let mut link = connect(transport, server.address, DEADLINE, Some(key(1)));
        link.greet().unwrap();
        let mut last = None;
        for _ in 0..200 {
            let Event::State(state) = link.next_event().unwrap() else {
                panic!("the session is over");
            };
            link.answer(Mode::Obtain, &at(3 * STEP_NM)).unwrap();
            last = Some(state);
        }
        let last = last.unwrap();
        assert_eq!((last.phase, last.counters.missed), (Phase::Obtain, 0));
        assert_eq!(last.counters.non_owner, 0);
        assert_eq!(last.axes[0].offsets.position, OffsetNm(3 * STEP_NM));
        link.leave().unwrap();
        server.quit().unwrap();
    }
}

#[test]
fn everybody_else_is_told_what_he_may_know() {
    for transport in TRANSPORTS {
        let server = ServerFixture::<3>::keyed(transport, keyring()).spawn();
        let greet = |key, patience| connect(transport, server.address, patience, key).greet();
        let error = greet(Some(key(3)), SHORT).unwrap_err();
        let id = key(3).id().to_string();
        assert!(
            matches!(&error, ClientError::Vanished(reason) if reason.contains("wrong key?") && reason.contains(&id)),
            "{error}"
        );
        let error = greet(None, SHORT).unwrap_err();
        match transport {
            Transport::Stream => {
                assert!(
                    matches!(error, ClientError::Noticed(notice) if notice == Notice::suite(1))
                );
            }
            Transport::Datagram => assert!(matches!(error, ClientError::Vanished(_))),
        }
        let error = greet(Some(key(2)), DEADLINE).unwrap_err();
        assert!(
            matches!(error, ClientError::Refused(Refusal::Role)),
            "{error}"
        );
        server.quit().unwrap();
    }
}

/// A session over datagrams, stepped by hand.
struct Session {
    server: ServerFixture<3>,
    client: Client<3>,
    socket: UdpSocket,
}

impl Session {
    fn obtaining() -> Self {
        let server = ServerFixture::keyed(Transport::Datagram, keyring());
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.connect(server.address()).unwrap();
        socket.set_nonblocking(true).unwrap();
        let client = Client::keyed(
            Transport::Datagram,
            Requirements::default(),
            key(1),
            [7; 16],
        );
        let mut session = Self {
            server,
            client,
            socket,
        };
        session.say_hello();
        wait_for("Obtain", || {
            session.turn(|_, _| {});
            session.server.phase() == Phase::Obtain
        });
        session
    }

    fn say_hello(&mut self) {
        if let Some(hello) = self.client.hello() {
            self.socket.send(&hello).unwrap();
        }
    }

    /// One tick: the client hears what has come, and answers; `disturb` sees its frame first.
    fn turn(&mut self, disturb: impl FnOnce(&UdpSocket, &FrameBytes)) {
        let mut buffer = [0; MAX_FRAME];
        while let Ok(count) = self.socket.recv(&mut buffer) {
            let event = self.client.feed(&buffer[..count]).poll_event();
            if event == Some(Ok(Event::Challenged)) {
                self.say_hello();
            }
        }
        let answer = self.client.answer(Mode::Obtain, &at(STEP_NM));
        if let Some(answer) = &answer {
            disturb(&self.socket, &answer.frame);
            self.socket.send(&answer.frame).unwrap();
        }
        let mut frames = self.server.receive();
        if answer.is_some() && self.server.phase() != Phase::Listening {
            wait_for("the command", || {
                frames = self.server.receive();
                frames > 0
            });
        }
        self.server.step();
    }
}

/// Frames from the owner's own socket that are not its own: none is accepted, and none costs a miss.
#[test]
fn forgeries_and_replays_from_the_owners_address_change_nothing() {
    let mut session = Session::obtaining();
    let mut recorded: Vec<FrameBytes> = Vec::new();
    for tick in 0..300_usize {
        session.turn(|socket, genuine| {
            for number in 0..12 {
                let mut forged = genuine.to_vec();
                let bit = (tick * 131 + number * 17) % (8 * forged.len());
                forged[bit / 8] ^= 1 << (bit % 8);
                socket.send(&forged).unwrap();
            }
            for old in recorded.iter().rev().take(12) {
                socket.send(old).unwrap();
            }
            recorded.push(genuine.clone());
        });
        assert_eq!(
            (session.server.misses(), session.server.phase()),
            (0, Phase::Obtain)
        );
    }
    assert!(session.server.non_owner() >= 300 * 12);
}

/// Strangers get no byte for anything that they send, and cost the owner nothing.
#[test]
fn strangers_get_no_byte() {
    let mut session = Session::obtaining();
    let stranger = UdpSocket::bind("127.0.0.1:0").unwrap();
    stranger.connect(session.server.address()).unwrap();
    stranger.set_nonblocking(true).unwrap();
    let mut of_other = Client::<3>::keyed(
        Transport::Datagram,
        Requirements::default(),
        key(3),
        [9; 16],
    );
    let hello = of_other.hello().unwrap();
    let mut plain = Client::<3>::new(Transport::Datagram, Requirements::default());
    let plain = plain.hello().unwrap();
    for _ in 0..100 {
        session.turn(|_, genuine| {
            for frame in [&hello[..], &plain, genuine, b"", b"GT", &[0; 600]] {
                stranger.send(frame).unwrap();
            }
        });
        assert_eq!(
            (session.server.misses(), session.server.phase()),
            (0, Phase::Obtain)
        );
    }
    let error = stranger.recv(&mut [0; MAX_FRAME]).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::WouldBlock);
}

/// A challenge is shorter than the Hello, and is the only answer to an address that may be forged.
#[test]
fn an_address_gets_no_more_than_it_sends() {
    let mut server = ServerFixture::<3>::keyed(Transport::Datagram, keyring());
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.connect(server.address()).unwrap();
    socket.set_read_timeout(Some(SHORT)).unwrap();
    let mut client = Client::<3>::keyed(
        Transport::Datagram,
        Requirements::default(),
        key(1),
        [7; 16],
    );
    let (mut sent, mut received) = (0, 0);
    for _ in 0..50 {
        let hello = client.hello().unwrap();
        sent += socket.send(&hello).unwrap();
        let mut buffer = [0; 1_000];
        wait_for("a challenge", || {
            server.receive();
            server.step();
            socket.recv(&mut buffer).is_ok_and(|count| {
                received += count;
                true
            })
        });
    }
    for _ in 0..20 {
        server.step();
    }
    assert!(socket.recv(&mut [0; 1_000]).is_err(), "more was sent");
    assert!(received < sent, "{received} bytes for {sent}");
    assert_eq!(server.phase(), Phase::Listening);
}

/// Six connections that say nothing do not keep the holder of the key out.
#[test]
fn idle_strangers_make_room_for_the_holder_of_the_key() {
    let mut server = ServerFixture::<3>::keyed(Transport::Stream, keyring());
    let address = server.address();
    let strangers: Vec<TcpStream> = (0..CONNECTIONS)
        .map(|_| TcpStream::connect(address).unwrap())
        .collect();
    for _ in 0..20 {
        server.receive();
        server.step();
    }
    let mut socket = TcpStream::connect(address).unwrap();
    socket.set_nonblocking(true).unwrap();
    let mut client =
        Client::<3>::keyed(Transport::Stream, Requirements::default(), key(1), [7; 16]);
    socket.write_all(&client.hello().unwrap()).unwrap();
    wait_for("a session", || {
        server.receive();
        server.step();
        let mut buffer = [0; 4_096];
        let count = socket.read(&mut buffer).unwrap_or(0);
        let mut received = client.feed(&buffer[..count]);
        let mut events = Vec::new();
        while let Some(event) = received.poll_event() {
            events.push(event.unwrap());
        }
        if events.contains(&Event::Challenged) {
            socket.write_all(&client.hello().unwrap()).unwrap();
        }
        server.phase() == Phase::Handshake
    });
    drop(strangers);
}
