use nalgebra::{DMatrix, SVector, UnitQuaternion, Vector3, Vector6};

use super::*;
use crate::elastic::{Equilibrium, Pose};
use crate::masses::RigidBody;
use crate::model::MachineKind;
use crate::robot_file::RobotFile;

/// A machine of a file, without wrist and play, and its axes at home.
fn at_home<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
) -> (MassiveMachine<N>, Pose, [f64; N]) {
    let pose = Pose {
        translation_m: robot.home_m(),
        rotation: UnitQuaternion::identity(),
    };
    let axes = robot.home_q().unwrap();
    (MassiveMachine::of(robot).unwrap(), pose, axes)
}

/// The state after a short time at these rates and accelerations.
fn after<const N: usize>(
    state: &MachineState<N>,
    changes: &Coordinates<N>,
    s: f64,
) -> MachineState<N> {
    let mean = state.rates + *changes * (0.5 * s);
    let [moved, turned] = [0, 3].map(|row| mean.platform.fixed_rows::<3>(row) * s);
    MachineState {
        pose: Pose {
            translation_m: state.pose.translation_m + moved,
            rotation: UnitQuaternion::from_scaled_axis(turned) * state.pose.rotation,
        },
        axes: std::array::from_fn(|axis| state.axes[axis] + s * mean.axes[axis]),
        rates: state.rates + *changes * s,
    }
}

fn dot<const N: usize>(one: &Coordinates<N>, other: &Coordinates<N>) -> f64 {
    one.platform.dot(&other.platform) + one.axes.dot(&other.axes)
}

fn kinetic_j<const N: usize>(machine: &MassiveMachine<N>, state: &MachineState<N>) -> f64 {
    let momentum = machine
        .mass_matrix(&state.pose, &state.axes)
        .times(&state.rates);
    0.5 * dot(&state.rates, &momentum)
}

/// The work of weight and load in a time is the change of the kinetic energy. By differences over
/// 2e-5 s, whose square leaves 1e-9 of it.
fn the_work_of_all_forces_is_the_kinetic_energy<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
) {
    let (mut machine, home, mut axes) = at_home(robot);
    machine.masses.links_kg = [2.0, 5.0, 1.0, 4.0, 0.5, 6.0];
    for (place, moved) in axes.iter_mut().zip([0.05, -0.1, 0.15, 0.2, -0.15, 0.1]) {
        *place += moved;
    }
    // Unloaded: springs would hide what the motion takes.
    let start = Equilibrium::unloaded(home);
    let unloaded = machine
        .elastic
        .equilibrium(&axes, &Vector6::zeros(), &start);
    let pose = unloaded.unwrap().pose;
    let state = MachineState {
        pose,
        axes,
        rates: Coordinates {
            platform: Vector6::new(0.7, -0.4, 0.9, 1.1, -0.8, 0.6),
            axes: SVector::from_fn(|axis, _| 0.9 - 0.4 * axis as f64),
        },
    };
    let load = Vector6::new(30.0, -20.0, 10.0, 2.0, -1.0, 3.0);
    let found = machine.acceleration(&state, &axes, &load).unwrap();
    let [behind, ahead] =
        [-1e-5, 1e-5].map(|s| kinetic_j(&machine, &after(&state, &found.rates, s)));
    let (_, springs) = machine.spring_forces(&pose, &axes, &axes);
    let mut forces = springs + machine.weight(&pose, &axes);
    forces.platform += load;
    let power_w = dot(&state.rates, &forces);
    let changed_w = (ahead - behind) / 2e-5;
    assert!(
        (changed_w - power_w).abs() < 1e-6 * power_w.abs(),
        "{changed_w} W of {power_w} W"
    );
    // The velocity terms count.
    let without = dot(&state.rates, &machine.velocity_forces(&state));
    assert!(
        without.abs() > 1e-4 * power_w.abs(),
        "{without} W of {power_w} W"
    );
}

#[test]
fn work_becomes_kinetic_energy() {
    the_work_of_all_forces_is_the_kinetic_energy(&RobotFile::builtin_l2().unwrap());
    the_work_of_all_forces_is_the_kinetic_energy(&RobotFile::builtin_f1().unwrap());
}

/// A force of 25 N, and 3 N m about the tool centre point.
#[test]
fn a_sensor_in_motion_reads_its_tool() {
    let tool = RigidBody {
        mass_kg: 5.0,
        centre_m: Vector3::new(0.0, 0.0, -0.12),
        inertia_kgm2: nalgebra::Matrix3::zeros(),
    };
    let still = Vector3::zeros();
    let along_x = Vector6::new(5.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    let taken = tool.inertial_load(&UnitQuaternion::identity(), &along_x, &still);
    assert!(
        (taken - Vector6::new(25.0, 0.0, 0.0, 0.0, -3.0, 0.0)).amax() < 1e-12,
        "{taken}"
    );
    // Its mass matrix is the same without rates.
    let turned = UnitQuaternion::from_euler_angles(0.3, -0.7, 1.1);
    let motion = Vector6::new(1.0, -2.0, 3.0, 0.4, -0.5, 0.6);
    let taken = tool.inertial_load(&turned, &motion, &still);
    assert!(
        (taken - tool.mass_matrix(&turned) * motion).amax() < 1e-12,
        "{taken}"
    );
}

/// Without weight and load a machine at rest stays at rest; with weight it falls onto its springs.
#[test]
fn weight_is_what_disturbs_a_machine_at_rest() {
    let (mut machine, pose, axes) = at_home(&RobotFile::builtin_f1().unwrap());
    let state = MachineState {
        pose,
        axes,
        rates: Coordinates::zeros(),
    };
    let falls = machine
        .acceleration(&state, &axes, &Vector6::zeros())
        .unwrap();
    assert!(falls.rates.platform[2] < -5.0, "{:?}", falls.rates);
    // The sensor hangs on a falling platform: its tool weighs the less.
    assert!(falls.sensor_load[2] > 5.0, "{}", falls.sensor_load);
    machine.masses.has_weight = false;
    let rests = machine
        .acceleration(&state, &axes, &Vector6::zeros())
        .unwrap();
    assert!(rests.rates.to_vector().amax() < 1e-6, "{:?}", rests.rates);
}

/// Shapes are orthogonal by mass and stiffness, and the damping matrix damps each by the ratio.
#[test]
fn modes_are_free_of_each_other() {
    let (machine, pose, axes) = at_home(&RobotFile::builtin_f1().unwrap());
    let modes = Modes::of(&machine, &pose, &axes).unwrap();
    let by = |matrix: &CoordinateMatrix<6>| {
        modes.shapes.transpose() * matrix.to_matrix() * &modes.shapes
    };
    let ones = DMatrix::<f64>::identity(12, 12);
    assert!((by(&modes.mass) - &ones).amax() < 1e-9);
    for (mode, w) in modes.rad_per_s.iter().enumerate() {
        let stiffness = by(&modes.stiffness);
        let damping = by(&modes.damping(0.02));
        // Of the stiffest, which has the rounding.
        let most = modes.rad_per_s[11];
        assert!((stiffness[(mode, mode)] - w * w).abs() < 1e-9 * most * most);
        for other in 0..12 {
            let expected = if other == mode { 0.04 * w } else { 0.0 };
            assert!(
                (damping[(mode, other)] - expected).abs() < 1e-9 * most,
                "{mode} {other}"
            );
        }
    }
    assert!(modes.hz().is_sorted());
}

/// The Schur complement against the whole matrix.
#[test]
fn blocks_solve_as_the_whole_matrix() {
    let (machine, pose, axes) = at_home(&RobotFile::builtin_f1().unwrap());
    let mass = machine.mass_matrix(&pose, &axes);
    let forces = Coordinates {
        platform: Vector6::new(1.0, -2.0, 3.0, 0.4, -0.5, 0.6),
        axes: SVector::from([3.0, 1.0, -4.0, 1.0, -5.0, 9.0]),
    };
    let whole = mass
        .to_matrix()
        .cholesky()
        .unwrap()
        .solve(&forces.to_vector());
    let found = mass.solve(&forces).unwrap().to_vector();
    assert!((found - &whole).amax() < 1e-12 * whole.amax());
    let found = mass.inverse().unwrap().times(&forces).to_vector();
    assert!((found - &whole).amax() < 1e-12 * whole.amax());
    assert_eq!(CoordinateMatrix::from_matrix(&mass.to_matrix()), mass);
}

/// Energy of the springs, `(length - rest)^2 / 2c` of each link and `(q - theta)^2 / 2c` of each axis.
fn elastic_j<const N: usize>(
    machine: &MassiveMachine<N>,
    pose: &Pose,
    axes: &[f64; N],
    drives: &[f64; N],
) -> f64 {
    let compliances = machine.elastic.compliances();
    let lengths_m = machine.elastic.lines(&SVector::from(*axes), pose).lengths_m;
    let rests_m = machine.elastic.geometry().lengths_m;
    let links = (0..6)
        .map(|link| (lengths_m[link] - rests_m[link]).powi(2) / compliances.links_m_per_n[link]);
    let springs = (0..N).map(|axis| (axes[axis] - drives[axis]).powi(2) / compliances.axes[axis]);
    0.5 * links.chain(springs).sum::<f64>()
}

/// The forces of the springs are the slopes of their energy, against central differences of 1 um and
/// 1 urad: the third derivative leaves less than a millionth.
fn springs_release_their_energy<K: MachineKind<N>, const N: usize>(robot: &RobotFile<K, N>) {
    let (machine, mut pose, mut axes) = at_home(robot);
    let drives = axes;
    // 100 N and more in every spring.
    pose.translation_m += Vector3::new(1e-4, -2e-4, 1.5e-4);
    for (axis, place) in axes.iter_mut().enumerate() {
        *place += [2e-5, -3e-5, 4e-5][axis % 3];
    }
    let (_, forces) = machine.spring_forces(&pose, &axes, &drives);
    for coordinate in 0..6 + N {
        let mut rates = Coordinates::zeros();
        match coordinate {
            0..6 => rates.platform[coordinate] = 1.0,
            _ => rates.axes[coordinate - 6] = 1.0,
        }
        let energy_j = |s: f64| {
            let state = MachineState { pose, axes, rates };
            let moved = after(&state, &Coordinates::zeros(), s);
            elastic_j(&machine, &moved.pose, &moved.axes, &drives)
        };
        let slope = (energy_j(1e-6) - energy_j(-1e-6)) / 2e-6;
        let along = dot(&forces, &rates);
        assert!(
            (along + slope).abs() < 1e-5 * along.abs().max(10.0),
            "{along} {slope}"
        );
    }
}

#[test]
fn springs_release_their_energy_on_both_machines() {
    springs_release_their_energy(&RobotFile::builtin_l2().unwrap());
    springs_release_their_energy(&RobotFile::builtin_f1().unwrap());
}
