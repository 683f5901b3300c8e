//! Killing client or server at any moment leaves nothing half-done.

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::message::{Cause, ClientMessage, Mode, Phase, Refusal};
use gantry_tau_core::control::wire::encode_client;
use gantry_tau_core::units::{Epoch, EpochRange, Sequence};
use gantry_tau_server::server::ServerError;
use gantry_tau_server::state::{Begun, FirstRun, MachineState, StatePlace};
use gantry_tau_tests::client::hello;
use gantry_tau_tests::fake_plant::{Bus, Record};
use gantry_tau_tests::server_fixture::{MAX_NM, ServerFixture, parameters};
use gantry_tau_tests::session_fixture::{SessionFixture, offsets};
use tempfile::TempDir;

/// Ticks of the scripted session: Submit, Obtain with all three channels moving, back to Submit,
/// Obtain again, Goodbye.
const SCRIPT: u32 = 60;

/// Tick `tick` of the script.
fn act(session: &mut SessionFixture<3>, tick: u32) {
    let step = i32::try_from(tick).unwrap();
    let velocity = 40 * step;
    let torque = i16::try_from(-step / 2).unwrap();
    let target = offsets(777 * step, velocity, torque);
    match tick {
        0..5 => session.answer_all(Mode::Submit, target),
        25 => session.tick(),
        30..45 => session.answer_all(Mode::Submit, target),
        5..55 => session.answer_all(Mode::Obtain, target),
        55 => {
            session.say(&ClientMessage::Goodbye(session.client.epoch));
            session.tick()
        }
        _ => session.tick(),
    };
}

/// The script until tick `killed`.
fn play(server: ServerFixture<3>, killed: u32) -> SessionFixture<3> {
    let mut session = SessionFixture::greeted(server);
    for tick in 0..killed {
        act(&mut session, tick);
    }
    session
}

/// An epoch file of this test's own, gone with it.
struct EpochFile(TempDir);

impl EpochFile {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// The state of a server that begins. The lock is given back at once: killed servers are no
    /// owners.
    fn begin(&self) -> Begun {
        MachineState::own(&StatePlace::named(&self.0.path().join("epoch")), "test")
            .unwrap()
            .begin(FirstRun::Harmless)
            .unwrap()
    }

    fn reserve(&self) -> EpochRange {
        self.begin().epochs
    }
}

/// Ticks of ramp that offsets need.
fn ramp_ticks(in_force: &[Offsets; 3]) -> u32 {
    let ticks = in_force.iter().map(|offsets| {
        let position = offsets.position.0.unsigned_abs().div_ceil(100);
        let velocity = offsets.velocity.0.unsigned_abs().div_ceil(50);
        position
            .max(velocity)
            .max(offsets.torque.0.unsigned_abs().into())
    });
    ticks.max().unwrap()
}

/// The server ramps what is in force in exactly the ticks it takes (the server watches each step),
/// lets no peer in, then listens.
fn assert_ramps_down(server: &mut ServerFixture<3>) {
    let ticks = ramp_ticks(&server.bus.in_force());
    for tick in 1..=ticks {
        server.receive();
        let row = server.step();
        assert_eq!(row.state.phase, Phase::SafeDisconnect);
        assert_eq!(row.state.ramp_ticks_left, ticks - tick);
        assert!(!row.welcomed);
    }
    assert_eq!(server.bus.in_force(), [Offsets::default(); 3]);
}

#[test]
fn a_client_killed_at_any_tick_leaves_a_server_for_the_next() {
    let mut server = ServerFixture::default();
    for killed in 0..=SCRIPT {
        let SessionFixture {
            server: mut running,
            client,
        } = play(server, killed);
        let ramping = running.phase() == Phase::SafeDisconnect;
        if killed % 2 == 0 {
            client.reset();
        } else {
            drop(client);
        }
        running.await_loss_of_owner();
        if ramp_ticks(&running.bus.in_force()) == 0 {
            // No offset was in force: there is nothing to ramp, and a tick to say so.
            let row = running.step();
            assert_eq!(row.ended, (!ramping).then_some(Cause::Closed));
        } else {
            assert_ramps_down(&mut running);
        }
        running.step();
        assert_eq!(running.phase(), Phase::Listening, "killed at {killed}");
        server = running;
    }
    let _ = SessionFixture::submitted_on(server);
}

#[test]
fn a_client_killed_within_a_frame_leaves_a_server_for_the_next() {
    let mut server = ServerFixture::default();
    for cut in 1..68 {
        let mut session = SessionFixture::submitted_on(server).obtain([250, -50, 0]);
        let frame = session.client.frame(Mode::Obtain, [5_000; 3]);
        session.client.send_bytes(&frame[..cut]);
        drop(session.client);
        session.server.await_loss_of_owner();
        session
            .server
            .assert_disconnect([250, -50, 0], Cause::Closed);
        server = session.server;
    }
}

#[test]
fn a_server_killed_at_any_tick_is_followed_without_a_step() {
    let file = EpochFile::new();
    let bus = Bus::default();
    let mut last_epoch = None;
    for killed in 0..=SCRIPT {
        let first = ServerFixture::start(parameters(), bus.clone(), file.reserve()).unwrap();
        let dead = play(first, killed);
        let epoch = dead.client.epoch;
        assert!(last_epoch.replace(epoch) < Some(epoch), "an epoch revived");
        let in_force = bus.in_force();
        // No ramp, no goodbye: the drives keep their last references.
        drop(dead);
        let mut second = ServerFixture::start(parameters(), bus.clone(), file.reserve()).unwrap();
        if in_force == [Offsets::default(); 3] {
            assert_eq!(second.phase(), Phase::Listening);
            continue;
        }
        assert_eq!(second.phase(), Phase::SafeDisconnect, "killed at {killed}");
        let row = second.step();
        assert_eq!(row.state.cause, Cause::Restart);
        assert_eq!(row.state.epoch, Epoch(0), "no session is claimed");
        assert_ramps_down(&mut second);
        assert_eq!(second.step().state.phase, Phase::Listening);
    }
}

#[test]
fn a_restarted_server_refuses_everybody_until_zero() {
    let bus = Bus::default();
    let from = [12_345, -7_050, 30];
    bus.record().in_force = from.map(|nm| offsets(nm, 0, 0));
    let mut server = ServerFixture::start(parameters(), bus, EpochRange::VOLATILE).unwrap();
    let refusal = server.refusal(&encode_client(&hello::<3>()));
    assert!(matches!(refusal, Refusal::Ramping { .. }), "{refusal:?}");
    let ticks = ramp_ticks(&server.bus.in_force());
    for _ in 0..ticks {
        assert_eq!(server.step().state.phase, Phase::SafeDisconnect);
    }
    assert_eq!(server.bus.positions(), [0; 3]);
    assert_eq!(server.step().state.phase, Phase::Listening);
    let _ = SessionFixture::submitted_on(server);
}

#[test]
fn a_restarted_server_ramps_every_channel_from_what_it_found() {
    let bus = Bus::<2>::default();
    bus.record().in_force = [offsets(950, -120, 3), offsets(-MAX_NM, 0, 0)];
    let mut server = ServerFixture::start(parameters(), bus, EpochRange::VOLATILE).unwrap();
    for expected in [
        [offsets(850, -70, 2), offsets(100 - MAX_NM, 0, 0)],
        [offsets(750, -20, 1), offsets(200 - MAX_NM, 0, 0)],
        [offsets(650, 0, 0), offsets(300 - MAX_NM, 0, 0)],
    ] {
        server.step();
        assert_eq!(server.bus.in_force(), expected);
    }
    for _ in 0..19_997 {
        assert_eq!(server.step().state.phase, Phase::SafeDisconnect);
    }
    assert_eq!(server.bus.positions(), [0; 2]);
    assert_eq!(server.step().state.phase, Phase::Listening);
}

/// Error of a server that does not start on an edited machine.
fn refused(edit: fn(&mut Record<3>)) -> ServerError {
    let bus = Bus::<3>::default();
    edit(&mut bus.record());
    let error = ServerFixture::start(parameters(), bus.clone(), EpochRange::VOLATILE)
        .err()
        .expect("it started");
    assert_eq!(bus.writes(), 0, "it has moved the machine");
    assert_eq!(error.to_string().lines().count(), 1);
    error
}

#[test]
fn a_server_that_cannot_know_its_offsets_does_not_start() {
    let unreadable = refused(|record| record.offsets_fail = true);
    assert!(matches!(unreadable, ServerError::Plant(_)), "{unreadable}");
    let dead = refused(|record| record.read_fails = true);
    assert!(matches!(dead, ServerError::Plant(_)), "{dead}");
    let edits: [fn(&mut Record<3>); 5] = [
        |record| record.in_force[1] = offsets(MAX_NM + 1, 0, 0),
        |record| record.in_force[1] = offsets(i32::MIN, 0, 0),
        |record| record.in_force[1] = offsets(0, -5_001, 0),
        |record| record.in_force[1] = offsets(0, 0, 51),
        |record| record.in_force[1] = offsets(0, 0, i16::MIN),
    ];
    for edit in edits {
        let beyond = refused(edit);
        assert!(matches!(beyond, ServerError::Start(_)), "{beyond}");
        assert!(beyond.to_string().contains("axis 1"), "{beyond}");
    }
}

/// A server on this machine, with the latch as it was left.
fn start(bus: &Bus<3>, file: &EpochFile) -> ServerFixture<3> {
    ServerFixture::with_latch(bus.clone(), file.begin().latch)
}

/// Found by audit: after a crash the next Hello obtained, as if the stop had not been pressed.
#[test]
fn a_stop_outlives_the_server() {
    let file = EpochFile::new();
    let bus = Bus::default();
    // A stop by the owner, and one at the machine.
    let mut session = SessionFixture::submitted_on(start(&bus, &file)).obtain([150; 3]);
    session.say(&ClientMessage::Stop(session.client.epoch));
    let mut server = session.server;
    server.step_until("the stop", |row| row.ended == Some(Cause::Stop));
    drop(server);
    for _restart in 0..2 {
        let mut server = start(&bus, &file);
        let refusal = server.refusal(&encode_client(&hello::<3>()));
        assert!(matches!(refusal, Refusal::Faulted { .. }), "{refusal:?}");
    }
    let mut server = start(&bus, &file);
    server.step_until("zero", |row| row.state.ramp_ticks_left == 0);
    assert_eq!(server.step_rearmed().state.phase, Phase::Listening);
    drop(server);
    let mut server = start(&bus, &file);
    assert_eq!(server.step().state.phase, Phase::Listening);
    server.step_stopped();
    drop(server);
    assert_eq!(start(&bus, &file).step().state.phase, Phase::Fault);
}

#[test]
fn the_frames_of_a_dead_servers_session_do_not_revive() {
    let file = EpochFile::new();
    let bus = Bus::default();
    let first = ServerFixture::start(parameters(), bus.clone(), file.reserve()).unwrap();
    let dead = SessionFixture::submitted_on(first).obtain([150; 3]);
    let (epoch, sequence) = (dead.client.epoch, dead.client.sequence);
    drop(dead);
    let mut second = ServerFixture::start(parameters(), bus, file.reserve()).unwrap();
    assert_ramps_down(&mut second);
    assert_eq!(second.step().state.phase, Phase::Listening);
    let mut session = SessionFixture::submitted_on(second).obtain([1_000; 3]);
    session.deliver_changed([0; 3], |old| {
        old.epoch = epoch;
        old.sequence = Sequence(sequence + 1);
    });
    session.say(&ClientMessage::Stop(epoch));
    session.say(&ClientMessage::Goodbye(epoch));
    assert_eq!(session.assert_held().state.counters.stale, 3);
    session.answer(Mode::Obtain, [1_000; 3]);
}
