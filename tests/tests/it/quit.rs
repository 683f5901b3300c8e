//! A server that is to end: it does when zero is in force at the drives, and otherwise says
//! what is not.

use gantry_tau_core::units::EpochRange;
use gantry_tau_server::server::ServerError;
use gantry_tau_server::state::{FirstRun, MachineState, StatePlace, StopLatch};
use gantry_tau_tests::fake_plant::Bus;
use gantry_tau_tests::server_fixture::{ServerFixture, parameters};
use gantry_tau_tests::session_fixture::offsets;
use gantry_tau_tests::wait_for;

/// A bus with offsets in force, and a server on it.
fn ramping() -> (Bus<2>, ServerFixture<2>) {
    let bus = Bus::default();
    bus.record().in_force = [offsets(950, -120, 3), offsets(-30, 0, 0)];
    let server = ServerFixture::start(parameters(), bus.clone(), EpochRange::VOLATILE).unwrap();
    (bus, server)
}

/// Found by audit: the session ramped to zero by itself, and the server said that all offsets were.
#[test]
fn with_a_dead_bus_it_says_what_the_drives_hold() {
    let (bus, mut server) = ramping();
    server.step();
    bus.record().write_fails = true;
    let ended = server.spawn().quit();
    let held = vec![offsets(850, -70, 2), offsets(0, 0, 0)];
    assert_eq!(
        ended,
        Err(ServerError::StillInForce {
            offsets: held.clone()
        })
    );
    assert_eq!(bus.in_force().to_vec(), held);
    let said = ended.unwrap_err().to_string();
    assert!(
        said.contains("axis 1: 850 nm, -70 um/s, 2 per mille"),
        "{said}"
    );
}

#[test]
fn it_waits_for_a_bus_that_comes_back() {
    let (bus, server) = ramping();
    let mut record = bus.record();
    (record.write_fails, record.offsets_fail) = (true, true);
    drop(record);
    let server = server.spawn();
    let quitting = std::thread::spawn(move || server.quit());
    wait_for("a dead bus", || bus.record().failures > 100);
    assert!(!quitting.is_finished());
    let mut record = bus.record();
    (record.write_fails, record.offsets_fail) = (false, false);
    drop(record);
    assert!(quitting.join().unwrap().is_ok());
    assert_eq!(bus.in_force(), [offsets(0, 0, 0); 2]);
}

/// The latch as it was left.
fn open(place: &StatePlace) -> StopLatch {
    MachineState::own(place, "test")
        .unwrap()
        .begin(FirstRun::Harmless)
        .unwrap()
        .latch
}

/// A quit ramps as a stop does, and is none; one that was pressed before stays.
#[test]
fn a_quit_is_no_stop() {
    let folder = tempfile::tempdir().unwrap();
    let place = StatePlace::named(&folder.path().join("epoch"));
    let server = ServerFixture::<2>::with_latch(Bus::default(), open(&place)).spawn();
    assert!(server.quit().is_ok());
    assert!(!open(&place).is_latched());
    let mut server = ServerFixture::<2>::with_latch(Bus::default(), open(&place));
    server.step_stopped();
    assert!(server.spawn().quit().is_ok());
    assert!(open(&place).is_latched());
}

/// Found from outside: "listening on" was printed, and then that the drives cannot be enabled.
#[test]
fn a_server_whose_drives_cannot_be_enabled_does_not_begin() {
    let (bus, server) = ramping();
    bus.record().start_fails = true;
    assert!(matches!(server.try_spawn(), Err(ServerError::Plant(_))));
    assert!(bus.record().written.is_empty());
}
