use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::model::robot::ARMS;
use gantry_tau_core::units::OffsetNm;
use gantry_tau_machine::model::{F1, F1_MOTORS, L2};
use gantry_tau_machine::robot_file::DriveKeys;
use gantry_tau_server::plant::interpolator::Motion;
use nalgebra::Vector3;

use super::*;
use crate::fixture::{Vectors, motion, parameters, springs};
use crate::load_generator::{LoadGenerator, load_generator};
use crate::load_pattern::{LoadPattern, Milling};

type Machine = SimulatedMachine<ARMS, ARMS>;

fn machine(parameters: &SimulationParameters<ARMS>) -> (Machine, LoadGenerator) {
    let (hand, tool) = load_generator();
    let (l2, motors) = (Vectors::l2(), MotorMap::new([0, 1, 2]).unwrap());
    (
        SimulatedMachine::new(&l2.geometry, &springs(&l2), motors, parameters, tool).unwrap(),
        hand,
    )
}

#[test]
fn the_motors_of_a_pair_push_against_each_other() {
    let axis_of_motor = [0, 1, 1, 2, 3, 3, 3];
    let directions: Vec<f64> = (0..7)
        .map(|motor| direction(&axis_of_motor, motor))
        .collect();
    assert_eq!(directions, [0.0, 1.0, -1.0, 0.0, 0.0, 0.0, 0.0]);
}

/// Runs one cycle of a server without offsets.
fn cycle(machine: &mut Machine) -> Reading<ARMS> {
    let reading = machine.read(1).unwrap();
    machine
        .write(
            &reading.nominal.map(without_offsets),
            &reading.nominal.map(InForce::at),
        )
        .unwrap();
    reading
}

/// Actual minus nominal positions, nm.
fn off_nm(reading: &Reading<ARMS>) -> [i64; ARMS] {
    std::array::from_fn(|axis| reading.actual[axis].position.0 - reading.nominal[axis].0)
}

fn pull(force_n: [f64; 3]) -> Load {
    Load {
        step: 1,
        force_n,
        moment_nm: [0.0; 3],
    }
}

/// Returns the displacement in x after settling under a force in x, metres.
fn settled_x(machine: &mut Machine, hand: &mut LoadGenerator, newtons: f64) -> f64 {
    hand.set(&pull([newtons, 0.0, 0.0])).unwrap();
    let mut x = 0.0;
    for _ in 0..200 {
        x = cycle(machine).tool.unwrap().displacement_m[0];
    }
    x
}

#[test]
fn unloaded_it_stands_at_home() {
    let (mut machine, _hand) = machine(&parameters());
    for _ in 0..100 {
        let reading = cycle(&mut machine);
        let tool = reading.tool.unwrap();
        assert!(tool.displacement_m.iter().all(|x| x.abs() < 1e-12));
        assert_eq!(tool.gauges_m.map(f64::abs), [0.0; 3]);
        assert_eq!(off_nm(&reading), [0; ARMS]);
    }
    let off = machine.loaded.pose.translation_m - Vector3::from(parameters().simulation.home_m);
    assert!(off.amax() < 2e-9);
}

#[test]
fn a_gauge_shows_whole_steps_within_half_a_step() {
    for nanometre in -3000..3000 {
        let length = f64::from(nanometre) * 1e-9;
        let shown = whole_steps(length, 0.5e-6);
        let steps = shown / 0.5e-6;
        assert!((steps - steps.round()).abs() < 1e-9);
        assert!((shown - length).abs() <= 0.25e-6 + 1e-15);
    }
}

#[test]
fn below_the_jump_it_is_a_spring_and_at_the_jump_it_steps() {
    let (mut machine, mut hand) = machine(&parameters());
    let slope = settled_x(&mut machine, &mut hand, 340.0) / 340.0;
    for newtons in [-240.0, -60.0, 60.0, 120.0, 240.0, 350.0] {
        let off = settled_x(&mut machine, &mut hand, newtons) - slope * newtons;
        assert!(
            off.abs() < 0.01 * slope * newtons.abs(),
            "{newtons} N: {off:e}"
        );
    }
    let step = settled_x(&mut machine, &mut hand, 370.0)
        - settled_x(&mut machine, &mut hand, 350.0)
        - 20.0 * slope;
    // By virtual work: the gap times the share of a force in x that cluster 3 takes.
    let half = settled_x(&mut machine, &mut hand, 360.0) - 360.0 * slope;
    let share = machine.loaded.cluster_3_n().abs() / 360.0;
    let expected = 40e-6 * share;
    assert!(expected > 5e-6, "{expected:e}");
    assert!(
        (step / expected - 1.0).abs() < 0.02,
        "{step:e} {expected:e}"
    );
    assert!(
        (half / expected - 0.5).abs() < 0.02,
        "{half:e} {expected:e}"
    );
}

#[test]
fn a_load_beyond_the_springs_is_reported() {
    let (mut machine, mut hand) = machine(&parameters());
    hand.set(&pull([1e5, 0.0, 0.0])).unwrap();
    let failed = machine.read(1).unwrap_err();
    let reason = "the springs find no equilibrium under this load";
    assert_eq!(
        failed,
        PlantError {
            operation: "advance the simulation",
            reason
        }
    );
}

#[test]
fn without_a_gap_there_is_no_jump() {
    let mut smooth = parameters();
    smooth.simulation.jump_gap_m = 0.0;
    let (mut machine, mut hand) = machine(&smooth);
    let slope = settled_x(&mut machine, &mut hand, 100.0) / 100.0;
    let x = settled_x(&mut machine, &mut hand, 600.0);
    assert!((x / (600.0 * slope) - 1.0).abs() < 0.01);
}

/// Bits of all that 400 ticks read.
fn bits_of_a_run(seed: u64) -> Vec<u64> {
    let motion = motion(&[[0.8, -0.3, 1.0]], 0.5, 5.0, 10);
    let mut walking = SimulationParameters {
        motion,
        ..parameters()
    };
    walking.simulation.seed = seed;
    let (mut machine, mut hand) = machine(&walking);
    let mut bits = Vec::new();
    for tick in 0..400 {
        if tick == 100 {
            hand.set(&pull([200.0, 50.0, -300.0])).unwrap();
        }
        let reading = cycle(&mut machine);
        let tool = reading.tool.unwrap();
        bits.extend(tool.sensor.map(f64::to_bits));
        bits.extend(tool.displacement_m.map(f64::to_bits));
        let positions = reading.actual.map(|axis| axis.position.0);
        bits.extend(positions.map(|nm| u64::from_ne_bytes(nm.to_ne_bytes())));
    }
    bits
}

#[test]
fn the_same_calls_give_the_same_bits() {
    assert_eq!(bits_of_a_run(7), bits_of_a_run(7));
    assert_ne!(bits_of_a_run(7), bits_of_a_run(8));
}

#[test]
fn motion_is_not_displacement() {
    let motion = motion(&[[0.8, -0.3, 1.0]], 0.2, 1.0, 100);
    let walking = SimulationParameters {
        motion,
        ..parameters()
    };
    let (mut machine, _hand) = machine(&walking);
    let mut last = machine.nominal;
    for _ in 0..3000 {
        let reading = cycle(&mut machine);
        let tool = reading.tool.unwrap();
        // What remains is the drives' following error while they accelerate.
        assert!(
            tool.displacement_m.iter().all(|x| x.abs() < 50e-6),
            "{tool:?}"
        );
        for axis in 0..ARMS {
            // 0.2 m/s is 200 µm a cycle; two roundings.
            let step = reading.nominal[axis].0 - last[axis].0;
            assert!(step.abs() <= 200_002);
        }
        last = reading.nominal;
    }
}

#[test]
fn offsets_move_the_tool_and_are_read_back() {
    let (mut machine, _hand) = machine(&parameters());
    let offsets = Offsets {
        position: OffsetNm(20_000),
        ..Offsets::default()
    };
    let mut reading = machine.read(1).unwrap();
    for _ in 0..200 {
        let away = reading
            .nominal
            .map(|nominal| without_offsets(PositionNm(nominal.0 + 20_000)));
        let parts = reading.nominal.map(|nominal| InForce { nominal, offsets });
        machine.write(&away, &parts).unwrap();
        reading = machine.read(1).unwrap();
    }
    assert_eq!(
        machine.in_force().unwrap().map(|parts| parts.offsets),
        [offsets; ARMS]
    );
    assert_eq!(off_nm(&reading), [20_000; ARMS]);
    assert!(reading.tool.unwrap().displacement_m[0] > 10e-6);
    cycle(&mut machine);
    assert_eq!(
        machine.in_force().unwrap().map(|parts| parts.offsets),
        [Offsets::ZERO; ARMS]
    );
}

#[test]
fn a_late_cycle_is_simulated_and_bounded() {
    let (mut once, mut hand) = machine(&parameters());
    let (mut twice, mut other_hand) = machine(&parameters());
    hand.set(&pull([100.0, 0.0, 0.0])).unwrap();
    other_hand.set(&pull([100.0, 0.0, 0.0])).unwrap();
    once.read(5).unwrap();
    let late = once.read(u64::MAX).unwrap();
    for _ in 0..104 {
        twice.read(1).unwrap();
    }
    assert_eq!(late, twice.read(1).unwrap());
    assert_eq!(late, twice.read(0).unwrap());
}

#[track_caller]
fn assert_finite(reading: &Reading<ARMS>) {
    let displacement = reading.tool.unwrap().displacement_m;
    assert!(displacement.iter().all(|x| x.is_finite()));
}

#[test]
fn a_load_beyond_the_machine_is_an_error_not_a_nan() {
    let (mut machine, mut hand) = machine(&parameters());
    hand.set(&Load {
        step: 1,
        force_n: [1e5; 3],
        moment_nm: [1e5; 3],
    })
    .unwrap();
    for _ in 0..300 {
        let Ok(reading) = machine.read(1) else { break };
        assert_finite(&reading);
    }
    hand.release();
    for _ in 0..2000 {
        if let Ok(reading) = machine.read(1) {
            assert_finite(&reading);
        }
    }
}

#[test]
fn another_scale_of_q_is_the_same_machine() {
    let scaled = SimulationParameters {
        metres_per_q: [2.0, 0.5, 1.0],
        ..parameters()
    };
    let (mut machine, mut hand) = machine(&scaled);
    settled_x(&mut machine, &mut hand, 100.0);
    let reading = cycle(&mut machine);
    assert!(off_nm(&reading).iter().all(|off| off.abs() < 100));
}

/// The F1 with ideal drives.
fn f1_with_ideal_drives() -> RobotFile<F1, 6> {
    RobotFile {
        drives: None,
        ..RobotFile::builtin_f1().unwrap()
    }
}

/// Two motors on a cart carry half of its load each: at rest the sum of their torques holds it, with
/// masses the weight too.
#[test]
fn motors_of_one_cart_share_its_load() {
    let file = f1_with_ideal_drives();
    let machine = |tool| SimulatedMachine::from_robot(&file, tool, Motion::Hold).unwrap();
    hold_a_load(machine, 500);
    let masses = file.masses.unwrap();
    hold_a_load(|tool| machine(tool).with_masses(&masses).unwrap(), 12_000);
}

fn hold_a_load(machine: impl FnOnce(AppliedLoad) -> SimulatedMachine<6, F1_MOTORS>, cycles: u32) {
    let (mut hand, tool) = load_generator();
    let mut machine = machine(tool);
    hand.set(&pull([300.0, 0.0, 0.0])).unwrap();
    let mut reading = None;
    for _ in 0..cycles {
        let now = machine.read(1).unwrap();
        let motors = machine.motors.spread(&now.nominal.map(without_offsets));
        let motors = motors.unwrap();
        machine
            .write(&motors, &now.nominal.map(InForce::at))
            .unwrap();
        reading = Some(now);
    }
    let actual = reading.unwrap().actual;
    for (axis, motors) in [(0, 2.0), (1, 2.0), (2, 2.0), (3, 1.0), (4, 1.0), (5, 1.0)] {
        let load_n = machine.axis_load_n(axis);
        let held_n = f64::from(actual[axis].torque.0) * 1e-3 * drive::RATED_FORCE_N * motors;
        // Torques are reported in whole per mille of the rated one: half a newton for each motor.
        assert!(
            (held_n + load_n).abs() <= 0.6 * motors,
            "{axis}: {held_n} {load_n}"
        );
    }
    assert!(machine.loaded.axis_loads[1] > 100.0, "hardly a load");
}

/// One motor of a pair is sent astray: it trips, its partner stops in the same cycle, and no drive
/// of another axis does.
#[test]
fn the_partner_of_a_drive_that_trips_stops_with_it() {
    let file = RobotFile {
        drives: Some(DriveKeys::default()),
        ..RobotFile::builtin_f1().unwrap()
    };
    let (_hand, tool) = load_generator();
    let mut machine =
        SimulatedMachine::<6, { F1_MOTORS }>::from_robot(&file, tool, Motion::Hold).unwrap();
    let nominal = machine.read(1).unwrap().nominal;
    let mut motors = machine
        .motors
        .spread(&nominal.map(without_offsets))
        .unwrap();
    motors[2].position.0 += 50_000_000;
    let astray = *machine.motors.axis_of_motor().get(2).unwrap();
    for cycle in 0.. {
        assert!(cycle < 1_000, "the drive does not trip");
        machine.write(&motors, &nominal.map(InForce::at)).unwrap();
        let read = machine.read(1).map(|_| ());
        let trips: Vec<_> = machine.drives.iter().map(Drive::trip).collect();
        if trips[2].is_none() {
            assert_eq!((read, trips), (Ok(()), vec![None; 9]));
            continue;
        }
        for (motor, of) in machine.motors.axis_of_motor().iter().enumerate() {
            let is_partner = *of == astray && motor != 2;
            assert_eq!(trips[motor].is_some(), is_partner || motor == 2, "{motor}");
            assert_eq!(trips[motor] == Some(Trip::Partner), is_partner, "{motor}");
        }
        assert_ne!(read, Ok(()));
        return;
    }
}

/// A cutter whose teeth come with 1 kHz: samples at a point of time all see a tooth at the same
/// angle, and their mean is wrong; the mean over a cycle is right.
#[test]
fn a_sensor_must_not_sample_points_of_a_fast_cutter() {
    let file = RobotFile::builtin_l2().unwrap();
    let [mean_n, of_points_n] = [false, true].map(|points| cutting_force_n(&file, points));
    // A tooth leaves the cut between two of 16 steps.
    assert!((mean_n - 300.0).abs() < 300.0 / 16.0, "{mean_n}");
    assert!((of_points_n - 300.0).abs() > 90.0, "{of_points_n}");
}

/// Mean of what the sensor shows of a cutter of 300 N, N.
fn cutting_force_n(file: &RobotFile<L2, 3>, points: bool) -> f64 {
    let (mut hand, tool) = load_generator();
    let machine = SimulatedMachine::<3, 3>::from_robot(file, tool, Motion::Hold).unwrap();
    let mut machine = if points {
        machine.sampling_points()
    } else {
        machine
    };
    let [unloaded_n, loaded_n] =
        [None, Some(Milling::new(300.0, 4, 15_000.0, 0.5).unwrap())].map(|cutter| {
            if let Some(cutter) = cutter {
                hand.begin(LoadPattern::Milling(cutter));
            }
            let mut sum_n = Vector3::zeros();
            for _ in 0..1_000 {
                let [x, y, z, ..] = machine.read(1).unwrap().tool.unwrap().sensor;
                sum_n += Vector3::new(x, y, z) * 1e-3;
            }
            sum_n
        });
    (loaded_n - unloaded_n).norm()
}
