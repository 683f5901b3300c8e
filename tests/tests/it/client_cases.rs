//! The client in Rust against the list of cases that the client in Python is run against, too:
//! every refusal that `wire.md` demands; and what the client that compensates demands in addition.

use std::convert::Infallible;
use std::net::SocketAddr;
use std::time::Duration;

use gantry_tau_client::force_sensor::SensorSource;
use gantry_tau_client::{self, ClientControls, ClientError, ClientOptions, Connection};
use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::client::{Event, Requirements};
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::{Capabilities, Mode};
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_tests::client_cases::Cases;

/// Answers States until the end.
fn hold(address: SocketAddr, cases: &Cases) -> ClientError {
    let requirements = Requirements {
        capabilities: Capabilities::LOCKSTEP,
        cycle_us: Some(cases.cycle_us),
        kinematics_checksum: Some(cases.checksum),
    };
    hold_until_error(address, requirements).unwrap_err()
}

fn hold_until_error(
    address: SocketAddr,
    requirements: Requirements,
) -> Result<Infallible, ClientError> {
    let mut link = Connection::<3>::open(
        Transport::Stream,
        address,
        Duration::from_secs(20),
        requirements,
    )?;
    link.greet()?;
    loop {
        match link.next_event()? {
            Event::Ended(state) => return Err(ClientError::Ended(state.cause)),
            _ => link.answer(Mode::Submit, &[Offsets::ZERO; 3])?,
        };
    }
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

/// The client that compensates, and a server whose Welcome has these bytes at their offsets.
fn compensates_with(bytes: [(usize, u32); 2]) -> ClientError {
    let cases = Cases::read();
    let set = bytes.map(|(offset, number)| (offset, format!("{:08x}", number.swap_bytes())));
    let case = serde_json::json!({
        "name": "Welcome", "exit_code": 5, "frames": [{"of": "welcome", "set": set}, {"of": "state"}],
    });
    let (address, serving) = cases.serve(&serde_json::from_value(case).unwrap());
    let options = ClientOptions {
        server: address.into(),
        transport: Transport::Stream,
        sensor: SensorSource::States,
        accelerometer: None,
        robot: RobotFile::builtin_l2().unwrap(),
        key: None,
        record: None,
        obtain: true,
        accept_unstable: false,
    };
    let error = gantry_tau_client::run(&options, &ClientControls::default()).unwrap_err();
    serving.join().unwrap();
    error
}

#[test]
fn the_client_that_compensates_has_a_machine_and_a_cycle_of_its_own() {
    let checksum = RobotFile::builtin_l2().unwrap().checksum();
    let cycle = compensates_with([(16, 2_000), (24, checksum)]);
    assert!(
        cycle
            .to_string()
            .contains("the server's cycle is 2000 us, the client's is 1000 us"),
        "{cycle}"
    );
    let machine = compensates_with([(16, 1_000), (24, checksum ^ 1)]);
    assert_eq!(
        (machine.exit_code(), machine.to_string().contains("cycle")),
        (5, false),
        "{machine}"
    );
    // With its own it goes on to the State, whose epoch and tick it takes, and finds no sample.
    let own = compensates_with([(16, 1_000), (24, checksum)]);
    assert_ne!(own.exit_code(), 5, "{own}");
}
