//! Ends of sessions: by a reset, a close, a frozen client, one that never reads, a Goodbye, a Stop, a Hello too many.

use gantry_tau_core::control::message::{Cause, ClientMessage, Mode, Phase, Refusal};
use gantry_tau_tests::client::Client;
use gantry_tau_tests::server_fixture::{MAX_NM, ServerFixture};
use gantry_tau_tests::session_fixture::SessionFixture;

use super::AT;

/// Ticks after which a client that never reads must have been noticed: its States are 220 bytes, no system buffers 100 MB of them.
const PATIENCE: usize = 500_000;

#[test]
fn a_reset_ramps_in_the_tick_that_sees_it() {
    let SessionFixture { mut server, client } = SessionFixture::obtained(AT);
    client.reset();
    server.await_loss_of_owner();
    server.assert_disconnect(AT, Cause::Closed);
    assert_eq!(SessionFixture::submitted_on(server).server.phase(), Phase::Submit);
}

#[test]
fn a_close_ramps_in_the_tick_that_sees_it_even_behind_an_answer() {
    let mut session = SessionFixture::obtained(AT);
    let frame = session.client.frame(Mode::Obtain, [0; 3]);
    session.client.send_bytes(&frame);
    drop(session.client);
    session.server.await_loss_of_owner();
    session.server.assert_disconnect(AT, Cause::Closed);
}

#[test]
fn a_half_closed_client_is_gone() {
    let mut session = SessionFixture::obtained(AT);
    session.client.close_half();
    session.server.await_loss_of_owner();
    session.client.assert_closed();
    session.server.assert_disconnect(AT, Cause::Closed);
}

#[test]
fn a_frozen_client_is_held_once_then_ramped_and_told() {
    let mut session = SessionFixture::obtained(AT);
    session.assert_held();
    let server = session.assert_disconnect(AT, Cause::ClientLate);
    assert_eq!(SessionFixture::submitted_on(server).server.phase(), Phase::Submit);
}

#[test]
fn a_frozen_client_at_full_offset_is_ramped_whether_or_not_its_buffers_fill() {
    let mut server = ServerFixture::default();
    let client = Client::connect_narrow(server.address());
    let mut session = SessionFixture::greeted(server, client);
    session.answer(Mode::Submit, [0; 3]);
    let full = [MAX_NM, -MAX_NM, MAX_NM - 50];
    let SessionFixture { server: mut running, client: frozen } = session.obtain(full);
    running.step();
    assert_eq!(running.bus.positions(), full);
    running.assert_disconnect(full, Cause::ClientLate);
    drop(frozen);
    server = SessionFixture::submitted_on(running).server;
    assert_eq!(server.phase(), Phase::Submit);
}

#[test]
fn one_in_two_loss_lives_and_two_in_three_does_not() {
    let mut session = SessionFixture::obtained(AT);
    for _ in 0..100 {
        session.assert_held();
        session.answer(Mode::Obtain, AT);
    }
    session.assert_held();
    let _ = session.assert_disconnect(AT, Cause::ClientLate);
}

#[test]
fn a_client_that_never_reads_is_closed_and_ramped_in_the_next_tick() {
    let server = ServerFixture::default();
    let client = Client::connect_narrow(server.address());
    let mut session = SessionFixture::greeted(server, client);
    session.answer(Mode::Submit, [0; 3]);
    let mut session = session.obtain(AT);
    let mut ticks = 0;
    // It knows its ticks without reading, and answers each of them in time.
    loop {
        let frame = session.client.frame(Mode::Obtain, AT);
        session.deliver(&frame);
        if !session.server.has_owner() {
            break;
        }
        session.client.tick = session.server.step().state.tick;
        assert_eq!(session.server.bus.positions(), AT);
        ticks += 1;
        assert!(ticks < PATIENCE, "the server believes its writes arrive");
    }
    assert!(ticks > 10, "{ticks} ticks");
    session.server.assert_disconnect(AT, Cause::Closed);
    assert_eq!(SessionFixture::submitted_on(session.server).server.phase(), Phase::Submit);
}

#[test]
fn a_goodbye_ramps_even_beside_an_answer() {
    let mut session = SessionFixture::obtained(AT);
    let frame = session.client.frame(Mode::Obtain, [0; 3]);
    session.deliver(&frame);
    session.say(&ClientMessage::Goodbye(session.client.epoch));
    let _ = session.assert_disconnect(AT, Cause::Goodbye);
}

#[test]
fn commands_during_the_ramp_change_nothing() {
    let mut session = SessionFixture::obtained([1_000; 3]);
    session.say(&ClientMessage::Goodbye(session.client.epoch));
    for tick in 1..=10 {
        session.tick();
        assert_eq!(session.server.bus.positions(), [1_000 - 100 * tick; 3]);
        let frame = session.client.frame(Mode::Obtain, [5_000; 3]);
        session.deliver(&frame);
    }
    assert_eq!(session.server.step().state.phase, Phase::Listening);
    session.client.assert_closed();
}

#[test]
fn the_owners_stop_is_a_fault_that_only_the_machine_s_side_ends() {
    let mut session = SessionFixture::obtained(AT);
    let epoch = session.client.epoch;
    let frame = session.client.frame(Mode::Obtain, [0; 3]);
    session.deliver(&frame);
    session.say(&ClientMessage::Stop(epoch));
    let rows = session.server.assert_ramp(AT, Phase::Fault);
    assert_eq!(rows[0].ended, Some(Cause::Stop));
    for row in rows {
        assert_eq!(session.client.state(), row.state);
    }
    // No word of the client's leads out, and a newcomer is told.
    for _ in 0..20 {
        let frame = session.client.frame(Mode::Obtain, AT);
        session.deliver(&frame);
        assert_eq!(session.tick().state.phase, Phase::Fault);
    }
    let refusal = refused(&mut session.server);
    assert_eq!(refusal, Refusal::Faulted { ticks_left: 0 });
    assert_eq!(session.server.step_rearmed().state.phase, Phase::Listening);
    assert_eq!(SessionFixture::submitted_on(session.server).server.phase(), Phase::Submit);
}

#[test]
fn rearming_waits_for_zero_and_for_the_release_of_the_stop() {
    let mut session = SessionFixture::obtained([1_050; 3]);
    assert_eq!(session.server.step_stopped().ended, Some(Cause::Stop));
    assert_eq!(session.server.bus.positions(), [950; 3]);
    for tick in 1..=9 {
        let row = session.server.step_rearmed();
        assert_eq!(row.state.phase, Phase::Fault);
        assert_eq!(session.server.bus.positions(), [950 - 100 * tick; 3]);
    }
    session.server.step_rearmed();
    assert_eq!(session.server.bus.positions(), [0; 3]);
    let both = gantry_tau::server::cycle::Demands { stop: true, rearm: true };
    assert_eq!(session.server.step_with(1, both).state.phase, Phase::Fault);
    assert_eq!(session.server.step_rearmed().state.phase, Phase::Listening);
}

#[test]
fn no_peer_is_let_in_during_a_ramp() {
    let mut session = SessionFixture::obtained(AT);
    session.say(&ClientMessage::Goodbye(session.client.epoch));
    session.tick();
    let mut seen = 0;
    let mut newcomer = Client::<3>::connect(session.server.address());
    newcomer.say_hello();
    for tick in 2..=124_u32 {
        session.server.receive();
        let row = session.server.step();
        if row.refused > 0 {
            seen += 1;
            // It is told what was left when it asked: the coming tick's step is not yet in it.
            let ticks_left = 125 - tick;
            assert_eq!(newcomer.refusal(), Refusal::Ramping { ticks_left });
            newcomer = Client::connect(session.server.address());
            newcomer.say_hello();
        }
    }
    assert!(seen > 0, "no Hello arrived within 124 ticks");
    gantry_tau_tests::wait_for("the last newcomer", || {
        session.server.receive();
        let row = session.server.step();
        if row.refused > 0 {
            // It asked in the very tick that went from zero to Listening.
            assert_eq!(newcomer.refusal(), Refusal::Ramping { ticks_left: 0 });
            newcomer = Client::connect(session.server.address());
            newcomer.say_hello();
        }
        row.welcomed
    });
    newcomer.welcome();
}

#[test]
fn a_second_hello_of_the_owner_costs_that_frame() {
    let mut session = SessionFixture::obtained(AT);
    session.say(&gantry_tau_tests::client::hello());
    let row = session.answer_after(1, AT);
    assert_eq!((row.state.phase, row.refused), (Phase::Obtain, 0));
    let counters = row.state.counters;
    assert_eq!((counters.malformed, counters.missed), (1, 0));
}

/// Returns the refusal of a newcomer while the owner keeps silent.
fn refused(server: &mut ServerFixture<3>) -> Refusal {
    let mut newcomer = Client::<3>::connect(server.address());
    newcomer.say_hello();
    gantry_tau_tests::wait_for("a refusal", || {
        server.receive();
        server.step().refused > 0
    });
    newcomer.refusal()
}
