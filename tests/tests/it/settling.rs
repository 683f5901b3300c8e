//! Settling time of a compensation, and its work under a cutter: the client's, through a server, on
//! the simulated machine with mass.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use gantry_tau_core::control::message::Phase;
use gantry_tau_machine::model::{CorrectionKind, F1_MOTORS, L2_MOTORS, MachineKind};
use gantry_tau_machine::robot_file::{AccelerometerKeys, RobotFile};
use gantry_tau_server::links::accelerometer::AccelerometerPublisher;
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::record::TickRecord;
use gantry_tau_sim::load_generator::{Load, LoadGenerator, load_generator};
use gantry_tau_sim::load_pattern::{LoadPattern, Milling};
use gantry_tau_sim::machine::SimulatedMachine;
use gantry_tau_tests::client_session;
use gantry_tau_tests::server_fixture::LOOPBACK;
use nalgebra::Vector3;

/// Ticks of Obtain before the load, and with it.
const BEFORE: usize = 50;
const LOADED: usize = 2_000;
/// Of the latter, those in which all has settled.
const SETTLED: usize = 1_000;
/// Rows that may still be on their way when the load is set.
const LATE: usize = 1_000;

/// A machine that its client knows exactly, and whose instruments are as good as none.
fn exact<K, const N: usize>(mut robot: RobotFile<K, N>) -> RobotFile<K, N> {
    robot.simulation.spring_deviation = 0.0;
    robot.simulation.force_noise_n = 0.0;
    robot.simulation.moment_noise_nm = 0.0;
    robot.simulation.acceleration_noise_m_per_s2 = 0.0;
    robot.simulation.jump_gap_m = 0.0;
    robot.sensor.tare_samples = 50;
    robot.client.correction = Some(CorrectionKind::Exact);
    robot
}

/// Rows of Obtain from the tick on in which the load acts.
fn loaded<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: RobotFile<K, N>,
    load: impl Fn(&mut LoadGenerator),
) -> Vec<TickRecord<N>> {
    let (mut hand, tool) = load_generator();
    let machine = SimulatedMachine::<N, M>::moving_from_robot(&robot, tool, Motion::Hold).unwrap();
    let accelerometer = AccelerometerPublisher::bind(LOOPBACK).unwrap();
    let address = accelerometer.address().unwrap();
    let cycle =
        client_session::cycle::<_, N, M, _>(&robot, machine).with_accelerometer(accelerometer);
    let mut obtaining = 0;
    let controls = Arc::default();
    let (report, mut rows) = client_session::play(robot, cycle, Some(address), &controls, |row| {
        obtaining += usize::from(row.state.phase == Phase::Obtain);
        if obtaining == BEFORE {
            load(&mut hand);
        }
        if obtaining > BEFORE + LATE + LOADED {
            controls.quit.store(true, Ordering::Relaxed);
        }
    });
    assert_eq!(report.unwrap().oscillations, 0);
    let is_loaded =
        |row: &TickRecord<N>| row.tool.unwrap().load.iter().any(|part| part.abs() > 0.0);
    let first = rows.iter().position(is_loaded).unwrap();
    rows.drain(..first);
    rows.truncate(LOADED);
    assert!(rows.iter().all(|row| row.state.phase == Phase::Obtain));
    assert_eq!(rows.len(), LOADED);
    rows
}

fn offsets_nm<const N: usize>(row: &TickRecord<N>) -> [i32; N] {
    row.state.axes.map(|axis| axis.offsets.position.0)
}

/// Ticks after a step of 300 N from which on the offset that moves most stays within 5 %.
fn settles<K: MachineKind<N>, const N: usize, const M: usize>(robot: RobotFile<K, N>) -> usize {
    let rows = loaded::<K, N, M>(exact(robot), |hand| {
        hand.set(&Load {
            step: 1,
            force_n: [300.0, 0.0, 0.0],
            moment_nm: [0.0; 3],
        })
        .unwrap();
    });
    let last = offsets_nm(rows.last().unwrap());
    let axis = (0..N).max_by_key(|axis| last[*axis].abs()).unwrap();
    let is_off =
        |row: &TickRecord<N>| (offsets_nm(row)[axis] - last[axis]).abs() * 20 > last[axis].abs();
    // The row in which the load acts is the first of its ticks.
    let ticks = 1 + rows.iter().rposition(is_off).unwrap();
    println!("{N} axes: settled after {ticks} ms, at {} nm", last[axis]);
    ticks
}

#[test]
fn offsets_settle_as_fast_as_their_filter() {
    assert!(settles::<_, 3, L2_MOTORS>(RobotFile::builtin_l2().unwrap()) <= 105);
    assert!(settles::<_, 6, F1_MOTORS>(RobotFile::builtin_f1().unwrap()) <= 190);
}

/// An accelerometer lets the filter be faster: half of the time with the same machine.
#[test]
fn offsets_settle_in_half_the_time_with_an_accelerometer() {
    let mut robot = RobotFile::builtin_l2().unwrap();
    robot.sensor.cutoff_hz = 10.0;
    robot.sensor.notches = 0;
    robot.sensor.accelerometer = Some(AccelerometerKeys {
        place_m: [0.03, -0.02, 0.05],
        axes: 6,
        rotation: [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        share: 0.9,
        gravity: true,
    });
    assert!(settles::<_, 3, L2_MOTORS>(robot) <= 55);
}

/// Displacement of the tool once settled: its mean, and its deviation from that (root mean square),
/// m.
fn displaced<const N: usize>(rows: &[TickRecord<N>]) -> (f64, f64) {
    let settled = rows[rows.len() - SETTLED..].iter();
    let all: Vec<Vector3<f64>> = settled
        .map(|row| row.tool.unwrap().displacement_m.into())
        .collect();
    let count = f64::from(u32::try_from(all.len()).unwrap());
    let mean = all.iter().sum::<Vector3<f64>>() / count;
    let squares: f64 = all.iter().map(|one| (one - mean).norm_squared()).sum();
    (mean.norm(), (squares / count).sqrt())
}

/// A cutter of 300 N whose teeth come with 200 Hz: the mean is compensated, and the vibration is
/// what it is without. No offset runs at its step limit.
#[test]
fn milling_is_compensated_and_not_shaken() {
    let milling = |hand: &mut LoadGenerator| {
        let cutter = Milling::new(300.0, 4, 3_000.0, 0.5).unwrap();
        hand.begin(LoadPattern::Milling(cutter));
    };
    let robot = exact(RobotFile::builtin_l2().unwrap());
    let mut without = robot.clone();
    without.client.gain = 0.0;
    let [without, with] = [without, robot.clone()].map(|robot| {
        let rows = loaded::<_, 3, L2_MOTORS>(robot, milling);
        let (mean_m, vibration_m) = displaced(&rows);
        println!(
            "mean {:.2} um, vibration {:.3} um",
            mean_m * 1e6,
            vibration_m * 1e6
        );
        (rows, mean_m, vibration_m)
    });
    assert!(without.1 > 100e-6 && with.1 <= 1e-6);
    assert!(with.2 <= 1.02 * without.2);
    let settled = &with.0[LOADED - SETTLED..];
    for ticks in settled.windows(2) {
        let [before, now] = [0, 1].map(|tick| offsets_nm(&ticks[tick]));
        for axis in 0..3 {
            let limit = robot.limits[axis].limits.position.values().step;
            assert!((now[axis] - before[axis]).abs() < limit);
        }
    }
}
