//! The rules of the server, tick by tick, through the public interface.

use std::vec::Vec as StdVec;

use Move::{Goodbye, Hello, Late, Silence, Written};
use Phase::{Fault, Handshake, Listening, Obtain, SafeDisconnect, Submit};

use super::bench::{BOTH, Bench, EPOCHS, Move, OWNER, REARM, STOP, obtain, start, submit};
use super::config::{MissBudget, Parameters};
use super::*;
use crate::control::axis::Actual;
use crate::control::fixture::{HELLO, at, axis, command, limits};
use crate::control::message::{AxisFlags, ClientMessage, Command, Mode, Refusal};
use crate::control::wire::FrameError;
use crate::units::{OffsetNm, PositionNm, TorquePermille, VelocityUmS};

mod agitation;
mod invariant;
mod nominal_accel;

const OTHER: Connection = Connection(2);

fn parameters() -> Parameters<2> {
    Parameters::thesis(
        [axis(
            limits(1_000_000, 5_000, 10_000, 100),
            1_000_000_000,
            1_000_000,
        ); 2],
    )
}

/// A session in Obtain, with the offsets at `position`.
fn obtaining(position: i32) -> Bench {
    let mut bench = Bench::new(parameters());
    bench.play(&Hello);
    bench.play(&submit(0));
    // At most 5 um per tick, and one tick to be there.
    for _ in 0..((position.abs() + 4_999) / 5_000).max(1) {
        bench.play(&obtain(position));
    }
    assert_eq!((bench.session.phase(), bench.offset()), (Obtain, position));
    bench
}

fn message(message: ClientMessage<2>) -> (Connection, Event<2>) {
    (OWNER, Event::Message(message))
}

/// The other peer asks for the session.
fn ask(bench: &mut Bench) -> Output<2> {
    bench.tick(&[(OTHER, Event::Message(HELLO))])
}

/// A move; phase, position offset and end of a session after it.
type Row = (Move, Phase, i32, Option<Cause>);

impl Bench {
    /// Plays the moves, and compares what they show.
    fn shows(&mut self, rows: &[Row]) {
        for (index, (one, phase, offset, ended)) in rows.iter().enumerate() {
            let output = self.play(one);
            let found = (output.state.phase, self.offset(), output.ended);
            assert_eq!(found, (*phase, *offset, *ended), "move {index}, {one:?}");
        }
    }
}

#[test]
fn a_session_from_hello_to_goodbye() {
    let mut bench = Bench::new(parameters());
    let granted = bench.play(&Hello);
    assert_eq!(granted.welcome, Some(OWNER));
    assert_eq!(
        (granted.state.epoch, granted.state.phase),
        (Epoch(7), Handshake)
    );
    let submitted = bench.play(&submit(4_000));
    assert_eq!(submitted.state.phase, Submit);
    assert_eq!(submitted.references[0].position, PositionNm(0));
    assert_eq!(submitted.state.axes[0].shadow.position, OffsetNm(4_000));
    let obtained = bench.play(&obtain(4_000));
    assert_eq!(obtained.state.phase, Obtain);
    assert_eq!(obtained.references[0].position, PositionNm(4_000));
    assert_eq!(obtained.state.axes[0].shadow, Offsets::ZERO);
    let goodbye = bench.play(&Goodbye);
    assert_eq!(goodbye.ended, Some(Cause::Goodbye));
    assert_eq!(goodbye.references[0].position, PositionNm(3_900));
    for _ in 0..39 {
        assert_eq!(bench.play(&Silence).state.phase, SafeDisconnect);
    }
    assert_eq!(bench.offset(), 0);
    let done = bench.play(&Silence);
    assert_eq!((done.state.phase, done.close), (Listening, Some(OWNER)));
}

#[test]
fn one_miss_holds_and_the_second_in_a_row_ramps_in_its_tick() {
    obtaining(12_000).shows(&[
        (Silence, Obtain, 12_000, None),
        (obtain(12_000), Obtain, 12_000, None),
        (Silence, Obtain, 12_000, None),
        (Silence, SafeDisconnect, 11_900, Some(Cause::ClientLate)),
    ]);
}

#[test]
fn a_skipped_cycle_is_a_miss_and_two_end_the_session() {
    let targets = at(12_000);
    let ended = Some(Cause::ServerLate);
    obtaining(12_000).shows(&[
        (Late(2, targets), Obtain, 12_000, None),
        (Late(3, targets), SafeDisconnect, 11_900, ended),
    ]);
    obtaining(12_000).shows(&[
        (Silence, Obtain, 12_000, None),
        (Late(2, targets), SafeDisconnect, 11_900, ended),
    ]);
}

#[test]
fn submit_is_entered_only_at_zero() {
    obtaining(12_000).shows(&[
        (submit(500_000), Obtain, 7_000, None),
        (submit(500_000), Obtain, 2_000, None),
        (submit(500_000), Obtain, 0, None),
        (submit(500_000), Submit, 0, None),
    ]);
}

#[test]
fn a_stop_ramps_and_only_a_local_rearm_leads_out() {
    let mut bench = obtaining(200);
    // Not while an offset remains, and not while the stop is asserted.
    bench.shows(&[
        (STOP, Fault, 100, Some(Cause::Stop)),
        (REARM, Fault, 0, None),
        (BOTH, Fault, 0, None),
    ]);
    assert_eq!(
        ask(&mut bench).refusals[..],
        [(OTHER, Refusal::Faulted { ticks_left: 0 })]
    );
    bench.shows(&[(REARM, Listening, 0, None)]);
}

/// Found by review: a re-arm pressed before the stop, or stuck, let a stop pass unnoticed.
#[test]
fn a_stuck_rearm_leads_nowhere() {
    obtaining(0).shows(&[
        (BOTH, Fault, 0, Some(Cause::Stop)),
        (REARM, Fault, 0, None),
        (REARM, Fault, 0, None),
        (REARM, Fault, 0, None),
        (Silence, Fault, 0, None),
        (REARM, Listening, 0, None),
    ]);
}

#[test]
fn others_are_refused_until_the_ramp_ends() {
    let mut bench = obtaining(100_000);
    bench.play(&Silence);
    assert_eq!(bench.play(&Silence).state.ramp_ticks_left, 999);
    for ticks_left in (1..=999).rev() {
        assert_ne!(bench.offset(), 0);
        assert_eq!(
            ask(&mut bench).refusals[..],
            [(OTHER, Refusal::Ramping { ticks_left })]
        );
    }
    assert_eq!(bench.offset(), 0);
    bench.play(&Silence);
    assert_eq!(ask(&mut bench).welcome, Some(OTHER));
}

#[test]
fn velocity_and_torque_do_not_hold_over_a_miss() {
    let mut bench = obtaining(0);
    let target = Offsets {
        position: OffsetNm(50),
        velocity: VelocityUmS(60),
        torque: TorquePermille(-7),
    };
    let followed = bench.play(&Move::Answer(Mode::Obtain, [target; 2]));
    assert_eq!(followed.state.axes[0].offsets, target);
    let held = Offsets {
        velocity: VelocityUmS(50),
        torque: TorquePermille(-6),
        ..target
    };
    assert_eq!(bench.play(&Silence).state.axes[0].offsets, held);
}

#[test]
fn only_fresh_commands_count() {
    let mut bench = obtaining(0);
    let ClientMessage::Command(good) = bench.command(Mode::Obtain, at(9)) else {
        unreachable!()
    };
    let edits: [fn(&mut Command<2>); 7] = [
        |c| c.epoch = Epoch(6),
        |c| c.sequence = Sequence(c.sequence.0 - 1),
        |c| c.sequence = Sequence(c.sequence.0 - 2),
        |c| c.sequence = Sequence(c.sequence.0 + 65_536),
        |c| c.echo = Tick(c.echo.0 - 1),
        |c| c.echo = Tick(c.echo.0 + 1),
        |c| c.targets[1].position = OffsetNm(1_000_001),
    ];
    for edit in edits {
        let mut bench = bench.clone();
        let mut bad = good;
        edit(&mut bad);
        let output = bench.tick(&[message(ClientMessage::Command(bad))]);
        assert_eq!(
            output.state.counters.missed, 1,
            "{bad:?} instead of {good:?}"
        );
        assert_eq!(bench.offset(), 0);
    }
    let other = bench.tick(&[(OTHER, Event::Message(ClientMessage::Command(good)))]);
    assert_eq!(
        (other.state.counters.missed, other.state.counters.non_owner),
        (1, 1)
    );
}

#[test]
fn a_late_network_is_told_from_a_late_client() {
    let mut bench = obtaining(0);
    let late = message(bench.command(Mode::Obtain, at(0)));
    bench.play(&Silence);
    let output = bench.tick(&[late]);
    assert_eq!(
        (output.ended, output.state.counters.late),
        (Some(Cause::NetworkLate), 1)
    );
}

#[test]
fn the_highest_of_a_burst_acts() {
    let mut bench = obtaining(0);
    let [first, second, third] =
        [10, 20, 30].map(|target| message(bench.command(Mode::Obtain, at(target))));
    let output = bench.tick(&[third, first, second, third]);
    assert_eq!(bench.offset(), 30);
    assert_eq!(
        (output.state.counters.late, output.state.counters.duplicate),
        (2, 1)
    );
}

#[test]
fn obtain_is_not_allowed_from_the_handshake() {
    let mut bench = Bench::new(parameters());
    bench.play(&Hello);
    let output = bench.play(&obtain(0));
    assert_eq!(
        (output.state.phase, output.state.counters.malformed),
        (Handshake, 1)
    );
}

#[test]
fn a_silent_handshake_times_out() {
    let mut bench = Bench::new(parameters());
    bench.play(&Hello);
    for _ in 0..999 {
        assert_eq!(bench.play(&Silence).state.phase, Handshake);
    }
    assert_eq!(bench.play(&Silence).ended, Some(Cause::HandshakeTimeout));
    assert_eq!(bench.play(&Silence).close, Some(OWNER));
}

#[test]
fn a_second_client_is_refused_and_changes_nothing() {
    let mut bench = obtaining(500);
    let own = message(bench.command(Mode::Obtain, at(700)));
    let output = bench.tick(&[
        (OTHER, Event::Message(ClientMessage::Stop(Epoch(7)))),
        (OTHER, Event::Message(HELLO)),
        (OTHER, Event::Message(ClientMessage::Goodbye(Epoch(7)))),
        (OTHER, Event::Flood),
        own,
    ]);
    assert_eq!(output.refusals[..], [(OTHER, Refusal::Busy)]);
    assert_eq!((output.state.phase, bench.offset()), (Obtain, 700));
}

#[test]
fn endings_have_their_causes_and_their_precedence() {
    let goodbye = Event::Message(ClientMessage::Goodbye(Epoch(7)));
    let cases: [(&[Event<2>], Cause); 6] = [
        (&[Event::Broken(FrameError::Checksum)], Cause::Malformed),
        (&[Event::Flood], Cause::Flood),
        (&[Event::Closed], Cause::Closed),
        (&[goodbye], Cause::Goodbye),
        (
            &[Event::Message(ClientMessage::Stop(Epoch(7)))],
            Cause::Stop,
        ),
        (&[goodbye, Event::Closed], Cause::Closed),
    ];
    for (events, cause) in cases {
        let mut bench = obtaining(1_000);
        let events: StdVec<_> = events.iter().map(|event| (OWNER, *event)).collect();
        let output = bench.tick(&events);
        let phase = if cause == Cause::Stop {
            Fault
        } else {
            SafeDisconnect
        };
        assert_eq!(
            (output.ended, output.state.phase, bench.offset()),
            (Some(cause), phase, 900)
        );
    }
}

/// Nothing is sent to it during the ramp; after a Goodbye the States go on.
#[test]
fn a_connection_that_is_gone_owns_nothing() {
    for event in [
        Event::Broken(FrameError::Checksum),
        Event::Flood,
        Event::Closed,
    ] {
        let mut bench = obtaining(1_000);
        let output = bench.tick(&[(OWNER, event)]);
        assert_eq!(
            (output.owner, bench.session.owner()),
            (None, None),
            "{event:?}"
        );
    }
    let mut bench = obtaining(1_000);
    let output = bench.play(&Goodbye);
    assert_eq!(
        (output.owner, bench.session.owner()),
        (Some(OWNER), Some(OWNER))
    );
}

#[test]
fn a_jump_of_the_nominal_is_passed_through_flagged_and_faults() {
    let mut bench = obtaining(1_000);
    let output = bench.play_at(&obtain(2_000), [PositionNm(0), PositionNm(1_000_001)]);
    assert_eq!(
        (output.state.phase, output.ended),
        (Fault, Some(Cause::Nominal))
    );
    assert_eq!(output.references[1].position, PositionNm(1_000_001 + 900));
    let flagged = output
        .state
        .axes
        .map(|axis| axis.flags.contains(AxisFlags::NOMINAL_STEP));
    assert_eq!(flagged, [false, true]);
}

#[test]
fn the_travel_clamps_a_faulty_nominal() {
    let mut bench = obtaining(1_000);
    for far in [i64::MAX, i64::MIN] {
        let output = bench.play_at(&Silence, [PositionNm(far); 2]);
        assert_eq!(output.references[0].position.0.abs(), 1_001_000_000);
        assert!(output.state.axes[0].flags.contains(AxisFlags::TRAVEL));
    }
}

#[test]
fn a_restarted_server_ramps_what_it_finds() {
    let mut bench = Bench::starting(parameters(), &start([at(-250)[0], Offsets::ZERO]));
    assert_eq!(bench.session.parts().cause, Cause::Restart);
    for offset in [-150, -50, 0] {
        ask(&mut bench);
        assert_eq!(bench.offset(), offset);
    }
    bench.play(&Silence);
    assert_eq!(ask(&mut bench).welcome, Some(OTHER));
    let [far, _] = at(1_000_001);
    assert_eq!(
        Session::new(*bench.session.config(), &start([Offsets::ZERO, far])),
        Err(StartError::OffsetInForce {
            axis: 1,
            offsets: far
        })
    );
}

#[test]
fn a_latched_stop_starts_in_fault() {
    let start = Start {
        stop_latched: true,
        ..start([Offsets::ZERO; 2])
    };
    let mut bench = Bench::starting(parameters(), &start);
    let refused = ask(&mut bench);
    assert_eq!(
        refused.refusals[..],
        [(OTHER, Refusal::Faulted { ticks_left: 0 })]
    );
    assert_eq!(refused.state.cause, Cause::Stop);
    bench.play(&REARM);
    assert_eq!(ask(&mut bench).welcome, Some(OTHER));
}

#[test]
fn one_in_two_loss_meets_the_budget() {
    let budget = Some(MissBudget {
        window: 100,
        allowed: 10,
    });
    let mut bench = Bench::new(Parameters {
        budget,
        ..parameters()
    });
    bench.play(&Hello);
    bench.play(&submit(0));
    for missed in 1..=10 {
        bench.play(&obtain(0));
        assert_eq!(bench.play(&Silence).state.counters.missed, missed);
    }
    bench.play(&obtain(0));
    assert_eq!(bench.play(&Silence).ended, Some(Cause::Budget));
}

#[test]
fn a_goodbye_is_no_miss_and_the_ending_miss_is_one() {
    let cases: [(&[Move], u32, u8); 4] = [
        (&[Goodbye], 0, 100),
        (&[Silence, Silence], 2, 98),
        (&[Late(2, at(0))], 1, 99),
        (&[Late(40, at(0))], 39, 61),
    ];
    for (moves, missed, on_time) in cases {
        let mut bench = obtaining(0);
        let states = moves.iter().map(|one| bench.play(one).state);
        let last = states.last().unwrap();
        assert_eq!(
            (last.counters.missed, last.on_time_of_100),
            (missed, on_time),
            "{moves:?}"
        );
    }
    let silent = obtaining(0)
        .tick_with(&[], |input| input.tick.elapsed_cycles = 40)
        .state;
    assert_eq!((silent.counters.missed, silent.on_time_of_100), (40, 60));
}

/// Runs a tick in which epoch 7 may be granted, and no other.
fn tick_with_one_epoch(session: &mut Session<2>, events: &[Event<2>]) -> Output<2> {
    let mut input = Input::empty(EpochRange {
        first: Epoch(7),
        last: Epoch(7),
    });
    input.events = events.iter().map(|event| (OWNER, *event)).collect();
    session.tick(&input)
}

#[test]
fn an_epoch_is_never_granted_twice() {
    let mut bench = Bench::new(parameters());
    let session = &mut bench.session;
    assert_eq!(
        tick_with_one_epoch(session, &[Event::Message(HELLO)])
            .state
            .epoch,
        Epoch(7)
    );
    tick_with_one_epoch(session, &[Event::Closed]);
    assert_eq!(tick_with_one_epoch(session, &[]).state.phase, Listening);
    assert_eq!(
        tick_with_one_epoch(session, &[Event::Message(HELLO)]).refusals[..],
        [(OWNER, Refusal::Unavailable)]
    );
}

#[test]
fn the_black_box_replays_bit_for_bit() {
    let mut bench = obtaining(3_000);
    let mut black_box = BlackBox::<2, 16>::new();
    for tick in 0..200 {
        let mut input = Input::empty(EPOCHS);
        input.tick.reading = Some(Reading::unmeasured([PositionNm(tick * 10); 2]));
        if tick < 100 {
            let command = bench.command(Mode::Obtain, at(3_000 + i32::try_from(tick).unwrap()));
            input.events.push(message(command)).unwrap();
        }
        Record::before_tick(&mut black_box, &bench.session);
        let output = bench.session.tick(&input);
        Record::after_tick(&mut black_box, &input, &output);
    }
    assert!(black_box.is_frozen());
    let before = black_box.before().unwrap();
    let mut entries: StdVec<_> = black_box.entries().cloned().collect();
    let end = entries
        .iter()
        .position(|entry| entry.output.ended.is_some())
        .unwrap();
    assert!(end >= 16, "{end} ticks before the cause");
    assert_eq!(entries.len() - end - 1, 16);
    let replayed = replay(before, &entries);
    assert_eq!(
        (replayed.agreeing, replayed.differing),
        (entries.len(), None)
    );
    // A nanometre more in one recorded output is found in its tick, and nowhere else.
    let recorded = entries[end].output.clone();
    entries[end].output.references[1].position.0 += 1;
    let replayed = replay(before, &entries);
    assert_eq!(
        (replayed.agreeing, replayed.differing),
        (end, Some(recorded))
    );
}

#[test]
fn a_shadow_held_back_is_flagged() {
    let mut bench = Bench::new(parameters());
    bench.play(&Hello);
    let far = bench.play(&submit(100_000));
    assert!(
        far.state.axes[0]
            .flags
            .contains(AxisFlags::POSITION_LIMITED)
    );
    assert_eq!(far.state.axes[0].shadow.position, OffsetNm(5_000));
}

/// A refused write, after which the drives have these position offsets.
fn refused(positions: [i32; 2], nominal: i64) -> Move {
    let in_force = positions.map(|nm| InForce {
        nominal: PositionNm(nominal),
        offsets: at(nm)[0],
    });
    Written(LastWrite::Refused { in_force })
}

/// Found by test: a bus that had lost writes received everything it had missed at once.
#[test]
fn the_ramp_begins_at_what_the_drives_have_in_force() {
    for phase in [Listening, Obtain, Fault] {
        let mut bench = if phase == Listening {
            Bench::new(parameters())
        } else {
            obtaining(9_000)
        };
        if phase == Fault {
            bench.play(&STOP);
        }
        let output = bench.play(&refused([-1_050; 2], 0));
        assert_eq!(
            (output.withheld, output.state.phase, bench.offset()),
            (false, Fault, -950)
        );
        assert_eq!(output.ended, (phase != Fault).then_some(Cause::Stop));
        // Beyond the limits, or unreadable: nothing may be written until a read-back says what is
        // in force.
        assert!(bench.play(&refused([0, i32::MIN], 0)).withheld);
        assert!(bench.play(&Silence).withheld, "accepted is not a read-back");
        assert!(bench.play(&Written(LastWrite::Unknown)).withheld);
        // The nominal moved on during the outage: a fault, for the drive is still where it was.
        let output = bench.play(&refused([-1_050; 2], -1_000_001));
        assert_eq!((output.withheld, output.state.phase), (false, Fault));
    }
}

#[test]
fn no_session_is_granted_while_the_values_in_force_are_unknown() {
    let mut bench = Bench::new(parameters());
    bench.play(&Written(LastWrite::Unknown));
    for _ in 0..3 {
        assert!(matches!(
            ask(&mut bench).refusals[..],
            [(OTHER, Refusal::Faulted { .. })]
        ));
        bench.play(&REARM);
    }
    bench.play(&Written(LastWrite::Refused {
        in_force: [InForce::at(PositionNm(0)); 2],
    }));
    bench.play(&REARM);
    assert_eq!(ask(&mut bench).welcome, Some(OTHER));
}

/// Values in force at both drives, without offsets.
fn in_force(nm: i64) -> [InForce; 2] {
    [InForce::at(PositionNm(nm)); 2]
}

/// Plays one tick at these nominal references. Returns the output and the position references.
fn play_at(bench: &mut Bench, one: &Move, nominal: [i64; 2]) -> (Output<2>, [i64; 2]) {
    let output = bench.play_at(one, nominal.map(PositionNm));
    let positions = output.references.map(|reference| reference.position.0);
    (output, positions)
}

/// The path has moved on while the drives took nothing.
#[test]
fn after_an_outage_the_reference_waits_for_the_path() {
    let step = 1_000_000;
    let mut bench = obtaining(0);
    bench.play_at(&Written(LastWrite::Unknown), [PositionNm(900_000); 2]);
    let refused = Written(LastWrite::Refused {
        in_force: in_force(0),
    });
    // Both hold, though one could follow: an axis that moves alone bends the machine.
    let (output, positions) = play_at(&mut bench, &refused, [step + 1, step]);
    assert_eq!(
        (output.state.phase, output.state.cause),
        (Fault, Cause::Stop)
    );
    assert_eq!(
        (positions, output.state.axes.map(|axis| axis.nominal.0)),
        ([0; 2], [0; 2])
    );
    let flagged = output
        .state
        .axes
        .map(|axis| axis.flags.contains(AxisFlags::NOMINAL_STEP));
    assert_eq!(flagged, [true, false]);
    // No re-arm leads out, and a path that moves on is not caught up with.
    for (one, nominal) in [
        (&Silence, 2 * step),
        (&REARM, 3 * step),
        (&Silence, i64::MAX),
        (&REARM, step + 1),
    ] {
        let (output, positions) = play_at(&mut bench, one, [nominal; 2]);
        assert_eq!((output.state.phase, positions), (Fault, [0; 2]));
    }
    let (output, positions) = play_at(&mut bench, &REARM, [step; 2]);
    assert_eq!((output.state.phase, positions), (Listening, [step; 2]));
    // From here on the path is in force again, and what it does is passed on.
    let (output, positions) = play_at(&mut bench, &Silence, [step + step + 1; 2]);
    assert_eq!(
        (output.state.phase, positions),
        (Fault, [step + step + 1; 2])
    );
}

#[test]
fn a_restarted_server_waits_for_the_path() {
    let found = Start {
        in_force: [InForce {
            nominal: PositionNm(5_000_000),
            offsets: at(-250)[0],
        }; 2],
        stop_latched: false,
    };
    let mut bench = Bench::starting(parameters(), &found);
    for offset in [-150, -50, 0, 0] {
        let (output, positions) = play_at(&mut bench, &Silence, [0; 2]);
        assert_eq!(
            (output.state.phase, positions),
            (Fault, [5_000_000 + offset; 2])
        );
    }
    let (output, positions) = play_at(&mut bench, &REARM, [4_500_000; 2]);
    assert_eq!((output.state.phase, positions), (Listening, [4_500_000; 2]));
}

#[test]
fn a_machine_that_cannot_be_read_stops_and_waits_for_the_path() {
    let mut bench = obtaining(0);
    let measured = Actual {
        position: PositionNm(77),
        ..Actual::ZERO
    };
    let seen = Reading {
        nominal: [PositionNm(300); 2],
        actual: [measured; 2],
    };
    bench.tick_with(&[], |input| input.tick.reading = Some(seen));
    let blind = bench.tick_with(&[], |input| input.tick.reading = None);
    assert_eq!((blind.state.phase, blind.ended), (Fault, Some(Cause::Stop)));
    assert_eq!(
        blind.references.map(|reference| reference.position.0),
        [300; 2]
    );
    assert_eq!(blind.state.axes.map(|axis| axis.actual), [measured; 2]);
    let (output, positions) = play_at(&mut bench, &Silence, [1_000_301; 2]);
    assert_eq!((output.state.phase, positions), (Fault, [300; 2]));
    let (_, positions) = play_at(&mut bench, &Silence, [1_000_300; 2]);
    assert_eq!(positions, [1_000_300; 2]);
}

#[test]
fn a_session_has_its_own_counts_and_sequence() {
    let mut bench = obtaining(20_000);
    let last = bench.play(&obtain(20_000)).state;
    assert_eq!((last.accepted, last.counters.limited), (Sequence(6), 2 * 3));
    bench.tick(&[(OWNER, Event::Flood)]);
    // 20 000 nm at 100 nm per tick, the first of them in the tick of the flood; and one tick at
    // zero.
    for _ in 0..200 {
        bench.play(&Silence);
    }
    assert_eq!(bench.session.phase(), Listening);
    let ended = bench.play(&Silence).state;
    assert_eq!(
        ended.counters.limited, last.counters.limited,
        "counts stay until the next grant"
    );
    let next = bench.play(&Hello).state;
    assert_eq!(
        (next.accepted, next.counters),
        (Sequence(0), Counters::default())
    );
    // Its first command has a sequence below those of the session before.
    let command = command(&bench.session, 1, Mode::Submit, at(0));
    let state = bench
        .tick(&[message(ClientMessage::Command(command))])
        .state;
    assert_eq!(
        (state.phase, state.accepted, state.counters.received),
        (Submit, Sequence(1), 1)
    );
}

#[test]
fn every_limited_channel_and_every_clamp_is_counted() {
    let mut bench = obtaining(0);
    let far = Offsets {
        position: OffsetNm(5_001),
        velocity: VelocityUmS(-101),
        torque: TorquePermille(11),
    };
    let near = Offsets {
        position: OffsetNm(5_000),
        velocity: VelocityUmS(100),
        torque: TorquePermille(10),
    };
    let state = bench.play(&Move::Answer(Mode::Obtain, [near, far])).state;
    assert_eq!(
        state.axes.map(|axis| axis.flags),
        [AxisFlags::default(), AxisFlags::LIMITED]
    );
    assert_eq!((state.counters.limited, state.counters.clamped), (3, 0));
    let state = bench
        .play_at(&Silence, [PositionNm(i64::MAX), PositionNm(0)])
        .state;
    assert_eq!((state.counters.limited, state.counters.clamped), (3, 1));
}

#[test]
fn a_shadow_holds_over_a_miss() {
    let mut bench = Bench::new(parameters());
    bench.play(&Hello);
    for one in [submit(3_000), Silence] {
        assert_eq!(
            bench.play(&one).state.axes[0].shadow.position,
            OffsetNm(3_000)
        );
    }
}

#[test]
fn messages_of_another_epoch_end_nothing() {
    let mut bench = obtaining(1_000);
    let other = [
        ClientMessage::Goodbye(Epoch(6)),
        ClientMessage::Stop(Epoch(8)),
    ]
    .map(message);
    let output = bench.tick(&other);
    assert_eq!(
        (
            output.state.phase,
            output.ended,
            output.state.counters.stale
        ),
        (Obtain, None, 2)
    );
}

#[test]
fn the_last_of_a_burst_in_order_acts() {
    let mut bench = obtaining(0);
    let burst = [10, 20, 30].map(|target| message(bench.command(Mode::Obtain, at(target))));
    let output = bench.tick(&burst);
    assert_eq!((bench.offset(), output.state.counters.late), (30, 2));
}

/// The server's own lateness is no miss of the client, and its cause is another.
#[test]
fn a_miss_in_a_late_tick_is_the_servers() {
    let output = obtaining(0).tick_with(&[], |input| input.tick.elapsed_cycles = 2);
    assert_eq!(output.ended, Some(Cause::ServerLate));
}
