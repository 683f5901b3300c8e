//! Ends of sessions: by a reset, a close, a frozen client, one that never reads, a Goodbye, a Stop,
//! a Hello too many.

use gantry_tau_core::control::message::{Cause, ClientMessage, Mode, Phase, Refusal};
use gantry_tau_core::control::wire::encode_client;
use gantry_tau_tests::client::{Client, hello};
use gantry_tau_tests::server_fixture::{MAX_NM, ServerFixture};
use gantry_tau_tests::session_fixture::SessionFixture;
use gantry_tau_tests::wait_for;

use super::AT;

/// Ticks after which a client that never reads must have been noticed: its States are 220 bytes, no
/// system buffers 100 MB of them.
const PATIENCE: usize = 500_000;

/// A session in Submit whose client buffers as little as can be.
fn narrow() -> SessionFixture<3> {
    let server = ServerFixture::default();
    SessionFixture::greeted_by(Client::connect_narrow(server.address()), server).submit()
}

#[test]
fn a_reset_ramps_in_the_tick_that_sees_it() {
    let SessionFixture { mut server, client } = SessionFixture::obtained(AT);
    client.reset();
    server.await_loss_of_owner();
    server.assert_disconnect(AT, Cause::Closed);
    let _ = SessionFixture::submitted_on(server);
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
    let _ = SessionFixture::submitted_on(server);
}

#[test]
fn a_frozen_client_at_full_offset_is_ramped_whether_or_not_its_buffers_fill() {
    let full = [MAX_NM, -MAX_NM, MAX_NM - 50];
    let SessionFixture {
        mut server,
        client: frozen,
    } = narrow().obtain(full);
    server.step();
    assert_eq!(server.bus.positions(), full);
    server.assert_disconnect(full, Cause::ClientLate);
    drop(frozen);
    let _ = SessionFixture::submitted_on(server);
}

#[test]
fn a_client_that_never_reads_is_closed_and_ramped_in_the_next_tick() {
    let mut session = narrow().obtain(AT);
    let mut ticks = 0;
    // It knows its ticks without reading, and answers each of them in time.
    loop {
        session.deliver_answer(AT);
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
    let _ = SessionFixture::submitted_on(session.server);
}

#[test]
fn a_goodbye_ramps_even_beside_an_answer() {
    let mut session = SessionFixture::obtained(AT);
    session.deliver_answer([0; 3]);
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
        session.deliver_answer([5_000; 3]);
    }
    assert_eq!(session.server.step().state.phase, Phase::Listening);
    session.client.assert_closed();
}

#[test]
fn the_owners_stop_is_a_fault_that_only_the_machine_s_side_ends() {
    let mut session = SessionFixture::obtained(AT);
    let epoch = session.client.epoch;
    session.deliver_answer([0; 3]);
    session.say(&ClientMessage::Stop(epoch));
    let rows = session.server.assert_ramp(AT, Phase::Fault);
    assert_eq!(rows[0].ended, Some(Cause::Stop));
    for row in rows {
        assert_eq!(session.client.state(), row.state);
    }
    // No word of the client's leads out, and a newcomer hears so.
    for _ in 0..20 {
        session.deliver_answer(AT);
        assert_eq!(session.tick().state.phase, Phase::Fault);
    }
    assert_eq!(
        session.server.refusal(&encode_client(&hello::<3>())),
        Refusal::Faulted { ticks_left: 0 }
    );
    assert_eq!(session.server.step_rearmed().state.phase, Phase::Listening);
    let _ = SessionFixture::submitted_on(session.server);
}

/// A client that has said Hello.
fn asking(server: std::net::SocketAddr) -> Client<3> {
    let mut newcomer = Client::connect(server);
    newcomer.say_hello();
    newcomer
}

#[test]
fn no_peer_is_let_in_during_a_ramp() {
    let mut session = SessionFixture::obtained(AT);
    session.say(&ClientMessage::Goodbye(session.client.epoch));
    let mut before = session.tick().state;
    let mut server = session.server;
    let mut newcomer = asking(server.address());
    let mut refused = 0;
    wait_for("the newcomer's session", || {
        server.receive();
        let row = server.step();
        if row.refused > 0 {
            refused += 1;
            // It hears what was left when it asked: the coming tick's step is not yet in it.
            assert_eq!(
                newcomer.refusal(),
                Refusal::Ramping {
                    ticks_left: before.ramp_ticks_left
                }
            );
            newcomer = asking(server.address());
        }
        if row.welcomed {
            assert_eq!(
                (before.phase, before.ramp_ticks_left),
                (Phase::Listening, 0),
                "let in during the ramp"
            );
        }
        before = row.state;
        row.welcomed
    });
    assert!(refused > 0, "no Hello arrived within the ramp");
    newcomer.welcome();
}
