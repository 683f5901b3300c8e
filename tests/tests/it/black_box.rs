//! Black boxes of real sessions over real sockets: handed over once, for any end, and
//! replayed bit for bit (T11).

use gantry_tau::replay::Findings;
use gantry_tau_core::control::message::{Cause, ClientMessage, Mode, Phase};
use gantry_tau_core::control::session::LastWrite;
use gantry_tau_record::black_box;
use gantry_tau_record::black_box::writer::BlackBoxWriter;
use gantry_tau_server::black_box::HALF;
use gantry_tau_server::black_box::Window;
use gantry_tau_server::black_box::swap_channel::Receiver;
use gantry_tau_tests::server_fixture::{NOMINAL_STEP_NM, ServerFixture};
use gantry_tau_tests::session_fixture::SessionFixture;

/// A session in Obtain, old enough that the box is full.
fn obtained<const N: usize>(positions: [i32; N]) -> (SessionFixture<N>, Receiver<N>) {
    let (server, windows) = ServerFixture::default().handing_over();
    let mut session = SessionFixture::submitted_on(server).obtain(positions);
    for _ in 0..3 * HALF {
        session.answer(Mode::Obtain, positions);
    }
    (session, windows)
}

/// The window that has been handed over: it ended because of `cause`, its file is read back as it
/// was, and it replays.
fn assert_window<const N: usize>(windows: &mut Receiver<N>, cause: Option<Cause>) -> Window<N> {
    let window = windows.receive().expect("no black box was handed over");
    assert_eq!(window.end().cause, cause);
    let text = black_box::encode(&window);
    let read = black_box::decode(&window.file_name(), text.as_bytes()).unwrap();
    assert_eq!(read, window);
    let findings = Findings::of(&read);
    assert_eq!(
        (findings.agreeing, findings.difference),
        (findings.ticks, None)
    );
    window
}

fn assert_nothing<const N: usize>(windows: &mut Receiver<N>) {
    assert!(windows.receive().is_none(), "an unexpected black box");
    assert_eq!(windows.take_lost(), 0);
}

fn silence<const N: usize>(cause: Cause) {
    let (mut session, mut windows) = obtained([9_000; N]);
    session.assert_held();
    assert_eq!(session.tick().ended, Some(cause));
    for _ in 1..HALF {
        session.tick();
    }
    assert_nothing(&mut windows);
    session.server.step();
    let window = assert_window(&mut windows, Some(cause));
    let end = window.end().index;
    assert!(end >= HALF, "{end} ticks before the cause");
    assert_eq!(window.entries.len() - end - 1, HALF);
    // Recording goes on: a stop after the session has a box of its own.
    session.server.step_stopped();
    for _ in 0..HALF {
        session.server.step();
    }
    assert_window(&mut windows, Some(Cause::Stop));
    assert_nothing(&mut windows);
}

#[test]
fn a_silent_client_leaves_a_black_box() {
    silence::<3>(Cause::ClientLate);
    silence::<6>(Cause::ClientLate);
}

#[test]
fn a_newcomer_does_not_cost_the_evidence() {
    let (mut session, mut windows) = obtained([300; 3]);
    session.say(&ClientMessage::Goodbye(session.client.epoch));
    let server = session.assert_disconnect([300; 3], Cause::Goodbye);
    assert_nothing(&mut windows);
    let session = SessionFixture::greeted(server);
    let window = assert_window(&mut windows, Some(Cause::Goodbye));
    let last = &window.entries.last().unwrap().output;
    assert!(
        last.welcome.is_some(),
        "the newcomer's tick belongs to the old box"
    );
    assert_eq!(last.state.epoch, session.client.epoch);
    assert_eq!(window.end().epoch.0 + 1, session.client.epoch.0);
    assert_nothing(&mut windows);
}

/// Refused references end the session in the tick after. They are an input, so one window shows
/// what led there and what followed.
#[test]
fn a_window_goes_on_across_refused_references() {
    let (mut session, mut windows) = obtained([5_000; 3]);
    session.server.bus.record().write_fails = true;
    let row = session.answer(Mode::Obtain, [6_000; 3]);
    assert!(row.plant_failed && row.ended.is_none());
    session.server.bus.record().write_fails = false;
    session.server.receive();
    let row = session.server.step();
    assert_eq!(
        (row.state.phase, row.ended),
        (Phase::Fault, Some(Cause::Stop))
    );
    assert_nothing(&mut windows);
    for _ in 0..HALF {
        session.server.step();
    }
    let window = assert_window(&mut windows, Some(Cause::Stop));
    let end = window.end();
    assert_eq!(end.tick, row.state.tick);
    assert!(end.index >= HALF, "{} ticks before the cause", end.index);
    let inputs: Vec<_> = window.entries[end.index..]
        .iter()
        .map(|entry| entry.input.last_write)
        .collect();
    assert!(
        matches!(inputs[0], LastWrite::Refused { in_force } if in_force[0].offsets.position.0 == 5_000),
        "{:?}",
        inputs[0]
    );
    assert!(
        inputs[1..]
            .iter()
            .all(|last_write| *last_write == LastWrite::Accepted)
    );
    assert_nothing(&mut windows);
}

/// Until a machine that took no references tells what it has in force, nothing is written and a
/// re-arm does nothing.
#[test]
fn a_window_goes_on_across_an_outage() {
    let (mut server, mut windows) = ServerFixture::<3>::default().handing_over();
    server.step();
    server.bus.record().write_fails = true;
    server.bus.record().offsets_fail = true;
    assert!(server.step().plant_failed);
    server.bus.record().write_fails = false;
    let writes = server.bus.writes();
    let row = server.step();
    assert_eq!(
        (row.state.phase, row.ended),
        (Phase::Fault, Some(Cause::Stop))
    );
    assert!((0..3).all(|_| server.step_rearmed().plant_failed));
    assert_eq!(server.bus.writes(), writes);
    server.bus.record().offsets_fail = false;
    // Read back in this tick, written in the next.
    assert!(server.step_rearmed().plant_failed);
    assert_eq!(server.bus.writes(), writes);
    // The outage asserts the stop until the machine has been read back.
    let row = server.step_rearmed();
    assert_eq!(
        (row.plant_failed, row.state.phase, server.bus.writes()),
        (false, Phase::Fault, writes + 1)
    );
    assert_eq!(server.step_rearmed().state.phase, Phase::Listening);
    for _ in 0..HALF {
        server.step();
    }
    let window = assert_window(&mut windows, Some(Cause::Stop));
    assert_eq!(window.end().index, 2);
    let fates: Vec<_> = window.entries[2..]
        .iter()
        .map(|entry| entry.input.last_write)
        .collect();
    assert_eq!(fates[..5], [LastWrite::Unknown; 5]);
    assert!(matches!(fates[5], LastWrite::Refused { .. }));
    assert_eq!(fates[6], LastWrite::Accepted);
}

/// The boxes are not emptied: the cycle neither waits nor forgets to count.
#[test]
fn what_finds_no_room_waits_until_it_must_go() {
    let (mut server, mut windows) = ServerFixture::<3>::default().handing_over();
    let mut nominal = server.bus.record().nominal;
    // The path is met first.
    server.step();
    for _ in 0..6 {
        // A nominal step ends nothing but is a cause; then a re-arm, and another.
        nominal[0].0 += 2 * i64::from(NOMINAL_STEP_NM);
        server.bus.record().nominal = nominal;
        assert_eq!(server.step().ended, Some(Cause::Nominal));
        for _ in 0..=HALF {
            server.step();
        }
        server.step_rearmed();
        assert_eq!(server.phase(), Phase::Listening);
    }
    // Four are under way, one has waited, frozen; what came later is not in any box.
    for _ in 0..4 {
        assert_window(&mut windows, Some(Cause::Nominal));
    }
    assert_nothing(&mut windows);
    server.step();
    assert_window(&mut windows, Some(Cause::Nominal));
    assert_nothing(&mut windows);
}

/// A client says Hello and is gone: the server as it listens again, and the epoch.
fn passed_by(server: ServerFixture<3>) -> (ServerFixture<3>, u64) {
    let SessionFixture { mut server, client } = SessionFixture::greeted(server);
    let epoch = client.epoch.0;
    drop(client);
    server.step_until("Listening", |row| row.state.phase == Phase::Listening);
    (server, epoch)
}

/// Found by attack: after 1 000 black boxes a run wrote no more, and 1 005 times Hello and close
/// take seconds.
#[test]
fn passers_by_do_not_cost_the_evidence_of_a_session_that_obtained() {
    let folder = tempfile::tempdir().unwrap();
    let (mut server, windows) = ServerFixture::default().handing_over();
    let mut writer = BlackBoxWriter::open(folder.path(), windows).unwrap();
    let mut last = 0;
    for _ in 0..1_005 {
        (server, last) = passed_by(server);
        writer.write_waiting();
    }
    let mut session = SessionFixture::submitted_on(server).obtain([9_000; 3]);
    // Back in Submit until the window has no tick of Obtain: it counts all the same.
    for _ in 0..3 * HALF {
        session.answer(Mode::Submit, [0; 3]);
    }
    let real = session.client.epoch.0;
    assert_eq!(real, last + 1);
    drop(session.client);
    let mut server = session.server;
    server.step_until("Listening", |row| row.state.phase == Phase::Listening);
    for _ in 0..40 {
        (server, last) = passed_by(server);
        writer.write_waiting();
    }
    drop(server);
    writer.finish().unwrap();
    let mut epochs: Vec<u64> = std::fs::read_dir(folder.path())
        .unwrap()
        .map(|file| file.unwrap().file_name().into_string().unwrap())
        .map(|name| name.split('-').nth(1).unwrap().parse().unwrap())
        .collect();
    epochs.sort_unstable();
    // That of the last passer-by would follow with the next session.
    let newest: Vec<u64> = std::iter::once(real).chain(last - 16..last).collect();
    assert_eq!(epochs, newest);
}

/// Passers-by that come faster than black boxes are written leave room for a session that obtained,
/// and are not called a loss.
#[test]
fn passers_by_do_not_use_up_the_boxes_of_the_cycle() {
    let (mut server, mut windows) = ServerFixture::default().handing_over();
    for _ in 0..20 {
        server = passed_by(server).0;
    }
    let mut session = SessionFixture::submitted_on(server).obtain([300; 3]);
    let epoch = session.client.epoch;
    session.say(&ClientMessage::Goodbye(epoch));
    let mut server = session.assert_disconnect([300; 3], Cause::Goodbye);
    for _ in 0..20 {
        server = passed_by(server).0;
    }
    let received: Vec<_> = std::iter::from_fn(|| windows.receive())
        .map(|window| window.end().epoch)
        .collect();
    assert!(
        received.contains(&epoch),
        "{epoch:?} is not in {received:?}"
    );
    assert_eq!(windows.take_lost(), 0);
}

#[test]
fn what_must_go_and_finds_no_room_is_counted() {
    let (mut server, mut windows) = ServerFixture::<3>::default().handing_over();
    for _ in 0..6 {
        let mut session = SessionFixture::submitted_on(server).obtain([100; 3]);
        session.say(&ClientMessage::Goodbye(session.client.epoch));
        server = session.assert_disconnect([100; 3], Cause::Goodbye);
    }
    // Five ended before a newcomer was let in, and there are four boxes.
    assert_eq!(windows.take_lost(), 1);
    for _ in 0..4 {
        assert_window(&mut windows, Some(Cause::Goodbye));
    }
    assert_nothing(&mut windows);
}
