//! The real client against a real server in lock-step, with a force sensor that lies or falls
//! silent: it leaves in good order and says why, instead of compensating a force that is not
//! measured.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use gantry_tau_client::{ClientControls, ClientError, ClientReport};
use gantry_tau_core::control::message::{Cause, Phase};
use gantry_tau_core::model::robot::ARMS;
use gantry_tau_machine::model::{L2, L2_MOTORS};
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_server::links::sensor::{Sample, SensorPublisher};
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::plant::{Plant, PlantError, Reading};
use gantry_tau_sim::load_generator::load_generator;
use gantry_tau_sim::machine::SimulatedMachine;
use gantry_tau_tests::client_session;
use gantry_tau_tests::server_fixture::LOOPBACK;

use super::liar::Liar;

/// Samples the tare of these tests takes.
const TARE: u32 = 50;
const LOAD: [f64; 6] = [30.0, 0.0, 0.0, 0.0, 0.0, 0.0];

/// A sensor's sample of each tick.
pub(super) type Lie = fn(u64) -> Option<Sample>;

/// Machine under no load, with a sensor that sends what `lie` makes of each tick; and the sensor's
/// address.
pub(super) fn machine(
    robot: &RobotFile<L2, ARMS>,
    lie: Lie,
) -> (
    impl Plant<ARMS, L2_MOTORS, Error = PlantError> + use<>,
    SocketAddr,
) {
    let (_hand, tool) = load_generator();
    let mut sensor = SensorPublisher::bind(LOOPBACK).unwrap();
    let address = sensor.address().unwrap();
    let machine = SimulatedMachine::from_robot(robot, tool, Motion::Hold).unwrap();
    let speak = move |tick, _: &Reading<ARMS>| {
        if let Some(sample) = lie(tick) {
            sensor.publish(&sample);
        }
    };
    (Liar::new(machine, speak), address)
}

/// Runs a client whose sensor lies, until it ends or, from a tick on, is asked to quit. Returns its
/// result, whether it reached Obtain, and the last tick of the session.
fn session(lie: Lie, quit_at: u64) -> (Result<ClientReport, ClientError>, bool, u64) {
    let mut robot = RobotFile::builtin_l2().unwrap();
    robot.sensor.tare_samples = TARE;
    let (liar, sensor) = machine(&robot, lie);
    let cycle = client_session::cycle::<_, ARMS, L2_MOTORS, _>(&robot, liar);
    let controls: Arc<ClientControls> = Arc::default();
    let (result, rows) = client_session::play(robot, cycle, sensor, &controls, |row| {
        if row.state.tick.0 >= quit_at {
            controls.quit.store(true, Ordering::Relaxed);
        }
    });
    let last = rows.last().unwrap();
    assert_eq!(last.ended, Some(Cause::Goodbye), "it leaves in good order");
    if let Ok(report) = &result {
        // Every State has its Command, but the last one, and that of the Goodbye, which may also
        // follow a Command at once.
        let commands = controls.commands.load(Ordering::Relaxed);
        assert!(
            (1..=2).contains(&(report.states - commands)),
            "{commands} {report:?}"
        );
    }
    let obtained = rows.iter().any(|row| row.state.phase == Phase::Obtain);
    (result, obtained, last.state.tick.0)
}

fn honest(tick: u64) -> Sample {
    let load = if tick < 1_000 { [0.0; 6] } else { LOAD };
    Sample { tick, wrench: load }
}

#[test]
fn a_sensor_that_lies_or_falls_silent_is_left() {
    fn nan_later(tick: u64) -> Option<Sample> {
        let wrench = if tick > 2_000 {
            [f64::NAN; 6]
        } else {
            honest(tick).wrench
        };
        Some(Sample { tick, wrench })
    }
    let cases: [(&str, Lie, bool, &str); 5] = [
        (
            "freezes",
            |tick| Some(honest(tick.min(2_000))),
            true,
            "none has come for too long",
        ),
        ("says NaN", nan_later, true, "could not be used"),
        (
            "gets another clock",
            |tick| Some(honest(if tick > 2_000 { tick + 1_000_000 } else { tick })),
            true,
            "not the server's",
        ),
        ("never speaks", |_| None, false, "none has come"),
        (
            "repeats one sample",
            |tick| Some(honest(tick.min(5))),
            false,
            "none has come for too long",
        ),
    ];
    for (case, lie, obtains, reason) in cases {
        let (result, obtained, _) = session(lie, u64::MAX);
        let error = result.unwrap_err();
        assert_eq!(obtained, obtains, "{case}");
        assert!(
            matches!(error, ClientError::SensorSilent(_)),
            "{case}: {error}"
        );
        assert!(error.to_string().contains(reason), "{case}: {error}");
        assert_eq!(error.exit_code(), 8, "{case}");
    }
}

/// Bad samples now and then, each time fewer than end a session and together more: the last
/// correction is held, and every one is counted.
#[test]
fn short_bursts_of_bad_samples_are_tolerated() {
    const BURST: u64 = 90;
    const fn is_bad(tick: u64) -> bool {
        tick > 2_000 && tick % 500 < BURST
    }
    let lie: Lie = |tick| {
        let wrench = if is_bad(tick) {
            [f64::NAN; 6]
        } else {
            honest(tick).wrench
        };
        Some(Sample { tick, wrench })
    };
    let (result, obtained, last) = session(lie, 6_000);
    let report = result.unwrap();
    assert!(obtained);
    let bad: u64 = (0..last).map(|tick| u64::from(is_bad(tick))).sum();
    // The last State is answered with Goodbye.
    assert!(
        bad > 2 * BURST && bad.abs_diff(report.held) <= 1,
        "{} of {bad}: {report:?}",
        report.held
    );
}
