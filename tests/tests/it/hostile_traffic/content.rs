//! The inside of frames: duplicated, reordered, of another session, out of range, nonsense. Each costs its frame and no more.

use gantry_tau_core::control::message::{Cause, ClientMessage, Mode, Phase};
use gantry_tau_core::control::wire::encode_client;
use gantry_tau_core::units::{Epoch, Sequence, Tick};
use gantry_tau_tests::client::{Noise, crc32, enclose};
use gantry_tau_tests::server_fixture::MAX_NM;
use gantry_tau_tests::session_fixture::{SessionFixture, offsets};

use super::AT;

#[test]
fn the_helpers_checksum_is_the_specified_one() {
    assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
    let goodbye = encode_client(&ClientMessage::<3>::Goodbye(Epoch(7)));
    assert_eq!(enclose(1, 5, &7_u64.to_le_bytes()), goodbye[..]);
}

#[test]
fn a_duplicate_acts_once_and_is_no_answer() {
    let mut session = SessionFixture::obtained(AT);
    let frame = session.client.frame(Mode::Obtain, AT);
    assert_eq!(session.deliver(&frame.repeat(2)), 2);
    assert_eq!(session.tick().state.counters.duplicate, 1);
    session.deliver(&frame);
    assert_eq!(session.assert_held().state.counters.duplicate, 2);
    session.deliver(&frame);
    let _ = session.assert_disconnect(AT, Cause::ClientLate);
}

#[test]
fn of_reordered_commands_the_highest_acts() {
    let mut session = SessionFixture::obtained([0; 3]);
    let [a, b, c] = [10, 20, 30].map(|nm| session.client.frame(Mode::Obtain, [nm; 3]));
    assert_eq!(session.deliver(&[c, a.clone(), b.clone()].concat()), 3);
    assert_eq!(session.tick().state.counters.late, 2);
    assert_eq!(session.server.bus.positions(), [30; 3]);
    assert_eq!(session.deliver(&[b, a].concat()), 2);
    assert_eq!(session.assert_held().state.counters.late, 4);
    session.answer(Mode::Obtain, [40; 3]);
    assert_eq!(session.server.bus.positions(), [40; 3]);
}

#[test]
fn a_sequence_may_be_65536_ahead_and_no_more() {
    let mut session = SessionFixture::obtained([0; 3]);
    session.client.sequence += 65_535;
    session.answer(Mode::Obtain, [10; 3]);
    assert_eq!(session.server.bus.positions(), [10; 3]);
    let accepted = session.client.sequence;
    for (misses, beyond) in (1..).zip([accepted + 65_537, u64::MAX]) {
        session.client.sequence = beyond - 1;
        let frame = session.client.frame(Mode::Obtain, [20; 3]);
        session.deliver(&frame);
        assert_eq!(session.assert_held().state.counters.stale, misses);
        session.client.sequence = accepted + u64::from(misses) - 1;
        session.answer(Mode::Obtain, [10; 3]);
    }
}

#[test]
fn only_an_echo_of_the_last_state_is_an_answer() {
    let mut session = SessionFixture::obtained(AT);
    let last = session.client.tick.0;
    for echo in [last + 1, u64::MAX, last + 3, 0] {
        let mut command = session.client.command(Mode::Obtain, [0; 3]);
        command.echo = Tick(echo);
        session.say(&ClientMessage::Command(command));
        session.assert_held();
        session.answer(Mode::Obtain, AT);
    }
    // Always one tick behind: the answers come, but never in time.
    let behind = Tick(session.client.tick.0 - 1);
    let mut command = session.client.command(Mode::Obtain, AT);
    command.echo = behind;
    session.say(&ClientMessage::Command(command));
    session.assert_held();
    command = session.client.command(Mode::Obtain, AT);
    command.echo = Tick(behind.0 + 1);
    session.say(&ClientMessage::Command(command));
    let _ = session.assert_disconnect(AT, Cause::NetworkLate);
}

#[test]
fn another_epoch_is_another_session() {
    let first = SessionFixture::obtained([150; 3]);
    let old = first.client.epoch;
    let SessionFixture { mut server, client } = first;
    client.reset();
    server.await_loss_of_owner();
    server.assert_disconnect([150; 3], Cause::Closed);
    let mut session = SessionFixture::submitted_on(server).obtain(AT);
    let own = session.client.epoch;
    assert!(own > old);
    for (count, epoch) in (1..).zip([old, Epoch(0), Epoch(own.0 + 1), Epoch(u64::MAX)]) {
        let mut command = session.client.command(Mode::Obtain, [0; 3]);
        command.epoch = epoch;
        session.say(&ClientMessage::Command(command));
        session.say(&ClientMessage::Goodbye(epoch));
        session.say(&ClientMessage::Stop(epoch));
        assert_eq!(session.assert_held().state.counters.stale, 3 * count);
        session.answer(Mode::Obtain, AT);
    }
}

#[test]
fn a_target_out_of_range_costs_the_frame() {
    let mut session = SessionFixture::obtained(AT);
    let (p, v, t) = (MAX_NM + 1, 5_001, 51);
    for (count, bad) in (1..).zip([
        offsets(p, 0, 0),
        offsets(-p, 0, 0),
        offsets(i32::MIN, 0, 0),
        offsets(0, v, 0),
        offsets(0, i32::MIN, 0),
        offsets(0, 0, -t),
    ]) {
        let mut command = session.client.command(Mode::Obtain, [0; 3]);
        command.targets[2] = bad;
        session.say(&ClientMessage::Command(command));
        let counters = session.assert_held().state.counters;
        assert_eq!((counters.out_of_range, counters.malformed), (count, count));
        session.answer(Mode::Obtain, AT);
    }
    session.assert_held();
    let frame = session.client.frame(Mode::Obtain, [MAX_NM + 1, 0, 0]);
    session.deliver(&frame);
    let _ = session.assert_disconnect(AT, Cause::ClientLate);
}

#[test]
fn a_target_far_away_is_approached_in_steps_of_s() {
    let mut session = SessionFixture::obtained([0; 3]);
    for tick in 1..=40 {
        let row = session.answer(Mode::Obtain, [MAX_NM, -MAX_NM, 0]);
        assert_eq!(session.server.bus.positions(), [5_000 * tick, -5_000 * tick, 0]);
        let limited = row.state.axes.map(|axis| axis.flags.bits());
        assert_eq!(limited, [2, 2, 0]);
    }
    // A reversal at full speed stays within S as well; the server watches A.
    session.answer(Mode::Obtain, [-MAX_NM, MAX_NM, 0]);
    assert_eq!(session.server.bus.positions(), [195_000, -195_000, 0]);
}

#[test]
fn velocity_and_torque_do_not_hold_over_a_miss() {
    let mut session = SessionFixture::submitted_on(gantry_tau_tests::server_fixture::ServerFixture::<2>::default());
    for _ in 0..3 {
        session.answer_all(Mode::Obtain, offsets(1_000, 420, -9));
    }
    assert_eq!(session.server.bus.in_force(), [offsets(1_000, 420, -9); 2]);
    session.tick();
    assert_eq!(session.server.bus.in_force(), [offsets(1_000, 370, -8); 2]);
    assert_eq!(session.tick().ended, Some(Cause::ClientLate));
    assert_eq!(session.server.bus.in_force(), [offsets(900, 320, -7); 2]);
    for tick in 1..=9 {
        session.tick();
        let left = |value: i32, rate: i32| (value - rate * tick).max(0);
        let torque = i16::try_from(-left(7, 1)).unwrap();
        let expected = offsets(left(900, 100), left(320, 50), torque);
        assert_eq!(session.server.bus.in_force(), [expected; 2]);
    }
    assert_eq!(session.server.step().state.phase, Phase::Listening);
}

#[test]
fn well_framed_nonsense_costs_nothing_but_its_frame() {
    let mut noise = Noise::new(42);
    let mut session = SessionFixture::obtained(AT);
    for round in 1..=400 {
        let count = noise.below(385);
        let kind = noise.bytes(1)[0];
        let nonsense = enclose(1, kind, &noise.bytes(count));
        let answer = session.client.frame(Mode::Obtain, AT);
        assert_eq!(session.deliver(&[nonsense, answer].concat()), 2);
        let row = session.tick();
        assert_eq!(row.state.phase, Phase::Obtain);
        let counters = row.state.counters;
        assert_eq!(counters.malformed + counters.stale, round);
        assert_eq!(session.server.bus.positions(), AT);
    }
    session.deliver(&enclose(1, 99, &[]));
    session.assert_held();
    session.deliver(&enclose(1, 3, &noise.bytes(58)));
    let _ = session.assert_disconnect(AT, Cause::ClientLate);
}

#[test]
fn every_byte_of_a_commands_body_may_be_anything() {
    let mut session = SessionFixture::obtained([0; 3]);
    for index in 0..58 {
        let mut command = session.client.command(Mode::Obtain, [7; 3]);
        command.sequence = Sequence(session.client.sequence);
        let frame = encode_client(&ClientMessage::Command(command));
        let mut body = frame[6..64].to_vec();
        body[index] ^= 0xa5;
        // Whatever it means now, the answer behind it is the higher sequence, and acts or is a miss.
        let answer = session.client.frame(Mode::Obtain, [0; 3]);
        assert_eq!(session.deliver(&[enclose(1, 3, &body), answer].concat()), 2);
        assert_eq!(session.tick().state.phase, Phase::Obtain, "byte {index}");
        session.client.sequence = session.client.sequence.max(session.server.accepted());
    }
}

#[test]
fn no_command_leads_from_submit_to_the_drives_but_obtain() {
    let mut session = SessionFixture::submitted_on(gantry_tau_tests::server_fixture::ServerFixture::<3>::default());
    for _ in 0..3 {
        let row = session.answer(Mode::Submit, AT);
        assert_eq!(row.state.phase, Phase::Submit);
        assert_eq!(session.server.bus.positions(), [0; 3]);
    }
    let row = session.answer(Mode::Submit, AT);
    assert_eq!(row.state.axes.map(|axis| axis.shadow.position.0), AT);
    // From offset 0, in the tick that asks for it.
    session.answer(Mode::Obtain, [4_000; 3]);
    assert_eq!(session.server.bus.positions(), [4_000; 3]);
    // And back: no miss, Submit once all is zero.
    let row = session.answer(Mode::Submit, [4_000; 3]);
    assert_eq!(row.state.phase, Phase::Obtain);
    assert_eq!(session.server.bus.positions(), [0; 3]);
    assert_eq!(session.answer(Mode::Submit, AT).state.phase, Phase::Submit);
}
