//! The client in Rust against the list of cases that the client in Python is run against, too: every refusal that `wire.md` demands.

use std::net::SocketAddr;
use std::time::Duration;

use gantry_tau::client::{ClientError, Connection};
use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::client::{Event, Requirements};
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::{Capabilities, Mode};
use gantry_tau_tests::client_cases::Cases;

/// Answers States until the end.
fn hold(address: SocketAddr, cases: &Cases) -> ClientError {
    let requirements = Requirements {
        capabilities: Capabilities::LOCKSTEP,
        cycle_us: Some(cases.cycle_us),
        kinematics_checksum: Some(cases.checksum),
    };
    let held = || {
        let mut link = Connection::<3>::open(Transport::Stream, address, Duration::from_secs(20), requirements)?;
        link.greet()?;
        loop {
            match link.next_event()? {
                Event::Ended(state) => return Err(ClientError::Ended(state.cause)),
                _ => link.answer(Mode::Submit, &[Offsets::ZERO; 3])?,
            };
        }
    };
    let ended: Result<(), ClientError> = held();
    ended.unwrap_err()
}

#[test]
fn every_case_of_the_shared_list_ends_as_it_says() {
    let cases = Cases::read();
    assert!(cases.cases.len() > 50);
    for case in &cases.cases {
        let (address, serving) = cases.serve(case);
        let error = hold(address, &cases);
        let sent = serving.join().unwrap();
        Cases::check(case, error.exit_code(), &error.to_string(), &sent);
    }
}
