//! The detector on a linear machine with mass, with the server's limits between the targets and the
//! drives.
#![allow(clippy::indexing_slicing, reason = "axes and states by their number")]

use std::f64::consts::{PI, TAU};

use gantry_tau_core::control::channel::{Channel, Limits};
use gantry_tau_core::model::robot::ARMS;
use gantry_tau_core::units::{OffsetNm, PositionNm};
use gantry_tau_machine::drive_cascade::CYCLE_S;
use gantry_tau_machine::dynamics::MassiveMachine;
use gantry_tau_machine::elastic::Pose;
use gantry_tau_machine::model::{MachineKind, on_path};
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_machine::stability::filter::Past;
use gantry_tau_machine::stability::{
    Contact, DriveKind, Filter, FilterKind, LinearMachine, Loop, LoopGain, TickMap,
};
use nalgebra::{DMatrix, DVector, UnitQuaternion, Vector3, Vector6};

use super::detector::Detector;
use super::lowest_mode::LowestMode;
use super::{Oscillation, Oscillations};

/// Filter of first order.
const FIRST_ORDER: FilterKind = FilterKind::FirstOrder { cutoff_hz: 20.0 };
/// Filter of second order with notches.
const AUTO: FilterKind = FilterKind::Auto {
    cutoff_hz: 6.0,
    notches: 2,
    notch_q: 0.7,
};

/// Machine, filter and workpiece of a trial.
#[derive(Clone, Copy, Debug)]
struct SetUp {
    tool_kg: f64,
    damping_ratio: f64,
    filter: FilterKind,
    /// Gain of the position loops, 1/s.
    position_gain_per_s: f64,
    /// A workpiece that the tool is in contact with all the time.
    workpiece: Option<Contact>,
}

/// A machine at home with its compensation in Obtain.
struct Trial<const N: usize> {
    map: TickMap,
    /// State at rest by a load, and the reading by a load at once.
    at_rest: DMatrix<f64>,
    direct: DMatrix<f64>,
    correction: DMatrix<f64>,
    filter: Filter,
    past: Vec<Vec<Past>>,
    state: DVector<f64>,
    limits: [Limits<OffsetNm>; N],
    channels: [Channel<OffsetNm>; N],
    /// References of the last two cycles, q-units, newest first.
    references: [DVector<f64>; 2],
    metres_per_q: [f64; N],
    oscillations: Oscillations<N>,
    home: [PositionNm; N],
    tick: u64,
    growth_per_s: f64,
}

impl<const N: usize> Trial<N> {
    fn new<K: MachineKind<N>>(robot: &RobotFile<K, N>, set_up: &SetUp) -> Self {
        let pose = Pose {
            translation_m: robot.home_m(),
            rotation: UnitQuaternion::identity(),
        };
        let q = robot.home_q().unwrap();
        let mut machine = MassiveMachine::of(robot).unwrap();
        machine.masses.tool.mass_kg = set_up.tool_kg;
        machine.masses.damping_ratio = set_up.damping_ratio;
        let drives = DriveKind::cascade(robot, set_up.position_gain_per_s).unwrap();
        let free = LinearMachine::at(&machine, &pose, &q).unwrap();
        let gain = LoopGain::of(&free, &TickMap::of(&free, &drives)).unwrap();
        let notches = set_up.filter.notches(&free, gain.response()).unwrap();
        let filter = set_up.filter.with(&notches, 1.0);
        let held = set_up
            .workpiece
            .map(|contact| free.in_contact(&contact).unwrap());
        let linear = held.unwrap_or_else(|| free.clone());
        let map = TickMap::of(&linear, &drives);
        let held = stiffness_of::<N>(set_up.workpiece);
        let at_rest = at_rest(&machine, robot, &free, &held, map.state.nrows());
        let direct = DMatrix::identity(6, 6)
            - &map.reading * &at_rest
            - held.view((0, 0), (6, 6 + N)) * at_rest.rows(0, 6 + N);
        let looped = Loop::new(&linear, map.clone(), filter.clone(), 1);
        let limits = robot.limits.map(|axis| axis.limits.position);
        Self {
            growth_per_s: looped.growth().unwrap().per_s,
            past: vec![vec![Past::default(); filter.order()]; N],
            state: DVector::zeros(map.state.nrows()),
            correction: linear.correction.clone(),
            limits,
            channels: [Channel::ZERO; N],
            references: [DVector::zeros(N), DVector::zeros(N)],
            metres_per_q: robot.metres_per_q,
            oscillations: Oscillations {
                detectors: limits.map(|limits| Detector::new(limits.step().unsigned_abs())),
                lowest_mode: LowestMode::of(robot),
            },
            home: on_path(&q, &robot.metres_per_q).unwrap(),
            tick: 0,
            map,
            at_rest,
            direct,
            filter,
        }
    }

    /// Runs a cycle under a load, with the noise of the sensor and a nominal displacement (q-units).
    /// Returns the oscillation that its targets show. The sensor is read at the beginning of the
    /// cycle; the offset that answers it acts in the next one.
    fn step(
        &mut self,
        load: &Vector6<f64>,
        noise: &Vector6<f64>,
        obtains: bool,
        nominal: &DVector<f64>,
    ) -> Option<Oscillation> {
        let [load, noise] = [load, noise].map(|six| DVector::from_column_slice(six.as_slice()));
        let reading = &self.map.reading * &self.state + &self.direct * &load + noise;
        let wanted = &self.correction * reading;
        let targets: [OffsetNm; N] = std::array::from_fn(|axis| {
            let q = self.filter.next(&mut self.past[axis], wanted[axis]);
            OffsetNm((q * self.metres_per_q[axis] * 1e9).round() as i32)
        });
        for (axis, channel) in self.channels.iter_mut().enumerate() {
            // In Submit the server follows zero.
            let target = if obtains { targets[axis] } else { OffsetNm(0) };
            *channel = channel.follow(target, &self.limits[axis]);
        }
        let [current, previous] = &self.references;
        let at_rest = &self.at_rest * load;
        self.state = &self.map.state * (&self.state - &at_rest)
            + at_rest
            + &self.map.previous * previous
            + &self.map.current * current;
        let offsets = DVector::from_fn(N, |axis, _| {
            f64::from(self.channels[axis].count()) * 1e-9 / self.metres_per_q[axis]
        });
        self.references.swap(0, 1);
        self.references[0] = offsets + nominal;
        self.tick += 1;
        self.oscillations.update(self.tick, &targets, &self.home)
    }

    fn tool_um(&self) -> f64 {
        self.state.rows(0, 3).norm() * 1e6
    }
}

/// Stiffness that a workpiece adds.
fn stiffness_of<const N: usize>(workpiece: Option<Contact>) -> DMatrix<f64> {
    let mut matrix = DMatrix::zeros(6 + N, 6 + N);
    if let Some(contact) = workpiece {
        let normal = contact.direction.normalize();
        matrix
            .view_mut((0, 0), (3, 3))
            .copy_from(&(normal * normal.transpose() * contact.stiffness_n_per_m));
    }
    matrix
}

/// States at rest by loads on the tool, one column each: the springs are bent, the drives hold
/// their place with the force that the springs of the axes take.
fn at_rest<K: MachineKind<N>, const N: usize>(
    machine: &MassiveMachine<N>,
    robot: &RobotFile<K, N>,
    free: &LinearMachine<N>,
    held: &DMatrix<f64>,
    states: usize,
) -> DMatrix<f64> {
    let half = 6 + N;
    let stiffness = free.modes.stiffness.to_matrix() + held;
    let loads = DMatrix::from_fn(half, 6, |row, column| f64::from(row == column));
    let places = stiffness.lu().solve(&loads).unwrap();
    let mut at_rest = DMatrix::zeros(states, 6);
    at_rest.rows_mut(0, half).copy_from(&places);
    let compliances = machine.elastic.compliances();
    for axis in 0..N {
        let newtons = -places.row(6 + axis) / compliances.axes[axis] / robot.metres_per_q[axis];
        for first in [2 * half + 2 * N, 2 * half + 3 * N] {
            at_rest.row_mut(first + axis).copy_from(&newtons);
        }
    }
    at_rest
}

/// A load that acts for one cycle gives the platform its momentum, and moves nothing else yet.
#[test]
fn a_load_begins_with_its_momentum() {
    let robot = RobotFile::builtin_l2().unwrap();
    let mut machine = MassiveMachine::of(&robot).unwrap();
    machine.masses.tool.mass_kg = 5.0;
    let mut trial = Trial::new(&robot, &l2(5.0, 0.02, FIRST_ORDER));
    let load = Vector6::new(100.0, -50.0, 20.0, 0.0, 0.0, 0.0);
    trial.step(&load, &Vector6::zeros(), true, &DVector::zeros(3));
    let pose = Pose {
        translation_m: robot.home_m(),
        rotation: UnitQuaternion::identity(),
    };
    let mass = machine
        .mass_matrix(&pose, &robot.home_q().unwrap())
        .to_matrix();
    let momentum = mass * trial.state.rows(9, 9);
    let given = DVector::from_column_slice(load.as_slice()) * CYCLE_S;
    let off = (momentum.rows(0, 6) - &given).amax() / given.amax();
    assert!(off < 0.05, "{off}");
    assert!(
        momentum.rows(6, 3).amax() < 0.05 * given.amax(),
        "{momentum}"
    );
}

const fn l2(tool_kg: f64, damping_ratio: f64, filter: FilterKind) -> SetUp {
    SetUp {
        tool_kg,
        damping_ratio,
        filter,
        position_gain_per_s: 150.0,
        workpiece: None,
    }
}

/// An F1 with the gain of its position loops that leaves its modes their damping.
const fn f1(tool_kg: f64, damping_ratio: f64, filter: FilterKind) -> SetUp {
    SetUp {
        position_gain_per_s: 40.0,
        ..l2(tool_kg, damping_ratio, filter)
    }
}

const fn on_workpiece(set_up: SetUp, stiffness_n_per_m: f64, direction: Vector3<f64>) -> SetUp {
    SetUp {
        workpiece: Some(Contact {
            stiffness_n_per_m,
            direction,
        }),
        ..set_up
    }
}

/// Noise of the sensor, normal: 0.2 N and 0.01 N m for a share of 1.
struct Noise(u64);

impl Noise {
    fn uniform(&mut self) -> f64 {
        self.0 = (self.0)
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn reading(&mut self, share: f64) -> Vector6<f64> {
        Vector6::from_fn(|component, _| {
            let deviation = if component < 3 { 0.2 } else { 0.01 };
            // Twelve uniform numbers have a variance of 1.
            let normal = (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0;
            share * deviation * normal
        })
    }
}

/// A force in a direction, and no moment.
fn along(direction: Vector3<f64>, newtons: f64) -> Vector6<f64> {
    let force_n = direction.normalize() * newtons;
    Vector6::new(force_n.x, force_n.y, force_n.z, 0.0, 0.0, 0.0)
}

/// Begin of a tap, in cycles, and its length.
const TAP: u32 = 100;
const TAP_CYCLES: u32 = 20;

/// Result of a tap.
#[derive(Debug)]
struct Tapped {
    /// Growth of the loop without the limits of the server, 1/s.
    growth_per_s: f64,
    /// Time from the begin of the tap to the departure (negative: out of the noise, before it), and
    /// the oscillation.
    left: Option<(f64, Oscillation)>,
    /// Largest displacement of the tool until then, um.
    tool_um: f64,
    /// The same in the second after it.
    after_um: f64,
}

/// Taps the tool with 100 N for 20 ms, and waits for so many seconds.
fn tapped<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    set_up: &SetUp,
    direction: Vector3<f64>,
    s: f64,
) -> Tapped {
    let mut trial = Trial::new(robot, set_up);
    let mut noise = Noise(1);
    let still = DVector::zeros(N);
    let mut result = Tapped {
        growth_per_s: trial.growth_per_s,
        left: None,
        tool_um: 0.0,
        after_um: 0.0,
    };
    let mut rest = TAP + (s * 1e3) as u32;
    let mut cycle = 0;
    while cycle < rest {
        let is_tapped = (TAP..TAP + TAP_CYCLES).contains(&cycle);
        let load = along(direction, if is_tapped { 100.0 } else { 0.0 });
        let found = trial.step(&load, &noise.reading(1.0), result.left.is_none(), &still);
        if result.left.is_some() {
            result.after_um = result.after_um.max(trial.tool_um());
        } else {
            result.tool_um = result.tool_um.max(trial.tool_um());
            let after_s = (f64::from(cycle) - f64::from(TAP)) * 1e-3;
            result.left = found.map(|found| (after_s, found));
            if found.is_some() {
                rest = cycle + 1_000;
            }
        }
        cycle += 1;
    }
    result
}

/// Checks that a tap is left within a time, with the tool within a displacement until then.
fn is_left<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    set_up: &SetUp,
    direction: Vector3<f64>,
    (within_s, within_um): (f64, f64),
) {
    let tapped = tapped(robot, set_up, direction, 4.0);
    assert!(tapped.growth_per_s > 0.0, "{set_up:?}: {tapped:?}");
    let (after_s, oscillation) = tapped.left.unwrap_or_else(|| panic!("{set_up:?}: stays"));
    assert!(after_s <= within_s, "{set_up:?}: {tapped:?}");
    assert!(tapped.tool_um <= within_um, "{set_up:?}: {tapped:?}");
    // It rings down from there, while the offsets go to zero.
    assert!(tapped.after_um <= 1.2 * within_um, "{set_up:?}: {tapped:?}");
    assert!(
        (5.0..200.0).contains(&oscillation.hz()),
        "{set_up:?}: {tapped:?}"
    );
}

/// Taps along x, and workpieces that hold the tool along x.
#[test]
fn an_l2_that_grows_is_left_after_a_tap() {
    let robot = RobotFile::builtin_l2().unwrap();
    for (tool_kg, ratio) in [(1.8, 0.01), (5.0, 0.02), (5.0, 0.01), (10.0, 0.02)] {
        let set_up = l2(tool_kg, ratio, FIRST_ORDER);
        is_left(&robot, &set_up, Vector3::x(), (0.6, 200.0));
        // Along z the tool moves further: 303 um with 10 kg.
        for direction in [Vector3::y(), Vector3::z()] {
            is_left(&robot, &set_up, direction, (0.6, 310.0));
        }
    }
    for (tool_kg, stiffness_n_per_m) in [(1.8, 2e6), (1.8, 1e7), (5.0, 2e6), (5.0, 1e7)] {
        let set_up = on_workpiece(
            l2(tool_kg, 0.02, FIRST_ORDER),
            stiffness_n_per_m,
            Vector3::x(),
        );
        is_left(&robot, &set_up, Vector3::x(), (0.6, 200.0));
    }
}

/// 1e7 N/m leaves Obtain out of the noise, before the tap.
#[test]
fn a_stiff_workpiece_is_left_before_the_tap() {
    let robot = RobotFile::builtin_l2().unwrap();
    let set_up = on_workpiece(l2(1.8, 0.02, FIRST_ORDER), 1e7, Vector3::x());
    let tapped = tapped(&robot, &set_up, Vector3::x(), 1.0);
    assert!((tapped.growth_per_s - 90.0).abs() < 2.0, "{tapped:?}");
    assert!(
        tapped.left.is_some_and(|(after_s, _)| after_s < 0.0),
        "{tapped:?}"
    );
}

/// With 5 kg the mode at 6.7 Hz grows by 0.39/s, 1.22 times in eight swings: less than the rule
/// asks for. What is found is its beat with others, after 0.94 s along x with the hysteresis of
/// 0.6 `step_um` (12 um), and later in other directions.
#[test]
fn an_f1_that_grows_is_left_after_a_tap() {
    let robot = RobotFile::builtin_f1().unwrap();
    for (tool_kg, ratio, within_s) in [(5.0, 0.01, 1.0), (10.0, 0.02, 0.8)] {
        let set_up = f1(tool_kg, ratio, FIRST_ORDER);
        is_left(&robot, &set_up, Vector3::x(), (within_s, 450.0));
    }
}

/// Taps on loops that decay, in free air and on workpieces.
fn is_left_alone<K: MachineKind<N>, const N: usize>(robot: &RobotFile<K, N>, set_up: &SetUp) {
    for direction in [Vector3::x(), Vector3::y(), Vector3::z()] {
        let mut set_up = *set_up;
        if let Some(contact) = &mut set_up.workpiece {
            contact.direction = direction;
        }
        let tapped = tapped(robot, &set_up, direction, 4.0);
        assert!(tapped.growth_per_s < 0.0, "{set_up:?}: {tapped:?}");
        assert!(tapped.left.is_none(), "{set_up:?}: {tapped:?}");
    }
}

#[test]
fn machines_that_decay_are_left_alone_after_a_tap() {
    let robot = RobotFile::builtin_l2().unwrap();
    for (tool_kg, ratio) in [(1.8, 0.01), (1.8, 0.02), (5.0, 0.01), (5.0, 0.02)] {
        is_left_alone(&robot, &l2(tool_kg, ratio, AUTO));
        for stiffness_n_per_m in [2e6, 1e7] {
            let set_up = l2(tool_kg, ratio, AUTO);
            is_left_alone(
                &robot,
                &on_workpiece(set_up, stiffness_n_per_m, Vector3::x()),
            );
        }
    }
    let robot = RobotFile::builtin_f1().unwrap();
    for (tool_kg, ratio, filter) in [
        (1.8, 0.01, FIRST_ORDER),
        (5.0, 0.02, FIRST_ORDER),
        (1.8, 0.01, AUTO),
        (5.0, 0.02, AUTO),
    ] {
        is_left_alone(&robot, &f1(tool_kg, ratio, filter));
    }
}

/// Rough work.
#[derive(Clone, Copy, Debug)]
enum Job {
    /// Load steps between nothing and 300 N, at a frequency, Hz.
    Steps(f64),
    /// 300 N on average, 200 teeth a second, as the average over a cycle.
    Milling,
    /// A hand, 100 N at 3 Hz.
    Hand,
    /// Taps of 500 N for 20 ms, each second.
    Taps,
    /// Ways along x at up to 1 m/s with 5 m/s^2 and 50 m/s^3.
    Motion,
    /// Noise of the sensor, as a multiple of 0.2 N.
    Noise(f64),
}

const JOBS: [Job; 8] = [
    Job::Steps(1.0),
    Job::Steps(5.0),
    Job::Milling,
    Job::Hand,
    Job::Taps,
    Job::Motion,
    Job::Noise(1.0),
    Job::Noise(5.0),
];

impl Job {
    /// Load at a time, N.
    fn load_n(&self, t: f64) -> f64 {
        match self {
            Self::Steps(hz) => 300.0 * f64::from((t * hz).fract() < 0.5),
            Self::Milling => {
                // Half immersion: a tooth cuts half of the time. 16 points a cycle.
                let points = (0..16).map(|point| t + f64::from(point) / 16.0 * CYCLE_S);
                let cut = points.map(|t| (TAU * 200.0 * t).sin().max(0.0));
                300.0 * PI * cut.sum::<f64>() / 16.0
            }
            Self::Hand => 100.0 * (TAU * 3.0 * t).sin(),
            Self::Taps => 500.0 * f64::from(t.fract() < 0.02),
            Self::Motion | Self::Noise(_) => 0.0,
        }
    }

    /// Jerk along x at a time, m/s^3: 1.2 s forth, then back.
    fn jerk(&self, t: f64) -> f64 {
        let Self::Motion = self else {
            return 0.0;
        };
        let tenth = (t * 10.0) as u32;
        let sign = match tenth % 12 {
            0 | 8 => 1.0,
            2 | 6 => -1.0,
            _ => 0.0,
        };
        let is_back = (tenth / 12) % 2 == 1;
        50.0 * if is_back { -sign } else { sign }
    }
}

/// Runs a job for 10 s. Returns the time of the first oscillation, and it.
fn first_alarm<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    set_up: &SetUp,
    job: Job,
    direction: Vector3<f64>,
) -> Option<(f64, Oscillation)> {
    let mut trial = Trial::new(robot, set_up);
    let mut noise = Noise(7);
    let share = if let Job::Noise(share) = job {
        share
    } else {
        1.0
    };
    // The guideways are along x: all carts move alike, and no plate turns.
    let (mut x_m, mut m_per_s, mut m_per_s2) = (0.0, 0.0, 0.0);
    for cycle in 0..10_000 {
        let t = f64::from(cycle) * CYCLE_S;
        m_per_s2 += job.jerk(t) * CYCLE_S;
        m_per_s += m_per_s2 * CYCLE_S;
        x_m += m_per_s * CYCLE_S;
        let nominal = DVector::from_fn(N, |axis, _| if axis < ARMS { x_m } else { 0.0 });
        let load = along(direction, job.load_n(t));
        let found = trial.step(&load, &noise.reading(share), true, &nominal);
        if let Some(found) = found {
            return Some((t, found));
        }
    }
    None
}

/// Alarms of the default filter: jobs, with 1.8 and 5 kg.
fn alarms<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    set_up: impl Fn(f64, f64, FilterKind) -> SetUp,
    direction: Vector3<f64>,
) -> Vec<String> {
    let mut alarms = Vec::new();
    for tool_kg in [1.8, 5.0] {
        for job in JOBS {
            if let Some((s, found)) =
                first_alarm(robot, &set_up(tool_kg, 0.02, AUTO), job, direction)
            {
                alarms.push(format!("{job:?} with {tool_kg} kg after {s:.2} s: {found}"));
            }
        }
    }
    alarms
}

/// 16 runs of 10 s in each direction.
#[test]
fn rough_work_raises_no_alarm_on_an_l2() {
    let robot = RobotFile::builtin_l2().unwrap();
    for direction in [Vector3::x(), Vector3::y(), Vector3::z()] {
        assert_eq!(alarms(&robot, l2, direction), [""; 0], "{direction:?}");
    }
}

/// Load steps of 300 N at 5 Hz are next to the modes at 6.8 Hz: with either tool a false alarm,
/// sustained. The other 14 runs are left alone.
#[test]
fn rough_work_raises_two_alarms_on_an_f1() {
    let robot = RobotFile::builtin_f1().unwrap();
    for direction in [Vector3::x(), Vector3::y(), Vector3::z()] {
        let alarms = alarms(&robot, f1, direction);
        assert_eq!(alarms.len(), 2, "{alarms:#?}");
        for alarm in &alarms {
            assert!(alarm.starts_with("Steps(5.0) with "), "{alarm}");
            assert!(alarm.ends_with("not decaying"), "{alarm}");
        }
    }
}

/// The filter of first order on a machine with mass: milling is an alarm, and rightly.
#[test]
fn milling_with_a_filter_of_first_order_is_an_alarm() {
    let robot = RobotFile::builtin_l2().unwrap();
    let set_up = l2(5.0, 0.02, FIRST_ORDER);
    assert!(first_alarm(&robot, &set_up, Job::Milling, Vector3::x()).is_some());
}
