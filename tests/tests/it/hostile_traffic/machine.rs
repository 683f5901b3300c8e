//! Trouble on the machine's side of the server: late cycles, nominals that jump, a bus that fails.

use gantry_tau::server::cycle::{Demands, Row};
use gantry_tau_core::control::message::{AxisFlags, Cause, Mode, Phase};
use gantry_tau_core::units::PositionNm;
use gantry_tau_tests::server_fixture::NOMINAL_STEP_NM;
use gantry_tau_tests::session_fixture::SessionFixture;

use super::AT;

/// The owner's answer arrives, and the server comes `elapsed` cycles after its last tick.
fn answer_late(duet: &mut SessionFixture<3>, elapsed: u32) -> Row<3> {
    let frame = duet.client.frame(Mode::Obtain, AT);
    duet.deliver(&frame);
    let row = duet.bench.step_with(elapsed, Demands::default());
    assert_eq!(duet.client.state(), row.state);
    row
}

#[test]
fn the_drives_have_their_references_before_the_client_its_state() {
    let mut duet = SessionFixture::obtained(AT);
    duet.bench.bus.record().ear = Some(duet.client.writer());
    let writes = duet.bench.bus.writes();
    for _ in 0..10 {
        duet.answer(Mode::Obtain, AT);
    }
    assert_eq!(duet.bench.bus.writes(), writes + 10);
    assert_eq!(duet.bench.bus.record().late_writes, 0);
    // What is listened to is heard.
    duet.answer(Mode::Obtain, AT);
    duet.bench.step();
    duet.bench.step();
    assert_eq!(duet.bench.bus.record().late_writes, 1);
}

#[test]
fn one_skipped_cycle_is_one_miss() {
    let mut duet = SessionFixture::obtained(AT);
    let before = duet.client.tick.0;
    let row = answer_late(&mut duet, 2);
    assert_eq!((row.state.phase, row.ended), (Phase::Obtain, None));
    assert_eq!(
        (row.state.counters.missed, row.state.tick.0),
        (1, before + 2)
    );
    // The answer that came resets the misses.
    duet.assert_held();
    duet.answer(Mode::Obtain, AT);
}

#[test]
fn two_skipped_cycles_end_the_session_whatever_came() {
    let mut duet = SessionFixture::obtained(AT);
    let row = answer_late(&mut duet, 3);
    assert_eq!(row.ended, Some(Cause::ServerLate));
    // One step of the ramp, not three.
    assert_eq!(duet.bench.bus.positions(), [12_245, -6_950, 0]);
}

#[test]
fn a_skipped_cycle_and_a_miss_are_two_misses() {
    let mut duet = SessionFixture::obtained(AT);
    let row = duet.bench.step_with(2, Demands::default());
    assert_eq!(row.ended, Some(Cause::ServerLate));
    assert_eq!(duet.bench.bus.positions(), [12_245, -6_950, 0]);

    let mut duet = SessionFixture::obtained(AT);
    duet.assert_held();
    let row = answer_late(&mut duet, 2);
    assert_eq!(row.ended, Some(Cause::ServerLate));
    assert_eq!(duet.bench.bus.positions(), [12_245, -6_950, 0]);
}

#[test]
fn a_late_cycle_takes_one_step_of_the_ramp_and_no_more() {
    let mut duet = SessionFixture::obtained([1_000; 3]);
    duet.assert_held();
    for (step, elapsed) in (1..).zip([1, 7, 2, u32::MAX, 0]) {
        duet.bench.step_with(elapsed, Demands::default());
        assert_eq!(duet.bench.bus.positions(), [1_000 - 100 * step; 3]);
    }
}

#[test]
fn a_jump_of_the_nominal_is_passed_through_flagged_and_faults() {
    let mut duet = SessionFixture::obtained(AT);
    let jump = i64::from(NOMINAL_STEP_NM) + 1;
    let old = duet.bench.bus.record().nominal;
    duet.bench.bus.record().nominal[1].0 += jump;
    let frame = duet.client.frame(Mode::Obtain, AT);
    duet.deliver(&frame);
    let row = duet.tick();
    assert_eq!(row.ended, Some(Cause::Nominal));
    assert_eq!(row.state.phase, Phase::Fault);
    let stepped = row
        .state
        .axes
        .map(|axis| axis.flags.contains(AxisFlags::NOMINAL_STEP));
    assert_eq!(stepped, [false, true, false]);
    let written = duet.bench.bus.last_written();
    assert_eq!(written[0].position, PositionNm(old[0].0 + 12_245));
    assert_eq!(written[1].position, PositionNm(old[1].0 + jump - 6_950));
    // It stays where it jumped to; nobody smooths it.
    duet.bench.assert_ramp([12_245, -6_950, 0], Phase::Fault);
    assert_eq!(duet.bench.step_rearmed().state.phase, Phase::Listening);
}

#[test]
fn a_nominal_at_its_limit_moves_on_in_peace() {
    let mut duet = SessionFixture::obtained(AT);
    for round in 1..=20 {
        let direction = if round % 4 < 2 { 1 } else { -1 };
        for nominal in &mut duet.bench.bus.record().nominal {
            nominal.0 += direction * i64::from(NOMINAL_STEP_NM);
        }
        let row = duet.answer(Mode::Obtain, AT);
        assert_eq!(
            (row.state.phase, duet.bench.bus.positions()),
            (Phase::Obtain, AT)
        );
    }
    // Two cycles may move it twice as far.
    for nominal in &mut duet.bench.bus.record().nominal {
        nominal.0 -= 2 * i64::from(NOMINAL_STEP_NM);
    }
    assert_eq!(answer_late(&mut duet, 2).state.phase, Phase::Obtain);
}

#[test]
fn a_machine_that_cannot_be_read_is_stopped_in_that_tick() {
    let mut duet = SessionFixture::obtained(AT);
    duet.bench.bus.record().read_fails = true;
    let frame = duet.client.frame(Mode::Obtain, AT);
    duet.deliver(&frame);
    let row = duet.tick();
    assert_eq!((row.plant_failed, row.ended), (true, Some(Cause::Stop)));
    duet.bench.assert_ramp([12_245, -6_950, 0], Phase::Fault);
    // While it fails the stop is not released.
    assert_eq!(duet.bench.step_rearmed().state.phase, Phase::Fault);
    duet.bench.bus.record().read_fails = false;
    assert_eq!(duet.bench.step().state.phase, Phase::Fault);
    assert_eq!(duet.bench.step_rearmed().state.phase, Phase::Listening);
}

#[test]
fn a_machine_that_takes_no_reference_is_stopped_in_the_next_tick() {
    let mut duet = SessionFixture::obtained(AT);
    duet.bench.bus.record().write_fails = true;
    let row = duet.answer(Mode::Obtain, AT);
    assert_eq!((row.plant_failed, row.ended), (true, None));
    duet.bench.bus.record().write_fails = false;
    let frame = duet.client.frame(Mode::Obtain, AT);
    duet.deliver(&frame);
    let row = duet.tick();
    assert_eq!((row.plant_failed, row.ended), (false, Some(Cause::Stop)));
    duet.bench.assert_ramp([12_245, -6_950, 0], Phase::Fault);
    assert_eq!(duet.bench.step_rearmed().state.phase, Phase::Listening);
}

#[test]
fn a_bus_that_comes_back_sees_no_step() {
    let mut duet = SessionFixture::obtained(AT);
    duet.bench.bus.record().write_fails = true;
    for _ in 0..51 {
        duet.bench.receive();
        duet.bench.step();
    }
    // It takes references again, but does not yet tell what it has in force: nothing is written.
    duet.bench.bus.record().write_fails = false;
    duet.bench.bus.record().offsets_fail = true;
    let writes = duet.bench.bus.writes();
    duet.bench.step();
    assert_eq!(duet.bench.bus.writes(), writes);
    duet.bench.bus.record().offsets_fail = false;
    // The bench compares with what the drives had in force: 100 nm per tick from there, whatever was lost.
    duet.bench.assert_ramp(AT, Phase::Fault);
}

#[test]
fn the_stop_at_the_machine_needs_no_network_and_no_session() {
    let mut duet = SessionFixture::obtained(AT);
    let frame = duet.client.frame(Mode::Obtain, AT);
    duet.deliver(&frame);
    assert_eq!(duet.bench.step_stopped().ended, Some(Cause::Stop));
    duet.bench.assert_ramp([12_245, -6_950, 0], Phase::Fault);

    let mut idle = gantry_tau_tests::server_fixture::ServerFixture::<3>::default();
    assert_eq!(idle.step_stopped().state.phase, Phase::Fault);
    assert_eq!(idle.step().state.phase, Phase::Fault);
    assert_eq!(idle.step_rearmed().state.phase, Phase::Listening);
}
