//! From connecting to the first command: who is let in, and what the others are told.

use gantry_tau_core::control::message::{Capabilities, Cause, ClientMessage, Hello, Mode, Phase, Refusal};
use gantry_tau_core::control::wire::encode_client;
use gantry_tau_core::units::{Epoch, EpochRange};
use gantry_tau_tests::client::{Client, enclose, hello};
use gantry_tau_tests::fake_plant::Bus;
use gantry_tau_tests::server_fixture::{ServerFixture, parameters};
use gantry_tau_tests::session_fixture::SessionFixture;
use gantry_tau_tests::wait_for;

/// Steps until the client has been told something, which must not be a Welcome.
fn refusal(server: &mut ServerFixture<3>, bytes: &[u8]) -> Refusal {
    let mut client = Client::<3>::connect(server.address());
    client.send_bytes(bytes);
    wait_for("an answer", || {
        server.receive();
        let row = server.step();
        assert!(!row.welcomed);
        assert_eq!(row.state.phase, Phase::Listening);
        !client.is_quiet()
    });
    client.refusal()
}

fn hello_with(axes: u8, capabilities: u16) -> Vec<u8> {
    let capabilities = Capabilities(capabilities);
    let hello = Hello { axes, capabilities };
    encode_client(&ClientMessage::<3>::Hello(hello)).to_vec()
}

#[test]
fn a_hello_is_refused_with_its_reason() {
    let mut parameters = parameters();
    parameters.capabilities = Capabilities::LOCKSTEP;
    let mut server = ServerFixture::start(parameters, Bus::default(), EpochRange::VOLATILE).unwrap();
    for axes in [0, 2, 4, 6, 255] {
        let said = refusal(&mut server, &hello_with(axes, 1));
        assert_eq!(said, Refusal::Axes { expected: 3 });
    }
    for capabilities in [0, 2] {
        let needed = Capabilities::LOCKSTEP;
        let said = refusal(&mut server, &hello_with(3, capabilities));
        assert_eq!(said, Refusal::Capability { needed });
    }
    for version in [0, 2, 255] {
        let said = refusal(&mut server, &enclose(version, 1, &[3, 0, 1, 0]));
        assert_eq!(said, Refusal::Version { supported: 1 });
    }
    let mut client = Client::<3>::connect(server.address());
    client.send_bytes(&hello_with(3, 0xffff));
    wait_for("the Welcome", || {
        server.receive();
        server.step().welcomed
    });
    client.welcome();
}

#[test]
fn a_server_without_an_epoch_to_give_says_so() {
    let epochs = EpochRange { first: Epoch(8), last: Epoch(7) };
    let mut server = ServerFixture::start(parameters(), Bus::default(), epochs).unwrap();
    let said = refusal(&mut server, &hello_with(3, 0));
    assert_eq!(said, Refusal::Unavailable);
}

#[test]
fn the_welcome_says_the_terms() {
    let mut server = ServerFixture::<3>::default();
    let mut client = Client::<3>::connect(server.address());
    client.say_hello();
    wait_for("the Welcome", || {
        server.receive();
        server.step().welcomed
    });
    let welcome = client.welcome();
    let terms = parameters::<3>();
    assert_eq!((welcome.cycle_us, welcome.echo_window), (1_000, 0));
    assert_eq!(welcome.kinematics_checksum, terms.kinematics_checksum);
    assert_eq!(welcome.limits, terms.axes.map(|axis| axis.limits));
    assert_eq!(welcome.tick, client.state().tick);
}

#[test]
fn obtain_straight_from_the_handshake_costs_the_frame() {
    let server = ServerFixture::default();
    let client = Client::connect(server.address());
    let mut session = SessionFixture::greeted(server, client);
    for count in 1..=3 {
        let row = session.answer(Mode::Obtain, [5_000; 3]);
        assert_eq!(row.state.phase, Phase::Handshake);
        assert_eq!(row.state.counters.malformed, count);
        assert_eq!(session.server.bus.positions(), [0; 3]);
    }
    assert_eq!(session.answer(Mode::Submit, [0; 3]).state.phase, Phase::Submit);
    session.answer(Mode::Obtain, [5_000; 3]);
    assert_eq!(session.server.bus.positions(), [5_000; 3]);
}

#[test]
fn the_first_commands_sequence_counts_and_two_misses_in_submit_end_the_session() {
    let mut session: SessionFixture<3> = SessionFixture::submitted_on(ServerFixture::default());
    for count in 1..=2 {
        // A second answer with the first one's number.
        session.client.sequence = 0;
        let frame = session.client.frame(Mode::Obtain, [5_000; 3]);
        session.deliver(&frame);
        let row = session.tick();
        assert_eq!(row.state.counters.duplicate, count);
        assert_eq!(row.ended, (count == 2).then_some(Cause::ClientLate));
    }
    assert_eq!(session.server.step().state.phase, Phase::Listening);
}

#[test]
fn a_silent_handshake_ends_after_its_thousand_ticks() {
    let server = ServerFixture::default();
    let client = Client::connect(server.address());
    let mut session: SessionFixture<3> = SessionFixture::greeted(server, client);
    for _ in 1..1_000 {
        assert_eq!(session.tick().state.phase, Phase::Handshake);
    }
    let row = session.tick();
    assert_eq!(row.ended, Some(Cause::HandshakeTimeout));
    assert_eq!(session.server.step().state.phase, Phase::Listening);
    session.client.assert_closed();
}

#[test]
fn an_impatient_hello_is_not_granted_and_keeps_no_peer_out() {
    // A Hello, and more before the Welcome: the connection is closed, and its Hello goes with it.
    let mut server = ServerFixture::<3>::default();
    let mut client = Client::<3>::connect(server.address());
    client.send_bytes(&encode_client(&hello::<3>()).repeat(2));
    wait_for("the end of the connection", || {
        server.receive();
        assert!(!server.step().welcomed);
        !client.is_quiet()
    });
    assert_eq!(SessionFixture::submitted_on(server).server.phase(), Phase::Submit);
}

#[test]
fn a_second_hello_in_the_handshake_costs_that_frame() {
    let server = ServerFixture::default();
    let client = Client::connect(server.address());
    let mut session: SessionFixture<3> = SessionFixture::greeted(server, client);
    session.say(&hello());
    let row = session.tick();
    assert_eq!((row.refused, row.state.counters.malformed), (0, 1));
    assert_eq!(session.answer(Mode::Submit, [0; 3]).state.phase, Phase::Submit);
}
