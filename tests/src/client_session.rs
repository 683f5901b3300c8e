//! The real client and a real server in lock-step, in one process, over loopback.

use std::net::SocketAddr;
use std::sync::Arc;

use gantry_tau_client::force_sensor::SensorSource;
use gantry_tau_client::{ClientControls, ClientError, ClientOptions, ClientReport, run};
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::Capabilities;
use gantry_tau_core::units::EpochRange;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_server::plant::Plant;
use gantry_tau_server::record::TickRecord;
use gantry_tau_server::server::Server;
use gantry_tau_server::server::cycle::Cycle;
use gantry_tau_server::server::tick_source::TickSource;
use gantry_tau_server::state::StopLatch;

use crate::server_fixture::LOOPBACK;

/// Creates the cycle of a server that keeps nothing.
#[must_use]
pub fn cycle<K: MachineKind<N>, const N: usize, const M: usize, P: Plant<N, M>>(
    robot: &RobotFile<K, N>,
    plant: P,
) -> Cycle<N, M, P> {
    let config = robot.session_config(Capabilities::LOCKSTEP).unwrap();
    let motors = robot.motor_map().unwrap();
    let (epochs, latch) = (EpochRange::VOLATILE, StopLatch::volatile());
    Cycle::new(config, motors, plant, epochs, latch, LOOPBACK).unwrap()
}

/// Runs a client, with any margin of stability, which reads its accelerometer at this address, until its session has ended; `each` sees
/// every row of the server. Returns the client's result and the rows.
pub fn play<K, const N: usize, const M: usize, P>(
    robot: RobotFile<K, N>,
    cycle: Cycle<N, M, P>,
    accelerometer: Option<SocketAddr>,
    controls: &Arc<ClientControls>,
    mut each: impl FnMut(&TickRecord<N>),
) -> (Result<ClientReport, ClientError>, Vec<TickRecord<N>>)
where
    K: MachineKind<N>,
    P: Plant<N, M> + Send + 'static,
{
    let (server, mut queue) = Server::spawn(cycle, TickSource::Lockstep).unwrap();
    let options = ClientOptions {
        server: server.address.into(),
        transport: Transport::Stream,
        sensor: SensorSource::States,
        accelerometer: accelerometer.map(Into::into),
        robot,
        key: None,
        record: None,
        obtain: true,
        accept_unstable: true,
    };
    let told = Arc::clone(controls);
    let client = std::thread::spawn(move || run(&options, &told));
    let mut rows: Vec<TickRecord<N>> = Vec::new();
    while rows.last().is_none_or(|row| row.ended.is_none()) {
        let Ok(row) = queue.pop() else {
            continue;
        };
        each(&row);
        rows.push(row);
    }
    let result = client.join().unwrap();
    server.quit().unwrap();
    (result, rows)
}
