//! Machines drawn from what a file says of its springs, measured and predicted.

use gantry_tau_core::model::kinematics::Pose as CorePose;
use gantry_tau_core::model::robot::{Compliances, LINKS};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::units::OffsetNm;
use nalgebra::{SVector, Vector3, Vector6};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::*;
use crate::elastic::backlash::Backlash;
use crate::elastic::{ElasticMachine, Equilibrium, Pose};
use crate::measurements::springs::{Campaign, NamedGauge, Noise, SetupNoise, Window};
use crate::measurements::wrench_columns::WrenchColumns;
use crate::model::{Held, L2, MachineKind, Wrist};
use crate::output::Name;
use crate::robot_file::{AnyRobotFile, Identified, RobotFile, WristJoint, text_of};
use crate::springs::gauge::{Body, Gauge};
use crate::springs::loaded::Loaded;

const N: usize = 3;
const SPRINGS: usize = LINKS + N;
/// Relative standard deviations of the springs: of the size that a campaign leaves.
const KNOWN: [f64; SPRINGS] = [0.006, 0.004, 0.008, 0.004, 0.006, 0.004, 0.08, 0.06, 0.04];

fn springs(compliances: &Compliances<N>) -> [f64; SPRINGS] {
    let mut all = compliances.link_m_per_n().iter().chain(compliances.cart_m_per_n()).copied();
    std::array::from_fn(|_| all.next().unwrap())
}

fn compliances(springs: &[f64; SPRINGS]) -> Compliances<N> {
    Compliances::new(std::array::from_fn(|link| springs[link]), std::array::from_fn(|axis| springs[LINKS + axis]))
        .unwrap()
}

/// The L2 as if identified: correlated springs, as two that one gauge sees together are.
fn identified() -> RobotFile<L2, N> {
    let mut file = RobotFile::builtin_l2().unwrap();
    let values = springs(file.compliances.as_ref().unwrap());
    let sd: [f64; SPRINGS] = std::array::from_fn(|index| KNOWN[index] * values[index]);
    let correlation = |row: usize, column: usize| match (row, column) {
        (row, column) if row == column => 1.0,
        (0, 6) | (6, 0) => -0.7,
        (1, 2) | (2, 1) => -0.4,
        _ => 0.0,
    };
    let entry = |row: usize, column: usize| correlation(row, column) * sd[row] * sd[column];
    file.identified = Some(Identified {
        relative_to: Vec::new(),
        measurements: "springs.csv".to_owned(),
        crc: 0,
        windows: 99,
        chi2: 0.0,
        dof: 0,
        sd: sd.to_vec(),
        covariance: (0..SPRINGS).map(|row| (0..SPRINGS).map(|column| entry(row, column)).collect()).collect(),
    });
    file
}

struct Draw(ChaCha8Rng);

impl Draw {
    fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    fn normal(&mut self, sd: f64) -> f64 {
        sd * Distribution::<f64>::sample(&StandardNormal, &mut self.0)
    }

    /// A machine out of those that the file takes for possible.
    fn machine(&mut self, file: &RobotFile<L2, N>) -> Compliances<N> {
        let model = model::FileModel::new(file).unwrap();
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
    let gauge = |(index, (point, axis)): (usize, ([f64; 3], Vector3<f64>))| NamedGauge {
        name: Name::made(format_args!("g{index}")),
        gauge: Gauge::Face { body: Body::Platform, point_m: point.into(), axis },
    };
    platform.into_iter().enumerate().map(gauge).collect()
}

const NOISE: Noise = Noise { gauge_um: 0.5, force_n: 0.5, moment_nm: 0.025 };

/// Set-up as well as a careful person gets it.
const SETUP: SetupNoise = SetupNoise {
    gauge_point_mm: Some(0.5),
    gauge_axis_mrad: Some(2.0),
    sensor_lever_mm: Some(0.5),
    sensor_axes_mrad: Some(2.0),
    sensor_gain: Some(0.005),
};

/// A sensor that is off by its constants.
struct OffSensor {
    lever_m: Vector3<f64>,
    turn: Vector3<f64>,
    gains: Vector6<f64>,
}

impl OffSensor {
    fn drawn(setup: &SetupNoise, draw: &mut Draw) -> Self {
        let mut vector = |sd: Option<f64>| Vector3::from_fn(|_, _| draw.normal(sd.unwrap_or(0.0)));
        let (lever_m, turn) = (vector(setup.sensor_lever_mm) * 1e-3, vector(setup.sensor_axes_mrad) * 1e-3);
        let gains = Vector6::from_fn(|_, _| draw.normal(setup.sensor_gain.unwrap_or(0.0)));
        Self { lever_m, turn, gains }
    }

    fn shows(&self, load: &Vector6<f64>) -> Vector6<f64> {
        let scaled = load + load.component_mul(&self.gains);
        let (force, moment) = (scaled.fixed_rows::<3>(0).into_owned(), scaled.fixed_rows::<3>(3).into_owned());
        let moment = moment + self.turn.cross(&moment) + self.lever_m.cross(&force);
        let force = force + self.turn.cross(&force);
        Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z)
    }
}

/// Gauges that stand only about where they should.
fn mounted(setup: &SetupNoise, draw: &mut Draw) -> Vec<Gauge> {
    let off = |gauge: NamedGauge| {
        let Gauge::Face { body, point_m, axis } = gauge.gauge else { panic!("not on the platform") };
        let mut vector = |sd: Option<f64>| Vector3::from_fn(|_, _| draw.normal(sd.unwrap_or(0.0))) * 1e-3;
        let (moved, turn) = (vector(setup.gauge_point_mm), vector(setup.gauge_axis_mrad));
        Gauge::Face { body, point_m: point_m + moved, axis: (axis + turn.cross(&axis)).normalize() }
    };
    gauges().into_iter().map(off).collect()
}

/// Measures `truth` at twenty places under six loads of 300 N, with the compensation of the file off and on.
fn measured(file: &RobotFile<L2, N>, truth: &Compliances<N>, setup: SetupNoise, draw: &mut Draw) -> Campaign<N> {
    let sensor = OffSensor::drawn(&setup, draw);
    let machine = ElasticMachine::new(file.model.geometry(), *truth, Backlash::NONE);
    let compensator = file.compensator(file.limits.map(|axis| OffsetNm(axis.limits.position.max()))).unwrap();
    let (mut windows, mut series, mut poses) = (Vec::new(), Vec::new(), Vec::new());
    for (pose, place) in places(file).into_iter().enumerate() {
        let off = file.model.axes_at(&place).unwrap();
        let start =
            Equilibrium::unloaded(Pose { translation_m: place, rotation: nalgebra::UnitQuaternion::identity() });
        let began = machine.equilibrium(&off, &Vector6::zeros(), &start).unwrap();
        let standing = mounted(&setup, draw);
        let zeros: Vec<f64> = gauges().iter().map(|_| draw.normal(1e-3)).collect();
        let mut add = |name: Name, q: [f64; N], load: Vector6<f64>, draw: &mut Draw| {
            let now = machine.equilibrium(&q, &load, &began).unwrap();
            let loaded = Loaded { machine, wrist: Wrist::default(), began: began.pose, now, load };
            let read = standing
                .iter()
                .zip(&zeros)
                .map(|(gauge, zero)| Some(gauge.read(&loaded).length_m + zero + draw.normal(NOISE.gauge_um * 1e-6)));
            let readings_m = read.collect();
            let sds = [NOISE.force_n, NOISE.force_n, NOISE.force_n, NOISE.moment_nm, NOISE.moment_nm, NOISE.moment_nm];
            let shown = sensor.shows(&load);
            let shown = Vector6::from_fn(|component, _| shown[component] + draw.normal(sds[component]));
            windows.push(Window {
                line: u64::try_from(windows.len()).unwrap() + 2,
                series: pose,
                mounting: pose,
                pose,
                window: name,
                stroke: 0,
                q,
                load: shown,
                pushes_n: SVector::zeros(),
                readings_m,
                sds_m: vec![None; gauges().len()],
                time_s: None,
            });
        };
        add(Name::made("start"), off, Vector6::zeros(), draw);
        for (index, way) in directions().into_iter().take(6).enumerate() {
            let force = way * 300.0;
            let moment = Vector3::new(0.0, 0.0, -0.08).cross(&force);
            let load = Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z);
            let wrench = Wrench::from_array(sensor.shows(&load).into());
            let held = Held::new(&*compensator, &[1.0; N], &CorePose::at(place), &off, &wrench).unwrap();
            add(Name::made(index), held.nominal, load, draw);
            add(Name::made(index), held.corrected, load, draw);
        }
        add(Name::made("end"), off, Vector6::zeros(), draw);
        series.push(Name::made(format_args!("s{pose}")));
        poses.push((Name::made(format_args!("p{pose}")), CorePose::at(place)));
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

const WORKPIECE: f64 = 1e9;

/// Root mean square of the z-scores of machines out of those that the file takes for possible; none may be doubted.
fn z_rms(machines: u32, setup: SetupNoise, seed: u64) -> f64 {
    let mut file = identified();
    // Every load counts: these machines have no play.
    file.simulation.jump_gap_m = 0.0;
    let mut draw = Draw::new(seed);
    let mut squares = 0.0;
    for _ in 0..machines {
        let truth = draw.machine(&file);
        let found = verify(&file, &measured(&file, &truth, setup, &mut draw), WORKPIECE).unwrap();
        assert_eq!((found.judged.pairs, found.at_the_jump.pairs), (120, 0));
        squares += found.judged.z_rms.powi(2);
        assert_eq!(found.doubts(30e-6), [""; 0], "{found}");
        assert!(found.judged.share < 0.03, "{found}");
    }
    (squares / f64::from(machines)).sqrt()
}

/// Remainders are as large as predicted, by springs and by noise; pooled, as the z-scores of one machine share its springs.
#[test]
fn machines_that_the_file_knows_remain_as_predicted() {
    let found = z_rms(12, SetupNoise::default(), 1);
    assert!((0.8..1.2).contains(&found), "{found}");
}

#[test]
fn a_set_up_that_is_off_as_stated_changes_nothing() {
    let found = z_rms(12, SETUP, 5);
    assert!((0.8..1.2).contains(&found), "{found}");
    // The same errors, not stated, are taken for a wrong machine.
    let file = identified();
    let mut draw = Draw::new(6);
    let mut campaign = measured(&file, file.compliances.as_ref().unwrap(), SETUP, &mut draw);
    campaign.setup = SetupNoise::default();
    let found = verify(&file, &campaign, WORKPIECE).unwrap();
    assert!(found.p < 1e-3, "{found}");
}

#[test]
fn springs_that_are_off_by_a_third_are_rejected() {
    let file = identified();
    let mut draw = Draw::new(2);
    let values = springs(file.compliances.as_ref().unwrap());
    let truth = compliances(&std::array::from_fn(|index| values[index] * if index % 2 == 0 { 1.3 } else { 0.7 }));
    let found = verify(&file, &measured(&file, &truth, SetupNoise::default(), &mut draw), WORKPIECE).unwrap();
    assert!(found.judged.z_rms > 5.0 && found.p < 1e-12, "{found}");
    assert_eq!(found.doubts(20e-6).len(), 2, "{found}");
    // Loads across the jump are counted apart.
    assert!(found.at_the_jump.pairs > 10 && found.judged.pairs + found.at_the_jump.pairs == 120, "{found}");
}

/// The L2 as if identified, without play, with offsets of at most so many µm.
fn with_limits(max_um: f64) -> RobotFile<L2, N> {
    let limits = format!("max_um = {:?}", [max_um; N]);
    let tight = text_of("l2").unwrap().replace("max_um = [2000.0, 2000.0, 2000.0]", &limits);
    let AnyRobotFile::L2(tight) = AnyRobotFile::parse("tight", &tight).unwrap() else { panic!("not an L2") };
    let mut file = identified();
    file.simulation.jump_gap_m = 0.0;
    file.limits = tight.limits;
    file
}

/// With every correction cut nothing was verified.
#[test]
fn pairs_of_which_none_is_judged_are_a_doubt() {
    let file = with_limits(5.0);
    let mut draw = Draw::new(8);
    let truth = draw.machine(&file);
    let found = verify(&file, &measured(&file, &truth, SetupNoise::default(), &mut draw), WORKPIECE).unwrap();
    assert_eq!((found.judged.pairs, found.saturated.pairs), (0, 120), "{found}");
    assert_eq!(found.doubts(1.0), ["no pair is judged: 0 across the jump, 120 at an offset limit"]);
}

/// A correction that a limit of the offsets cuts is no fault of the springs: judged apart.
#[test]
fn corrections_that_a_limit_cuts_are_judged_apart() {
    let file = with_limits(300.0);
    let mut draw = Draw::new(8);
    let truth = draw.machine(&file);
    let found = verify(&file, &measured(&file, &truth, SetupNoise::default(), &mut draw), WORKPIECE).unwrap();
    assert!(found.saturated.pairs > 10 && found.judged.pairs > 10, "{found}");
    assert_eq!(found.saturated.pairs + found.judged.pairs, 120, "{found}");
    assert!(found.saturated.after_largest_m > 50e-6, "{found}");
    // What the limits leave is predicted like everything else.
    assert!(found.saturated.z_rms < 2.0 && found.judged.share < 0.03, "{found}");
    assert_eq!(found.doubts(30e-6), [""; 0], "{found}");
}

/// The prediction over the workspace against machines drawn from the file: means of squares, place by place and load by load.
#[test]
fn the_map_is_the_mean_over_machines() {
    let file = identified();
    let options = PredictOptions { cells: 12, force_n: 300.0, workpiece_n_per_m: WORKPIECE };
    let prediction = predict(&file, &options).unwrap();
    let summary = prediction.summary();
    let compensator = file.compensator([OffsetNm(2_000_000); N]).unwrap();
    let mut draw = Draw::new(3);
    let (mut simulated, mut predicted, mut count) = (0.0, 0.0, 0.0);
    for _ in 0..40 {
        let machine = ElasticMachine::new(file.model.geometry(), draw.machine(&file), Backlash::NONE);
        for place in prediction.places.iter().step_by(5) {
            let tool_m = Vector3::from(place.tool_m);
            let off = file.model.axes_at(&tool_m).unwrap();
            let start =
                Equilibrium::unloaded(Pose { translation_m: tool_m, rotation: nalgebra::UnitQuaternion::identity() });
            let began = machine.equilibrium(&off, &Vector6::zeros(), &start).unwrap();
            for (way, load) in directions().into_iter().zip(&place.loads).filter(|(_, load)| load.is_judged()) {
                let force = way * options.force_n;
                let wrench = Vector6::new(force.x, force.y, force.z, 0.0, 0.0, 0.0);
                let pose = CorePose::at(tool_m);
                let held =
                    Held::new(&*compensator, &[1.0; N], &pose, &off, &Wrench::from_array(wrench.into())).unwrap();
                let now = machine.equilibrium(&held.corrected, &wrench, &began).unwrap();
                // Relative, so that places near a singularity do not decide alone.
                simulated += ((now.pose.translation_m - began.pose.translation_m).norm() / load.before_m).powi(2);
                predicted += (load.expected_m() / load.before_m).powi(2);
                count += 1.0;
            }
        }
    }
    assert!(count > 1000.0);
    // Forty machines of nine springs: the mean square is known to a tenth.
    let ratio = f64::sqrt(simulated / predicted);
    assert!((0.9..1.1).contains(&ratio), "{ratio} {summary}");
    assert!(summary.across_the_jump > 0 && summary.method_rms_m < 1e-8, "{summary}");
}

/// A wrist is compensated along; what the file does not know of it remains.
#[test]
fn a_wrist_is_part_of_the_prediction() {
    let mut file = identified();
    let joint = |axis| WristJoint { axis, point_m: [0.0, 0.0, 0.15], c_rad_per_nm: 1e-5 };
    file.wrist = vec![joint([1.0, 0.0, 0.0]), joint([0.0, 1.0, 0.0])];
    // Known to a tenth each.
    let known = file.identified.as_mut().unwrap();
    known.sd.extend([1e-6; 2]);
    known.covariance.iter_mut().for_each(|row| row.extend([0.0; 2]));
    for joint in 0..2 {
        known
            .covariance
            .push((0..SPRINGS + 2).map(|column| if column == SPRINGS + joint { 1e-12 } else { 0.0 }).collect());
    }
    let options = PredictOptions { cells: 12, force_n: 300.0, workpiece_n_per_m: WORKPIECE };
    let with = predict(&file, &options).unwrap().summary();
    let without = predict(&identified(), &options).unwrap().summary();
    // 300 N across 0.15 m turn a joint by 0.45 mrad, which moves the tool by 67 um; a tenth of it is not known.
    assert!(with.before_rms_m > without.before_rms_m + 10e-6, "{with} {without}");
    assert!(with.method_rms_m < 1.5e-6 && (4e-6..8e-6).contains(&with.springs_rms_m), "{with}");
    assert!(with.largest_gain < without.largest_gain, "{with} {without}");
}

#[test]
fn a_file_without_a_covariance_predicts_nothing() {
    let file = RobotFile::builtin_l2().unwrap();
    let options = PredictOptions { cells: 12, force_n: 300.0, workpiece_n_per_m: WORKPIECE };
    let error = predict(&file, &options).unwrap_err().to_string();
    assert!(error.contains("has no [identified]") && !error.contains('\n'), "{error}");
}

/// Against a rigid workpiece the margin is what the springs are not known to: one sided 97.5 %. A soft workpiece allows more.
#[test]
fn the_margin_is_that_of_the_springs() {
    let mut file = identified();
    let gain = |file: &RobotFile<L2, N>, workpiece_n_per_m: f64| {
        predict(file, &PredictOptions { cells: 12, force_n: 300.0, workpiece_n_per_m }).unwrap().summary().largest_gain
    };
    let (rigid, soft) = (gain(&file, 1e12), gain(&file, 1e5));
    assert!((0.8..0.995).contains(&rigid) && soft > rigid + 0.2, "{rigid} {soft}");
    let exact = file.identified.as_mut().unwrap();
    exact.covariance.iter_mut().flatten().for_each(|entry| *entry = 0.0);
    assert!((gain(&file, 1e12) - 1.0).abs() < 1e-4);
}

/// The same windows in series of their own, each with its rows without a load; those of the second mounted anew, with other zeros.
fn in_two_series(campaign: &Campaign<N>) -> Campaign<N> {
    let mut split = campaign.clone();
    split.series = campaign
        .series
        .iter()
        .flat_map(|name| ["off", "on"].map(|state| Name::made(format_args!("{name} {state}"))))
        .collect();
    let is_unloaded = |window: &Window<N>| window.load.norm() < 50.0;
    let mut names = std::collections::HashSet::new();
    for window in &mut split.windows {
        let is_second = !names.insert((window.series, window.window.clone()));
        window.series = 2 * window.series + usize::from(is_second);
    }
    let again: Vec<Window<N>> = split.windows.iter().filter(|window| is_unloaded(window)).cloned().collect();
    split.windows.extend(again.into_iter().map(|window| Window { series: window.series + 1, ..window }));
    for window in split.windows.iter_mut().filter(|window| window.series % 2 == 1) {
        window.readings_m.iter_mut().flatten().for_each(|reading| *reading += 3e-4);
    }
    for (line, window) in (2..).zip(&mut split.windows) {
        window.line = line;
    }
    split
}

/// Two series of a strap are judged as one that holds both windows, whatever their zeros.
#[test]
fn pairs_may_stand_in_series_of_their_own() {
    let mut file = identified();
    file.simulation.jump_gap_m = 0.0;
    let mut draw = Draw::new(7);
    let truth = draw.machine(&file);
    let together = measured(&file, &truth, SETUP, &mut draw);
    let apart = in_two_series(&together);
    let [one, two] = [&together, &apart].map(|campaign| verify(&file, campaign, WORKPIECE).unwrap());
    assert_eq!((one.pairs.len(), two.pairs.len()), (120, 120));
    for (one, two) in one.pairs.iter().zip(&two.pairs) {
        assert_eq!((&one.series, &one.window), (&two.series, &two.window));
        // The zeros are the same rows, moved by a third of a millimetre: rounding, and q of the rows that is rounded to a nanometre.
        assert!((one.after_m - two.after_m).abs() < 2e-9 && (one.before_m - two.before_m).abs() < 2e-9);
        assert!((one.z - two.z).abs() < 1e-3, "{} {}", one.z, two.z);
    }
    // Six gauges of twenty series have another zero, and two more readings for each.
    assert_eq!(two.dof, one.dof + 20 * 6);
    assert!(two.p > 1e-3, "{two}");
    let refused = |change: &dyn Fn(&mut Campaign<N>)| {
        let mut campaign = apart.clone();
        change(&mut campaign);
        verify(&file, &campaign, WORKPIECE).unwrap_err().to_string()
    };
    let at =
        |series: usize| apart.windows.iter().position(|window| window.series == series && window.load.norm() > 50.0);
    let (off, on) = (at(0).unwrap(), at(1).unwrap());
    let alone = refused(&|campaign| campaign.windows[on].window = Name::made("other"));
    assert!(alone.contains("window \"0\" must stand once in series \"s0 on\", its other half"), "{alone}");
    let swapped = refused(&|campaign| campaign.series.swap(0, 1));
    assert!(swapped.contains("compensation was on"), "{swapped}");
    let moved = refused(&|campaign| {
        campaign.windows.iter_mut().filter(|window| window.series == 1).for_each(|window| window.mounting += 100);
    });
    assert!(moved.contains("must stand twice in its series"), "{moved}");
    let same = refused(&|campaign| campaign.windows[on].q = campaign.windows[off].q);
    assert!(same.contains("with compensation on it contains the offsets"), "{same}");
    // A series that was broken off, and mounted anew.
    let mut again = apart.clone();
    again.series.push(Name::made("s0 on.2"));
    let last = again.series.len() - 1;
    again.windows.iter_mut().filter(|window| window.series == 1).for_each(|window| window.series = last);
    let mut broken = Window { series: 1, window: Name::made("5"), ..again.windows[on].clone() };
    broken.readings_m.iter_mut().flatten().for_each(|reading| *reading += 1e-7);
    again.windows.push(broken);
    let found = verify(&file, &again, WORKPIECE).unwrap();
    assert_eq!((found.pairs.len(), found.dof), (120, two.dof));
}

#[test]
fn rows_without_a_partner_are_refused() {
    let file = identified();
    let good = measured(&file, file.compliances.as_ref().unwrap(), SetupNoise::default(), &mut Draw::new(4));
    let refused = |change: &dyn Fn(&mut Campaign<N>)| {
        let mut campaign = good.clone();
        change(&mut campaign);
        verify(&file, &campaign, WORKPIECE).unwrap_err().to_string()
    };
    let alone = refused(&|campaign| campaign.windows[2].window = Name::made("other"));
    assert!(alone.starts_with("verify.csv:3: window \"0\" must stand twice"), "{alone}");
    let same = refused(&|campaign| campaign.windows[2].q = campaign.windows[1].q);
    assert!(same.starts_with("verify.csv:4: q is that of line 3"), "{same}");
    let load = refused(&|campaign| campaign.windows[2].load *= 0.5);
    assert!(load.starts_with("verify.csv:4: the load is not that of line 3"), "{load}");
    let no_zero = refused(&|campaign| campaign.windows.retain(|window| window.load.norm() > 100.0));
    assert!(no_zero.contains("no row without a load"), "{no_zero}");
    let none = refused(&|campaign| campaign.windows.retain(|window| window.load.norm() < 100.0));
    assert!(none.contains("no pair of windows"), "{none}");
}
