//! How sessions end: by a reset, a close, a frozen client, one that never reads, a Goodbye, a Stop, a Hello too many.

use gantry_tau_core::control::message::{Cause, ClientMessage, Mode, Phase, Refusal};
use gantry_tau_tests::client::Client;
use gantry_tau_tests::server_fixture::{MAX_NM, ServerFixture};
use gantry_tau_tests::session_fixture::SessionFixture;

use super::AT;

/// Ticks after which a client that never reads must have been noticed: its States are 220 bytes, no system buffers 100 MB of them.
const PATIENCE: usize = 500_000;

#[test]
fn a_reset_ramps_in_the_tick_that_sees_it() {
    let SessionFixture { mut bench, client } = SessionFixture::obtained(AT);
    client.reset();
    bench.await_loss_of_owner();
    bench.assert_disconnect(AT, Cause::Closed);
    assert_eq!(
        SessionFixture::submitted_on(bench).bench.phase(),
        Phase::Submit
    );
}

#[test]
fn a_close_ramps_in_the_tick_that_sees_it_even_behind_an_answer() {
    let mut duet = SessionFixture::obtained(AT);
    let frame = duet.client.frame(Mode::Obtain, [0; 3]);
    duet.client.send_bytes(&frame);
    drop(duet.client);
    duet.bench.await_loss_of_owner();
    duet.bench.assert_disconnect(AT, Cause::Closed);
}

#[test]
fn a_half_closed_client_is_gone() {
    let mut duet = SessionFixture::obtained(AT);
    duet.client.close_half();
    duet.bench.await_loss_of_owner();
    duet.client.assert_closed();
    duet.bench.assert_disconnect(AT, Cause::Closed);
}

#[test]
fn a_frozen_client_is_held_once_then_ramped_and_told() {
    let mut duet = SessionFixture::obtained(AT);
    duet.assert_held();
    let bench = duet.assert_disconnect(AT, Cause::ClientLate);
    assert_eq!(
        SessionFixture::submitted_on(bench).bench.phase(),
        Phase::Submit
    );
}

#[test]
fn a_frozen_client_at_full_offset_is_ramped_whether_or_not_its_buffers_fill() {
    let mut bench = ServerFixture::default();
    let client = Client::connect_narrow(bench.address());
    let mut duet = SessionFixture::greeted(bench, client);
    duet.answer(Mode::Submit, [0; 3]);
    let full = [MAX_NM, -MAX_NM, MAX_NM - 50];
    let SessionFixture {
        bench: mut running,
        client: frozen,
    } = duet.obtain(full);
    running.step();
    assert_eq!(running.bus.positions(), full);
    running.assert_disconnect(full, Cause::ClientLate);
    drop(frozen);
    bench = SessionFixture::submitted_on(running).bench;
    assert_eq!(bench.phase(), Phase::Submit);
}

#[test]
fn one_in_two_loss_lives_and_two_in_three_does_not() {
    let mut duet = SessionFixture::obtained(AT);
    for _ in 0..100 {
        duet.assert_held();
        duet.answer(Mode::Obtain, AT);
    }
    duet.assert_held();
    let _ = duet.assert_disconnect(AT, Cause::ClientLate);
}

#[test]
fn a_client_that_never_reads_is_closed_and_ramped_in_the_next_tick() {
    let bench = ServerFixture::default();
    let client = Client::connect_narrow(bench.address());
    let mut duet = SessionFixture::greeted(bench, client);
    duet.answer(Mode::Submit, [0; 3]);
    let mut duet = duet.obtain(AT);
    let mut ticks = 0;
    // It knows its ticks without reading, and answers each of them in time.
    loop {
        let frame = duet.client.frame(Mode::Obtain, AT);
        duet.deliver(&frame);
        if !duet.bench.has_owner() {
            break;
        }
        duet.client.tick = duet.bench.step().state.tick;
        assert_eq!(duet.bench.bus.positions(), AT);
        ticks += 1;
        assert!(ticks < PATIENCE, "the server believes its writes arrive");
    }
    assert!(ticks > 10, "{ticks} ticks");
    duet.bench.assert_disconnect(AT, Cause::Closed);
    assert_eq!(
        SessionFixture::submitted_on(duet.bench).bench.phase(),
        Phase::Submit
    );
}

#[test]
fn a_goodbye_ramps_even_beside_an_answer() {
    let mut duet = SessionFixture::obtained(AT);
    let frame = duet.client.frame(Mode::Obtain, [0; 3]);
    duet.deliver(&frame);
    duet.say(&ClientMessage::Goodbye(duet.client.epoch));
    let _ = duet.assert_disconnect(AT, Cause::Goodbye);
}

#[test]
fn commands_during_the_ramp_change_nothing() {
    let mut duet = SessionFixture::obtained([1_000; 3]);
    duet.say(&ClientMessage::Goodbye(duet.client.epoch));
    for tick in 1..=10 {
        duet.tick();
        assert_eq!(duet.bench.bus.positions(), [1_000 - 100 * tick; 3]);
        let frame = duet.client.frame(Mode::Obtain, [5_000; 3]);
        duet.deliver(&frame);
    }
    assert_eq!(duet.bench.step().state.phase, Phase::Listening);
    duet.client.assert_closed();
}

#[test]
fn the_owners_stop_is_a_fault_that_only_the_machine_s_side_ends() {
    let mut duet = SessionFixture::obtained(AT);
    let epoch = duet.client.epoch;
    let frame = duet.client.frame(Mode::Obtain, [0; 3]);
    duet.deliver(&frame);
    duet.say(&ClientMessage::Stop(epoch));
    let rows = duet.bench.assert_ramp(AT, Phase::Fault);
    assert_eq!(rows[0].ended, Some(Cause::Stop));
    for row in rows {
        assert_eq!(duet.client.state(), row.state);
    }
    // No word of the client's leads out, and a newcomer is told.
    for _ in 0..20 {
        let frame = duet.client.frame(Mode::Obtain, AT);
        duet.deliver(&frame);
        assert_eq!(duet.tick().state.phase, Phase::Fault);
    }
    let refusal = refused(&mut duet.bench);
    assert_eq!(refusal, Refusal::Faulted { ticks_left: 0 });
    assert_eq!(duet.bench.step_rearmed().state.phase, Phase::Listening);
    assert_eq!(
        SessionFixture::submitted_on(duet.bench).bench.phase(),
        Phase::Submit
    );
}

#[test]
fn rearming_waits_for_zero_and_for_the_release_of_the_stop() {
    let mut duet = SessionFixture::obtained([1_050; 3]);
    assert_eq!(duet.bench.step_stopped().ended, Some(Cause::Stop));
    assert_eq!(duet.bench.bus.positions(), [950; 3]);
    for tick in 1..=9 {
        let row = duet.bench.step_rearmed();
        assert_eq!(row.state.phase, Phase::Fault);
        assert_eq!(duet.bench.bus.positions(), [950 - 100 * tick; 3]);
    }
    duet.bench.step_rearmed();
    assert_eq!(duet.bench.bus.positions(), [0; 3]);
    let both = gantry_tau::server::cycle::Demands {
        stop: true,
        rearm: true,
    };
    assert_eq!(duet.bench.step_with(1, both).state.phase, Phase::Fault);
    assert_eq!(duet.bench.step_rearmed().state.phase, Phase::Listening);
}

#[test]
fn nobody_is_let_in_during_a_ramp() {
    let mut duet = SessionFixture::obtained(AT);
    duet.say(&ClientMessage::Goodbye(duet.client.epoch));
    duet.tick();
    let mut seen = 0;
    let mut newcomer = Client::<3>::connect(duet.bench.address());
    newcomer.say_hello();
    for tick in 2..=124_u32 {
        duet.bench.receive();
        let row = duet.bench.step();
        if row.refused > 0 {
            seen += 1;
            // It is told what was left when it asked: the coming tick's step is not yet in it.
            let ticks_left = 125 - tick;
            assert_eq!(newcomer.refusal(), Refusal::Ramping { ticks_left });
            newcomer = Client::connect(duet.bench.address());
            newcomer.say_hello();
        }
    }
    assert!(seen > 0, "no Hello arrived within 124 ticks");
    gantry_tau_tests::wait_for("the last newcomer", || {
        duet.bench.receive();
        let row = duet.bench.step();
        if row.refused > 0 {
            // It asked in the very tick that went from zero to Listening.
            assert_eq!(newcomer.refusal(), Refusal::Ramping { ticks_left: 0 });
            newcomer = Client::connect(duet.bench.address());
            newcomer.say_hello();
        }
        row.welcomed
    });
    newcomer.welcome();
}

#[test]
fn a_second_hello_of_the_owner_costs_that_frame() {
    let mut duet = SessionFixture::obtained(AT);
    duet.say(&gantry_tau_tests::client::hello());
    let row = duet.answer_after(1, AT);
    assert_eq!((row.state.phase, row.refused), (Phase::Obtain, 0));
    let counters = row.state.counters;
    assert_eq!((counters.malformed, counters.missed), (1, 0));
}

/// What a newcomer is told, while the owner keeps silent.
fn refused(bench: &mut ServerFixture<3>) -> Refusal {
    let mut newcomer = Client::<3>::connect(bench.address());
    newcomer.say_hello();
    gantry_tau_tests::wait_for("a refusal", || {
        bench.receive();
        bench.step().refused > 0
    });
    newcomer.refusal()
}
