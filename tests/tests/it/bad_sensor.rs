//! The real client against a real server in lock-step, with a force sensor that lies or falls silent: it leaves in good order
//! and says why, instead of compensating a force that is not measured.

use gantry_tau::client::{self, ClientControls, ClientError, ClientOptions};
use gantry_tau::model::L2_MOTORS;
use gantry_tau::plant::{Plant, PlantError, Reading};
use gantry_tau::robot_file::RobotFile;
use gantry_tau::sensor_link::{Sample, SensorPublisher};
use gantry_tau::server::Server;
use gantry_tau::server::cycle::Cycle;
use gantry_tau::server::tick_source::TickSource;
use gantry_tau::sim::load_generator::load_generator;
use gantry_tau::sim::machine::SimulatedMachine;
use gantry_tau::sim::parameters::Motion;
use gantry_tau_core::control::axis::{Offsets, Reference};
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::{Capabilities, Cause, Phase};
use gantry_tau_core::model::robot::ARMS;
use gantry_tau_core::units::EpochRange;

/// Samples the tare of these tests takes.
const TARE: u32 = 50;
const LOAD: [f64; 6] = [30.0, 0.0, 0.0, 0.0, 0.0, 0.0];

/// The simulated machine, with a sensor that sends what `lie` makes of each tick, in the cycle as an honest one would.
struct Liar<F> {
    machine: SimulatedMachine<ARMS, L2_MOTORS>,
    sensor: SensorPublisher,
    lie: F,
    reads: u64,
}

impl<F: Fn(u64) -> Option<Sample> + Send> Plant<ARMS, L2_MOTORS> for Liar<F> {
    fn offsets_in_force(&mut self) -> Result<[Offsets; ARMS], PlantError> {
        self.machine.offsets_in_force()
    }

    fn read(&mut self, elapsed: u64) -> Result<Reading<ARMS>, PlantError> {
        // The read before the first cycle is that of tick 0.
        if let Some(sample) = (self.lie)(self.reads) {
            self.sensor.publish(&sample);
        }
        self.reads += 1;
        self.machine.read(elapsed)
    }

    fn write(&mut self, references: &[Reference; L2_MOTORS]) -> Result<(), PlantError> {
        self.machine.write(references)
    }
}

/// Runs a client whose sensor lies; returns how it ended, and whether it ever reached Obtain.
fn session(lie: impl Fn(u64) -> Option<Sample> + Send + 'static) -> (ClientError, bool) {
    let loopback = ([127, 0, 0, 1], 0).into();
    let mut robot = RobotFile::builtin_l2().unwrap();
    robot.sensor.tare_samples = TARE;
    let (_hand, tool) = load_generator();
    let config = robot.session_config(Capabilities::LOCKSTEP).unwrap();
    let motors = robot.motor_map().unwrap();
    let liar = Liar {
        machine: robot.simulated_machine(tool, Motion::Hold).unwrap(),
        sensor: SensorPublisher::bind(loopback).unwrap(),
        lie,
        reads: 0,
    };
    let sensor = liar.sensor.address().unwrap();
    let cycle: Cycle<ARMS, L2_MOTORS, _> = Cycle::new(config, motors, liar, EpochRange::VOLATILE, loopback).unwrap();
    let (server, mut rows) = Server::spawn(cycle, TickSource::Lockstep).unwrap();
    let options = ClientOptions {
        server: server.address,
        transport: Transport::Stream,
        sensor,
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
        let wrench = if tick > 2_000 { [f64::NAN; 6] } else { honest(tick).wrench };
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
