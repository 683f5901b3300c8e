//! The simulated machine with the client's compensation swings, or does not, as `gantry-tau
//! stability` says: two computations of one loop, by integration and by eigenvalues.

use std::collections::VecDeque;
use std::time::Duration;

use gantry_tau::compensated_machine::CompensatedMachine;
use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::units::OffsetNm;
use gantry_tau_machine::masses::GRAVITY_M_PER_S2;
use gantry_tau_machine::model::{F1_MOTORS, MachineKind};
use gantry_tau_machine::robot_file::{AccelerometerKeys, DriveKeys, FilterKey, RobotFile};
use gantry_tau_machine::stability::{Growth, LinearMachine, Loop, NotchFinder, TickMap};
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_sim::load_generator::{Load, load_generator};
use gantry_tau_sim::machine::SimulatedMachine;
use gantry_tau_test_support::seeds::Seeds;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A machine with this tool and filter, known exactly, with ideal drives, without noise, weight and
/// play.
fn exact<K: MachineKind<N>, const N: usize>(
    mut robot: RobotFile<K, N>,
    tool_kg: f64,
    filter: FilterKey,
    cutoff_hz: f64,
) -> RobotFile<K, N> {
    robot.drives = None;
    robot.simulation.spring_deviation = 0.0;
    robot.simulation.force_noise_n = 0.0;
    robot.simulation.moment_noise_nm = 0.0;
    robot.simulation.acceleration_noise_m_per_s2 = 0.0;
    robot.simulation.jump_gap_m = 0.0;
    robot.sensor.filter = Some(filter);
    robot.sensor.cutoff_hz = cutoff_hz;
    robot.sensor.tare_samples = 1;
    robot.sensor.tool.weight_n = [0.0, 0.0, -tool_kg * GRAVITY_M_PER_S2];
    let masses = robot.masses.as_mut().unwrap();
    masses.tool.mass_kg = tool_kg;
    masses.has_weight = false;
    robot
}

/// Growth by the eigenvalues, with this many cycles from a reading to the reference that answers it.
fn computed<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    latency_cycles: usize,
) -> Growth {
    let finder = NotchFinder::of(robot).unwrap();
    let (home, axes) = (Pose::at(robot.home_m()), robot.home_q().unwrap());
    let machine = LinearMachine::at(&finder.machine, &(&home).into(), &axes).unwrap();
    let map = TickMap::of(&machine, &finder.drives);
    let notches = finder.at(&home, &axes).unwrap();
    let notches: Vec<_> = notches.into_iter().flatten().collect();
    let filter = finder.filter.with(&notches, 1.0);
    Loop::new(&machine, map, filter, latency_cycles)
        .growth()
        .unwrap()
}

/// Growth of what is left of a tap, 1/s, between two spans of time.
fn simulated<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
    latency_cycles: usize,
    growth_per_s: f64,
) -> f64 {
    let (mut hand, tool) = load_generator();
    let machine = SimulatedMachine::<N, M>::moving_from_robot(robot, tool, Motion::Hold).unwrap();
    let mut machine = CompensatedMachine::<N, M>::new(machine, robot).unwrap();
    // What grows is not beyond what 200 N do at the end, and far above the nanometre of an offset; the
    // other vibrations have decayed before the first span, or are small beside it.
    let apart_s = (3.0 / growth_per_s.abs()).clamp(0.1, 1.5);
    let wait_s = if growth_per_s > 0.0 {
        (5.0 / growth_per_s).clamp(0.3, 8.0)
    } else {
        0.8
    };
    let tap_n = 200.0 * (-growth_per_s.max(0.0) * (wait_s + apart_s)).exp();
    let [first, apart] =
        [wait_s, apart_s].map(|s| usize::try_from(Duration::from_secs_f64(s).as_millis()).unwrap());
    let span = 200;
    // A server writes an answer in the next tick.
    let mut waiting = VecDeque::from(vec![[OffsetNm(0); N]; latency_cycles]);
    let mut energies = [0.0; 2];
    for cycle in 0..first + apart + span {
        let force_n = if (10..20).contains(&cycle) {
            tap_n
        } else {
            0.0
        };
        hand.set(&Load {
            step: 0,
            force_n: [force_n, 0.6 * force_n, -force_n],
            moment_nm: [0.0; 3],
        })
        .unwrap();
        let (shown, answer) = machine.read().unwrap();
        waiting.push_back(answer);
        machine.write(&waiting.pop_front().unwrap()).unwrap();
        let moved: f64 = shown.displacement_m.iter().map(|m| m * m).sum();
        for (energy, start) in energies.iter_mut().zip([first, first + apart]) {
            if (start..start + span).contains(&cycle) {
                *energy += moved;
            }
        }
    }
    (energies[1] / energies[0]).ln()
        / 2.0
        / Duration::from_millis(apart.try_into().unwrap()).as_secs_f64()
}

fn agree<K: MachineKind<N>, const N: usize, const M: usize>(robot: &RobotFile<K, N>) -> f64 {
    let computed = computed(robot, 1);
    let simulated = simulated::<K, N, M>(robot, 1, computed.per_s);
    println!(
        "{simulated:+.2}/s, computed {:+.2}/s at {:.1} Hz",
        computed.per_s, computed.hz
    );
    let off = (simulated - computed.per_s).abs();
    assert!(
        off < 0.1 * computed.per_s.abs() + 0.2,
        "{simulated:+.2}/s, computed {:+.2}/s at {:.1} Hz",
        computed.per_s,
        computed.hz
    );
    computed.per_s
}

/// Random places, tools, filters and latencies: a loop that grows or decays by more than 0.3/s does so
/// in the simulation.
fn no_verdict_differs<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
    seeds: Seeds,
) {
    let mut judged = [0; 2];
    for seed in seeds.iter() {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut within = |low, high| random.random_range(low..high);
        let tool_kg = within(0.5, 8.0);
        let (filter, cutoff_hz) = match seed % 4 {
            0 => (FilterKey::FirstOrder, within(5.0, 20.0)),
            1 => (FilterKey::SecondOrder, within(4.0, 15.0)),
            _ => (FilterKey::Auto, within(4.0, 15.0)),
        };
        let mut robot = exact(robot.clone(), tool_kg, filter, cutoff_hz);
        for home in &mut robot.simulation.home_m {
            *home += within(-0.12, 0.12);
        }
        let latency_cycles = 1 + usize::try_from(seed % 6).unwrap();
        let computed = computed(&robot, latency_cycles);
        if computed.per_s.abs() < 0.3 {
            continue;
        }
        let simulated = simulated::<K, N, M>(&robot, latency_cycles, computed.per_s);
        let grows = computed.per_s > 0.0;
        assert_eq!(
            simulated > 0.0,
            grows,
            "seed {seed}: {tool_kg} kg, {filter:?} {cutoff_hz} Hz: {simulated:+.2}/s, {computed:?}"
        );
        judged[usize::from(grows)] += 1;
    }
    println!("{}: {judged:?} that decay and grow", robot.name);
    assert!(judged.iter().all(|count| *count > 0), "{judged:?}");
}

#[test]
fn no_verdict_of_an_l2_differs() {
    no_verdict_differs::<_, 3, 3>(&RobotFile::builtin_l2().unwrap(), Seeds::new(12, 100));
}

#[test]
fn no_verdict_of_an_f1_differs() {
    let seeds = Seeds::new(12, 100);
    no_verdict_differs::<_, 6, F1_MOTORS>(&RobotFile::builtin_f1().unwrap(), seeds);
}

#[test]
fn l2() {
    let robot = |tool_kg, filter, cutoff_hz| {
        exact(RobotFile::builtin_l2().unwrap(), tool_kg, filter, cutoff_hz)
    };
    let agree = |tool_kg, filter, cutoff_hz| agree::<_, 3, 3>(&robot(tool_kg, filter, cutoff_hz));
    assert!(agree(5.0, FilterKey::FirstOrder, 20.0) > 10.0);
    assert!(agree(1.835, FilterKey::FirstOrder, 20.0) > -1.0);
    assert!(agree(5.0, FilterKey::SecondOrder, 6.0) < 0.0);
    assert!(agree(5.0, FilterKey::Auto, 6.0) < -2.0);
    assert!(agree(1.835, FilterKey::Auto, 6.0) < -2.0);
}

/// An accelerometer makes the tool lighter in the loop: with the filter of first order 5 kg grow by 12/s, and decay with it.
#[test]
fn l2_with_an_accelerometer() {
    let with = |axes, share| {
        let l2 = RobotFile::builtin_l2().unwrap();
        let mut robot = exact(l2, 5.0, FilterKey::FirstOrder, 20.0);
        robot.sensor.accelerometer = Some(AccelerometerKeys {
            place_m: robot.sensor.tool.centre_m,
            axes,
            rotation: [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
            share,
            gravity: true,
        });
        agree::<_, 3, 3>(&robot)
    };
    assert!(with(6, 0.9) < -1.0);
    assert!(with(3, 0.9) < -1.0);
    assert!(with(6, 0.3) > 5.0);
}

#[test]
fn f1() {
    let robot = |tool_kg, filter, cutoff_hz| {
        exact(RobotFile::builtin_f1().unwrap(), tool_kg, filter, cutoff_hz)
    };
    let agree = |tool_kg, filter, cutoff_hz| {
        agree::<_, 6, { F1_MOTORS }>(&robot(tool_kg, filter, cutoff_hz))
    };
    assert!(agree(10.0, FilterKey::FirstOrder, 20.0) > 2.0);
}

/// With the drives of its file, which are slow, without their delays.
#[test]
fn f1_with_its_drives() {
    for (tool_kg, filter, cutoff_hz) in [
        (10.0, FilterKey::FirstOrder, 20.0),
        (5.0, FilterKey::Auto, 6.0),
    ] {
        let drives = DriveKeys {
            command_delay_cycles: 0,
            actual_delay_cycles: 0,
            encoder_counts_per_turn: 1 << 30,
            ..RobotFile::builtin_f1().unwrap().drives.unwrap()
        };
        let robot = RobotFile {
            drives: Some(drives),
            ..exact(RobotFile::builtin_f1().unwrap(), tool_kg, filter, cutoff_hz)
        };
        let growth_per_s = agree::<_, 6, F1_MOTORS>(&robot);
        assert_eq!(growth_per_s > 0.0, filter == FilterKey::FirstOrder);
    }
}
