//! Feed-forward of inertia on the simulated machine: what a path at 5 m/s^2 bends, with and without.

use gantry_tau::compensated_machine::CompensatedMachine;
use gantry_tau_core::control::agitation::Agitation;
use gantry_tau_core::control::channel::{LimitValues, Limits};
use gantry_tau_machine::masses::GRAVITY_M_PER_S2;
use gantry_tau_machine::model::{F1_MOTORS, MachineKind};
use gantry_tau_machine::robot_file::{AccelerometerKeys, FeedForwardKey, RATED_FORCE_N, RobotFile};
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_sim::load_generator::load_generator;
use gantry_tau_sim::machine::SimulatedMachine;
use nalgebra::{Matrix3, Vector3};

/// Rest before and after each way, cycles: the filter and the tare have settled by then.
const DWELL: usize = 2_000;
/// Cycles of the way and of what it leaves ringing.
const WAY: usize = 1_200;
/// Largest acceleration of an axis, m/s^2.
const ACCELERATION: f64 = 5.0;

/// A path, and the machine that walks it.
#[derive(Clone, Copy, Debug)]
struct Job {
    tool_kg: f64,
    /// The tool's way from home, world axes, m.
    way_m: [f64; 3],
    feed_forward: FeedForwardKey,
    /// Masses of the client's file, as a share of those of the machine.
    known_masses: f64,
    /// The machine has an accelerometer.
    is_measured: bool,
}

fn robot<K: MachineKind<N>, const N: usize>(
    mut robot: RobotFile<K, N>,
    job: &Job,
) -> RobotFile<K, N> {
    // A path that comes later is no displacement.
    if let Some(drives) = &mut robot.drives {
        (drives.command_delay_cycles, drives.actual_delay_cycles) = (0, 0);
    }
    robot.simulation.spring_deviation = 0.0;
    robot.simulation.jump_gap_m = 0.0;
    robot.sensor.tool.weight_n = [0.0, 0.0, -job.tool_kg * GRAVITY_M_PER_S2];
    let masses = robot.masses.as_mut().unwrap();
    masses.tool.mass_kg = job.tool_kg;
    masses.has_weight = false;
    robot.sensor.accelerometer = job.is_measured.then_some(AccelerometerKeys {
        place_m: robot.sensor.tool.centre_m,
        axes: 6,
        rotation: Matrix3::identity().into(),
        share: 0.9,
        gravity: true,
    });
    robot.rated_n = Some([RATED_FORCE_N; N]);
    for axis in &mut robot.limits {
        axis.limits.torque = Limits::new(LimitValues {
            max: 500,
            step: 50,
            accel: 100,
            ramp: 1,
        })
        .unwrap();
    }
    robot
}

fn client<K: MachineKind<N>, const N: usize>(
    mut robot: RobotFile<K, N>,
    job: &Job,
) -> RobotFile<K, N> {
    robot.client.feed_forward = job.feed_forward;
    let share = job.known_masses;
    let masses = robot.masses.as_mut().unwrap();
    for body in [&mut masses.platform, &mut masses.tool] {
        body.mass_kg *= share;
        body.inertia_kgm2 *= share;
    }
    masses.links_kg = masses.links_kg.map(|kg| kg * share);
    masses.carts_kg = masses.carts_kg.map(|kg| kg * share);
    masses.plates_kgm2 = masses.plates_kgm2.map(|inertia| inertia * share);
    robot
}

/// Walks a path once, with the answers of the client in force a tick later, within the limits of the
/// server and its budget. Returns the displacement of the tool where it accelerates most, um.
fn walk<K: MachineKind<N>, const N: usize, const M: usize>(
    file: RobotFile<K, N>,
    job: &Job,
) -> f64 {
    walk_and_push::<K, N, M>(file, job).0
}

/// The same, and the largest sum of the axes' torques on the way, per mille.
fn walk_and_push<K: MachineKind<N>, const N: usize, const M: usize>(
    file: RobotFile<K, N>,
    job: &Job,
) -> (f64, i16) {
    let robot = robot(file, job);
    let end_m = robot.home_m() + Vector3::from(job.way_m);
    let end_q = robot.model.axes_at(&end_m).unwrap();
    let motion = Motion::BackAndForth {
        waypoints_m: vec![std::array::from_fn(|axis| {
            end_q[axis] * robot.metres_per_q[axis]
        })],
        speed_m_per_s: 2.0,
        acceleration_m_per_s2: ACCELERATION,
        dwell_cycles: DWELL.try_into().unwrap(),
    };
    let (_hand, tool) = load_generator();
    let machine = SimulatedMachine::<N, M>::moving_from_robot(&robot, tool, motion).unwrap();
    let client = client(robot.clone(), job);
    let mut machine = CompensatedMachine::<N, M>::new(machine, &client).unwrap();
    let mut agitation = [Agitation::ZERO; N];
    let mut pushed = 0;
    let rows: Vec<(f64, Vector3<f64>)> = (0..DWELL + WAY)
        .map(|_| {
            let before = *machine.channels();
            let shown = machine.cycle().unwrap();
            let torques = machine.torques().map(|torque| torque.0);
            pushed = pushed.max(torques.iter().sum());
            for axis in 0..N {
                if let Some(budget) = &robot.limits[axis].agitation {
                    let change = before[axis].change();
                    let changed = machine.channels()[axis].change();
                    agitation[axis] = agitation[axis].after(change, changed, budget);
                    assert!(!agitation[axis].exceeds(budget));
                }
            }
            (machine.nominal_m()[0], shown.displacement_m.into())
        })
        .collect();
    let rms_um = rms_where_accelerated(&rows[DWELL..]) * 1e6;
    println!(
        "{}, {job:?}: {rms_um:.2} um, {pushed} per mille",
        robot.name
    );
    (rms_um, pushed)
}

/// Root mean square of the displacement, m, where the acceleration of axis 1 is more than 0.9 of its
/// largest.
fn rms_where_accelerated(rows: &[(f64, Vector3<f64>)]) -> f64 {
    let accelerations: Vec<f64> = rows
        .windows(3)
        .map(|w| (w[0].0 - 2.0 * w[1].0 + w[2].0) / 1e-6)
        .collect();
    let largest = accelerations
        .iter()
        .fold(0.0_f64, |most, a| most.max(a.abs()));
    let squares: Vec<f64> = accelerations
        .iter()
        .zip(&rows[1..])
        .filter(|(a, _)| a.abs() > 0.9 * largest)
        .map(|(_, row)| row.1.norm_squared())
        .collect();
    let count = f64::from(u32::try_from(squares.len()).unwrap());
    (squares.iter().sum::<f64>() / count).sqrt()
}

/// 5 kg along x, without feed-forward.
const JOB: Job = Job {
    tool_kg: 5.0,
    way_m: [0.4, 0.0, 0.0],
    feed_forward: FeedForwardKey::None,
    known_masses: 1.0,
    is_measured: false,
};
/// The same with it.
const FED_FORWARD: Job = Job {
    feed_forward: FeedForwardKey::Inertia,
    ..JOB
};

/// Without it the sensor, whose filter is slow, finds next to nothing of a way of 0.6 s.
#[test]
fn l2() {
    let walk = |job: Job| walk::<_, 3, 3>(RobotFile::builtin_l2().unwrap(), &job);
    let along_z = |job| Job {
        way_m: [0.0, 0.0, 0.3],
        tool_kg: 1.835,
        ..job
    };
    let (none, fed_forward) = (walk(JOB), walk(FED_FORWARD));
    assert!(none > 50.0, "{none} um");
    assert!(fed_forward < 8.0, "{fed_forward} um");
    // What an accelerometer takes out of the reading is not taken out twice.
    let measured = walk(Job {
        is_measured: true,
        ..FED_FORWARD
    });
    assert!(measured < 8.0, "{measured} um");
    let (none, fed_forward) = (walk(along_z(JOB)), walk(along_z(FED_FORWARD)));
    assert!(none > 25.0, "{none} um");
    assert!(fed_forward < 6.0, "{fed_forward} um");
}

/// All that moves along x, 164 kg, takes 820 N at 5 m/s^2, which motors of 1000 N share; the position
/// loops are spared the error that they would need for it.
#[test]
fn l2_with_torques() {
    let walk = |job: Job| walk_and_push::<_, 3, 3>(RobotFile::builtin_l2().unwrap(), &job);
    let with_torques = Job {
        feed_forward: FeedForwardKey::InertiaAndTorque,
        ..FED_FORWARD
    };
    let ((without_um, none), (with_um, pushed)) = (walk(FED_FORWARD), walk(with_torques));
    assert_eq!(none, 0);
    assert!((780..860).contains(&pushed), "{pushed} per mille");
    assert!(with_um < without_um, "{with_um} and {without_um} um");
}

#[test]
fn l2_with_masses_a_fifth_wrong() {
    for known_masses in [0.8, 1.2] {
        let job = Job {
            known_masses,
            ..FED_FORWARD
        };
        let walked = walk::<_, 3, 3>(RobotFile::builtin_l2().unwrap(), &job);
        assert!(walked < 20.0, "{known_masses}: {walked} um");
    }
}

/// Its offsets run at the step limit of the server.
#[test]
fn f1() {
    let walk = |job: Job| {
        let job = Job {
            // A jerk of 50 m/s^3: on a shorter way the step limit is less than half of what it takes.
            way_m: [0.0, 0.0, -0.94],
            ..job
        };
        walk::<_, 6, F1_MOTORS>(RobotFile::builtin_f1().unwrap(), &job)
    };
    let (none, fed_forward) = (walk(JOB), walk(FED_FORWARD));
    assert!(none > 1_000.0, "{none} um");
    assert!(fed_forward < 450.0, "{fed_forward} um");
}
