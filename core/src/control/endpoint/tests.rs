//! Bytes in, bytes and references out: budgets, transports, closings, motors.

use std::vec::Vec as StdVec;

use super::bench::{Bench, NOMINAL, Ticked};
use super::*;
use crate::control::axis::InForce;
use crate::control::fixture::{HELLO, at, axis, limits};
use crate::control::message::{Cause, Mode, Phase, ServerMessage};
use crate::control::session::config::Parameters;
use crate::control::wire::{Frame, decode_server, encode_client};
use crate::units::{Epoch, PositionNm};

fn bench() -> Bench {
    Bench::new(Parameters::thesis(
        [axis(limits(100_000, 5_000, 10_000, 100), 1_000_000, 0); 2],
    ))
}

/// A session in Obtain, and the connection of its owner.
fn obtaining(transport: Transport) -> (Bench, Connection) {
    let mut bench = bench();
    let owner = bench.open(transport);
    bench.endpoint.feed(owner, &hello());
    bench.tick();
    for mode in [Mode::Submit, Mode::Obtain] {
        let command = bench.command(mode, at(3_000));
        bench.endpoint.feed(owner, &command);
        bench.tick();
    }
    assert_eq!(bench.endpoint.session().phase(), Phase::Obtain);
    (bench, owner)
}

impl Bench {
    /// Feeds the answer to the last State, and returns it.
    fn answer(&mut self, owner: Connection) -> FrameBytes {
        let command = self.command(Mode::Obtain, at(3_000));
        self.endpoint.feed(owner, &command);
        command
    }

    /// Opens a stream that asks for the session.
    fn ask(&mut self) -> Connection {
        let peer = self.open(Transport::Stream);
        self.endpoint.feed(peer, &hello());
        peer
    }

    /// Commands that were all sent in one tick.
    fn burst(&mut self, frames: usize) -> StdVec<u8> {
        (0..frames)
            .flat_map(|_| self.command(Mode::Obtain, at(3_000)).to_vec())
            .collect()
    }
}

impl Ticked {
    /// True if the one frame of the tick is a State for this connection.
    fn is_state_for(&self, owner: Connection) -> bool {
        matches!(self.messages()[..], [(to, ServerMessage::State(_))] if to == owner)
    }
}

fn hello() -> FrameBytes {
    encode_client(&HELLO)
}

#[test]
fn paired_motors_receive_equal_references() {
    let (mut bench, owner) = obtaining(Transport::Stream);
    let command = bench.command(Mode::Obtain, at(-20_000));
    bench.endpoint.feed(owner, &command);
    let motors = MotorMap::<2, 3>::new([0, 0, 1]).unwrap();
    let references = bench.tick().references;
    let [first, paired, other] = motors.spread(&references).unwrap();
    assert_eq!(first, paired);
    assert_eq!(first.position, PositionNm(-2_000));
    assert_eq!(other.position, PositionNm(1_000 - 2_000));
    assert_eq!(
        MotorMap::<2, 2>::new([0, 2]),
        Err(MotorMapError {
            motor: 1,
            axis: 2,
            axes: 2
        })
    );
}

#[test]
fn a_ninth_frame_in_a_tick_ends_the_session() {
    for (frames, ended) in [
        (8, None),
        (9, Some(Cause::Flood)),
        (100, Some(Cause::Flood)),
    ] {
        let (mut bench, owner) = obtaining(Transport::Stream);
        let bytes = bench.burst(frames);
        assert_eq!(bench.endpoint.feed(owner, &bytes), 8);
        let turn = bench.tick();
        assert_eq!(turn.output.ended, ended, "{frames} frames");
        assert_eq!(turn.close.contains(&owner), ended.is_some());
    }
}

/// Found by review: a Stop behind a burst was dropped with the flood.
#[test]
fn a_stop_behind_a_burst_still_stops() {
    for frames in [7, 8, 9, 50] {
        let (mut bench, owner) = obtaining(Transport::Stream);
        let mut bytes = bench.burst(frames);
        bytes.extend_from_slice(&encode_client(&ClientMessage::<2>::Stop(
            bench.endpoint.session().epoch(),
        )));
        bench.endpoint.feed(owner, &bytes);
        let output = bench.tick().output;
        assert_eq!(
            (output.ended, output.state.phase),
            (Some(Cause::Stop), Phase::Fault),
            "behind {frames} frames"
        );
    }
}

#[test]
fn others_cannot_crowd_out_the_owner() {
    let (mut bench, owner) = obtaining(Transport::Stream);
    // Other peers connect, send, and leave, far more often than a tick has room for.
    for _ in 0..50 {
        let other = bench.ask();
        bench.endpoint.feed(other, b"nonsense");
        bench.endpoint.close(other);
    }
    let bytes = bench.burst(8);
    bench.endpoint.feed(owner, &bytes);
    bench.endpoint.close(owner);
    let output = bench.tick().output;
    assert_eq!(
        (output.state.counters.received, output.ended),
        (10, Some(Cause::Closed))
    );
}

#[test]
fn a_second_client_is_told_and_closed() {
    let (mut bench, owner) = obtaining(Transport::Stream);
    let other = bench.ask();
    bench.answer(owner);
    let turn = bench.tick();
    assert_eq!(turn.close, [other]);
    let sent = turn.messages();
    assert_eq!(sent[0], (other, ServerMessage::Refusal(Refusal::Busy)));
    assert!(matches!(sent[1], (to, ServerMessage::State(_)) if to == owner));
}

#[test]
fn another_version_or_suite_is_told_ours_over_a_stream_and_closed() {
    for (at, notice) in [(2, Notice::VERSION), (6, Notice::suite(0))] {
        let mut bytes = hello().to_vec();
        bytes[at] = 9;
        let mut bench = bench();
        let other = bench.open(Transport::Stream);
        bench.endpoint.feed(other, &bytes);
        let turn = bench.tick();
        assert_eq!(turn.sent, [(other, encode_notice(notice).to_vec())]);
        assert_eq!(turn.close, [other]);
        let peer = bench.open(Transport::Datagram);
        bench.endpoint.feed(peer, &bytes);
        let turn = bench.tick();
        assert_eq!(
            (turn.sent.as_slice(), turn.close.as_slice()),
            (&[][..], &[][..])
        );
    }
}

/// Two servers must not answer each other for ever.
#[test]
fn a_notice_is_not_answered() {
    let mut bench = bench();
    let other = bench.open(Transport::Stream);
    bench.endpoint.feed(other, &encode_notice(Notice::VERSION));
    let turn = bench.tick();
    assert_eq!(turn.sent, []);
    assert_eq!(turn.close, [other]);
}

#[test]
fn a_broken_stream_ends_and_a_broken_datagram_does_not() {
    for (transport, ended) in [
        (Transport::Stream, Some(Cause::Malformed)),
        (Transport::Datagram, None),
    ] {
        let (mut bench, owner) = obtaining(transport);
        let [mut broken, whole] = [(); 2].map(|()| bench.burst(1));
        broken[10] ^= 1;
        bench.endpoint.feed(owner, &broken);
        if transport == Transport::Datagram {
            bench.endpoint.feed(owner, &whole);
        }
        let output = bench.tick().output;
        assert_eq!(output.ended, ended);
        if ended.is_none() {
            assert_eq!(
                (
                    output.state.counters.malformed,
                    output.state.counters.missed
                ),
                (1, 0)
            );
        }
    }
}

#[test]
fn an_empty_datagram_is_a_broken_one_and_no_bytes_of_a_stream_are_nothing() {
    for (transport, malformed) in [(Transport::Stream, 0), (Transport::Datagram, 1)] {
        let (mut bench, owner) = obtaining(transport);
        assert_eq!(bench.endpoint.feed(owner, &[]), malformed);
        assert_eq!(bench.endpoint.frames_of(owner), malformed);
        let command = bench.burst(1);
        assert_eq!(bench.endpoint.feed(owner, &command), malformed + 1);
        let state = bench.tick().output.state;
        assert_eq!(
            (state.phase, state.counters.malformed),
            (Phase::Obtain, malformed.into())
        );
    }
}

#[test]
fn connections_are_numbered_once_and_limited() {
    let mut bench = bench();
    let first = [(); CONNECTIONS].map(|()| bench.open(Transport::Stream));
    assert_eq!(bench.endpoint.open(Transport::Stream), Err(Full));
    bench.endpoint.close(first[0]);
    let next = bench.open(Transport::Stream);
    assert!(!first.contains(&next));
    assert_eq!(
        bench.endpoint.feed(first[0], &hello()),
        0,
        "a closed connection has no voice"
    );
    let notice = Endpoint::<2>::full_refusal(Transport::Stream);
    assert_eq!(notice, encode_notice(Notice::FULL));
    let refusal = Endpoint::<2>::full_refusal(Transport::Datagram);
    let frame = Frame::parse(&refusal).unwrap();
    assert_eq!(
        decode_server::<2>(&frame),
        Ok(ServerMessage::Refusal(Refusal::Unavailable))
    );
}

#[test]
fn the_last_ramp_step_releases_the_old_owner() {
    let (mut bench, owner) = obtaining(Transport::Stream);
    let goodbye = ClientMessage::<2>::Goodbye(bench.endpoint.session().epoch());
    bench.endpoint.feed(owner, &encode_client(&goodbye));
    // 3 000 nm at 100 nm per tick, the first of them in the tick of the Goodbye.
    for tick in 0..30 {
        let turn = bench.tick();
        assert!(
            turn.is_state_for(owner) && turn.close.is_empty(),
            "tick {tick}"
        );
    }
    assert!(bench.tick().close.contains(&owner));
    assert_eq!(bench.endpoint.session().phase(), Phase::Listening);
}

/// A refused write may come at any time, and the host may ignore what it should poll.
#[test]
fn frames_and_closings_that_are_not_polled_do_no_harm() {
    let (mut bench, owner) = obtaining(Transport::Stream);
    let other = bench.ask();
    for _ in 0..2 {
        bench.answer(owner);
        bench.due().accepted();
        assert_eq!(bench.endpoint.feed(other, &hello()), 0, "not read any more");
    }
    // The Refusal of the first tick is gone with that tick; its connection is still to be closed.
    bench.answer(owner);
    let turn = bench.tick();
    assert!(turn.is_state_for(owner));
    assert_eq!(turn.close, [other]);
}

/// Found by review: a Hello whose connection is gone or expelled by the same tick was granted, and
/// no other peer got in for a second.
#[test]
fn a_hello_without_a_connection_is_not_granted() {
    let ways: [fn(&mut Bench, Connection); 3] = [
        |bench, peer| bench.endpoint.close(peer),
        |bench, peer| {
            bench.endpoint.feed(peer, &hello());
        },
        |bench, peer| {
            bench.endpoint.feed(peer, b"garbage!");
        },
    ];
    for spoil in ways {
        let mut bench = bench();
        let peer = bench.ask();
        spoil(&mut bench, peer);
        assert_eq!(bench.tick().output.welcome, None);
        let next = bench.ask();
        assert_eq!(bench.tick().output.welcome, Some(next));
    }
}

#[test]
fn closing_again_and_again_crowds_no_peer_out() {
    let (mut bench, owner) = obtaining(Transport::Stream);
    for _ in 0..20 {
        bench.endpoint.close(owner);
    }
    let other = bench.ask();
    let turn = bench.tick();
    assert_eq!(turn.output.ended, Some(Cause::Closed));
    assert!(
        turn.sent.iter().any(|(to, _)| *to == other),
        "the other is told why it cannot have the session"
    );
}

/// Found by review: the owner's second Hello closed its connection and kept its session.
#[test]
fn a_hello_of_the_owner_costs_that_frame() {
    let (mut bench, owner) = obtaining(Transport::Stream);
    bench.endpoint.feed(owner, &hello());
    bench.answer(owner);
    let turn = bench.tick();
    assert_eq!((turn.output.refusals.len(), turn.close.len()), (0, 0));
    let counters = turn.output.state.counters;
    assert_eq!((counters.missed, counters.malformed), (0, 1));
}

/// Found by review: connections that never say Hello kept everybody out for ever.
#[test]
fn silent_others_are_shown_out() {
    let mut bench = bench();
    for _ in 0..CONNECTIONS {
        bench.open(Transport::Stream);
    }
    let ticks = (1..=2_000)
        .find(|_| !bench.tick().close.is_empty())
        .unwrap();
    assert_eq!(ticks, 1_001);
    bench.open(Transport::Stream);
}

#[test]
fn the_connection_that_is_open_longest_without_the_session_makes_room() {
    let (mut bench, owner) = obtaining(Transport::Stream);
    assert_eq!(bench.endpoint.longest_idle(), None);
    let [first, next] = [(); 2].map(|()| bench.open(Transport::Stream));
    assert_eq!(bench.endpoint.longest_idle(), Some(first));
    bench.endpoint.close(first);
    assert_eq!(bench.endpoint.longest_idle(), Some(next));
    bench.endpoint.close(owner);
    assert_eq!(bench.endpoint.longest_idle(), Some(next));
}

#[test]
fn lock_step_waits_for_the_answer_to_the_last_state() {
    let (mut bench, owner) = obtaining(Transport::Stream);
    let old = bench.answer(owner);
    bench.tick();
    bench.endpoint.feed(owner, &old);
    assert!(
        !bench.endpoint.owner_has_answered(),
        "a repeated command counted as an answer"
    );
    bench.answer(owner);
    assert!(bench.endpoint.owner_has_answered());
    bench.tick();
    bench.endpoint.close(owner);
    assert!(
        bench.endpoint.owner_has_answered(),
        "nothing more will come"
    );
}

/// Nominal reference and position offset of each axis by the State of the last tick.
fn reported(bench: &mut Bench) -> [(i64, i32); 2] {
    let (_, frame) = bench.endpoint.poll_transmit().unwrap();
    let Ok(ServerMessage::<2>::State(state)) = decode_server(&Frame::parse(frame).unwrap()) else {
        panic!()
    };
    state
        .axes
        .map(|axis| (axis.nominal.0, axis.offsets.position.0))
}

/// Position offset of both axes in force at the drives, at the nominal references of the bench.
fn in_force(position: i32) -> [InForce; 2] {
    NOMINAL.map(|nominal| InForce {
        offsets: at(position)[0],
        ..InForce::at(nominal)
    })
}

impl Bench {
    /// Ticks; the references are due.
    fn due(&mut self) -> PendingWrite<'_, 2> {
        match self.endpoint.tick(&Self::input()) {
            Write::Due(write) => write,
            Write::Withheld(_) => panic!("withheld"),
        }
    }

    /// Ticks; nothing may be written.
    fn withheld(&mut self) -> PendingReadBack<'_, 2> {
        match self.endpoint.tick(&Self::input()) {
            Write::Due(_) => panic!("due"),
            Write::Withheld(read_back) => read_back,
        }
    }
}

/// While nothing reaches the drives, the State reports what they have, and the server does not end.
#[test]
fn a_refused_write_is_not_reported_as_in_force() {
    let (mut bench, owner) = obtaining(Transport::Stream);
    let command = bench.command(Mode::Obtain, at(-1_000));
    bench.endpoint.feed(owner, &command);
    // At the drives nothing moves, although the ramp would go on.
    let here = [(0, 3_000), (1_000, 3_000)];
    bench.due().refused(in_force(3_000));
    assert_eq!(reported(&mut bench), here);
    bench.due().unknown();
    assert_eq!(reported(&mut bench), here);
    bench.withheld().unknown();
    assert_eq!(reported(&mut bench), here);
    bench.withheld().read_back(in_force(3_000));
    assert_eq!(reported(&mut bench), here);
    // Taken again: the ramp goes on from there, and the server may end when its zero was taken.
    let write = bench.due();
    assert_eq!(write.references()[0].position, PositionNm(2_900));
    assert_eq!(write.parts(), in_force(2_900));
    write.accepted();
    assert_eq!(reported(&mut bench), [(0, 2_900), (1_000, 2_900)]);
    for _ in 0..28 {
        bench.tick();
    }
    assert!(!bench.endpoint.is_at_zero());
    bench.tick();
    assert!(bench.endpoint.is_at_zero());
    bench.due().refused(in_force(0));
    assert!(!bench.endpoint.is_at_zero());
}

/// The State reports the values that were read back, and the next tick goes on from them; beyond the
/// limits they count as unknown.
#[test]
fn values_that_were_read_back_count_from_the_same_tick_on() {
    let (mut bench, _) = obtaining(Transport::Stream);
    bench.due().refused(in_force(1_234));
    assert_eq!(reported(&mut bench), [(0, 1_234), (1_000, 1_234)]);
    assert_eq!(bench.due().parts(), in_force(1_134));
    let (mut bench, _) = obtaining(Transport::Stream);
    bench.due().refused(in_force(100_001));
    assert_eq!(reported(&mut bench), [(0, 3_000), (1_000, 3_000)]);
    bench.withheld().read_back(in_force(-100_001));
    assert_eq!(reported(&mut bench), [(0, 3_000), (1_000, 3_000)]);
    bench.withheld().read_back(in_force(-100_000));
    assert_eq!(reported(&mut bench), [(0, -100_000), (1_000, -100_000)]);
    assert_eq!(bench.due().parts(), in_force(-99_900));
}

/// The server does not go on from references that no embedder has called accepted, for any reason of
/// its silence.
#[test]
fn what_is_not_told_is_unknown() {
    let silences: [fn(&mut Bench); 3] = [
        |bench| drop(bench.due()),
        |bench| {
            drop(bench.due());
            assert_eq!(reported(bench), [(0, 3_000), (1_000, 3_000)]);
            assert!(bench.endpoint.pending().is_none(), "too late");
        },
        |bench| bench.due().unknown(),
    ];
    for silence in silences {
        let (mut bench, _) = obtaining(Transport::Stream);
        silence(&mut bench);
        assert!(!bench.endpoint.is_at_zero());
        assert_eq!(bench.endpoint.hold(&NOMINAL, 1), None);
        for _ in 0..2 {
            drop(bench.withheld());
            let session = bench.endpoint.session();
            assert_eq!(session.phase(), Phase::Fault);
        }
        bench.withheld().read_back(in_force(3_000));
        bench.due().accepted();
        assert_eq!(bench.endpoint.session().phase(), Phase::Fault);
        bench.due().accepted();
    }
}

#[test]
fn an_interface_that_cannot_keep_the_references_asks_for_them_again() {
    let (mut bench, owner) = obtaining(Transport::Stream);
    bench.answer(owner);
    drop(bench.due());
    for _ in 0..2 {
        let write = bench.endpoint.pending();
        assert!(matches!(write, Some(Write::Due(_))));
    }
    let Some(Write::Due(write)) = bench.endpoint.pending() else {
        panic!("nothing to write")
    };
    write.accepted();
    assert!(bench.endpoint.pending().is_none(), "told once");
    bench.answer(owner);
    assert_eq!(bench.tick().output.state.phase, Phase::Obtain);
}

/// Before the first tick there is nothing to write, and nothing that could be unknown.
#[test]
fn an_endpoint_that_has_not_ticked_owes_nothing() {
    let mut bench = bench();
    assert!(bench.endpoint.pending().is_none() && bench.endpoint.poll_transmit().is_none());
    assert!(!bench.endpoint.is_at_zero());
    bench.due().accepted();
    assert_eq!(bench.endpoint.session().phase(), Phase::Listening);
}

#[test]
fn the_arrival_is_that_of_one_tick() {
    let mut bench = bench();
    for arrivals in [[700, 0], [65_535, 0]] {
        bench.endpoint.note_arrival(arrivals[0]);
        for arrival_us in arrivals {
            assert_eq!(bench.tick().output.state.arrival_us, arrival_us);
        }
    }
}

/// One clause broken at a time, all others kept.
#[test]
fn every_clause_of_the_invariant_counts() {
    type Break = fn(&mut Endpoint<2>);
    let breaks: [(&str, Break); 9] = [
        ("slot", |endpoint| endpoint.slots[0].frames = 9),
        ("number", |endpoint| {
            endpoint.next_connection = endpoint.slots[1].connection.0
        }),
        ("order", |endpoint| {
            endpoint.slots[1].connection = endpoint.slots[0].connection
        }),
        ("events of the owner", |endpoint| {
            endpoint.slots[0].frames = 2
        }),
        ("events of others", |endpoint| endpoint.non_owner_events = 0),
        ("budget of others", |endpoint| endpoint.non_owner_events = 6),
        ("owner gone", |endpoint| {
            endpoint.input.events.clear();
            endpoint.slots.remove(0);
        }),
        ("a fate that is not told", |endpoint| {
            endpoint.is_told = false;
        }),
        ("owner to be closed", |endpoint| {
            endpoint.input.events.truncate(1);
            endpoint.slots[0].closed = true;
        }),
    ];
    let (mut bench, owner) = obtaining(Transport::Stream);
    let bytes = bench.burst(3);
    assert_eq!(bench.endpoint.feed(owner, &bytes), 3);
    bench.ask();
    assert!(bench.endpoint.is_valid());
    for (clause, spoil) in breaks {
        let mut spoilt = bench.endpoint.clone();
        spoil(&mut spoilt);
        assert!(!spoilt.is_valid(), "{clause}");
    }
    bench.endpoint.close(owner);
    assert!(bench.endpoint.is_valid(), "its Closed waits");
}

#[test]
fn six_others_have_five_events_and_the_last_is_shown_out() {
    let mut bench = bench();
    let peers = [(); CONNECTIONS].map(|()| bench.ask());
    assert!(bench.endpoint.is_valid());
    let turn = bench.tick();
    assert_eq!(turn.output.welcome, Some(peers[0]));
    let refused: StdVec<_> = turn.output.refusals.iter().map(|(peer, _)| *peer).collect();
    assert_eq!(refused[..], peers[1..5]);
    assert_eq!(turn.close[..], peers[1..]);
}

/// One frame per tick is read of a connection that does not own the session; a second one of any
/// content costs it the first.
#[test]
fn a_stop_of_another_has_no_way_round_its_budget() {
    let (mut bench, owner) = obtaining(Transport::Stream);
    let other = bench.ask();
    let stop = ClientMessage::<2>::Stop(bench.endpoint.session().epoch());
    assert_eq!(bench.endpoint.feed(other, &encode_client(&stop)), 1);
    bench.answer(owner);
    let turn = bench.tick();
    assert_eq!(
        (
            turn.output.state.phase,
            turn.output.state.counters.non_owner
        ),
        (Phase::Obtain, 0)
    );
    assert_eq!(turn.close, [other]);
}

#[test]
fn epochs_may_be_replaced_while_it_runs() {
    let mut bench = bench();
    bench.endpoint.set_epochs(EpochRange {
        first: Epoch(40),
        last: Epoch(41),
    });
    bench.ask();
    assert_eq!(bench.tick().output.state.epoch, Epoch(40));
}
