//! Attempts to use the server up: thousands of connections, connections that hardly speak. The
//! owner notices none of them.

use std::net::TcpStream;

use gantry_tau_core::control::message::{Mode, Phase, Refusal};
use gantry_tau_core::control::wire::encode_client;
use gantry_tau_tests::client::{Client, hello};
use gantry_tau_tests::session_fixture::SessionFixture;
use gantry_tau_tests::soak::real_time::Footprint;
use gantry_tau_tests::wait_for;

use super::AT;

fn tick(session: &mut SessionFixture<3>) {
    let row = session.answer(Mode::Obtain, AT);
    assert_eq!(row.state.phase, Phase::Obtain);
    assert_eq!(row.state.counters.missed, 0);
    assert_eq!(session.server.bus.positions(), AT);
}

#[test]
fn thousands_of_connections_come_and_go() {
    let mut session = SessionFixture::obtained(AT);
    let before = Footprint::now();
    for round in 0..300 {
        let crowd: Vec<TcpStream> = (0..10)
            .map(|_| TcpStream::connect(session.server.address()).unwrap())
            .collect();
        for _ in 0..5 {
            tick(&mut session);
        }
        // Some are closed by their peers, some stay until the server has had enough of them.
        if round % 2 == 0 {
            drop(crowd);
        }
    }
    // What waits in the system's queue comes in, hears that all places are taken, and goes.
    for _ in 0..2_000 {
        tick(&mut session);
    }
    // This process holds both ends of the connections, and those of the tests beside this one until
    // they end.
    wait_for("the descriptors of thousands", || {
        tick(&mut session);
        before.is_none_or(|before| Footprint::now().unwrap().files <= before.files + 8)
    });
}

#[test]
fn who_hardly_speaks_is_closed_and_a_newcomer_is_served() {
    let mut session = SessionFixture::obtained(AT);
    let hello = encode_client(&hello::<3>());
    let mut slow: Vec<Client<3>> = (0..5)
        .map(|_| Client::connect(session.server.address()))
        .collect();
    // A byte each now and then: never a whole Hello within the thousand ticks that another has.
    for at in 0..5 {
        for client in &mut slow {
            client.send_bytes(&hello[at..=at]);
        }
        for _ in 0..190 {
            tick(&mut session);
        }
    }
    wait_for("the end of the slow ones", || {
        tick(&mut session);
        slow.iter_mut().all(|client| !client.is_quiet())
    });
    let mut next = Client::<3>::connect(session.server.address());
    next.say_hello();
    wait_for("the refusal", || {
        tick(&mut session);
        !next.is_quiet()
    });
    assert_eq!(next.refusal(), Refusal::Busy);
}
