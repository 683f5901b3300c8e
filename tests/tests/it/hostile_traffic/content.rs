//! The inside of frames: duplicated, reordered, of another session, out of range, nonsense. Each
//! costs its frame and no more.

use gantry_tau_core::control::message::{Cause, ClientMessage, Command, Counters, Mode, Phase};
use gantry_tau_core::control::wire::{HEADER_LEN, PROTOCOL_VERSION, TRAILER_LEN};
use gantry_tau_core::units::Epoch;
use gantry_tau_tests::client::{Noise, enclose};
use gantry_tau_tests::server_fixture::MAX_NM;
use gantry_tau_tests::session_fixture::{SessionFixture, offsets};

use super::AT;

/// A session at [`AT`], after another one, whose epoch was given to a client.
fn second_session() -> SessionFixture<3> {
    let SessionFixture { mut server, client } = SessionFixture::obtained(AT);
    client.reset();
    server.await_loss_of_owner();
    server.assert_disconnect(AT, Cause::Closed);
    SessionFixture::submitted_on(server).obtain(AT)
}

#[test]
fn a_command_that_is_no_fresh_answer_is_a_miss() {
    type Case = (&'static str, fn(&mut Command<3>), fn(&Counters) -> u32);
    let cases: [Case; 19] = [
        (
            "of the last sequence",
            |c| c.sequence.0 -= 1,
            |n| n.duplicate,
        ),
        ("overtaken", |c| c.sequence.0 -= 2, |n| n.late),
        ("65 537 ahead", |c| c.sequence.0 += 65_536, |n| n.stale),
        (
            "of the greatest sequence",
            |c| c.sequence.0 = u64::MAX,
            |n| n.stale,
        ),
        ("to the State before", |c| c.echo.0 -= 1, |n| n.late),
        ("to the first State", |c| c.echo.0 = 0, |n| n.late),
        ("to the next State", |c| c.echo.0 += 1, |n| n.stale),
        (
            "to the last State there can be",
            |c| c.echo.0 = u64::MAX,
            |n| n.stale,
        ),
        ("of no session", |c| c.epoch.0 = 0, |n| n.stale),
        ("of the session before", |c| c.epoch.0 -= 1, |n| n.stale),
        ("of the next session", |c| c.epoch.0 += 1, |n| n.stale),
        (
            "of the last session there can be",
            |c| c.epoch.0 = u64::MAX,
            |n| n.stale,
        ),
        (
            "too far",
            |c| c.targets[2] = offsets(MAX_NM + 1, 0, 0),
            |n| n.out_of_range,
        ),
        (
            "too far back",
            |c| c.targets[2] = offsets(-MAX_NM - 1, 0, 0),
            |n| n.out_of_range,
        ),
        (
            "as far back as can be",
            |c| c.targets[2] = offsets(i32::MIN, 0, 0),
            |n| n.out_of_range,
        ),
        (
            "too fast",
            |c| c.targets[2] = offsets(0, 5_001, 0),
            |n| n.out_of_range,
        ),
        (
            "as fast back as can be",
            |c| c.targets[2] = offsets(0, i32::MIN, 0),
            |n| n.out_of_range,
        ),
        (
            "too strong",
            |c| c.targets[2] = offsets(0, 0, -51),
            |n| n.out_of_range,
        ),
        (
            "too strong and too far",
            |c| c.targets[0] = offsets(MAX_NM + 1, 0, 51),
            |n| n.out_of_range,
        ),
    ];
    let mut session = second_session();
    // 65 536 ahead is fresh.
    session.client.sequence += 65_535;
    let mut counters = session.answer(Mode::Obtain, AT).state.counters;
    for (case, change, count) in cases {
        // Names the case if the next assertion fails.
        println!("{case}");
        session.deliver_changed([0; 3], change);
        let before = std::mem::replace(&mut counters, session.assert_held().state.counters);
        assert_eq!(count(&counters), count(&before) + 1, "{case}: {counters:?}");
        assert_eq!(counters.out_of_range, counters.malformed, "{case}");
        session.client.sequence = session.server.accepted();
        session.answer(Mode::Obtain, AT);
    }
}

#[test]
fn a_goodbye_and_a_stop_of_another_epoch_change_nothing() {
    let mut session = second_session();
    let own = session.client.epoch.0;
    for (count, epoch) in (1..).zip([0, own - 1, own + 1, u64::MAX]) {
        session.say(&ClientMessage::Goodbye(Epoch(epoch)));
        session.say(&ClientMessage::Stop(Epoch(epoch)));
        assert_eq!(session.assert_held().state.counters.stale, 2 * count);
        session.answer(Mode::Obtain, AT);
    }
}

#[test]
fn a_target_far_away_is_approached_in_steps_of_s() {
    let mut session = SessionFixture::obtained([0; 3]);
    for tick in 1..=40 {
        let row = session.answer(Mode::Obtain, [MAX_NM, -MAX_NM, 0]);
        assert_eq!(
            session.server.bus.positions(),
            [5_000 * tick, -5_000 * tick, 0]
        );
        let limited = row.state.axes.map(|axis| axis.flags.bits());
        assert_eq!(limited, [2, 2, 0]);
    }
    // A reversal at full speed stays within S as well; the server watches A.
    session.answer(Mode::Obtain, [-MAX_NM, MAX_NM, 0]);
    assert_eq!(session.server.bus.positions(), [195_000, -195_000, 0]);
}

#[test]
fn well_framed_nonsense_costs_nothing_but_its_frame() {
    let mut noise = Noise::new(42);
    let mut session = SessionFixture::obtained(AT);
    for round in 1..=400 {
        let count = noise.below(385);
        let kind = noise.bytes(1)[0];
        let nonsense = enclose(PROTOCOL_VERSION, kind, &noise.bytes(count));
        let answer = session.client.frame(Mode::Obtain, AT);
        assert_eq!(session.deliver(&[nonsense, answer].concat()), 2);
        let row = session.tick();
        assert_eq!(row.state.phase, Phase::Obtain);
        let counters = row.state.counters;
        assert_eq!(counters.malformed + counters.stale, round);
        assert_eq!(session.server.bus.positions(), AT);
    }
    session.deliver(&enclose(PROTOCOL_VERSION, 99, &[]));
    session.assert_held();
    session.deliver(&enclose(PROTOCOL_VERSION, 3, &noise.bytes(58)));
    let _ = session.assert_disconnect(AT, Cause::ClientLate);
}

#[test]
fn every_byte_of_a_commands_body_may_be_anything() {
    let mut session = SessionFixture::obtained([0; 3]);
    for index in 0..58 {
        let frame = session.client.frame(Mode::Obtain, [7; 3]);
        let mut body = frame[HEADER_LEN..frame.len() - TRAILER_LEN].to_vec();
        body[index] ^= 0xa5;
        // For any meaning of it now, the answer behind it is the higher sequence, and acts or is a
        // miss.
        let answer = session.client.frame(Mode::Obtain, [0; 3]);
        assert_eq!(
            session.deliver(&[enclose(PROTOCOL_VERSION, 3, &body), answer].concat()),
            2
        );
        assert_eq!(session.tick().state.phase, Phase::Obtain, "byte {index}");
        session.client.sequence = session.client.sequence.max(session.server.accepted());
    }
}
