//! Bytes in, bytes and references out: budgets, transports, closings, motors.

use std::vec::Vec as StdVec;

use super::*;
use crate::control::axis::{Actual, Offsets};
use crate::control::channel::tests::limits;
use crate::control::message::{Capabilities, Cause, ClientMessage, Command, Hello, Mode, Phase};
use crate::control::session::config::{AxisConfig, Config, Parameters, Travel};
use crate::control::session::{LastWrite, Start};
use crate::control::wire::{Frame, decode_server, encode_client};
use crate::units::{OffsetNm, PositionNm, Sequence};

type Tested = Endpoint<2, 3>;

const NOMINAL: [PositionNm; 2] = [PositionNm(0), PositionNm(1_000)];

/// One tick as its host sees it.
struct Ticked {
    motors: [Reference; 3],
    output: Output<2>,
    close: StdVec<Connection>,
}

struct Bench {
    endpoint: Tested,
    /// Messages of the last tick.
    sent: StdVec<(Connection, ServerMessage<2>)>,
    sequence: u64,
}

fn config() -> Config<2> {
    let limits = limits(100_000, 5_000, 10_000, 100);
    let axis = AxisConfig::position_only(limits, Travel::around_zero(1_000_000), 0);
    Config::new(Parameters::thesis([axis; 2])).unwrap()
}

/// A refused write may come at any time, and the host may ignore what it should poll.
#[test]
fn frames_and_closings_that_are_not_polled_do_no_harm() {
    let (mut bench, owner) = Bench::obtaining(Transport::Stream);
    let other = bench.endpoint.open(Transport::Stream).unwrap();
    bench.endpoint.feed(other, &hello());
    let input = bench.input();
    for _ in 0..2 {
        let command = bench.command(Mode::Obtain, 3_000);
        bench.endpoint.feed(owner, &command);
        let _ = bench.endpoint.tick(&input);
        assert_eq!(bench.endpoint.feed(other, &hello()), 0, "not read any more");
    }
    // The Refusal of the first tick is gone with that tick; its connection is still to be closed.
    let command = bench.command(Mode::Obtain, 3_000);
    bench.endpoint.feed(owner, &command);
    let ticked = bench.tick();
    assert!(matches!(bench.sent[..], [(to, ServerMessage::State(_))] if to == owner));
    assert_eq!(ticked.close, [other]);
}

impl Bench {
    fn new() -> Self {
        let session = Session::new(config(), &Start::at_rest(NOMINAL)).unwrap();
        let motors = MotorMap::new([0, 0, 1]).unwrap();
        Self { endpoint: Endpoint::new(session, motors, EpochRange::VOLATILE), sent: StdVec::new(), sequence: 0 }
    }

    fn input(&self) -> TickInput<2> {
        TickInput {
            elapsed_cycles: 1,
            nominal: NOMINAL,
            actual: [Actual::ZERO; 2],
            stop: false,
            rearm: false,
            last_write: LastWrite::Accepted,
            arrival_us: 0,
        }
    }

    fn tick(&mut self) -> Ticked {
        let input = self.input();
        let motors = self.endpoint.tick(&input).unwrap();
        assert!(self.endpoint.is_valid());
        self.sent.clear();
        while let Some((to, bytes)) = self.endpoint.poll_transmit() {
            let frame = Frame::parse(bytes).unwrap();
            self.sent.push((to, decode_server(&frame).unwrap()));
        }
        assert!(self.sent.len() <= FRAMES);
        let output = self.endpoint.output().unwrap().clone();
        let close = core::iter::from_fn(|| self.endpoint.poll_close()).collect();
        assert!(self.endpoint.is_valid());
        Ticked { motors, output, close }
    }

    fn command(&mut self, mode: Mode, position: i32) -> FrameBytes {
        self.sequence += 1;
        let session = self.endpoint.session();
        let target = Offsets::position(OffsetNm(position));
        encode_client(&ClientMessage::Command(Command {
            epoch: session.epoch(),
            sequence: Sequence(self.sequence),
            echo: session.last_tick(),
            mode,
            targets: [target; 2],
        }))
    }

    /// A session in Obtain over the given transport.
    fn obtaining(transport: Transport) -> (Self, Connection) {
        let mut bench = Self::new();
        let owner = bench.endpoint.open(transport).unwrap();
        bench.endpoint.feed(owner, &hello());
        bench.tick();
        for mode in [Mode::Submit, Mode::Obtain] {
            let command = bench.command(mode, 3_000);
            bench.endpoint.feed(owner, &command);
            bench.tick();
        }
        assert_eq!(bench.endpoint.session().phase(), Phase::Obtain);
        (bench, owner)
    }
}

fn hello() -> FrameBytes {
    encode_client(&ClientMessage::<2>::Hello(Hello { axes: 2, capabilities: Capabilities::NONE }))
}

#[test]
fn paired_motors_receive_equal_references() {
    let (mut bench, owner) = Bench::obtaining(Transport::Stream);
    let command = bench.command(Mode::Obtain, -20_000);
    bench.endpoint.feed(owner, &command);
    let turn = bench.tick();
    assert_eq!(turn.motors[0], turn.motors[1]);
    assert_eq!(turn.motors[0].position, PositionNm(-2_000));
    assert_eq!(turn.motors[2].position, PositionNm(1_000 - 2_000));
    assert_eq!(MotorMap::<2, 2>::new([0, 2]), Err(MotorMapError { motor: 1, axis: 2, axes: 2 }));
}

#[test]
fn a_ninth_frame_in_a_tick_ends_the_session() {
    for (frames, ended) in [(8, None), (9, Some(Cause::Flood)), (100, Some(Cause::Flood))] {
        let (mut bench, owner) = Bench::obtaining(Transport::Stream);
        let mut bytes = StdVec::new();
        for _ in 0..frames {
            bytes.extend_from_slice(&bench.command(Mode::Obtain, 3_000));
        }
        assert_eq!(bench.endpoint.feed(owner, &bytes), 8);
        let turn = bench.tick();
        assert_eq!(turn.output.ended, ended, "{frames} frames");
        assert_eq!(turn.close.contains(&owner), ended.is_some());
    }
}

#[test]
fn others_cannot_crowd_out_the_owner() {
    let (mut bench, owner) = Bench::obtaining(Transport::Stream);
    // Other peers connect, send, and leave, far more often than a tick has room for.
    for _ in 0..50 {
        let other = bench.endpoint.open(Transport::Stream).unwrap();
        bench.endpoint.feed(other, &hello());
        bench.endpoint.feed(other, b"nonsense");
        bench.endpoint.close(other);
    }
    let mut bytes = StdVec::new();
    for _ in 0..8 {
        bytes.extend_from_slice(&bench.command(Mode::Obtain, 4_000));
    }
    bench.endpoint.feed(owner, &bytes);
    bench.endpoint.close(owner);
    let turn = bench.tick();
    assert_eq!(turn.output.state.counters.received, 10);
    assert_eq!(turn.output.ended, Some(Cause::Closed));
}

#[test]
fn a_second_client_is_told_and_closed() {
    let (mut bench, owner) = Bench::obtaining(Transport::Stream);
    let other = bench.endpoint.open(Transport::Stream).unwrap();
    bench.endpoint.feed(other, &hello());
    let command = bench.command(Mode::Obtain, 3_000);
    bench.endpoint.feed(owner, &command);
    let turn = bench.tick();
    assert_eq!(turn.close[..], [other]);
    assert_eq!(bench.sent[0], (other, ServerMessage::Refusal(Refusal::Busy)));
    assert!(matches!(bench.sent[1], (to, ServerMessage::State(_)) if to == owner));
}

#[test]
fn another_version_is_told_ours_and_closed() {
    let mut bench = Bench::new();
    let other = bench.endpoint.open(Transport::Stream).unwrap();
    let mut bytes = hello().to_vec();
    bytes[2] = 9;
    bench.endpoint.feed(other, &bytes);
    let turn = bench.tick();
    let supported = PROTOCOL_VERSION;
    assert_eq!(bench.sent[..], [(other, ServerMessage::Refusal(Refusal::Version { supported }))]);
    assert_eq!(turn.close[..], [other]);
}

#[test]
fn a_broken_stream_ends_and_a_broken_datagram_does_not() {
    for (transport, ended) in [(Transport::Stream, Some(Cause::Malformed)), (Transport::Datagram, None)] {
        let (mut bench, owner) = Bench::obtaining(transport);
        let mut broken = bench.command(Mode::Obtain, 3_000).to_vec();
        broken[10] ^= 1;
        bench.endpoint.feed(owner, &broken);
        if transport == Transport::Datagram {
            let whole = bench.command(Mode::Obtain, 3_000);
            bench.endpoint.feed(owner, &whole);
        }
        let turn = bench.tick();
        assert_eq!(turn.output.ended, ended);
        if ended.is_none() {
            assert_eq!(turn.output.state.counters.malformed, 1);
            assert_eq!(turn.output.state.counters.missed, 0);
        }
    }
}

#[test]
fn connections_are_numbered_once_and_limited() {
    let mut bench = Bench::new();
    let first: StdVec<_> = (0..CONNECTIONS).map(|_| bench.endpoint.open(Transport::Stream).unwrap()).collect();
    assert_eq!(bench.endpoint.open(Transport::Stream), Err(Full));
    bench.endpoint.close(first[0]);
    let next = bench.endpoint.open(Transport::Stream).unwrap();
    assert!(!first.contains(&next));
    assert_eq!(bench.endpoint.feed(first[0], &hello()), 0, "a closed connection has no voice");
    let refusal = Tested::full_refusal();
    let frame = Frame::parse(&refusal).unwrap();
    assert_eq!(decode_server::<2>(&frame), Ok(ServerMessage::Refusal(Refusal::Unavailable)));
}

#[test]
fn the_last_ramp_step_releases_the_old_owner() {
    let (mut bench, owner) = Bench::obtaining(Transport::Stream);
    let epoch = bench.endpoint.session().epoch();
    bench.endpoint.feed(owner, &encode_client(&ClientMessage::<2>::Goodbye(epoch)));
    let mut ticks = 0;
    while !bench.tick().close.contains(&owner) {
        assert!(matches!(bench.sent[..], [(to, ServerMessage::State(_))] if to == owner));
        ticks += 1;
    }
    // 3 000 nm at 100 nm per tick, the first of them in the tick of the Goodbye.
    assert_eq!(ticks, 30);
    assert_eq!(bench.endpoint.session().phase(), Phase::Listening);
}

/// Found by review: a Hello whose connection is gone or expelled by the same tick was granted, and no other peer got in for a second.
#[test]
fn a_hello_without_a_connection_is_not_granted() {
    let ways: [fn(&mut Tested, Connection); 3] = [
        |endpoint, peer| endpoint.close(peer),
        |endpoint, peer| {
            endpoint.feed(peer, &hello());
        },
        |endpoint, peer| {
            endpoint.feed(peer, b"garbage");
        },
    ];
    for spoil in ways {
        let mut bench = Bench::new();
        let peer = bench.endpoint.open(Transport::Stream).unwrap();
        bench.endpoint.feed(peer, &hello());
        spoil(&mut bench.endpoint, peer);
        let turn = bench.tick();
        assert_eq!(turn.output.welcome, None);
        let next = bench.endpoint.open(Transport::Stream).unwrap();
        bench.endpoint.feed(next, &hello());
        assert_eq!(bench.tick().output.welcome, Some(next));
    }
}

/// Found by review: the owner's second Hello closed its connection and kept its session.
#[test]
fn closing_again_and_again_crowds_no_peer_out() {
    let (mut bench, owner) = Bench::obtaining(Transport::Stream);
    for _ in 0..20 {
        bench.endpoint.close(owner);
    }
    let other = bench.endpoint.open(Transport::Stream).unwrap();
    bench.endpoint.feed(other, &hello());
    let turn = bench.tick();
    assert_eq!(turn.output.ended, Some(Cause::Closed));
    let told = bench.sent.iter().any(|(to, _)| *to == other);
    assert!(told, "the other is told why it cannot have the session");
}

#[test]
fn a_hello_of_the_owner_costs_that_frame() {
    let (mut bench, owner) = Bench::obtaining(Transport::Stream);
    bench.endpoint.feed(owner, &hello());
    let command = bench.command(Mode::Obtain, 3_000);
    bench.endpoint.feed(owner, &command);
    let turn = bench.tick();
    assert_eq!((turn.output.refusals.len(), turn.close.len()), (0, 0));
    assert_eq!(turn.output.state.counters.missed, 0);
    assert_eq!(turn.output.state.counters.malformed, 1);
}

/// Found by review: a Stop behind a burst was dropped with the flood.
#[test]
fn a_stop_behind_a_burst_still_stops() {
    for frames in [7, 8, 9, 50] {
        let (mut bench, owner) = Bench::obtaining(Transport::Stream);
        let epoch = bench.endpoint.session().epoch();
        let mut bytes = StdVec::new();
        for _ in 0..frames {
            bytes.extend_from_slice(&bench.command(Mode::Obtain, 3_000));
        }
        bytes.extend_from_slice(&encode_client(&ClientMessage::<2>::Stop(epoch)));
        bench.endpoint.feed(owner, &bytes);
        let turn = bench.tick();
        assert_eq!(turn.output.ended, Some(Cause::Stop), "behind {frames} frames");
        assert_eq!(turn.output.state.phase, Phase::Fault);
    }
}

/// Found by review: connections that never say Hello kept everybody out for ever.
#[test]
fn silent_others_are_shown_out() {
    let mut bench = Bench::new();
    for _ in 0..CONNECTIONS {
        bench.endpoint.open(Transport::Stream).unwrap();
    }
    let ticks = (1..).find(|_| !bench.tick().close.is_empty()).unwrap();
    assert_eq!(ticks, 1_001);
    assert!(bench.endpoint.open(Transport::Stream).is_ok());
}

#[test]
fn lock_step_waits_for_the_answer_to_the_last_state() {
    let (mut bench, owner) = Bench::obtaining(Transport::Stream);
    let old = bench.command(Mode::Obtain, 3_000);
    bench.endpoint.feed(owner, &old);
    bench.tick();
    bench.endpoint.feed(owner, &old);
    assert!(!bench.endpoint.owner_has_answered(), "a repeated command counted as an answer");
    let answer = bench.command(Mode::Obtain, 3_000);
    bench.endpoint.feed(owner, &answer);
    assert!(bench.endpoint.owner_has_answered());
    bench.tick();
    bench.endpoint.close(owner);
    assert!(bench.endpoint.owner_has_answered(), "nothing more will come");
}

#[test]
fn an_empty_datagram_is_a_broken_one_and_no_bytes_of_a_stream_are_nothing() {
    for (transport, malformed) in [(Transport::Stream, 0), (Transport::Datagram, 1)] {
        let (mut bench, owner) = Bench::obtaining(transport);
        assert_eq!(bench.endpoint.feed(owner, &[]), malformed);
        assert_eq!(bench.endpoint.frames_of(owner), malformed);
        let command = bench.command(Mode::Obtain, 3_000);
        assert_eq!(bench.endpoint.feed(owner, &command), malformed + 1);
        let state = bench.tick().output.state;
        assert_eq!(state.phase, Phase::Obtain);
        assert_eq!(state.counters.malformed, u32::from(malformed));
    }
}
