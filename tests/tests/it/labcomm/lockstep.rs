//! The simulated L2 in lock-step with the real client, stepped by the test.
//!
//! Its force sensor has no noise: two runs of a script differ in nothing but the number of ticks
//! before the session.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use gantry_tau_client::force_sensor::{DEFAULT_NAME, SensorSource};
use gantry_tau_client::{self, ClientControls, ClientError, ClientOptions, ClientReport};
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::{Capabilities, Phase};
use gantry_tau_core::model::robot::ARMS;
use gantry_tau_core::units::{EpochRange, Tick};
use gantry_tau_machine::model::{L2, L2_MOTORS};
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::publication::Publication;
use gantry_tau_server::record::TickRecord;
use gantry_tau_server::server::cycle::{Cycle, OperatorInputs};
use gantry_tau_server::server::event_log::EventLog;
use gantry_tau_server::state::StopLatch;
use gantry_tau_sim::load_generator::{Load, LoadGenerator, load_generator};
use gantry_tau_sim::machine::SimulatedMachine;
use gantry_tau_tests::server_fixture::LOOPBACK;
use gantry_tau_tests::wait_for;

/// Samples that the tare of these tests takes.
const TARE: u32 = 50;
/// Force of the script, N.
pub(super) const FORCE_N: f64 = 60.0;
/// Tick of a session from which the force acts.
pub(super) const PULLED: usize = 200;
/// Ticks until the offsets have followed a step of the force, and the sensor's filter has settled.
pub(super) const SETTLED: usize = 600;

/// The thesis' robot, with a sensor without noise and a short tare.
fn robot() -> RobotFile<L2, ARMS> {
    let mut robot = RobotFile::builtin_l2().unwrap();
    robot.sensor.tare_samples = TARE;
    (
        robot.simulation.force_noise_n,
        robot.simulation.moment_noise_nm,
    ) = (0.0, 0.0);
    robot
}

/// The server of `gantry-tau serve --pace lockstep`, without its threads.
pub(super) struct Lockstep {
    cycle: Cycle<ARMS, L2_MOTORS, SimulatedMachine<ARMS, L2_MOTORS>>,
    hand: LoadGenerator,
    /// Ports that the observing thread would write.
    ports: Vec<Publication>,
    log: EventLog,
    /// Every row so far.
    pub(super) rows: Vec<TickRecord<ARMS>>,
}

/// A session, from the tick of its Welcome to the first tick in which the server listens again.
pub(super) struct Session {
    pub(super) rows: Vec<TickRecord<ARMS>>,
    pub(super) client: Result<ClientReport, ClientError>,
}

impl Lockstep {
    /// A server with LabComm ports.
    pub(super) fn start(ports: Vec<Publication>) -> Self {
        let robot = robot();
        let (hand, tool) = load_generator();
        let machine = SimulatedMachine::from_robot(&robot, tool, Motion::Hold).unwrap();
        let config = robot.session_config(Capabilities::LOCKSTEP).unwrap();
        let motors = robot.motor_map().unwrap();
        let (sensors, ports) = ports.into_iter().partition(Publication::is_of_sensors);
        let cycle = Cycle::new(
            config,
            motors,
            machine,
            EpochRange::VOLATILE,
            StopLatch::volatile(),
            LOOPBACK,
        )
        .unwrap();
        let cycle = cycle.with_sensors(sensors);
        Self {
            cycle,
            hand,
            ports,
            log: EventLog::default(),
            rows: Vec::new(),
        }
    }

    /// One tick, and what `serve` does with its row.
    pub(super) fn tick(&mut self) -> TickRecord<ARMS> {
        let row = self.cycle.step(1, OperatorInputs::default());
        let events = self.log.see(&row);
        for port in &mut self.ports {
            port.publish(&row, &events);
            port.flush();
        }
        self.rows.push(row);
        row
    }

    fn pull(&mut self) {
        self.hand
            .set(&Load {
                step: 1,
                force_n: [FORCE_N, 0.0, 0.0],
                moment_nm: [0.0; 3],
            })
            .unwrap();
    }

    /// Displacement of the tool by the force without compensation, m.
    pub(super) fn uncompensated_m(mut self) -> f64 {
        self.pull();
        for _ in 0..SETTLED {
            self.tick();
        }
        displacement_m(self.rows.last().unwrap())
    }

    /// Waits for what a server in lock-step waits for.
    fn await_answer(&mut self) {
        if matches!(
            self.cycle.phase(),
            Phase::Handshake | Phase::Submit | Phase::Obtain
        ) {
            wait_for("the answer", || {
                self.cycle.receive();
                self.cycle.owner_has_answered()
            });
        } else {
            self.cycle.receive();
        }
    }

    /// Runs a client for so many ticks, or until it leaves by itself, then its ramp. From tick
    /// [`PULLED`] on, [`FORCE_N`] pulls in x. Before each tick, when the last State has been
    /// answered, `beside` gets its number and the last row.
    pub(super) fn session(
        &mut self,
        sensor: SensorSource,
        ticks: usize,
        mut beside: impl FnMut(usize, &TickRecord<ARMS>),
    ) -> Session {
        let server = self.cycle.address().unwrap().into();
        let transport = Transport::Stream;
        let options = ClientOptions {
            server,
            transport,
            sensor,
            accelerometer: None,
            robot: robot(),
            key: None,
            record: None,
            obtain: true,
            accept_unstable: false,
        };
        let controls = Arc::new(ClientControls::default());
        let switches = Arc::clone(&controls);
        let client = std::thread::spawn(move || gantry_tau_client::run(&options, &switches));
        wait_for("the Welcome", || {
            self.cycle.receive();
            self.tick().welcomed
        });
        let begin = self.rows.len() - 1;
        for tick in 0.. {
            let row = *self.rows.last().unwrap();
            if row.state.phase == Phase::Listening {
                break;
            }
            if tick == PULLED {
                self.pull();
            }
            self.await_answer();
            // The client now waits for the State of this tick: with it, it sees the switch, and
            // what is done here.
            beside(tick, &row);
            controls.quit.store(tick + 1 >= ticks, Ordering::Relaxed);
            self.tick();
        }
        self.hand.release();
        Session {
            rows: self.rows[begin..].to_vec(),
            client: client.join().unwrap(),
        }
    }
}

impl Session {
    /// Checks that another run of the script was the same: phases, references, offsets, actual
    /// values, counters.
    pub(super) fn assert_is(&self, other: &Self) {
        let (rows, others) = (self.comparable(), other.comparable());
        for (row, other) in rows.iter().zip(&others) {
            assert_eq!(row, other);
        }
        assert_eq!(rows.len(), others.len());
    }

    /// Rows with ticks counted from the Welcome, without the readings of the gauges. The drives
    /// operate from the second tick of the server on, whenever the client comes.
    fn comparable(&self) -> Vec<TickRecord<ARMS>> {
        let begin = self.rows[0].state.tick.0;
        let relative = self.rows.iter().map(|row| {
            let mut row = TickRecord {
                tool: None,
                drives: None,
                ..*row
            };
            row.state.tick = Tick(row.state.tick.0 - begin);
            row
        });
        relative.collect()
    }

    /// Checks that no tick was late, and none missed.
    pub(super) fn assert_on_time(&self) {
        for (before, row) in self.rows.iter().zip(&self.rows[1..]) {
            let (state, counters) = (&row.state, row.state.counters);
            assert_eq!((row.elapsed, state.tick.0), (1, before.state.tick.0 + 1));
            assert_eq!(
                (counters.missed, counters.late, counters.longest_miss_run),
                (0, 0, 0),
                "tick {:?}",
                state.tick
            );
        }
    }

    /// Position offsets of the ticks in Obtain, nm.
    pub(super) fn obtained(&self) -> Vec<[i32; ARMS]> {
        let rows = self
            .rows
            .iter()
            .filter(|row| row.state.phase == Phase::Obtain);
        rows.map(|row| row.state.axes.map(|axis| axis.offsets.position.0))
            .collect()
    }
}

/// Length of the displacement of the tool, m.
pub(super) fn displacement_m(row: &TickRecord<ARMS>) -> f64 {
    row.tool
        .unwrap()
        .displacement_m
        .iter()
        .map(|component| component * component)
        .sum::<f64>()
        .sqrt()
}

/// The sample `forcesensor` of a stream.
pub(super) fn stream(address: SocketAddr) -> SensorSource {
    SensorSource::Labcomm {
        address: address.into(),
        name: DEFAULT_NAME.to_owned(),
    }
}
