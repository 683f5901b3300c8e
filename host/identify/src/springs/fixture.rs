//! Campaigns of simulated machines of known springs, for tests.

use gantry_tau_core::model::f1;
use gantry_tau_machine::elastic::backlash::Backlash;
use gantry_tau_machine::elastic::loaded::Loaded;
use gantry_tau_machine::elastic::springs::Springs;
use gantry_tau_machine::elastic::{ElasticMachine, Equilibrium};
use gantry_tau_machine::model::{L2, MachineKind};
use gantry_tau_machine::robot_file::{RobotFile, WristJoint};
use gantry_tau_system::output::Name;
use nalgebra::{DVector, SVector, Vector3, Vector6};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::problem::SpringsProblem;
use crate::measurements::springs::{Campaign, Noise, SeriesEntry, SetupNoise, Window};
use crate::measurements::wrench_columns::WrenchColumns;
use crate::plan::springs::default_gauges;

pub(super) const HOME: [f64; 3] = [0.0, 0.5, 0.65];
/// Hooks, from the tool centre point, m.
pub(super) const HOOKS: [[f64; 3]; 3] = [[0.0, 0.0, -0.08], [0.15, 0.0, -0.08], [0.0, 0.15, -0.08]];
pub(super) const FINE: Noise = Noise {
    gauge_um: 1.0,
    force_n: 1.0,
    moment_nm: 0.05,
};
/// Levels of a strap up and down, N.
pub(super) const LEVELS: [f64; 11] = [
    0.0, 60.0, 120.0, 180.0, 240.0, 300.0, 240.0, 180.0, 120.0, 60.0, 0.0,
];

/// A machine and a campaign on it.
pub(super) struct TestBench<const N: usize> {
    pub(super) geometry: f1::Geometry,
    pub(super) file: Springs<N>,
    pub(super) campaign: Campaign<N>,
}

/// A strap: pose, hook, direction, and its levels.
pub(super) struct Strap {
    pub(super) pose: usize,
    pub(super) hook: [f64; 3],
    pub(super) direction: Vector3<f64>,
    pub(super) levels: Vec<f64>,
}

/// Straps at each hook of each pose, along x, y and z.
pub(super) fn straps(poses: usize, hooks: &[[f64; 3]]) -> Vec<Strap> {
    let mut straps = Vec::new();
    for pose in 0..poses {
        for hook in hooks {
            for direction in [Vector3::x(), Vector3::y(), Vector3::z()] {
                straps.push(Strap {
                    pose,
                    hook: *hook,
                    direction,
                    levels: LEVELS.to_vec(),
                });
            }
        }
    }
    straps
}

impl<const N: usize> TestBench<N> {
    /// A campaign without readings, loads exact.
    pub(super) fn new<K: MachineKind<N>>(
        robot: &RobotFile<K, N>,
        places: &[[f64; 3]],
        straps: &[Strap],
        noise: Noise,
    ) -> Self {
        let gauges = default_gauges(robot);
        let mut windows = Vec::new();
        for (series, strap) in straps.iter().enumerate() {
            let q = robot
                .model
                .axes_at(&Vector3::from(places[strap.pose]))
                .unwrap();
            let top = strap.levels.iter().copied().fold(0.0, f64::max);
            let first_top = strap.levels.iter().position(|level| *level >= top).unwrap();
            for (window, level) in strap.levels.iter().enumerate() {
                let force = strap.direction * *level;
                let moment = Vector3::from(strap.hook).cross(&force);
                windows.push(Window {
                    line: 0,
                    series,
                    mounting: series,
                    pose: strap.pose,
                    window: Name::made(window),
                    stroke: if window <= first_top { 1 } else { -1 },
                    q,
                    load: Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z),
                    pushes_n: SVector::zeros(),
                    readings_m: vec![Some(0.0); gauges.len()],
                    sds_m: vec![None; gauges.len()],
                    time_s: None,
                });
            }
        }
        let poses = places
            .iter()
            .map(|place| gantry_tau_core::model::kinematics::Pose::at(Vector3::from(*place)));
        let series: Vec<Name> = (0..straps.len()).map(Name::made).collect();
        let campaign = Campaign {
            table: String::new(),
            crc: 0,
            metres_per_q: robot.metres_per_q,
            noise,
            is_noise_stated: true,
            setup: SetupNoise::default(),
            wrench: WrenchColumns::of_load(places.len()),
            poses: poses.map(|pose| (Name::made(""), pose)).collect(),
            gauges,
            mountings: series.clone(),
            series,
            windows,
            plan: Vec::new(),
        };
        Self {
            geometry: robot.model.geometry(),
            file: Springs::of(robot).unwrap(),
            campaign,
        }
    }

    pub(super) fn problem(&self) -> SpringsProblem<'_, N> {
        SpringsProblem::new(&self.geometry, &self.file, &self.campaign)
    }

    /// The file's compliances, each up to 30 % off.
    pub(super) fn true_springs(&self, random: &mut ChaCha8Rng) -> Springs<N> {
        let off = self
            .file
            .vector()
            .map(|value| value * (1.0 + random.random_range(-0.3..0.3)));
        self.file.with(&off)
    }

    /// Turns the joints of the wrist by these angles (rad) in every second series.
    pub(super) fn turn_wrist(&mut self, angles_rad: &[f64]) {
        let turned = self.campaign.series.iter().skip(1).step_by(2);
        self.campaign.plan = turned
            .map(|series| SeriesEntry {
                name: series.clone(),
                pose: Name::made(""),
                mounting: series.clone(),
                hook_m: [0.0; 3],
                direction: [1.0, 0.0, 0.0],
                levels_n: Vec::new(),
                gauges: Vec::new(),
                compensated: false,
                wrist_rad: angles_rad.to_vec(),
            })
            .collect();
    }

    /// Measures: gauges with zeros, noise and errors of where they stand, loads with noise and
    /// errors of the sensor. `is_crossed`: beyond the jump, by the sum of the tensions of cluster 3
    /// and the stroke; there the links of the cluster are `gap_m` longer.
    pub(super) fn measure(
        &mut self,
        truth: &Springs<N>,
        random: &mut ChaCha8Rng,
        gap_m: f64,
        beyond: impl Fn(f64, i8) -> f64,
    ) {
        self.measure_with(truth, random, beyond, |_| {
            Vector6::new(0.0, 0.0, 0.0, gap_m, gap_m, gap_m)
        });
    }

    /// As [`measure`](Self::measure), with links that are longer by what their tensions say.
    pub(super) fn measure_with(
        &mut self,
        truth: &Springs<N>,
        random: &mut ChaCha8Rng,
        beyond: impl Fn(f64, i8) -> f64,
        elongations_m: impl Fn(&Vector6<f64>) -> Vector6<f64>,
    ) {
        let problem = self.problem();
        let campaign = &self.campaign;
        let machine = ElasticMachine::new(self.geometry, truth.machine, Backlash::NONE);
        let constants = DVector::from_fn(problem.setup.count(), |_, _| normal(random));
        let of_sensor = constants
            .rows(problem.setup.first_of_sensor(), problem.setup.of_sensor())
            .into_owned();
        let zeros: Vec<Vec<f64>> = campaign
            .series
            .iter()
            .map(|_| {
                campaign
                    .gauges
                    .iter()
                    .map(|_| 1e-3 * normal(random))
                    .collect()
            })
            .collect();
        let noise = campaign.noise;
        let mut measured = Vec::new();
        for window in &campaign.windows {
            let began = problem.unloaded(&machine, window).unwrap();
            let rigid = machine
                .equilibrium(&window.q, &window.load, &began)
                .unwrap();
            let mut longer = self.geometry;
            let share = beyond(rigid.cluster_3_n(), window.stroke);
            if share > 0.0 {
                let elongations_m = elongations_m(&rigid.tensions_n) * share;
                longer
                    .lengths_m
                    .iter_mut()
                    .zip(&elongations_m)
                    .for_each(|(length, by)| *length += by);
            }
            let machine = ElasticMachine::new(longer, truth.machine, Backlash::NONE);
            let now: Equilibrium<N> = machine
                .equilibrium(&window.q, &window.load, &rigid)
                .unwrap();
            let wrist = truth
                .wrist
                .turned(campaign.wrist_rad(&campaign.series[window.series]));
            let loaded = Loaded {
                machine,
                wrist,
                began: began.pose,
                now,
                load: window.load,
            };
            let exact_m = (0..campaign.gauges.len()).map(|gauge| {
                let placed = problem
                    .setup
                    .placed(campaign, &constants, window.mounting, gauge);
                placed.read(&loaded).length_m
            });
            let readings: Vec<Option<f64>> = exact_m
                .zip(&zeros[window.series])
                .map(|(exact, zero)| Some(exact + zero + noise.gauge_um * 1e-6 * normal(random)))
                .collect();
            let mut load = window.load;
            let effect = problem.setup.effect(&window.load) * &of_sensor;
            for component in 0..6 {
                let sd = if component < 3 {
                    noise.force_n
                } else {
                    noise.moment_nm
                };
                load[component] += effect[component] + sd * normal(random);
            }
            measured.push((readings, load));
        }
        for (window, (readings, load)) in self.campaign.windows.iter_mut().zip(measured) {
            window.readings_m = readings;
            window.load = load;
        }
    }
}

impl<const N: usize> TestBench<N> {
    /// Disturbs this share of all readings by 10 to 30 um.
    pub(super) fn disturb(&mut self, random: &mut ChaCha8Rng, share: f64) {
        for reading in self
            .campaign
            .windows
            .iter_mut()
            .flat_map(|window| &mut window.readings_m)
        {
            if random.random::<f64>() < share {
                let off =
                    random.random_range(10e-6..30e-6) * if random.random() { 1.0 } else { -1.0 };
                *reading = reading.map(|reading| reading + off);
            }
        }
    }
}

/// No window is beyond a jump.
pub(super) const fn never(_: f64, _: i8) -> f64 {
    0.0
}

pub(super) fn normal(random: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(random)
}

/// Point of both axes of the wrist, from the tool centre point, m.
pub(super) const WRIST_M: [f64; 3] = [0.0, 0.0, 0.15];

/// The L2 with two joints between platform and tool, as its extension to five degrees of freedom
/// has them.
pub(super) fn l2_with_wrist() -> RobotFile<L2, 3> {
    let mut robot = RobotFile::builtin_l2().unwrap();
    robot.wrist = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
        .map(|axis| WristJoint {
            axis,
            point_m: WRIST_M,
            c_rad_per_nm: 1e-5,
        })
        .into();
    robot
}

/// The L2 and its campaign A: nine straps at home.
pub(super) fn campaign_a(noise: Noise) -> TestBench<3> {
    TestBench::new(
        &RobotFile::builtin_l2().unwrap(),
        &[HOME],
        &straps(1, &HOOKS),
        noise,
    )
}

pub(super) fn seeded(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}
