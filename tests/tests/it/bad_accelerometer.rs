//! The real client against a real server in lock-step, with an accelerometer that shows what it does
//! not measure: the client leaves in good order and says why.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use gantry_tau_client::{ClientControls, ClientError};
use gantry_tau_core::control::message::{Cause, Phase};
use gantry_tau_core::model::robot::ARMS;
use gantry_tau_machine::model::{L2, L2_MOTORS};
use gantry_tau_machine::robot_file::{AccelerometerKeys, RobotFile};
use gantry_tau_server::links::accelerometer::{Acceleration, AccelerometerPublisher};
use gantry_tau_server::plant::Reading;
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_sim::load_generator::load_generator;
use gantry_tau_sim::machine::SimulatedMachine;
use gantry_tau_tests::client_session;
use gantry_tau_tests::liar::Liar;
use gantry_tau_tests::server_fixture::LOOPBACK;

/// Tick from which on it lies; the tare is done, and the offsets act.
const LATER: u64 = 500;

/// A sample of each tick, by the honest one.
type Lie = fn(Acceleration) -> Option<Acceleration>;

fn robot() -> RobotFile<L2, ARMS> {
    let mut robot = RobotFile::builtin_l2().unwrap();
    robot.sensor.tare_samples = 50;
    robot.sensor.accelerometer = Some(AccelerometerKeys {
        place_m: robot.sensor.tool.centre_m,
        axes: 6,
        rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        share: 0.9,
        gravity: true,
    });
    robot
}

/// Runs a client whose accelerometer lies, until it ends or, at twice [`LATER`], is asked to quit.
/// Returns its result, and whether it reached Obtain.
fn session(lie: Lie) -> (Result<u64, ClientError>, bool) {
    let robot = robot();
    let (_hand, tool) = load_generator();
    let machine = SimulatedMachine::moving_from_robot(&robot, tool, Motion::Hold).unwrap();
    let mut accelerometer = AccelerometerPublisher::bind(LOOPBACK).unwrap();
    let address = accelerometer.address().unwrap();
    let liar = Liar::new(machine, move |tick, reading: &mut Reading<ARMS>| {
        let components = reading.tool.unwrap().acceleration.unwrap();
        if let Some(sample) = lie(Acceleration { tick, components }) {
            accelerometer.publish(&sample);
        }
    });
    let cycle = client_session::cycle::<_, ARMS, L2_MOTORS, _>(&robot, liar);
    let controls: Arc<ClientControls> = Arc::default();
    let (result, rows) =
        client_session::play(robot.clone(), cycle, Some(address), &controls, |row| {
            if row.state.tick.0 >= 2 * LATER {
                controls.quit.store(true, Ordering::Relaxed);
            }
        });
    assert_eq!(rows.last().unwrap().ended, Some(Cause::Goodbye));
    for rows in rows.windows(2) {
        for axis in 0..ARMS {
            let [before, now] = [0, 1].map(|row| rows[row].state.axes[axis].offsets.position.0);
            let limit = robot.limits[axis].limits.position.values().step;
            assert!((now - before).abs() <= limit, "{before} {now}");
        }
    }
    let obtained = rows.iter().any(|row| row.state.phase == Phase::Obtain);
    (result.map(|report| report.held), obtained)
}

#[test]
fn an_accelerometer_that_lies_or_falls_silent_is_left() {
    let cases: [(&str, Lie, bool, &str); 6] = [
        (
            "says NaN",
            |mut sample| {
                if sample.tick > LATER {
                    sample.components[4] = f64::NAN;
                }
                Some(sample)
            },
            true,
            "the accelerometer shows NaN",
        ),
        (
            "is ten cycles late",
            |mut sample| {
                sample.tick -= if sample.tick > LATER { 10 } else { 0 };
                Some(sample)
            },
            true,
            "no sample within 1 ms of the force sample",
        ),
        (
            "falls silent",
            |sample| (sample.tick <= LATER).then_some(sample),
            true,
            "no sample within 1 ms of the force sample",
        ),
        ("never speaks", |_| None, false, "no sample within 1 ms"),
        (
            "counts in g",
            |mut sample| {
                sample.components = sample.components.map(|value| value / 9.806_65);
                Some(sample)
            },
            false,
            "m/s^2 at rest",
        ),
        (
            "has other axes",
            |mut sample| {
                sample.components.swap(1, 2);
                Some(sample)
            },
            false,
            "m/s^2 at rest",
        ),
    ];
    for (case, lie, obtains, reason) in cases {
        let (result, obtained) = session(lie);
        let error = result.unwrap_err();
        assert_eq!(obtained, obtains, "{case}");
        assert!(error.to_string().contains(reason), "{case}: {error}");
        assert_eq!(error.exit_code(), 8, "{case}");
    }
}

#[test]
fn an_honest_accelerometer_and_one_that_is_a_cycle_late_serve() {
    let cases: [Lie; 2] = [Some, |mut sample| {
        sample.tick = sample.tick.saturating_sub(1);
        Some(sample)
    }];
    for lie in cases {
        let (result, obtained) = session(lie);
        assert!(obtained);
        assert_eq!(result.unwrap(), 0);
    }
}
