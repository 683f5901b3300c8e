//! A client against a real endpoint, in memory, over streams and datagrams. Any turns in any order:
//! `proofs`; lost, doubled and reordered datagrams: the soak of `tests`.

use std::vec::Vec as StdVec;

use super::dialogue::{Granted, Stage};
use super::*;
use crate::control::endpoint::bench::Bench;
use crate::control::fixture::{self, at, axis, limits};
use crate::control::message::{Cause, ServerMessage};
use crate::control::session::Connection;
use crate::control::session::config::Parameters;
use crate::control::wire::{Kind, Notice, encode_notice, encode_server};
use crate::units::{Epoch, OffsetNm, Tick, TorquePermille, VelocityUmS};

type Tested = Client<2>;

const CHECKSUM: u32 = 0xfeed_f00d;

fn requirements() -> Requirements {
    Requirements {
        capabilities: Capabilities::NONE,
        cycle_us: Some(1_000),
        kinematics_checksum: Some(CHECKSUM),
    }
}

/// A client that has said Hello.
fn greeted(transport: Transport, requirements: Requirements) -> Tested {
    let mut client = Tested::new(transport, requirements);
    assert!(client.hello().is_some());
    client
}

/// The server and its side of the connection.
struct Server {
    bench: Bench,
    connection: Connection,
}

impl Server {
    fn new(transport: Transport) -> Self {
        let axes =
            [20_000, 30_000].map(|max| axis(limits(max, 5_000, 10_000, 1_000), 1_000_000, 0));
        let mut bench = Bench::new(Parameters {
            kinematics_checksum: CHECKSUM,
            ..Parameters::thesis(axes)
        });
        let connection = bench.open(transport);
        Self { bench, connection }
    }

    /// The State of the last tick.
    fn state(&self) -> &State<2> {
        &self.bench.endpoint.output().unwrap().state
    }

    /// One tick; returns the frames for the client.
    fn tick(&mut self, received: &[StdVec<u8>]) -> StdVec<StdVec<u8>> {
        for bytes in received {
            self.bench.endpoint.feed(self.connection, bytes);
        }
        let ticked = self.bench.tick();
        assert!(ticked.sent.iter().all(|(to, _)| *to == self.connection));
        ticked.sent.into_iter().map(|(_, frame)| frame).collect()
    }

    /// One tick over a stream that the client reads in pieces; returns what the client makes of it.
    fn turn(
        &mut self,
        client: &mut Tested,
        frame: Option<FrameBytes>,
        piece: usize,
    ) -> StdVec<Event<2>> {
        let received: StdVec<_> = frame.iter().map(|frame| frame.to_vec()).collect();
        let mut events = StdVec::new();
        for rest in self.tick(&received).concat().chunks(piece) {
            let mut received = client.feed(rest);
            while let Some(event) = received.poll_event() {
                events.push(event.unwrap());
            }
            assert_eq!(received.left(), 0);
            assert!(client.is_valid());
        }
        events
    }
}

/// Feeds at most one event.
fn fed<const N: usize>(
    client: &mut Client<N>,
    bytes: &[u8],
) -> Result<Option<Event<N>>, ClientError> {
    let mut received = client.feed(bytes);
    let event = received.poll_event().transpose();
    assert!(received.poll_event().is_none() && received.left() == 0);
    event
}

fn far() -> [Offsets; 2] {
    let far = Offsets {
        position: OffsetNm(i32::MIN),
        velocity: VelocityUmS(1_001),
        torque: TorquePermille(100),
    };
    [far, Offsets::position(OffsetNm(30_000))]
}

#[test]
fn a_session_over_a_stream_split_anywhere() {
    for piece in 1..=600 {
        let mut client = Tested::new(Transport::Stream, requirements());
        let mut server = Server::new(Transport::Stream);
        assert!(client.goodbye().is_none() && client.stop().is_none());
        let mut outgoing = client.hello();
        assert!(client.hello().is_none(), "one Hello per stream");
        let mut phases = StdVec::new();
        for _ in 0..30 {
            if client.is_gone() {
                break;
            }
            for event in server.turn(&mut client, outgoing.take(), piece) {
                match event {
                    Event::Challenged => panic!("a server without keys"),
                    Event::Welcomed(welcome) => assert_eq!(client.welcome(), Some(&welcome)),
                    Event::Refused(refusal) => panic!("{refusal}"),
                    Event::State(state) => {
                        assert!(client.has_unanswered());
                        phases.push(state.phase);
                    }
                    Event::Ended(state) => {
                        assert_eq!(
                            (state.cause, state.phase),
                            (Cause::Goodbye, Phase::SafeDisconnect)
                        );
                    }
                }
            }
            outgoing = if phases.len() < 10 {
                let answer = client.answer(Mode::Obtain, &far()).unwrap();
                let [first, second] = answer.saturated;
                assert!(answer.is_saturated() && !second.any());
                assert!(first.position && first.velocity && !first.torque);
                let cut = Offsets {
                    position: OffsetNm(-20_000),
                    velocity: VelocityUmS(1_000),
                    ..far()[0]
                };
                assert_eq!(answer.command.targets, [cut, far()[1]]);
                assert!(!client.has_unanswered());
                Some(answer.frame)
            } else {
                client
                    .goodbye()
                    .inspect(|_| assert!(client.goodbye().is_none(), "one Goodbye per stream"))
            };
            assert!(
                client.answer(Mode::Submit, &far()).is_none(),
                "one answer per State"
            );
        }
        assert!(client.is_gone());
        assert_eq!(
            phases[..3],
            [Phase::Handshake, Phase::Submit, Phase::Obtain]
        );
        assert!(client.is_at_boundary());
        assert_eq!(client.ignored(), Ignored::default());
        assert_eq!(server.state().counters.malformed, 0);
    }
}

#[test]
fn submit_is_asked_for_until_the_server_has_accepted_it() {
    let (mut client, mut server) = granted(Transport::Datagram);
    let modes = [true, true, false, false].map(|is_lost| {
        let answer = client.answer(Mode::Obtain, &at(0)).unwrap();
        let received = if is_lost {
            StdVec::new()
        } else {
            std::vec![answer.frame.to_vec()]
        };
        for frame in server.tick(&received) {
            fed(&mut client, &frame).unwrap();
        }
        answer.command.mode
    });
    assert_eq!(
        modes,
        [Mode::Submit, Mode::Submit, Mode::Submit, Mode::Obtain]
    );
}

#[test]
fn a_goodbye_over_datagrams_is_repeated_per_state() {
    let (mut client, mut server) = granted(Transport::Datagram);
    for _ in 0..3 {
        // The Goodbye is lost; the server counts a miss, or waits for its first command.
        assert!(client.goodbye().is_some());
        assert!(client.goodbye().is_none(), "once per State");
        assert!(client.answer(Mode::Submit, &at(0)).is_none());
        for frame in server.tick(&[]) {
            assert!(fed(&mut client, &frame).is_ok());
        }
    }
    let goodbye = client.goodbye().unwrap().to_vec();
    let frames = server.tick(&[goodbye]);
    let event = fed(&mut client, &frames[0]);
    assert!(matches!(event, Ok(Some(Event::Ended(state))) if state.cause == Cause::Goodbye));
    assert!(client.is_gone() && client.goodbye().is_none());
}

/// A client and a server in Handshake, the first State unanswered.
fn granted(transport: Transport) -> (Tested, Server) {
    let mut client = Tested::new(transport, requirements());
    let mut server = Server::new(transport);
    let hello = client.hello().unwrap().to_vec();
    for frame in server.tick(&[hello]) {
        fed(&mut client, &frame).unwrap();
    }
    assert_eq!(client.phase(), Some(Phase::Handshake));
    assert!(client.hello().is_none());
    (client, server)
}

/// The frame of a State of the server's first session.
fn state(tick: u64, phase: Phase) -> FrameBytes {
    state_of(Epoch(1), tick, phase)
}

fn state_of(epoch: Epoch, tick: u64, phase: Phase) -> FrameBytes {
    encode_server(&ServerMessage::State(fixture::state(epoch, tick, phase, 0)))
}

/// The frame of a Welcome on the server's terms, but for what `edit` changes.
fn welcome(edit: impl FnOnce(&mut Welcome<2>)) -> FrameBytes {
    let mut welcome = *granted(Transport::Stream).0.welcome().unwrap();
    edit(&mut welcome);
    encode_server(&ServerMessage::Welcome(welcome))
}

fn refusal(reason: Refusal) -> FrameBytes {
    encode_server(&ServerMessage::<2>::Refusal(reason))
}

#[test]
fn a_goodbye_without_effect_is_an_error() {
    let (mut client, _) = granted(Transport::Stream);
    assert!(client.goodbye().is_some());
    let first = client.welcome().unwrap().tick.0;
    for count in 1..u64::from(GOODBYE_STATES) {
        assert!(matches!(
            fed(&mut client, &state(first + count, Phase::Obtain)),
            Ok(Some(Event::State(_)))
        ));
    }
    let last = fed(
        &mut client,
        &state(first + u64::from(GOODBYE_STATES), Phase::Obtain),
    );
    assert_eq!(last, Err(ClientError::GoodbyeUnheard { states: 100 }));
    assert!(client.is_valid() && !client.is_gone());
}

/// It proves nothing: whoever reaches the port of the client could have sent it.
#[test]
fn a_notice_is_shown_over_streams_and_ignored_over_datagrams() {
    for notice in [Notice::VERSION, Notice::FULL, Notice::suite(0)] {
        let frame = encode_notice(notice);
        let mut client = Client::<2>::new(Transport::Stream, requirements());
        let mut event = Ok(None);
        // Known by its header, before the end of the frame.
        for byte in frame.iter().take(8) {
            assert_eq!(event, Ok(None));
            event = fed(&mut client, &[*byte]);
        }
        assert_eq!(event, Err(ClientError::Notice(notice)));
        let (mut client, _) = granted(Transport::Datagram);
        assert_eq!(fed(&mut client, &frame), Ok(None));
        assert_eq!(client.ignored().broken, 1);
    }
}

#[test]
fn messages_that_do_not_fit_are_errors_over_streams_and_ignored_over_datagrams() {
    let cases = [
        (
            refusal(Refusal::Busy),
            ClientError::Unexpected {
                received: Kind::Refusal,
            },
            [0, 0, 1],
        ),
        (
            welcome(|_| {}),
            ClientError::Unexpected {
                received: Kind::Welcome,
            },
            [0, 0, 1],
        ),
        (
            state(1, Phase::Handshake),
            ClientError::OldState {
                expected: Tick(2),
                received: Tick(1),
            },
            [1, 0, 0],
        ),
        (
            state_of(Epoch(9), 50, Phase::Handshake),
            ClientError::Epoch {
                expected: Epoch(1),
                received: Epoch(9),
            },
            [0, 1, 0],
        ),
    ];
    for (frame, error, counts) in cases {
        let (mut client, _) = granted(Transport::Stream);
        let before = client.dialogue;
        assert_eq!(fed(&mut client, &frame), Err(error));
        assert_eq!(client.dialogue, before, "{error}");
        let (mut client, _) = granted(Transport::Datagram);
        assert_eq!(fed(&mut client, &frame), Ok(None), "{error}");
        let ignored = client.ignored();
        assert_eq!(
            [ignored.old, ignored.other_epoch, ignored.unexpected],
            counts,
            "{error}"
        );
        assert!(client.has_unanswered());
    }
    let error = Err(ClientError::Unexpected {
        received: Kind::State,
    });
    for (transport, expected, ignored) in [
        (Transport::Stream, error, 0),
        (Transport::Datagram, Ok(None), 1),
    ] {
        let mut early = Tested::new(transport, requirements());
        assert_eq!(
            fed(&mut early, &state(1, Phase::Handshake)),
            expected,
            "a State before the Welcome"
        );
        assert_eq!(early.ignored().unexpected, ignored);
    }
}

#[test]
fn a_welcome_is_not_taken_before_a_hello() {
    let welcomed = welcome(|_| {});
    let mut client = Tested::new(Transport::Datagram, requirements());
    assert_eq!(fed(&mut client, &welcomed), Ok(None));
    assert_eq!(client.ignored().unexpected, 1);
    assert!(
        client.hello().is_some() && client.hello().is_some(),
        "as often as asked"
    );
    assert!(matches!(
        fed(&mut client, &welcomed),
        Ok(Some(Event::Welcomed(_)))
    ));
}

#[test]
fn a_state_from_before_the_welcome_is_not_of_this_session() {
    let mut client = greeted(Transport::Datagram, requirements());
    assert!(fed(&mut client, &welcome(|welcome| welcome.tick = Tick(40))).is_ok());
    assert_eq!(fed(&mut client, &state(39, Phase::Handshake)), Ok(None));
    assert!(matches!(
        fed(&mut client, &state(40, Phase::Handshake)),
        Ok(Some(Event::State(_)))
    ));
}

#[test]
fn terms_that_do_not_fit_are_errors_by_name() {
    let any = Requirements::default();
    let terms = *granted(Transport::Stream).0.welcome().unwrap();
    let usual = encode_server(&ServerMessage::Welcome(terms));
    let needed = Capabilities::LOCKSTEP;
    let cases = [
        (
            Requirements {
                cycle_us: Some(2_000),
                ..any
            },
            usual.clone(),
            ClientError::Cycle {
                expected_us: 2_000,
                received_us: 1_000,
            },
        ),
        (
            Requirements {
                kinematics_checksum: Some(1),
                ..any
            },
            usual.clone(),
            ClientError::Checksum {
                expected: 1,
                received: CHECKSUM,
            },
        ),
        (
            any,
            welcome(|welcome| welcome.capabilities = needed),
            ClientError::Capability { needed },
        ),
    ];
    for (requirements, frame, error) in cases {
        let mut client = greeted(Transport::Stream, requirements);
        assert_eq!(fed(&mut client, &frame), Err(error));
        assert!(client.welcome().is_none());
    }
    let mut client = greeted(Transport::Stream, any);
    assert_eq!(fed(&mut client, &usual), Ok(Some(Event::Welcomed(terms))));
    // A server of another number of axes.
    let mut other = Client::<3>::new(Transport::Stream, any);
    let _ = other.hello();
    assert!(matches!(
        fed(&mut other, &usual),
        Err(ClientError::Content(_))
    ));
}

#[test]
fn a_refusal_ends_the_client_even_before_its_hello() {
    let mut client = Tested::new(Transport::Stream, requirements());
    let event = fed(&mut client, &refusal(Refusal::Unavailable));
    assert_eq!(event, Ok(Some(Event::Refused(Refusal::Unavailable))));
    assert!(client.is_gone() && client.hello().is_none() && client.goodbye().is_none());
}

#[test]
fn a_broken_stream_stays_broken_and_a_broken_datagram_is_counted() {
    let (mut client, _) = granted(Transport::Stream);
    let mut bytes = state(2, Phase::Handshake).to_vec();
    bytes[20] ^= 1;
    for _ in 0..2 {
        let event = fed(&mut client, &bytes);
        assert!(matches!(event, Err(ClientError::Frame(_))));
    }
    let (mut client, _) = granted(Transport::Datagram);
    assert_eq!(fed(&mut client, &bytes), Ok(None));
    assert_eq!(fed(&mut client, &[]), Ok(None));
    assert_eq!(client.ignored().broken, 2);
}

#[test]
fn a_stop_stops_and_the_ramp_is_seen() {
    let (mut client, mut server) = granted(Transport::Stream);
    // One to submit, four of 5 um each to get there.
    for _ in 0..5 {
        let answer = client
            .answer(Mode::Obtain, &at(20_000))
            .map(|answer| answer.frame);
        server.turn(&mut client, answer, 4_096);
    }
    assert_eq!(server.state().axes[0].offsets.position, OffsetNm(20_000));
    let stop = client.stop();
    let events = server.turn(&mut client, stop, 4_096);
    assert!(
        matches!(events[..], [Event::Ended(state)] if (state.cause, state.phase) == (Cause::Stop, Phase::Fault))
    );
    assert!(client.is_gone() && client.goodbye().is_none());
    let events = server.turn(&mut client, None, 4_096);
    assert!(
        matches!(events[..], [Event::Ended(state)] if state.axes[0].offsets.position == OffsetNm(18_000))
    );
    assert!(client.stop().is_some(), "a Stop may be repeated");
}

#[test]
fn a_session_that_is_over_does_not_come_back() {
    let (mut client, _) = granted(Transport::Datagram);
    for (tick, phase) in [(2, Phase::SafeDisconnect), (3, Phase::Obtain)] {
        assert!(matches!(
            fed(&mut client, &state(tick, phase)),
            Ok(Some(Event::Ended(_)))
        ));
    }
    assert!(client.is_valid() && client.answer(Mode::Submit, &at(0)).is_none());
}

#[test]
fn errors_say_what_and_where() {
    use std::string::ToString;
    let error = ClientError::Cycle {
        expected_us: 1_000,
        received_us: 2_000,
    };
    assert_eq!(
        error.to_string(),
        "the server's cycle is 2000 us, the client's is 1000 us"
    );
    let error = ClientError::Unexpected {
        received: Kind::Welcome,
    };
    assert_eq!(
        error.to_string(),
        "unexpected Welcome: expected one answer to Hello, then States"
    );
}

#[test]
fn every_clause_of_the_invariant_counts() {
    let (mut client, mut server) = granted(Transport::Stream);
    let tick = client.welcome().unwrap().tick;
    let breaks: [fn(&mut Granted<2>); 6] = [
        |session| session.last = None,
        |session| (session.last, session.unanswered, session.ended) = (None, false, true),
        |session| session.welcome.tick.0 += 9,
        |session| session.last.as_mut().unwrap().phase = Phase::SafeDisconnect,
        |session| session.ended = true,
        |session| session.leaving = Some(GOODBYE_STATES + 1),
    ];
    let answer = client.answer(Mode::Submit, &at(0)).unwrap();
    assert!(!answer.is_saturated());
    for frame in server.tick(&[answer.frame.to_vec()]) {
        fed(&mut client, &frame).unwrap();
    }
    assert!(client.is_valid() && client.dialogue.last().unwrap().tick > tick);
    for (clause, spoil) in breaks.iter().enumerate() {
        let mut spoilt = client.clone();
        let Stage::Granted(session) = &mut spoilt.dialogue.stage else {
            panic!()
        };
        spoil(session);
        assert!(!spoilt.is_valid(), "{clause}");
    }
}

/// Bytes that were not polled may be fed again, and nothing is lost.
#[test]
fn bytes_are_taken_as_events_are_polled() {
    let (mut client, _) = granted(Transport::Stream);
    let frames = [2, 3, 4].map(|tick| state(tick, Phase::Handshake).to_vec());
    let bytes = frames.concat();
    let one = frames[0].len();
    let mut received = client.feed(&bytes);
    assert_eq!(received.left(), bytes.len());
    assert!(
        matches!(received.poll_event(), Some(Ok(Event::State(state))) if state.tick == Tick(2))
    );
    assert_eq!(received.left(), bytes.len() - one);
    let mut received = client.feed(&bytes[one..]);
    for tick in [3, 4] {
        assert!(
            matches!(received.poll_event(), Some(Ok(Event::State(state))) if state.tick == Tick(tick))
        );
    }
    assert!(received.poll_event().is_none() && received.left() == 0);
    assert!(client.feed(&[]).poll_event().is_none());
}

#[test]
fn a_frame_in_pieces_is_no_boundary() {
    let (mut client, mut server) = granted(Transport::Stream);
    let frame = server.tick(&[]).concat();
    assert!(client.is_at_boundary());
    assert_eq!(fed(&mut client, &frame[..9]), Ok(None));
    assert!(!client.is_at_boundary());
    assert!(matches!(
        fed(&mut client, &frame[9..]),
        Ok(Some(Event::State(_)))
    ));
    assert!(client.is_at_boundary());
}

/// A server that is in Submit before it had a command is not taken at its word.
#[test]
fn the_first_command_asks_for_submit_whatever_the_server_says() {
    let (mut client, _) = granted(Transport::Stream);
    let tick = client.welcome().unwrap().tick.0;
    fed(&mut client, &state(tick + 1, Phase::Submit)).unwrap();
    assert_eq!(
        client.answer(Mode::Obtain, &at(0)).unwrap().command.mode,
        Mode::Submit
    );
}

#[test]
fn a_cut_of_any_channel_is_a_cut() {
    let none = Saturated::default();
    assert!(!none.any());
    let one = [
        Saturated {
            position: true,
            ..none
        },
        Saturated {
            velocity: true,
            ..none
        },
        Saturated {
            torque: true,
            ..none
        },
    ];
    assert!(one.iter().all(|saturated| saturated.any()));
}
