//! The real client against a real server in lock-step, with a force sensor that lies or falls silent: it leaves in good order
//! and says why, instead of compensating a force that nobody measures.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::arithmetic_side_effects,
    reason = "a test that cannot be set up must fail"
)]

use gantry_tau::client::{self, ClientControls, ClientError, ClientOptions};
use gantry_tau::epoch::Epochs;
use gantry_tau::machine::MOTORS;
use gantry_tau::robot_file::RobotFile;
use gantry_tau::sensor_link::{Sample, SensorPublisher};
use gantry_tau::server::Server;
use gantry_tau::server::cycle::Cycle;
use gantry_tau::server::pace::Pace;
use gantry_tau::sim::hand::hand_and_tool;
use gantry_tau::sim::parameters::Motion;
use gantry_tau_core::message::{Capabilities, Cause, Phase};
use gantry_tau_core::robot::ARMS;

/// Samples the tare of these tests takes.
const TARE: u32 = 50;
const LOAD: [f64; 6] = [30.0, 0.0, 0.0, 0.0, 0.0, 0.0];

/// Runs a client whose sensor sends what `lie` makes of an honest tick; returns how it ended, and whether it ever reached Obtain.
fn session(lie: impl Fn(u64) -> Option<Sample>) -> (ClientError, bool) {
    let loopback = ([127, 0, 0, 1], 0).into();
    let mut robot = RobotFile::builtin_l2().unwrap();
    robot.sensor.tare_samples = TARE;
    let (_hand, tool) = hand_and_tool();
    let machine = robot.simulated_machine(tool, Motion::Hold).unwrap();
    let config = robot.session_config(Capabilities::LOCKSTEP).unwrap();
    let motors = robot.motor_map().unwrap();
    let cycle: Cycle<ARMS, MOTORS, _> =
        Cycle::new(config, motors, machine, Epochs::volatile(), loopback).unwrap();
    let mut sensor = SensorPublisher::bind(loopback).unwrap();
    let (server, mut rows) = Server::spawn(cycle, Pace::Lockstep).unwrap();
    let options = ClientOptions {
        server: server.address,
        sensor: sensor.address().unwrap(),
        robot,
        record: None,
        obtain: true,
    };
    let client = std::thread::spawn(move || client::run(&options, &ClientControls::default()));
    let mut obtained = false;
    let mut ended = None;
    while ended.is_none() {
        if let Ok(row) = rows.pop() {
            obtained |= row.state.phase == Phase::Obtain;
            ended = row.ended;
            if let Some(sample) = lie(row.state.tick.0) {
                sensor.publish(&sample);
            }
        }
    }
    assert_eq!(ended, Some(Cause::Goodbye), "it leaves in good order");
    let error = client.join().unwrap().unwrap_err();
    server.quit().unwrap();
    (error, obtained)
}

fn honest(tick: u64) -> Sample {
    let load = if tick < 1_000 { [0.0; 6] } else { LOAD };
    Sample { tick, wrench: load }
}

fn assert_silent(error: &ClientError, reason: &str) {
    assert!(matches!(error, ClientError::SensorSilent(_)), "{error}");
    assert!(error.to_string().contains(reason), "{error}");
    assert_eq!(error.exit_code(), 8);
}

#[test]
fn a_sensor_that_freezes_is_left() {
    let (error, obtained) = session(|tick| Some(honest(tick.min(2_000))));
    assert!(obtained);
    assert_silent(&error, "none has come for too long");
}

#[test]
fn a_sensor_that_says_nan_is_left() {
    let (error, obtained) = session(|tick| {
        let wrench = if tick > 2_000 {
            [f64::NAN; 6]
        } else {
            honest(tick).wrench
        };
        Some(Sample { tick, wrench })
    });
    assert!(obtained);
    assert_silent(&error, "could not be used");
}

#[test]
fn a_sensor_with_another_clock_is_left() {
    let (error, obtained) = session(|tick| {
        let tick = tick + if tick > 2_000 { 1_000_000 } else { 0 };
        Some(honest(tick))
    });
    assert!(obtained);
    assert_silent(&error, "not the server's");
}

#[test]
fn a_sensor_that_never_speaks_gives_no_obtain() {
    let (error, obtained) = session(|_| None);
    assert!(!obtained);
    assert_silent(&error, "none has come");
}

#[test]
fn one_sample_repeated_is_no_tare() {
    let (error, obtained) = session(|tick| Some(honest(tick.min(5))));
    assert!(!obtained);
    assert_silent(&error, "none has come for too long");
}
