//! A keyed endpoint against clients, forgers and strangers, over streams and datagrams.

use std::vec::Vec as StdVec;

use proptest::prelude::*;

use crate::control::axis::{Offsets, Reference};
use crate::control::client::{Client, ClientError, Event, Requirements};
use crate::control::endpoint::bench::{Bench, Ticked};
use crate::control::endpoint::{Budget, CONNECTIONS, Endpoint, Greeted, Transport};
use crate::control::fixture::{at, axis, limits};
use crate::control::keys::{Key, KeyId, Keyring, Nonce, Role};
use crate::control::message::{
    Capabilities, Cause, FrameError, Hello, KeyedHello, Mode, Notice, Phase, Refusal,
};
use crate::control::session::Connection;
use crate::control::session::config::Parameters;
use crate::control::wire::{FrameBytes, Kind, Sealed, Suite, enclose};
use crate::units::{Epoch, EpochRange};

const CONTROL: [u8; 32] = [1; 32];
const READ: [u8; 32] = [2; 32];
const STRANGE: [u8; 32] = [3; 32];
const NONCE: Nonce = [0xa5; 16];
const ADDRESS: [u8; 18] = [7; 18];
const TRANSPORTS: [Transport; 2] = [Transport::Stream, Transport::Datagram];
/// Bytes of a Hello.
const HELLO: usize = 68;

fn keyring() -> Keyring {
    let mut keyring = Keyring::new(&[0x55; 32]);
    keyring.add(Key::new(&CONTROL, Role::Control)).unwrap();
    keyring.add(Key::new(&READ, Role::Read)).unwrap();
    keyring
}

/// A server with keys, and its connection with one client.
struct Server {
    bench: Bench,
    transport: Transport,
    connection: Option<Connection>,
    /// Frames that were sent without a connection.
    answers: StdVec<StdVec<u8>>,
}

impl Server {
    fn new(transport: Transport) -> Self {
        let axes = [axis(limits(100_000, 5_000, 10_000, 100), 1_000_000, 0); 2];
        let mut bench = Bench::new(Parameters::thesis(axes));
        let session = *bench.endpoint.session();
        bench.endpoint =
            Endpoint::keyed(session, EpochRange::VOLATILE, keyring(), Budget::default());
        let connection = (transport == Transport::Stream).then(|| bench.open(Transport::Stream));
        Self {
            bench,
            transport,
            connection,
            answers: StdVec::new(),
        }
    }

    /// Feeds a frame of the client.
    fn take(&mut self, frame: &[u8]) {
        let endpoint = &mut self.bench.endpoint;
        match self.connection {
            Some(connection) => drop(endpoint.feed(connection, frame)),
            None => match endpoint.greet(&ADDRESS, frame) {
                Greeted::Nothing => {}
                Greeted::Answer(answer) => {
                    assert!(
                        answer.len() <= frame.len(),
                        "an address gets no more than it sends"
                    );
                    self.answers.push(answer.to_vec());
                }
                Greeted::Peer(connection) => self.connection = Some(connection),
            },
        }
    }

    /// One tick; returns the frames for the client.
    fn tick(&mut self) -> (StdVec<StdVec<u8>>, Ticked) {
        let ticked = self.bench.tick();
        let mut frames = core::mem::take(&mut self.answers);
        let own = |(to, frame): &(Connection, StdVec<u8>)| {
            (Some(*to) == self.connection).then(|| frame.clone())
        };
        frames.extend(ticked.sent.iter().filter_map(own));
        if self.transport == Transport::Datagram
            && self
                .connection
                .is_some_and(|own| ticked.close.contains(&own))
        {
            self.connection = None;
        }
        (frames, ticked)
    }

    fn non_owner(&self) -> u32 {
        self.bench
            .endpoint
            .output()
            .unwrap()
            .state
            .counters
            .non_owner
    }

    fn phase(&self) -> Phase {
        self.bench.endpoint.session().phase()
    }
}

fn client_of(transport: Transport, secret: &[u8; 32]) -> Client<2> {
    let key = Key::new(secret, Role::Control);
    Client::keyed(transport, Requirements::default(), key, NONCE)
}

/// Events of the frames of a tick.
fn events(client: &mut Client<2>, frames: &[StdVec<u8>]) -> StdVec<Result<Event<2>, ClientError>> {
    let mut events = StdVec::new();
    for frame in frames {
        let mut received = client.feed(frame);
        while let Some(event) = received.poll_event() {
            events.push(event);
        }
    }
    events
}

/// Server and client in Obtain.
fn obtaining(transport: Transport) -> (Server, Client<2>) {
    let (mut server, mut client) = (Server::new(transport), client_of(transport, &CONTROL));
    server.take(&client.hello().unwrap());
    for _ in 0..10 {
        let (frames, _) = server.tick();
        for event in events(&mut client, &frames) {
            if event.unwrap() == Event::Challenged {
                server.take(&client.hello().unwrap());
            }
        }
        if server.phase() == Phase::Obtain {
            return (server, client);
        }
        if let Some(answer) = client.answer(Mode::Obtain, &at(3_000)) {
            server.take(&answer.frame);
        }
    }
    panic!("no session");
}

/// A frame without its trailer.
fn kind_of(frame: &[u8]) -> Option<Kind> {
    Kind::from_code(Sealed::parse(frame, Suite::Tag).unwrap().kind_code())
}

/// The frame with one bit flipped.
fn flipped(frame: &[u8], bit: usize) -> StdVec<u8> {
    let mut forged = frame.to_vec();
    forged[bit / 8] ^= 1 << (bit % 8);
    forged
}

/// The first Hello of this client, with other content and a right tag.
fn hello(secret: &[u8; 32], change: impl FnOnce(&mut KeyedHello)) -> FrameBytes {
    let key = Key::new(secret, Role::Control);
    let mut hello = KeyedHello {
        hello: Hello {
            axes: 2,
            capabilities: Capabilities::TAGGED_STATES,
        },
        key: key.id(),
        nonce: NONCE,
        cookie: [0; 16],
    };
    change(&mut hello);
    let mut frame = enclose(Kind::KeyedHello, &hello);
    frame.tag(key.greeting(), &[]);
    frame
}

#[test]
fn a_holder_of_the_key_gets_in_and_moves_the_machine() {
    for transport in TRANSPORTS {
        let (mut server, mut client) = obtaining(transport);
        let id = Key::new(&CONTROL, Role::Control).id();
        assert_eq!(server.bench.endpoint.granted_key(), Some(id));
        for _ in 0..100 {
            let answer = client.answer(Mode::Obtain, &at(3_000));
            if let Some(answer) = answer {
                assert_eq!(answer.frame.len(), 28 + 20 + 24);
                server.take(&answer.frame);
            }
            let (frames, _) = server.tick();
            assert!(matches!(
                events(&mut client, &frames)[..],
                [Ok(Event::State(_))]
            ));
        }
        let state = &server.bench.endpoint.output().unwrap().state;
        assert_eq!(state.axes.map(|axis| axis.offsets), at(3_000));
        assert_eq!((state.counters.missed, state.counters.non_owner), (0, 0));
        server.take(&client.goodbye().unwrap());
        let (frames, _) = server.tick();
        let [Ok(Event::Ended(state))] = events(&mut client, &frames)[..] else {
            panic!("it goes on");
        };
        assert_eq!(state.cause, Cause::Goodbye);
    }
}

#[test]
fn who_has_no_key_gets_no_byte() {
    let genuine = hello(&CONTROL, |_| {});
    assert_eq!(genuine.len(), HELLO);
    let mut forged: StdVec<StdVec<u8>> = (0..8 * HELLO).map(|bit| flipped(&genuine, bit)).collect();
    forged.extend((0..HELLO).map(|length| genuine[..length].to_vec()));
    forged.push([&genuine[..], &[0]].concat());
    forged.push([&genuine[..], &genuine[..]].concat());
    forged.push(hello(&STRANGE, |_| {}).to_vec());
    // The id of one key under the tag of another.
    let other = Key::new(&READ, Role::Read).id();
    forged.push(hello(&CONTROL, |hello| hello.key = other).to_vec());
    forged.push(hello(&STRANGE, |hello| hello.key = KeyId([0; 8])).to_vec());
    forged.push(enclose(Kind::Goodbye, &Epoch(0)).to_vec());
    for frame in &forged {
        let mut server = Server::new(Transport::Datagram);
        server.take(frame);
        let (frames, _) = server.tick();
        assert!(
            frames.is_empty() && server.connection.is_none(),
            "{frame:x?}"
        );
        assert_eq!((server.phase(), server.non_owner()), (Phase::Listening, 1));
    }
}

#[test]
fn a_stream_without_the_key_is_closed_and_is_not_answered() {
    let genuine = hello(&CONTROL, |_| {});
    for bit in 0..8 * HELLO {
        let mut server = Server::new(Transport::Stream);
        server.take(&flipped(&genuine, bit));
        let (frames, ticked) = server.tick();
        let is_waiting = matches!(bit / 8, 4 | 5) && ticked.close.is_empty();
        // Version and suite of a frame are no secret.
        let notice = match bit / 8 {
            2 => Some(Notice::VERSION),
            6 | 7 => Some(Notice::suite(1)),
            _ => None,
        };
        let expected: StdVec<_> = notice
            .map(|notice| crate::control::wire::encode_notice(notice).to_vec())
            .into_iter()
            .collect();
        assert_eq!(frames, expected, "bit {bit}");
        assert!(
            is_waiting || ticked.close == [server.connection.unwrap()],
            "bit {bit}"
        );
        assert_eq!(server.phase(), Phase::Listening);
    }
}

/// A cookie is that of one peer, one nonce, one epoch, and two windows of ticks.
#[test]
fn a_cookie_of_something_else_is_answered_by_another_one() {
    let cookie_for = |address: &[u8; 18], nonce: Nonce, epoch: u64, tick: u64| {
        keyring().cookie(address, &nonce, Epoch(epoch), crate::units::Tick(tick))
    };
    let mut other = ADDRESS;
    other[17] ^= 1;
    let cases = [
        ("its own", cookie_for(&ADDRESS, NONCE, 1, 0), true),
        ("of another peer", cookie_for(&other, NONCE, 1, 0), false),
        (
            "of another nonce",
            cookie_for(&ADDRESS, [0; 16], 1, 0),
            false,
        ),
        ("of another epoch", cookie_for(&ADDRESS, NONCE, 2, 0), false),
        (
            "of a later window",
            cookie_for(&ADDRESS, NONCE, 1, 4_096),
            false,
        ),
        ("none", [0; 16], false),
    ];
    for (case, cookie, is_granted) in cases {
        let mut server = Server::new(Transport::Datagram);
        server.take(&hello(&CONTROL, |hello| hello.cookie = cookie));
        let (frames, _) = server.tick();
        let phase = if is_granted {
            assert_eq!(kind_of(&frames[0]), Some(Kind::Welcome), "{case}");
            Phase::Handshake
        } else {
            assert_eq!(frames.len(), 1, "{case}");
            assert_eq!(kind_of(&frames[0]), Some(Kind::Challenge), "{case}");
            Phase::Listening
        };
        assert_eq!(server.phase(), phase, "{case}");
    }
}

#[test]
fn a_cookie_serves_in_its_window_and_in_the_next() {
    let cookie = keyring().cookie(&ADDRESS, &NONCE, Epoch(1), crate::units::Tick(0));
    for (ticks, is_granted) in [(4_095, true), (8_191, true), (8_192, false)] {
        let mut server = Server::new(Transport::Datagram);
        for _ in 0..ticks {
            server.tick();
        }
        server.take(&hello(&CONTROL, |hello| hello.cookie = cookie));
        server.tick();
        assert_eq!(server.phase() == Phase::Handshake, is_granted, "{ticks}");
    }
}

/// A grant voids every cookie that was given: a recorded Hello grants nothing.
#[test]
fn a_recorded_hello_is_challenged_again() {
    let mut server = Server::new(Transport::Datagram);
    let cookie = keyring().cookie(&ADDRESS, &NONCE, Epoch(1), crate::units::Tick(0));
    let recorded = hello(&CONTROL, |hello| hello.cookie = cookie);
    server.take(&recorded);
    server.tick();
    assert_eq!(server.phase(), Phase::Handshake);
    while server.phase() != Phase::Listening {
        server.tick();
    }
    server.tick();
    server.take(&recorded);
    let (frames, _) = server.tick();
    assert_eq!(kind_of(&frames[0]), Some(Kind::Challenge));
    assert_eq!(server.phase(), Phase::Listening);
}

/// A Hello that is refused is used up as well: replayed after the session of another it would hold
/// one, and send its States to whom it was recorded from.
#[test]
fn a_refused_hello_grants_nothing_later() {
    let (mut server, mut owner) = obtaining(Transport::Datagram);
    let other = [9; 18];
    let endpoint = &mut server.bench.endpoint;
    let Greeted::Answer(challenge) = endpoint.greet(&other, &hello(&CONTROL, |_| {})) else {
        panic!("not challenged");
    };
    let challenge = Sealed::parse(challenge, Suite::Tag).unwrap().body();
    let cookie = challenge.try_into().unwrap();
    let refused = hello(&CONTROL, |hello| hello.cookie = cookie);
    assert!(matches!(endpoint.greet(&other, &refused), Greeted::Peer(_)));
    server.tick();
    server.take(&owner.goodbye().unwrap());
    while server.phase() != Phase::Listening {
        server.tick();
    }
    server.tick();
    let greeted = server.bench.endpoint.greet(&other, &refused);
    let Greeted::Answer(answer) = greeted else {
        panic!("{greeted:?}");
    };
    assert_eq!(kind_of(answer), Some(Kind::Challenge));
}

#[test]
fn four_hellos_are_judged_per_tick() {
    let mut server = Server::new(Transport::Datagram);
    for _ in 0..6 {
        server.take(&hello(&CONTROL, |_| {}));
    }
    let (frames, _) = server.tick();
    assert_eq!(frames.len(), 4);
    assert_eq!(server.non_owner(), 2);
    server.take(&hello(&CONTROL, |_| {}));
    assert_eq!(server.tick().0.len(), 1);
}

#[test]
fn a_key_that_reads_gets_no_session() {
    for transport in TRANSPORTS {
        let (mut server, mut client) = (Server::new(transport), client_of(transport, &READ));
        server.take(&client.hello().unwrap());
        let (frames, _) = server.tick();
        assert_eq!(events(&mut client, &frames), [Ok(Event::Challenged)]);
        server.take(&client.hello().unwrap());
        let (frames, _) = server.tick();
        assert_eq!(
            events(&mut client, &frames),
            [Ok(Event::Refused(Refusal::Role))]
        );
        assert!(client.is_gone());
        assert_eq!(server.phase(), Phase::Listening);
    }
}

#[test]
fn a_second_client_is_refused_under_its_key() {
    for transport in TRANSPORTS {
        let (mut server, _) = obtaining(transport);
        let endpoint = &mut server.bench.endpoint;
        let mut second = client_of(transport, &CONTROL);
        let stream = (transport == Transport::Stream).then(|| endpoint.open(transport).unwrap());
        let mut refused = false;
        for _ in 0..3 {
            let endpoint = &mut server.bench.endpoint;
            let mut answers = StdVec::new();
            let mut connection = stream;
            if let Some(hello) = second.hello() {
                match stream {
                    Some(stream) => drop(endpoint.feed(stream, &hello)),
                    None => match endpoint.greet(&[9; 18], &hello) {
                        Greeted::Nothing => {}
                        Greeted::Answer(answer) => answers.push(answer.to_vec()),
                        Greeted::Peer(peer) => connection = Some(peer),
                    },
                }
            }
            let (_, ticked) = server.tick();
            answers.extend(
                (ticked.sent.iter())
                    .filter(|(to, _)| Some(*to) == connection)
                    .map(|(_, frame)| frame.clone()),
            );
            let heard = events(&mut second, &answers);
            refused |= heard == [Ok(Event::Refused(Refusal::Busy))];
        }
        assert!(refused, "{transport:?}");
    }
}

/// References of a session of some ticks; `disturb` sees the genuine frame before the server does.
fn run(
    transport: Transport,
    ticks: usize,
    mut disturb: impl FnMut(&mut Server, &[u8]),
) -> (StdVec<[Reference; 2]>, Server) {
    let (mut server, mut client) = obtaining(transport);
    let mut references = StdVec::new();
    for index in 0..ticks {
        let target = if index / 20 % 2 == 0 { 9_000 } else { -9_000 };
        let answer = client.answer(Mode::Obtain, &at(target));
        if let Some(answer) = answer {
            disturb(&mut server, &answer.frame);
            server.take(&answer.frame);
        }
        let (frames, ticked) = server.tick();
        references.push(ticked.references);
        events(&mut client, &frames);
    }
    (references, server)
}

/// Any sender can forge the owner's address: 15 forgeries before each genuine frame, and any number
/// behind it.
#[test]
fn forgeries_from_the_owners_address_move_nothing() {
    let (quiet, _) = run(Transport::Datagram, 200, |_, _| {});
    let mut forged = 0_u32;
    let (disturbed, server) = run(Transport::Datagram, 200, |server, genuine| {
        for _ in 0..15 {
            let bit = usize::try_from(forged).unwrap() * 7 % (8 * genuine.len());
            server.take(&flipped(genuine, bit));
            forged += 1;
        }
    });
    assert_eq!(quiet, disturbed);
    let state = &server.bench.endpoint.output().unwrap().state;
    assert_eq!((state.counters.missed, state.counters.malformed), (0, 0));
    assert_eq!(state.counters.non_owner, forged);
    assert_eq!(state.phase, Phase::Obtain);
}

/// Sixteen that look genuine use the tick's tags up: a miss, which is tolerated.
#[test]
fn sixteen_plausible_forgeries_cost_one_command() {
    for (forgeries, misses) in [(15, 0), (16, 1), (17, 1)] {
        let mut left = 1;
        let (_, server) = run(Transport::Datagram, 40, |server, genuine| {
            if left > 0 {
                left -= 1;
                for _ in 0..forgeries {
                    server.take(&flipped(genuine, 8 * genuine.len() - 1));
                }
            }
        });
        let state = &server.bench.endpoint.output().unwrap().state;
        assert_eq!(
            (state.counters.missed, state.phase),
            (misses, Phase::Obtain)
        );
    }
}

/// Recorded frames of this session cost neither tags nor the budget of frames: more than nine of them
/// are no flood.
#[test]
fn replays_are_dropped_before_the_budget() {
    let (quiet, _) = run(Transport::Datagram, 100, |_, _| {});
    let mut recorded: StdVec<StdVec<u8>> = StdVec::new();
    let (disturbed, server) = run(Transport::Datagram, 100, |server, genuine| {
        for frame in recorded.iter().rev().take(20) {
            server.take(frame);
        }
        recorded.push(genuine.to_vec());
        server.take(genuine);
        for _ in 0..20 {
            server.take(genuine);
        }
    });
    assert_eq!(quiet, disturbed);
    let state = &server.bench.endpoint.output().unwrap().state;
    assert_eq!((state.counters.missed, state.counters.duplicate), (0, 0));
    assert_eq!(state.phase, Phase::Obtain);
}

#[test]
fn a_frame_of_the_last_session_is_nothing() {
    let (mut server, mut client) = obtaining(Transport::Datagram);
    let old = client.answer(Mode::Obtain, &at(3_000)).unwrap().frame;
    let stop = client.stop().unwrap();
    server.take(&client.goodbye().unwrap());
    while server.phase() != Phase::Listening {
        server.tick();
    }
    server.tick();
    let (mut again, _) = {
        let mut client = client_of(Transport::Datagram, &CONTROL);
        for _ in 0..8 {
            if let Some(hello) = client.hello() {
                server.take(&hello);
            }
            let (frames, _) = server.tick();
            events(&mut client, &frames);
            if let Some(answer) = client.answer(Mode::Submit, &at(0)) {
                server.take(&answer.frame);
            }
        }
        (client, ())
    };
    assert_eq!(server.phase(), Phase::Submit);
    let before = server.non_owner();
    server.take(&old);
    server.take(&stop);
    if let Some(answer) = again.answer(Mode::Submit, &at(0)) {
        server.take(&answer.frame);
    }
    server.tick();
    assert_eq!(server.phase(), Phase::Submit);
    assert_eq!(server.non_owner(), before + 2);
}

#[test]
fn a_wrong_tag_ends_the_owners_stream_by_the_ramp() {
    let (mut server, mut client) = obtaining(Transport::Stream);
    let genuine = client.answer(Mode::Obtain, &at(3_000)).unwrap().frame;
    server.take(&flipped(&genuine, 8 * genuine.len() - 1));
    let (_, ticked) = server.tick();
    assert_eq!(ticked.output.ended, Some(Cause::Malformed));
    assert_eq!(server.phase(), Phase::SafeDisconnect);
}

#[test]
fn a_hello_of_the_owner_is_not_looked_at() {
    for transport in TRANSPORTS {
        let (mut server, mut client) = obtaining(transport);
        server.take(&hello(&CONTROL, |_| {}));
        server.take(&client.answer(Mode::Obtain, &at(3_000)).unwrap().frame);
        let (_, ticked) = server.tick();
        assert_eq!(ticked.output.state.counters.missed, 0);
        assert_eq!(ticked.output.state.counters.non_owner, 1);
        assert_eq!(server.phase(), Phase::Obtain);
    }
}

/// The other suite is another protocol, on both sides.
#[test]
fn the_suites_do_not_hear_each_other() {
    // Without a key, to a server with keys.
    for transport in TRANSPORTS {
        let mut server = Server::new(transport);
        let mut client = Client::<2>::new(transport, Requirements::default());
        server.take(&client.hello().unwrap());
        let (frames, _) = server.tick();
        let heard = events(&mut client, &frames);
        match transport {
            Transport::Stream => {
                assert_eq!(heard, [Err(ClientError::Notice(Notice::suite(1)))]);
            }
            Transport::Datagram => assert!(heard.is_empty()),
        }
        assert_eq!(server.phase(), Phase::Listening);
    }
    // With a key, to a server without.
    let axes = [axis(limits(100_000, 5_000, 10_000, 100), 1_000_000, 0); 2];
    let mut bench = Bench::new(Parameters::thesis(axes));
    let mut client = client_of(Transport::Stream, &CONTROL);
    let connection = bench.open(Transport::Stream);
    bench.endpoint.feed(connection, &client.hello().unwrap());
    let sent = bench.tick().sent;
    let frames: StdVec<_> = sent.into_iter().map(|(_, frame)| frame).collect();
    let heard = events(&mut client, &frames);
    assert_eq!(heard, [Err(ClientError::Notice(Notice::suite(0)))]);
    assert_eq!(
        bench.endpoint.greet(&ADDRESS, &hello(&CONTROL, |_| {})),
        Greeted::Nothing
    );
}

/// States of a client that declines tags have checksums; its commands have tags.
#[test]
fn a_client_may_decline_the_tags_of_states() {
    let mut server = Server::new(Transport::Datagram);
    let cookie = keyring().cookie(&ADDRESS, &NONCE, Epoch(1), crate::units::Tick(0));
    server.take(&hello(&CONTROL, |hello| {
        hello.cookie = cookie;
        hello.hello.capabilities = Capabilities::NONE;
    }));
    let (frames, _) = server.tick();
    let [welcome, state] = &frames[..] else {
        panic!("{frames:x?}");
    };
    assert_eq!(kind_of(welcome), Some(Kind::Welcome));
    let state = Sealed::parse(state, Suite::Checksum).unwrap();
    assert_eq!(state.check_sum().unwrap().kind_code(), Kind::State.code());
}

/// A client acts on nothing without the server's tag.
#[test]
fn a_client_is_not_moved_by_forgeries() {
    let (mut server, mut client) = obtaining(Transport::Datagram);
    let (frames, _) = server.tick();
    let state = &frames[0];
    let ignored = client.ignored().broken;
    for bit in 0..8 * state.len() {
        assert!(events(&mut client, &[flipped(state, bit)]).is_empty());
    }
    assert_eq!(
        usize::try_from(client.ignored().broken - ignored),
        Ok(8 * state.len())
    );
    assert!(matches!(
        events(&mut client, &frames)[..],
        [Ok(Event::State(_))]
    ));

    let (mut server, mut client) = obtaining(Transport::Stream);
    let (frames, _) = server.tick();
    let forged = flipped(&frames[0], 8 * frames[0].len() - 1);
    let heard = events(&mut client, &[forged, frames[0].clone()]);
    let broken = Err(ClientError::Frame(FrameError::Tag));
    assert_eq!(heard, [broken, broken]);
}

/// Frames of the client itself have right tags: sent back to it, they are none of the server's.
#[test]
fn a_client_does_not_take_its_own_frames() {
    for transport in TRANSPORTS {
        let (mut server, mut client) = obtaining(transport);
        let (frames, _) = server.tick();
        events(&mut client, &frames);
        let command = client.answer(Mode::Obtain, &at(3_000)).unwrap().frame;
        for own in [command, client.stop().unwrap(), client.goodbye().unwrap()] {
            let ignored = client.ignored().broken;
            let heard = events(&mut client, &[own.to_vec()]);
            match transport {
                Transport::Datagram => {
                    assert!(heard.is_empty());
                    assert_eq!(client.ignored().broken, ignored + 1);
                }
                Transport::Stream => {
                    assert_eq!(heard, [Err(ClientError::Frame(FrameError::Tag))]);
                }
            }
        }
    }
}

/// A recorded Refusal or Challenge is for another nonce.
#[test]
fn an_answer_to_another_client_is_not_taken() {
    let mut server = Server::new(Transport::Datagram);
    server.take(&hello(&CONTROL, |hello| hello.nonce = [0; 16]));
    let (frames, _) = server.tick();
    let mut client = client_of(Transport::Datagram, &CONTROL);
    let _ = client.hello();
    assert!(events(&mut client, &frames).is_empty());
    assert_eq!(client.ignored().broken, 1);
}

/// A Challenge that comes twice is not answered twice, and one after the Welcome not at all.
#[test]
fn a_challenge_is_answered_once() {
    for transport in TRANSPORTS {
        let unexpected = Err(ClientError::Unexpected {
            received: Kind::Challenge,
        });
        let (expected, count) = match transport {
            Transport::Stream => (StdVec::from([unexpected]), 0),
            Transport::Datagram => (StdVec::new(), 1),
        };
        let (mut server, mut client) = (Server::new(transport), client_of(transport, &CONTROL));
        server.take(&client.hello().unwrap());
        let (challenge, _) = server.tick();
        assert_eq!(events(&mut client, &challenge), [Ok(Event::Challenged)]);
        assert!(client.hello().is_some());
        assert_eq!(events(&mut client, &challenge), expected);
        assert_eq!(client.ignored().unexpected, count);
        let (_, mut client) = obtaining(transport);
        assert_eq!(events(&mut client, &challenge), expected);
    }
}

#[test]
fn a_client_answers_eight_challenges() {
    let mut client = client_of(Transport::Stream, &CONTROL);
    let key = Key::new(&CONTROL, Role::Control);
    for number in 1..=9_u8 {
        let hello = client.hello().unwrap();
        assert_eq!(hello.len(), HELLO);
        let cookie = crate::control::message::Challenge {
            cookie: [number; 16],
        };
        let mut challenge = enclose(Kind::Challenge, &cookie);
        challenge.tag(key.greeting(), &NONCE);
        let expected = match number {
            ..=8 => Ok(Event::Challenged),
            _ => Err(ClientError::Challenges { answered: 8 }),
        };
        assert_eq!(events(&mut client, &[challenge.to_vec()]), [expected]);
    }
}

/// Strangers make room before a client that has shown its key, and none before it can have done so.
#[test]
fn a_stranger_makes_room_first() {
    let mut server = Server::new(Transport::Stream);
    let shown = server.connection.unwrap();
    let strangers: StdVec<_> = (1..CONNECTIONS)
        .map(|_| server.bench.open(Transport::Stream))
        .collect();
    server.take(&hello(&CONTROL, |_| {}));
    for _ in 0..7 {
        server.tick();
        assert_eq!(server.bench.endpoint.longest_idle(), None);
    }
    server.tick();
    for stranger in strangers {
        assert_eq!(server.bench.endpoint.longest_idle(), Some(stranger));
        server.bench.endpoint.close(stranger);
    }
    assert_eq!(server.bench.endpoint.longest_idle(), Some(shown));
    let (server, _) = obtaining(Transport::Stream);
    assert_eq!(server.bench.endpoint.longest_idle(), None);
}

#[test]
fn six_proven_peers_are_the_most() {
    let mut server = Server::new(Transport::Datagram);
    let endpoint = &mut server.bench.endpoint;
    for peer in 0..CONNECTIONS {
        endpoint.open(Transport::Datagram).unwrap();
        assert!(endpoint.is_valid(), "{peer}");
    }
    let cookie = keyring().cookie(&ADDRESS, &NONCE, Epoch(1), crate::units::Tick(0));
    let Greeted::Answer(answer) =
        endpoint.greet(&ADDRESS, &hello(&CONTROL, |hello| hello.cookie = cookie))
    else {
        panic!("there is no room");
    };
    let mut client = client_of(Transport::Datagram, &CONTROL);
    let _ = client.hello();
    let heard = events(&mut client, &[answer.to_vec()]);
    assert_eq!(heard, [Ok(Event::Refused(Refusal::Unavailable))]);
}

/// Act of a forger, on a frame that either side has sent before.
#[derive(Clone, Debug)]
enum Forgery {
    /// Frame and bit.
    Flip((usize, usize)),
    /// Frame and length.
    Cut((usize, usize)),
    Replay(usize),
    Garbage(StdVec<u8>),
}

fn forgery() -> impl Strategy<Value = Forgery> {
    prop_oneof![
        (0..1_000_usize, 0..4_000_usize).prop_map(Forgery::Flip),
        (0..1_000_usize, 0..400_usize).prop_map(Forgery::Cut),
        (0..1_000_usize).prop_map(Forgery::Replay),
        proptest::collection::vec(any::<u8>(), 0..120).prop_map(Forgery::Garbage),
    ]
}

proptest! {
    /// Without the key nothing is accepted, from any address: the references are those of a quiet
    /// run.
    #[test]
    fn nothing_forged_is_accepted(
        forgeries in proptest::collection::vec((forgery(), any::<bool>()), 1..400),
    ) {
        let (quiet, _) = run(Transport::Datagram, 60, |_, _| {});
        let mut seen: StdVec<StdVec<u8>> = StdVec::new();
        let mut forgeries = forgeries.into_iter();
        let (disturbed, server) = run(Transport::Datagram, 60, |server, genuine| {
            // Fewer than the tags of a tick, so that the genuine frame is looked at.
            for (forgery, is_from_owner) in forgeries.by_ref().take(10) {
                let pick = |index: usize| seen.get(index % seen.len().max(1)).cloned().unwrap_or_default();
                let forged = match forgery {
                    Forgery::Flip((frame, bit)) => {
                        let frame = if frame % 2 == 0 { genuine.to_vec() } else { pick(frame) };
                        if frame.is_empty() { frame } else { let bits = 8 * frame.len(); flipped(&frame, bit % bits) }
                    }
                    Forgery::Cut((frame, length)) => {
                        let frame = pick(frame);
                        frame.get(..length).unwrap_or_default().to_vec()
                    }
                    Forgery::Replay(frame) => pick(frame),
                    Forgery::Garbage(bytes) => bytes,
                };
                if is_from_owner {
                    server.take(&forged);
                } else {
                    let greeted = server.bench.endpoint.greet(&[1; 18], &forged);
                    assert!(!matches!(greeted, Greeted::Peer(_)));
                }
            }
            seen.push(genuine.to_vec());
        });
        prop_assert_eq!(quiet, disturbed);
        let state = &server.bench.endpoint.output().unwrap().state;
        prop_assert_eq!((state.counters.missed, state.phase), (0, Phase::Obtain));
        prop_assert!(state.axes.iter().any(|axis| axis.offsets != Offsets::ZERO));
    }
}
