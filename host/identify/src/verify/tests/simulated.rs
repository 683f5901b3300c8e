//! Machines drawn from what a file says of its springs, measured with gauges and sensors that err.

use gantry_tau_core::model::kinematics::Pose as CorePose;
use gantry_tau_core::model::robot::{Compliances, LINKS};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::units::OffsetNm;
use gantry_tau_machine::elastic::backlash::Backlash;
use gantry_tau_machine::elastic::gauge::{Body, Gauge};
use gantry_tau_machine::elastic::loaded::Loaded;
use gantry_tau_machine::elastic::{ElasticMachine, Equilibrium, Pose};
use gantry_tau_machine::model::{CorrectedPose, L2, MachineKind, Wrist};
use gantry_tau_machine::robot_file::{Identified, RobotFile};
use gantry_tau_system::output::Name;
use nalgebra::{SVector, Vector3, Vector6};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::measurements::springs::{Campaign, NamedGauge, Noise, SetupNoise, Window};
use crate::measurements::wrench_columns::WrenchColumns;
use crate::verify::directions;
use crate::verify::model::FileModel;

pub(super) const N: usize = 3;

pub(super) const SPRINGS: usize = LINKS + N;

/// Relative standard deviations of the springs: of the size that a campaign leaves.
const KNOWN: [f64; SPRINGS] = [0.006, 0.004, 0.008, 0.004, 0.006, 0.004, 0.08, 0.06, 0.04];

pub(super) fn springs(compliances: &Compliances<N>) -> [f64; SPRINGS] {
    let mut all = compliances
        .link_m_per_n()
        .iter()
        .chain(compliances.cart_m_per_n())
        .copied();
    std::array::from_fn(|_| all.next().unwrap())
}

pub(super) fn compliances(springs: &[f64; SPRINGS]) -> Compliances<N> {
    Compliances::new(
        std::array::from_fn(|link| springs[link]),
        std::array::from_fn(|axis| springs[LINKS + axis]),
    )
    .unwrap()
}

/// The L2 as if identified: correlated springs, as two that one gauge sees together are.
pub(super) fn identified() -> RobotFile<L2, N> {
    let mut file = RobotFile::builtin_l2().unwrap();
    let values = springs(file.compliances.as_ref().unwrap());
    let sd: [f64; SPRINGS] = std::array::from_fn(|index| KNOWN[index] * values[index]);
    file.identified = Some(Identified {
        relative_to: Vec::new(),
        measurements: "springs.csv".to_owned(),
        crc: 0,
        windows: 99,
        chi2: 0.0,
        dof: 0,
        sd: sd.to_vec(),
        covariance: (0..SPRINGS)
            .map(|row| {
                (0..SPRINGS)
                    .map(|column| correlation(row, column) * sd[row] * sd[column])
                    .collect()
            })
            .collect(),
    });
    file
}

fn correlation(row: usize, column: usize) -> f64 {
    match (row, column) {
        (row, column) if row == column => 1.0,
        (0, 6) | (6, 0) => -0.7,
        (1, 2) | (2, 1) => -0.4,
        _ => 0.0,
    }
}

pub(super) struct Draw(ChaCha8Rng);

impl Draw {
    pub(super) fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    fn normal(&mut self, sd: f64) -> f64 {
        sd * Distribution::<f64>::sample(&StandardNormal, &mut self.0)
    }

    fn vector(&mut self, sd: Option<f64>) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.normal(sd.unwrap_or(0.0)))
    }

    /// A machine out of those that the file takes for possible.
    pub(super) fn machine(&mut self, file: &RobotFile<L2, N>) -> Compliances<N> {
        let model = FileModel::new(file).unwrap();
        let unit = nalgebra::DVector::from_fn(SPRINGS, |_, _| self.normal(1.0));
        let away = model.factor * unit;
        let values = springs(file.compliances.as_ref().unwrap());
        compliances(&std::array::from_fn(|index| values[index] + away[index]))
    }
}

/// Twenty places over the middle of the reach.
fn places(file: &RobotFile<L2, N>) -> Vec<Vector3<f64>> {
    let mut places = Vec::new();
    for x in [-0.4, -0.1, 0.2, 0.4] {
        for y in [0.3, 0.45, 0.58] {
            places.extend([0.5, 0.65, 0.8].map(|z| Vector3::new(x, y, z)));
        }
    }
    places.retain(|place| file.model.axes_at(place).is_ok());
    places.truncate(20);
    assert_eq!(places.len(), 20);
    places
}

fn gauges() -> Vec<NamedGauge> {
    let platform = [
        ([0.12, -0.06, 0.10], Vector3::z()),
        ([-0.12, -0.06, 0.10], Vector3::z()),
        ([0.0, 0.10, 0.10], Vector3::z()),
        ([0.10, 0.12, 0.05], Vector3::y()),
        ([-0.10, 0.12, 0.05], Vector3::y()),
        ([0.14, 0.0, 0.05], Vector3::x()),
    ];
    platform
        .into_iter()
        .enumerate()
        .map(|(index, (point, axis))| NamedGauge {
            name: Name::made(format_args!("g{index}")),
            gauge: Gauge::Face {
                body: Body::Platform,
                point_m: point.into(),
                axis,
            },
        })
        .collect()
}

const NOISE: Noise = Noise {
    gauge_um: 0.5,
    force_n: 0.5,
    moment_nm: 0.025,
};

/// Set-up as well as a careful person gets it.
pub(super) const SETUP: SetupNoise = SetupNoise {
    gauge_point_mm: Some(0.5),
    gauge_axis_mrad: Some(2.0),
    sensor_lever_mm: Some(0.5),
    sensor_axes_mrad: Some(2.0),
    sensor_gain: Some(0.005),
};

/// A sensor that is off by its constants.
struct InexactSensor {
    lever_m: Vector3<f64>,
    turn: Vector3<f64>,
    gains: Vector6<f64>,
}

impl InexactSensor {
    fn drawn(setup: &SetupNoise, draw: &mut Draw) -> Self {
        Self {
            lever_m: draw.vector(setup.sensor_lever_mm) * 1e-3,
            turn: draw.vector(setup.sensor_axes_mrad) * 1e-3,
            gains: Vector6::from_fn(|_, _| draw.normal(setup.sensor_gain.unwrap_or(0.0))),
        }
    }

    fn shows(&self, load: &Vector6<f64>) -> Vector6<f64> {
        let scaled = load + load.component_mul(&self.gains);
        let force = scaled.fixed_rows::<3>(0).into_owned();
        let moment = scaled.fixed_rows::<3>(3).into_owned();
        let moment = moment + self.turn.cross(&moment) + self.lever_m.cross(&force);
        let force = force + self.turn.cross(&force);
        Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z)
    }
}

/// Gauges that stand only about where they should.
fn mounted(setup: &SetupNoise, draw: &mut Draw) -> Vec<Gauge> {
    let mut mounted = Vec::new();
    for named in gauges() {
        let Gauge::Face {
            body,
            point_m,
            axis,
        } = named.gauge
        else {
            panic!("not on the platform")
        };
        let moved = draw.vector(setup.gauge_point_mm) * 1e-3;
        let turn = draw.vector(setup.gauge_axis_mrad) * 1e-3;
        mounted.push(Gauge::Face {
            body,
            point_m: point_m + moved,
            axis: (axis + turn.cross(&axis)).normalize(),
        });
    }
    mounted
}

/// A machine at a place, with its gauges and its sensor.
struct MeasuredPlace<'a> {
    machine: &'a ElasticMachine<N>,
    sensor: &'a InexactSensor,
    gauges: Vec<Gauge>,
    zeros_m: Vec<f64>,
    began: Equilibrium<N>,
    index: usize,
}

impl MeasuredPlace<'_> {
    fn window(&self, name: Name, q: [f64; N], load: Vector6<f64>, draw: &mut Draw) -> Window<N> {
        let now = self.machine.equilibrium(&q, &load, &self.began).unwrap();
        let loaded = Loaded {
            machine: *self.machine,
            wrist: Wrist::default(),
            began: self.began.pose,
            now,
            load,
        };
        let read = self.gauges.iter().zip(&self.zeros_m).map(|(gauge, zero)| {
            Some(gauge.read(&loaded).length_m + zero + draw.normal(NOISE.gauge_um * 1e-6))
        });
        let readings_m = read.collect();
        let sds = [
            NOISE.force_n,
            NOISE.force_n,
            NOISE.force_n,
            NOISE.moment_nm,
            NOISE.moment_nm,
            NOISE.moment_nm,
        ];
        let shown = self.sensor.shows(&load);
        let shown = Vector6::from_fn(|component, _| shown[component] + draw.normal(sds[component]));
        Window {
            line: 0,
            series: self.index,
            mounting: self.index,
            pose: self.index,
            window: name,
            stroke: 0,
            q,
            load: shown,
            pushes_n: SVector::zeros(),
            readings_m,
            sds_m: vec![None; self.gauges.len()],
            time_s: None,
        }
    }
}

/// Measures `truth` at twenty places under six loads of 300 N, with the compensation of the file
/// off and on.
pub(super) fn measured(
    file: &RobotFile<L2, N>,
    truth: &Compliances<N>,
    setup: SetupNoise,
    draw: &mut Draw,
) -> Campaign<N> {
    let sensor = InexactSensor::drawn(&setup, draw);
    let machine = ElasticMachine::new(file.model.geometry(), *truth, Backlash::NONE);
    let compensator = file
        .compensator(file.limits.map(|axis| OffsetNm(axis.limits.position.max())))
        .unwrap();
    let mut windows = Vec::new();
    let mut series = Vec::new();
    let mut poses = Vec::new();
    for (index, place) in places(file).into_iter().enumerate() {
        let off = file.model.axes_at(&place).unwrap();
        let start = Equilibrium::unloaded(Pose {
            translation_m: place,
            rotation: nalgebra::UnitQuaternion::identity(),
        });
        let began = machine
            .equilibrium(&off, &Vector6::zeros(), &start)
            .unwrap();
        let at = MeasuredPlace {
            machine: &machine,
            sensor: &sensor,
            gauges: mounted(&setup, draw),
            zeros_m: gauges().iter().map(|_| draw.normal(1e-3)).collect(),
            began,
            index,
        };
        windows.push(at.window(Name::made("start"), off, Vector6::zeros(), draw));
        for (number, way) in directions().into_iter().take(6).enumerate() {
            let force = way * 300.0;
            let moment = Vector3::new(0.0, 0.0, -0.08).cross(&force);
            let load = Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z);
            let wrench = Wrench::from_array(sensor.shows(&load).into());
            let held = CorrectedPose::new(
                &*compensator,
                &[1.0; N],
                &CorePose::at(place),
                &off,
                &wrench,
            )
            .unwrap();
            windows.push(at.window(Name::made(number), held.nominal, load, draw));
            windows.push(at.window(Name::made(number), held.corrected, load, draw));
        }
        windows.push(at.window(Name::made("end"), off, Vector6::zeros(), draw));
        series.push(Name::made(format_args!("s{index}")));
        poses.push((Name::made(format_args!("p{index}")), CorePose::at(place)));
    }
    for (line, window) in (2..).zip(&mut windows) {
        window.line = line;
    }
    Campaign {
        table: "verify.csv".to_owned(),
        crc: 0,
        metres_per_q: [1.0; N],
        noise: NOISE,
        is_noise_stated: true,
        setup,
        wrench: WrenchColumns::of_load(poses.len()),
        poses,
        gauges: gauges(),
        mountings: series.clone(),
        series,
        windows,
        plan: Vec::new(),
    }
}
