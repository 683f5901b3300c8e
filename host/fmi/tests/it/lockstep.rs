//! Units that are coupled cycle by cycle against a server in lock-step with its client over TCP: the same
//! numbers, to the bit.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use gantry_tau_client::force_sensor::SensorSource;
use gantry_tau_client::{ClientControls, ClientOptions};
use gantry_tau_core::Transport;
use gantry_tau_core::control::message::{Capabilities, Phase};
use gantry_tau_core::units::EpochRange;
use gantry_tau_machine::model::{F1_MOTORS, L2_MOTORS, MachineKind};
use gantry_tau_machine::robot_file::{AnyRobotFile, RobotFile};
use gantry_tau_server::plant::Plant;
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::record::TickRecord;
use gantry_tau_server::server::Cycle;
use gantry_tau_server::server::cycle::OperatorInputs;
use gantry_tau_server::state::StopLatch;
use gantry_tau_sim::load_generator::{Load, load_generator};
use gantry_tau_sim::machine::SimulatedMachine;

use crate::named::{Coupled, Row};

/// Longest wait for an answer of the client: a defect, not a slow computer.
const PATIENCE: Duration = Duration::from_secs(60);
/// Ticks without a client at the beginning.
const ALONE: usize = 7;
/// Length of the back-and-forth motion, m.
const MOTION_M: f64 = 0.03;

/// Load of a tick: steps of one second, in all directions.
fn load_of(tick: usize) -> Load {
    let step = (tick / 1_000) as u32;
    let scale = f64::from(step % 4) * 80.0;
    Load {
        step,
        force_n: [scale, -0.5 * scale, 0.25 * scale],
        moment_nm: [0.0, 0.01 * scale, -0.02 * scale],
    }
}

/// Runs a server in lock-step for so many ticks of a session, then with the cable out until the ramp is
/// done. Returns its rows, the one in which the client was welcomed and that of the cut.
fn served<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
    session: usize,
) -> (Vec<TickRecord<N>>, usize, usize) {
    let (mut hand, tool) = load_generator();
    let motion = Motion::by(robot.home_axes_m().unwrap(), MOTION_M);
    let machine = SimulatedMachine::<N, M>::moving_from_robot(robot, tool, motion).unwrap();
    let address: SocketAddr = "127.0.0.1:0".parse().unwrap();
    let mut cycle = Cycle::new(
        robot.session_config(Capabilities::LOCKSTEP).unwrap(),
        robot.motor_map().unwrap(),
        machine,
        EpochRange::VOLATILE,
        StopLatch::volatile(),
        address,
    )
    .unwrap();
    let options = ClientOptions {
        server: cycle.address().unwrap().into(),
        transport: Transport::Stream,
        sensor: SensorSource::States,
        accelerometer: None,
        robot: robot.clone(),
        key: None,
        record: None,
        obtain: true,
        accept_unstable: false,
    };
    let controls = Arc::new(ClientControls::default());
    let (shared, mut client) = (Arc::clone(&controls), None);
    let mut rows: Vec<TickRecord<N>> = Vec::new();
    let mut welcomed = None;
    let is_over = |rows: &[TickRecord<N>], cut| {
        rows.len() > cut && rows.last().unwrap().state.phase == Phase::Listening
    };
    while welcomed.is_none_or(|welcomed| !is_over(&rows, welcomed + session)) {
        if rows.len() == ALONE {
            let (options, shared) = (options.clone(), Arc::clone(&shared));
            client = Some(std::thread::spawn(move || {
                gantry_tau_client::run(&options, &shared)
            }));
        }
        if welcomed.is_none_or(|welcomed| rows.len() < welcomed + session) {
            await_answer(&mut cycle);
        }
        hand.set(&load_of(rows.len())).unwrap();
        rows.push(cycle.step(1, OperatorInputs::default()));
        if rows.last().unwrap().welcomed {
            welcomed = Some(rows.len() - 1);
        }
    }
    let welcomed = welcomed.unwrap();
    controls.quit.store(true, Ordering::Relaxed);
    drop(cycle);
    let _ended = client.unwrap().join().unwrap();
    (rows, welcomed, welcomed + session)
}

/// Reads the sockets until the owner has answered; without a session once.
fn await_answer<const N: usize, const M: usize, P: Plant<N, M>>(cycle: &mut Cycle<N, M, P>) {
    let since = Instant::now();
    loop {
        cycle.receive();
        let is_running = matches!(
            cycle.phase(),
            Phase::Handshake | Phase::Submit | Phase::Obtain
        );
        if !is_running || cycle.owner_has_answered() {
            return;
        }
        assert!(since.elapsed() < PATIENCE, "the client does not answer");
        std::thread::yield_now();
    }
}

fn equal_a_server_in_lock_step<K: MachineKind<N>, const N: usize, const M: usize>(
    name: &str,
    session: usize,
) {
    let robot = RobotFile::<K, N>::named(name).unwrap();
    let (rows, welcomed, cut) = served::<K, N, M>(&robot, session);
    let mut coupled = Coupled::new(&AnyRobotFile::named(name).unwrap(), MOTION_M);
    for (tick, row) in rows.iter().enumerate() {
        let tool = row.tool.as_ref().unwrap();
        if tick > 0 {
            coupled.machine_step(&load_of(tick));
        }
        coupled.server_step(tick >= welcomed && tick < cut);
        let expected = Row {
            phase: row.state.phase,
            cause: row.state.cause,
            missed: row.state.counters.missed,
            references_nm: row.references.map(|axis| axis.position.0).to_vec(),
            offsets_nm: row.state.axes.map(|axis| axis.offsets.position.0).to_vec(),
            computed_nm: row.state.axes.map(|axis| axis.shadow.position.0).to_vec(),
            sensor: tool.sensor,
            displacement_m: tool.displacement_m,
        };
        assert_eq!(coupled.row(), expected, "tick {tick}");
    }
    let phases = |phase| rows.iter().filter(|row| row.state.phase == phase).count();
    assert!(phases(Phase::Obtain) > session - 1_100);
    assert!(phases(Phase::SafeDisconnect) > 100);
    let largest = rows.iter().flat_map(|row| row.state.axes);
    let largest = largest.map(|axis| axis.offsets.position.0.abs()).max();
    assert!(largest > Some(50_000), "{largest:?}");
    // 0.1 um per ms from the second missed deadline on.
    for pair in rows[cut + 1..].windows(2) {
        for (before, after) in pair[0].state.axes.iter().zip(&pair[1].state.axes) {
            let (before, after) = (before.offsets.position.0, after.offsets.position.0);
            assert_eq!(after, before - before.clamp(-100, 100));
        }
    }
}

#[test]
fn units_of_an_l2_equal_a_server_in_lock_step() {
    equal_a_server_in_lock_step::<gantry_tau_machine::model::L2, 3, L2_MOTORS>("l2", 11_200);
}

#[test]
fn units_of_an_f1_equal_a_server_in_lock_step() {
    equal_a_server_in_lock_step::<gantry_tau_machine::model::F1, 6, F1_MOTORS>("f1", 4_000);
}
