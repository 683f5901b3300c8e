use gantry_tau_machine::drive_cascade::SUBSTEPS;
use gantry_tau_machine::elastic::backlash::Backlash;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use nalgebra::{DVector, Vector3};

use super::*;

/// A machine of a robot file at home, with its axes.
fn at_home<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    change: impl FnOnce(&mut Masses<N>),
) -> (MovingPlatform<N>, MassiveMachine<N>, [f64; N]) {
    let mut machine = MassiveMachine::of(robot).unwrap();
    change(&mut machine.masses);
    let home_q = robot.home_q().unwrap();
    let home = Equilibrium::at_home(robot.simulation.home_m);
    let MassiveMachine {
        elastic, masses, ..
    } = machine;
    let platform = MovingPlatform::at_rest(elastic, masses, &home, &home_q).unwrap();
    (platform, machine, home_q)
}

/// Runs cycles with the motors held.
fn run<const N: usize>(
    platform: &mut MovingPlatform<N>,
    q: &[f64; N],
    load: &Vector6<f64>,
    cycles: u32,
) {
    let motors = Motors {
        places: *q,
        rates: [0.0; N],
    };
    for _ in 0..cycles {
        let elastic = platform.machine.elastic;
        platform.begin_cycle(&elastic).unwrap();
        for _ in 0..SUBSTEPS {
            platform.step(&motors, load, None);
        }
    }
}

/// It stands at home under its weight, and under a load where the springs without masses stand.
#[test]
fn at_rest_it_is_the_equilibrium_of_the_springs() {
    let l2 = RobotFile::builtin_l2().unwrap();
    let home = Equilibrium::at_home(l2.simulation.home_m);
    let (mut platform, machine, q) = at_home(&l2, |masses| masses.damping_ratio = 0.3);
    run(&mut platform, &q, &Vector6::zeros(), 2000);
    let off_m = (platform.state.pose.translation_m - home.pose.translation_m).norm();
    assert!(off_m < 1e-9, "{off_m}");

    // Without weight: the change of its direction in a turned platform is no part of the springs.
    let (mut platform, _, q) = at_home(&l2, |masses| {
        masses.damping_ratio = 0.3;
        masses.has_weight = false;
    });
    let load = Vector6::new(300.0, -100.0, 50.0, 3.0, -2.0, 1.0);
    run(&mut platform, &q, &load, 3000);
    let expected = machine.elastic.equilibrium(&q, &load, &home).unwrap();
    let found = platform.equilibrium();
    let off_m = (found.pose.translation_m - expected.pose.translation_m).norm();
    assert!(off_m < 1e-9, "{off_m}");
    assert!(found.pose.rotation.angle_to(&expected.pose.rotation) < 1e-9);
    assert!((found.tensions_n - expected.tensions_n).amax() < 1e-3);
    assert!((found.axis_loads - expected.axis_loads).amax() < 1e-3);
}

/// With the play of the joint of arm 3 as well, on both sides of the jump and in it.
#[test]
fn at_rest_with_play_it_is_the_equilibrium_of_the_springs() {
    let l2 = RobotFile::builtin_l2().unwrap();
    let (mut platform, machine, q) = at_home(&l2, |masses| {
        masses.damping_ratio = 0.3;
        masses.has_weight = false;
    });
    let home = Equilibrium::at_home(l2.simulation.home_m);
    let along_x = |newtons: f64| Vector6::new(newtons, 0.0, 0.0, 0.0, 0.0, 0.0);
    let preload_n = -machine
        .elastic
        .equilibrium(&q, &along_x(360.0), &home)
        .unwrap()
        .cluster_3_n();
    let backlash = Backlash::new(40e-6, preload_n).unwrap();
    let elastic = ElasticMachine::new(l2.model.geometry(), l2.compliances.unwrap(), backlash);
    platform.machine.elastic = elastic;
    for newtons in [200.0, 350.0, 359.0, 361.0, 420.0] {
        run(&mut platform, &q, &along_x(newtons), 4000);
        let expected = elastic.equilibrium(&q, &along_x(newtons), &home).unwrap();
        let off_m = (platform.state.pose.translation_m - expected.pose.translation_m).norm();
        assert!(off_m < 1e-8, "{newtons} N: {off_m}");
    }
}

/// Energy of springs and motion about an unloaded place.
fn energy<const N: usize>(
    machine: &MassiveMachine<N>,
    state: &MachineState<N>,
    q: &[f64; N],
) -> f64 {
    let lines = machine.elastic.lines(&state.axes.into(), &state.pose);
    let tensions_n = machine.elastic.tensions_n(&lines.lengths_m);
    let compliances = machine.elastic.compliances();
    let links: f64 = (0..6)
        .map(|link| 0.5 * tensions_n[link].powi(2) * compliances.links_m_per_n[link])
        .sum();
    let axes: f64 = (0..N)
        .map(|axis| 0.5 * (state.axes[axis] - q[axis]).powi(2) / compliances.axes[axis])
        .sum();
    let mass = machine.mass_matrix(&state.pose, &state.axes);
    let rates = state.rates.to_vector();
    links + axes + 0.5 * rates.dot(&mass.times(&state.rates).to_vector())
}

/// Ten seconds without damping: energy neither comes nor goes.
fn keeps_its_energy<K: MachineKind<N>, const N: usize>(robot: &RobotFile<K, N>) {
    let (mut platform, machine, q) = at_home(robot, |masses| masses.has_weight = false);
    platform.machine.masses.damping_ratio = 0.0;
    platform.damping.matrix = CoordinateMatrix::zeros();
    let load = Vector6::new(20.0, 50.0, -30.0, 1.0, 0.0, 2.0);
    // A push of 5 ms.
    run(&mut platform, &q, &load, 5);
    let mut energies = Vec::new();
    for _ in 0..100 {
        run(&mut platform, &q, &Vector6::zeros(), 100);
        energies.push(energy(&machine, &platform.state, &q));
    }
    let mean = energies.iter().sum::<f64>() / 100.0;
    // The energy of symplectic Euler swings with the step times the frequency; it does not drift.
    let drift = energies[50..].iter().sum::<f64>() / 50.0 - mean;
    assert!(drift.abs() < 0.01 * mean, "{drift} of {mean}");
    assert!(
        energies
            .iter()
            .all(|energy| (energy / mean - 1.0).abs() < 0.1)
    );
}

#[test]
fn without_damping_energy_stays() {
    keeps_its_energy(&RobotFile::builtin_l2().unwrap());
    keeps_its_energy(&RobotFile::builtin_f1().unwrap());
}

/// Half a second after a small push, against the modes: each is a sine that decays, in closed form.
fn rings_down<K: MachineKind<N>, const N: usize>(robot: &RobotFile<K, N>) {
    let (mut platform, machine, q) = at_home(robot, |masses| masses.has_weight = false);
    let home = platform.state;
    let zeta = machine.masses.damping_ratio;
    let modes = Modes::of(&machine, &home.pose, &home.axes).unwrap();
    // Small rates of the six lowest modes, and the same places.
    let amplitude = |mode: usize| 1e-6 / (1.0 + mode as f64);
    let mut start = DVector::zeros(6 + N);
    for mode in 0..6 {
        start += modes.shapes.column(mode) * amplitude(mode);
    }
    platform.state.pose = Pose {
        translation_m: home.pose.translation_m + Vector3::new(start[0], start[1], start[2]),
        rotation: UnitQuaternion::from_scaled_axis(Vector3::new(start[3], start[4], start[5]))
            * home.pose.rotation,
    };
    for axis in 0..N {
        platform.state.axes[axis] += start[6 + axis];
    }
    // Rates are those half a step before the places.
    let mut rates = DVector::zeros(6 + N);
    for mode in 0..6 {
        let half = modes.rad_per_s[mode].powi(2) * 0.5 * SUBSTEP_S;
        rates += modes.shapes.column(mode) * (amplitude(mode) * half);
    }
    platform.state.rates = Coordinates {
        platform: rates.fixed_rows::<6>(0).into_owned(),
        axes: rates.fixed_rows::<N>(6).into_owned(),
    };
    let most = start.rows(0, 3).norm();
    for cycle in 1..=500 {
        run(&mut platform, &q, &Vector6::zeros(), 1);
        let t = f64::from(cycle) * 1e-3;
        let mut expected = DVector::zeros(6 + N);
        for mode in 0..6 {
            let w = modes.rad_per_s[mode];
            let damped = w * (1.0 - zeta * zeta).sqrt();
            let decay = (-zeta * w * t).exp();
            let turn = (damped * t).cos() + zeta * w / damped * (damped * t).sin();
            expected += modes.shapes.column(mode) * (amplitude(mode) * decay * turn);
        }
        let moved = platform.state.pose.translation_m - home.pose.translation_m;
        let off = (moved - Vector3::new(expected[0], expected[1], expected[2])).norm();
        assert!(off < 1e-2 * most, "{cycle} ms: {off:e} of {most:e}");
    }
}

#[test]
fn it_rings_down_with_its_modes() {
    rings_down(&RobotFile::builtin_l2().unwrap());
    rings_down(&RobotFile::builtin_f1().unwrap());
}

/// Pushed at rest by a force, the tool accelerates, and the sensor feels the tool less than the
/// force by what that takes.
#[test]
fn the_sensor_feels_inertia() {
    let l2 = RobotFile::builtin_l2().unwrap();
    let (mut platform, machine, q) = at_home(&l2, |masses| masses.has_weight = false);
    let load = Vector6::new(0.0, 100.0, 0.0, 0.0, 0.0, 0.0);
    let motors = Motors {
        places: q,
        rates: [0.0; 3],
    };
    let expected = machine.acceleration(&platform.state, &q, &load).unwrap();
    platform.step(&motors, &load, None);
    let taken = load - platform.sensor_load();
    assert!(taken[1] > 5.0, "{taken}");
    assert!((platform.sensor_load() - expected.sensor_load).amax() < 1e-9);
}

/// A workpiece carries its share of a load that presses on it, as springs in parallel do.
#[test]
fn a_workpiece_pushes_back() {
    let l2 = RobotFile::builtin_l2().unwrap();
    let stands = |workpiece: Option<&Workpiece>| {
        let (mut platform, _, q) = at_home(&l2, |masses| masses.damping_ratio = 0.3);
        let motors = Motors {
            places: q,
            rates: [0.0; 3],
        };
        let load = Vector6::new(0.0, 0.0, -100.0, 0.0, 0.0, 0.0);
        for _ in 0..2_000 {
            let elastic = platform.machine.elastic;
            platform.begin_cycle(&elastic).unwrap();
            for _ in 0..SUBSTEPS {
                platform.step(&motors, &load, workpiece);
            }
        }
        let sunk_m = l2.home_m().z - platform.state.pose.translation_m.z;
        (sunk_m, platform.load()[2])
    };
    let (free_m, free_n) = stands(None);
    assert!(free_m > 1e-6 && (free_n + 100.0).abs() < 1e-9);
    let stiffness = 1e7;
    let below = Workpiece::below(&l2.home_m().into(), stiffness, 0.0, true).unwrap();
    let (sunk_m, left_n) = stands(Some(&below));
    let expected_m = free_m / (1.0 + stiffness * free_m / 100.0);
    assert!(
        (sunk_m / expected_m - 1.0).abs() < 1e-3,
        "{sunk_m} {expected_m}"
    );
    assert!(
        (left_n + 100.0 - stiffness * sunk_m).abs() < 1e-3,
        "{left_n}"
    );
}

/// In motion as well, and with motors that move.
#[test]
fn loads_of_the_drives_are_those_of_the_next_step() {
    let f1 = RobotFile::builtin_f1().unwrap();
    let (mut platform, _, q) = at_home(&f1, |_| {});
    let load = Vector6::new(200.0, -100.0, 300.0, 5.0, -3.0, 2.0);
    run(&mut platform, &q, &load, 3);
    let motors = Motors {
        places: q,
        rates: [0.01, -0.02, 0.03, 0.1, -0.2, 0.1],
    };
    let before = platform.drive_loads(&motors);
    let of_step = platform.step(&motors, &load, None);
    assert!((before - of_step).amax() < 1e-9 * of_step.amax());
}

#[test]
fn runs_are_bit_equal() {
    let f1 = RobotFile::builtin_f1().unwrap();
    let run = || {
        let (mut platform, _, q) = at_home(&f1, |_| {});
        let load = Vector6::new(20.0, 50.0, -30.0, 1.0, 0.0, 2.0);
        run(&mut platform, &q, &load, 300);
        platform.state
    };
    assert_eq!(run(), run());
}
