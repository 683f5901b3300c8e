//! From connecting to the first command: who is let in, and what the others hear.

use gantry_tau_core::control::message::{
    Capabilities, Cause, ClientMessage, Hello, Phase, Refusal,
};
use gantry_tau_core::control::wire::{Notice, encode_client};
use gantry_tau_core::units::{Epoch, EpochRange};
use gantry_tau_tests::client::{Client, enclose};
use gantry_tau_tests::fake_plant::Bus;
use gantry_tau_tests::server_fixture::{ServerFixture, parameters};
use gantry_tau_tests::session_fixture::SessionFixture;

fn hello_with(axes: u8, capabilities: u16) -> Vec<u8> {
    let hello = Hello {
        axes,
        capabilities: Capabilities(capabilities),
    };
    encode_client(&ClientMessage::<3>::Hello(hello)).to_vec()
}

#[test]
fn a_hello_is_refused_with_its_reason() {
    let mut parameters = parameters::<3>();
    parameters.capabilities = Capabilities::LOCKSTEP;
    let mut server =
        ServerFixture::start(parameters, Bus::default(), EpochRange::VOLATILE).unwrap();
    for axes in [0, 2, 4, 6, 255] {
        let said = server.refusal(&hello_with(axes, 1));
        assert_eq!(said, Refusal::Axes { expected: 3 });
    }
    for capabilities in [0, 2] {
        let needed = Capabilities::LOCKSTEP;
        let said = server.refusal(&hello_with(3, capabilities));
        assert_eq!(said, Refusal::Capability { needed });
    }
    for version in [0, 1, 3, 255] {
        let said = server.notice(&enclose(version, 1, &[3, 0, 1, 0]));
        assert_eq!(said, Notice::VERSION);
    }
    for suite in [1, 2, 65_535_u16] {
        let mut hello = hello_with(3, 1);
        hello[6..8].copy_from_slice(&suite.to_le_bytes());
        assert_eq!(server.notice(&hello), Notice::suite(0));
    }
    // As version 1 had it: no suite in its header.
    let said = server.notice(b"GT\x01\x01\x04\0\x03\0\x01\0\x46\xb3\xb0\x4a");
    assert_eq!(said, Notice::VERSION);
    let mut client = Client::<3>::connect(server.address());
    client.send_bytes(&hello_with(3, 0xffff));
    server.step_until("the Welcome", |row| row.welcomed);
    client.welcome();
}

#[test]
fn a_server_without_an_epoch_to_give_says_so() {
    let epochs = EpochRange {
        first: Epoch(8),
        last: Epoch(7),
    };
    let mut server = ServerFixture::<3>::start(parameters(), Bus::default(), epochs).unwrap();
    let said = server.refusal(&hello_with(3, 0));
    assert_eq!(said, Refusal::Unavailable);
}

#[test]
fn the_welcome_says_the_terms() {
    let mut server = ServerFixture::<3>::default();
    let mut client = Client::<3>::connect(server.address());
    client.say_hello();
    server.step_until("the Welcome", |row| row.welcomed);
    let welcome = client.welcome();
    let terms = parameters::<3>();
    assert_eq!((welcome.cycle_us, welcome.echo_window), (1_000, 0));
    assert_eq!(welcome.kinematics_checksum, terms.kinematics_checksum);
    assert_eq!(welcome.limits, terms.axes.map(|axis| axis.limits));
    assert_eq!(welcome.tick, client.state().tick);
}

#[test]
fn the_first_commands_sequence_counts_and_two_misses_in_submit_end_the_session() {
    let mut session: SessionFixture<3> = SessionFixture::submitted_on(ServerFixture::default());
    for count in 1..=2 {
        // A second answer with the first one's number.
        session.client.sequence = 0;
        session.deliver_answer([5_000; 3]);
        let row = session.tick();
        assert_eq!(row.state.counters.duplicate, count);
        assert_eq!(row.ended, (count == 2).then_some(Cause::ClientLate));
    }
    assert_eq!(session.server.step().state.phase, Phase::Listening);
}
