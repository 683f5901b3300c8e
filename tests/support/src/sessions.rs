//! A whole session in lock-step, whose rows go to recordings.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use gantry_tau_client::force_sensor::{Sample, SensorSource};
use gantry_tau_client::{self, ClientControls, ClientError, ClientOptions, Observer};
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::{Capabilities, Phase, State, Welcome};
use gantry_tau_core::units::EpochRange;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_record::recording::{RecordTo, Recorded, Recording, drain};
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::record::Event;
use gantry_tau_server::record::TickRecord;
use gantry_tau_server::server::Server;
use gantry_tau_server::server::cycle::Cycle;
use gantry_tau_server::server::event_log::EventLog;
use gantry_tau_server::server::tick_source::TickSource;
use gantry_tau_server::state::StopLatch;
use gantry_tau_sim::load_generator::load_generator;
use gantry_tau_sim::load_profile::LoadProfile;
use gantry_tau_sim::machine::SimulatedMachine;

/// Ticks in Obtain after which the client leaves.
const OBTAINING: usize = 400;

/// A client that waits where rows are not taken in time: in lock-step a busy machine would lose
/// some.
struct Paced(Arc<AtomicU64>);

/// Rows that may wait.
const WAITING: u64 = 1_000;

impl<const N: usize> Observer<N> for Paced {
    fn welcomed(&mut self, _: &Welcome<N>) {}

    fn answered(&mut self, state: &State<N>, _: Option<&Sample>) -> Result<(), ClientError> {
        while state.tick.0 > self.0.load(Ordering::Relaxed) + WAITING {
            std::thread::sleep(Duration::from_millis(1));
        }
        Ok(())
    }
}

/// Grants a session, pulls, compensates, ramps to zero. Server and client are recorded to every
/// file; returns rows and events of the server.
pub fn run<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
    server_files: &[RecordTo],
    client_file: RecordTo,
) -> (Vec<TickRecord<N>>, Vec<Event>, Vec<Recorded>) {
    let any: SocketAddr = "127.0.0.1:0".parse().unwrap();
    let (hand, tool) = load_generator();
    let machine = SimulatedMachine::<N, M>::from_robot(robot, tool, Motion::Hold).unwrap();
    let config = robot.session_config(Capabilities::LOCKSTEP).unwrap();
    let motors = robot.motor_map().unwrap();
    let cycle: Cycle<N, M, _> = Cycle::new(
        config,
        motors,
        machine,
        EpochRange::VOLATILE,
        StopLatch::volatile(),
        any,
    )
    .unwrap();
    let (server, mut queue) = Server::spawn(cycle, TickSource::Lockstep).unwrap();
    let controls = Arc::new(ClientControls::default());
    let options = ClientOptions {
        server: server.address.into(),
        transport: Transport::Stream,
        sensor: SensorSource::States,
        accelerometer: None,
        robot: robot.clone(),
        key: None,
        record: Some(client_file),
        obtain: true,
        accept_unstable: false,
    };
    let shared = Arc::clone(&controls);
    let taken = Arc::new(AtomicU64::new(0));
    let mut paced = Paced(Arc::clone(&taken));
    let client = std::thread::spawn(move || {
        gantry_tau_client::run_observed(&options, &shared, &mut paced).unwrap()
    });
    let mut files: Vec<Recording<N>> = server_files
        .iter()
        .map(|to| Recording::create::<TickRecord<N>, K>(to, robot).unwrap())
        .collect();
    let mut load = LoadProfile::new(hand, 60.0, 0.1);
    let (mut log, mut rows, mut events) = (EventLog::default(), Vec::new(), Vec::new());
    let mut obtaining = 0;
    drain(&mut queue, |row, _| {
        taken.store(row.state.tick.0, Ordering::Relaxed);
        load.update(row.state.phase, row.state.tick);
        let happened = log.see(row);
        files.iter_mut().for_each(|file| file.write(row, &happened));
        let ended = happened
            .iter()
            .any(|event| event.text == "SafeDisconnect -> Listening");
        rows.push(*row);
        events.extend(happened);
        obtaining += usize::from(row.state.phase == Phase::Obtain);
        if obtaining > OBTAINING {
            controls.quit.store(true, Ordering::Relaxed);
        }
        if ended {
            server.controls.quit.store(true, Ordering::Relaxed);
        }
    });
    let lost = server.quit().unwrap();
    assert_eq!(lost, 0);
    let recorded = client.join().unwrap().recorded;
    let mut all: Vec<Recorded> = files.into_iter().map(|file| file.finish(lost)).collect();
    all.extend(recorded);
    (rows, events, all)
}
