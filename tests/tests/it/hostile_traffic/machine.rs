//! Trouble on the machine's side of the server: late cycles, nominals that jump, a bus that fails.

use gantry_tau_core::control::message::{Cause, Mode, Phase};
use gantry_tau_server::record::TickRecord;
use gantry_tau_server::server::cycle::OperatorInputs;
use gantry_tau_tests::server_fixture::{NOMINAL_STEP_NM, ServerFixture};
use gantry_tau_tests::session_fixture::SessionFixture;

use super::AT;

/// [`AT`] after one tick of the ramp.
const STEPPED: [i32; 3] = [12_245, -6_950, 0];

/// The owner's answer arrives, and the server comes `elapsed` cycles after its last tick.
fn answer_late(session: &mut SessionFixture<3>, elapsed: u32) -> TickRecord<3> {
    session.deliver_answer(AT);
    let row = session.server.step_with(elapsed, OperatorInputs::default());
    assert_eq!(session.client.state(), row.state);
    row
}

#[test]
fn the_drives_have_their_references_before_the_client_its_state() {
    let mut session = SessionFixture::obtained(AT);
    session.server.bus.record().ear = Some(session.client.writer());
    let writes = session.server.bus.writes();
    for _ in 0..10 {
        session.answer(Mode::Obtain, AT);
    }
    assert_eq!(session.server.bus.writes(), writes + 10);
    assert_eq!(session.server.bus.record().late_writes, 0);
    // What is listened to is heard.
    session.answer(Mode::Obtain, AT);
    session.server.step();
    session.server.step();
    assert_eq!(session.server.bus.record().late_writes, 1);
}

#[test]
fn one_skipped_cycle_is_one_miss() {
    let mut session = SessionFixture::obtained(AT);
    let before = session.client.tick.0;
    let row = answer_late(&mut session, 2);
    assert_eq!((row.state.phase, row.ended), (Phase::Obtain, None));
    assert_eq!(
        (row.state.counters.missed, row.state.tick.0),
        (1, before + 2)
    );
    // The answer that came resets the misses.
    session.assert_held();
    session.answer(Mode::Obtain, AT);
}

#[test]
fn a_late_cycle_takes_one_step_of_the_ramp_and_no_more() {
    let mut session = SessionFixture::obtained([1_000; 3]);
    session.assert_held();
    for (step, elapsed) in (1..).zip([1, 7, 2, u32::MAX, 0]) {
        session.server.step_with(elapsed, OperatorInputs::default());
        assert_eq!(session.server.bus.positions(), [1_000 - 100 * step; 3]);
    }
}

#[test]
fn a_nominal_at_its_limit_moves_on_in_peace() {
    let mut session = SessionFixture::obtained(AT);
    for round in 1..=20 {
        let direction = if round % 4 < 2 { 1 } else { -1 };
        for nominal in &mut session.server.bus.record().nominal {
            nominal.0 += direction * i64::from(NOMINAL_STEP_NM);
        }
        let row = session.answer(Mode::Obtain, AT);
        assert_eq!(
            (row.state.phase, session.server.bus.positions()),
            (Phase::Obtain, AT)
        );
    }
    // Two cycles may move it twice as far.
    for nominal in &mut session.server.bus.record().nominal {
        nominal.0 -= 2 * i64::from(NOMINAL_STEP_NM);
    }
    assert_eq!(answer_late(&mut session, 2).state.phase, Phase::Obtain);
}

#[test]
fn a_machine_that_cannot_be_read_is_stopped_in_that_tick() {
    let mut session = SessionFixture::obtained(AT);
    session.server.bus.record().read_fails = true;
    session.deliver_answer(AT);
    let row = session.tick();
    assert_eq!((row.plant_failed, row.ended), (true, Some(Cause::Stop)));
    session.server.assert_ramp(STEPPED, Phase::Fault);
    // While it fails the stop is not released.
    assert_eq!(session.server.step_rearmed().state.phase, Phase::Fault);
    session.server.bus.record().read_fails = false;
    assert_eq!(session.server.step().state.phase, Phase::Fault);
    assert_eq!(session.server.step_rearmed().state.phase, Phase::Listening);
}

#[test]
fn a_machine_that_takes_no_reference_is_stopped_in_the_next_tick() {
    let mut session = SessionFixture::obtained(AT);
    session.server.bus.record().write_fails = true;
    let row = session.answer(Mode::Obtain, AT);
    assert_eq!((row.plant_failed, row.ended), (true, None));
    session.server.bus.record().write_fails = false;
    session.deliver_answer(AT);
    let row = session.tick();
    assert_eq!((row.plant_failed, row.ended), (false, Some(Cause::Stop)));
    session.server.assert_ramp(STEPPED, Phase::Fault);
    assert_eq!(session.server.step_rearmed().state.phase, Phase::Listening);
}

#[test]
fn a_bus_that_comes_back_sees_no_step() {
    let mut session = SessionFixture::obtained(AT);
    session.server.bus.record().write_fails = true;
    for _ in 0..51 {
        session.server.receive();
        session.server.step();
    }
    // It takes references again, but has not told what it has in force: nothing is written.
    session.server.bus.record().offsets_fail = true;
    session.server.step();
    session.server.bus.record().write_fails = false;
    let writes = session.server.bus.writes();
    session.server.step();
    assert_eq!(session.server.bus.writes(), writes);
    session.server.bus.record().offsets_fail = false;
    session.server.step();
    assert_eq!(session.server.bus.writes(), writes, "read back first");
    // The server compares with what the drives had in force: 100 nm per tick from there, for
    // any loss.
    session.server.assert_ramp(AT, Phase::Fault);
}

#[test]
fn the_stop_at_the_machine_needs_no_network_and_no_session() {
    let mut session = SessionFixture::obtained(AT);
    session.deliver_answer(AT);
    assert_eq!(session.server.step_stopped().ended, Some(Cause::Stop));
    session.server.assert_ramp(STEPPED, Phase::Fault);

    let mut idle = ServerFixture::<3>::default();
    assert_eq!(idle.step_stopped().state.phase, Phase::Fault);
    assert_eq!(idle.step().state.phase, Phase::Fault);
    assert_eq!(idle.step_rearmed().state.phase, Phase::Listening);
}
