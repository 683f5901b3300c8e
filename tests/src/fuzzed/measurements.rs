//! Any bytes as a file of measurements: a set-up with its table, a plan, gauges, or points of a
//! frame. It is read within its limits, or refused in one line that names the file and says why.

use std::path::Path;

use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::linalg::rotation_deviation;
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_identify::measurements::plan::{self, Plan};
use gantry_tau_identify::measurements::poses::{self, Poses, PosesPlan};
use gantry_tau_identify::measurements::springs::{self, Campaign, NamedGauge, Setup};
use gantry_tau_identify::measurements::{FileError, MAX_ROWS, frame, tool};
use gantry_tau_machine::elastic::gauge::Gauge;
use gantry_tau_server::links::gauges::MAX_GAUGES;
use nalgebra::{Isometry3, Matrix3, Vector3};

const SETUP: &str = "campaigns/fuzzed.toml";
const TABLE: &str = "campaigns/fuzzed.csv";

/// Line between a set-up and its table.
pub const BETWEEN: &str = "\n---\n";
/// Largest position of an axis, q-units, and of a tool or a target, m.
const FARTHEST: f64 = 1e3;
/// Largest force, N, and moment, N m.
const STRONGEST: f64 = 1e5;
/// Largest reading of a gauge, m.
const MAX_M: f64 = 2e4 * 1e-6;
/// Farthest hook or gauge from the tool centre point, m.
const REACH_M: f64 = 10.0;
/// Range of a standard deviation, µm and so on; and of its square in SI units, with the rounding of
/// both.
const SPREAD: std::ops::RangeInclusive<f64> = 1e-6..=1e6;
const VARIANCE: std::ops::RangeInclusive<f64> = 0.999e-24..=1.001;
/// Largest deviation of a direction, a rotation or a quaternion from unit length as a file may have
/// it; and as it is kept.
const UNIT: f64 = 1e-6;
const ROUNDED: f64 = 1e-12;

/// The bytes are the text of a set-up and, after [`BETWEEN`], its table.
pub fn measurements(data: &[u8]) {
    let _ = kinds_of_file(data);
}

/// Returns the kinds of file that the bytes are; each reader gets them.
#[must_use]
pub fn kinds_of_file(data: &[u8]) -> Vec<&'static str> {
    let between = data
        .windows(BETWEEN.len())
        .position(|window| window == BETWEEN.as_bytes());
    let (setup, table) = match between {
        Some(at) => (&data[..=at], &data[at + BETWEEN.len()..]),
        None => (data, &[][..]),
    };
    let Ok(setup) = std::str::from_utf8(setup) else {
        return Vec::new();
    };
    let mut kinds = machine(setup, table, "l2", &[1.0, 2.0, 0.5]);
    kinds.extend(machine(setup, table, "f1", &[1.0, 1.0, 1.0, 0.5, 2.0, 1.0]));
    if let Some(motion) = told(frame::parse(Path::new(SETUP), setup)) {
        is_motion(&motion);
        kinds.push("frame");
    }
    kinds
}

/// As files of one machine.
fn machine<const N: usize>(
    setup: &str,
    table: &[u8],
    model: &str,
    metres_per_q: &[f64; N],
) -> Vec<&'static str> {
    let path = Path::new(SETUP);
    let mut kinds = Vec::new();
    if let Some(gauges) = told(springs::parse_gauges(path, setup, metres_per_q)) {
        are_gauges(&gauges, N);
        kinds.push("gauges");
    }
    if let Some(setup) = told(springs::parse_setup(path, setup, model, metres_per_q)) {
        is_setup(&setup, N);
        if let Some(campaign) = told(springs::campaign(
            setup.clone(),
            Path::new(TABLE),
            table,
            metres_per_q,
        )) {
            is_campaign(&campaign);
            kinds.push("springs");
        }
        if let Some(plan) = told(plan::of(path, setup, metres_per_q)) {
            is_plan(&plan);
            kinds.push("plan");
        }
    }
    if let Some(poses) = told(poses::parse::<N>(path, setup, model, table)) {
        are_poses(&poses);
        kinds.push("poses");
    }
    if let Some(readings) = told(tool::parse::<N>(path, setup, model, table)) {
        assert!(!readings.readings.is_empty() && readings.readings.len() <= MAX_ROWS);
        for reading in &readings.readings {
            let Wrench { force_n, moment_nm } = reading.raw;
            assert!(
                within(&reading.q, FARTHEST) && within(force_n.as_slice(), STRONGEST),
                "{reading:?}"
            );
            assert!(within(moment_nm.as_slice(), STRONGEST), "{reading:?}");
        }
        kinds.push("tool");
    }
    if let Some((plan, noise)) = told(PosesPlan::parse(path, setup, model)) {
        is_noise(&noise);
        for pose in &plan.poses {
            is_pose(&pose.pose());
            assert!(within(&pose.q, FARTHEST), "{pose:?}");
        }
        kinds.push("plan_of_poses");
    }
    kinds
}

fn told<T>(read: Result<T, FileError>) -> Option<T> {
    let error = match read {
        Ok(value) => return Some(value),
        Err(error) => error,
    };
    let line = error.to_string();
    assert!(!error.file.is_empty(), "an error names a file: {line}");
    assert!(!error.reason.is_empty(), "an error says why: {line}");
    assert!(!line.contains(['\n', '\r']), "one line: {line}");
    None
}

/// NaN is not within.
fn within(numbers: &[f64], most: f64) -> bool {
    numbers.iter().all(|number| number.abs() <= most)
}

fn is_unit(direction: &Vector3<f64>) {
    let off = (direction.norm() - 1.0).abs();
    assert!(off <= ROUNDED, "a unit vector: {direction:?}");
}

fn is_pose(pose: &Pose) {
    assert!(within(pose.position_m.as_slice(), FARTHEST), "{pose:?}");
    assert!(rotation_deviation(&pose.rotation) <= UNIT, "{pose:?}");
}

fn is_motion(motion: &Isometry3<f64>) {
    // From a corner of one cube to any place of the other, which may be turned.
    assert!(
        within(
            motion.translation.vector.as_slice(),
            2.0 * 3.0_f64.sqrt() * FARTHEST
        ),
        "{motion:?}"
    );
    is_quaternion(motion.rotation.coords.as_slice());
}

fn is_quaternion(quaternion: &[f64]) {
    let norm = quaternion
        .iter()
        .map(|part| part * part)
        .sum::<f64>()
        .sqrt();
    let off = (norm - 1.0).abs();
    assert!(off <= ROUNDED, "a unit quaternion: {quaternion:?}");
}

fn are_gauges(gauges: &[NamedGauge], axes: usize) {
    assert!(gauges.len() <= MAX_GAUGES, "{} gauges", gauges.len());
    for NamedGauge { name, gauge } in gauges {
        assert_eq!(
            gauges.iter().filter(|other| other.name == *name).count(),
            1,
            "duplicate name {name:?}"
        );
        match gauge {
            Gauge::Face { point_m, axis, .. } => {
                assert!(within(point_m.as_slice(), REACH_M), "{point_m:?}");
                is_unit(axis);
            }
            Gauge::Axis { axis, metres_per_q } => {
                assert!(*axis < axes && metres_per_q.is_finite(), "{gauge:?}")
            }
        }
    }
}

fn is_setup(setup: &Setup, axes: usize) {
    are_gauges(&setup.gauges, axes);
    setup.poses.iter().for_each(|(_, pose)| is_pose(pose));
    for series in &setup.plan {
        assert!(
            within(&series.wrist_rad, springs::MAX_TURN_RAD),
            "{series:?}"
        );
    }
    let noise = setup
        .noise
        .map(|noise| [noise.gauge_um, noise.force_n, noise.moment_nm]);
    let known = setup.setup.unwrap_or_default();
    let known = [
        known.gauge_point_mm,
        known.gauge_axis_mrad,
        known.sensor_lever_mm,
        known.sensor_axes_mrad,
        known.sensor_gain,
    ];
    let mut deviations = noise
        .into_iter()
        .flatten()
        .chain(known.into_iter().flatten());
    assert!(
        deviations.all(|deviation| SPREAD.contains(&deviation)),
        "{noise:?} {known:?}"
    );
}

fn is_campaign<const N: usize>(campaign: &Campaign<N>) {
    assert!(
        (1..=MAX_ROWS).contains(&campaign.windows.len()),
        "{} windows",
        campaign.windows.len()
    );
    let mut of_series = vec![None; campaign.series.len()];
    for window in &campaign.windows {
        assert!(
            window.mounting < campaign.mountings.len() && window.pose < campaign.poses.len(),
            "{window:?}"
        );
        let place = (window.mounting, window.pose);
        assert_eq!(
            *of_series[window.series].get_or_insert(place),
            place,
            "one mounting and one pose: {window:?}"
        );
        assert!((-1..=1).contains(&window.stroke), "{window:?}");
        assert!(within(&window.q, FARTHEST), "{window:?}");
        assert!(within(window.load.as_slice(), STRONGEST), "{window:?}");
        assert!(within(window.pushes_n.as_slice(), STRONGEST), "{window:?}");
        assert!(
            window.time_s.is_none_or(|time_s| time_s.abs() <= 1e9),
            "{window:?}"
        );
        assert_eq!(
            [window.readings_m.len(), window.sds_m.len()],
            [campaign.gauges.len(); 2],
            "{window:?}"
        );
        assert!(
            window
                .readings_m
                .iter()
                .flatten()
                .all(|reading| reading.abs() <= MAX_M),
            "{window:?}"
        );
        assert!(
            window
                .sds_m
                .iter()
                .flatten()
                .all(|sd| *sd > 0.0 && *sd <= MAX_M),
            "{window:?}"
        );
    }
    assert!(
        of_series.iter().all(Option::is_some),
        "a series has windows"
    );
}

fn is_plan<const N: usize>(plan: &Plan<N>) {
    let windows: usize = plan.series.iter().map(|series| series.levels_n.len()).sum();
    assert!((1..=MAX_ROWS).contains(&windows), "{windows} windows");
    for series in &plan.series {
        assert!(
            series.pose < plan.poses.len() && series.mounting < plan.mountings.len(),
            "{series:?}"
        );
        assert!(within(series.hook_m.as_slice(), REACH_M), "{series:?}");
        is_unit(&series.direction);
        assert!(
            series
                .levels_n
                .iter()
                .all(|level| (0.0..=STRONGEST).contains(level)),
            "{series:?}"
        );
        assert_eq!(series.strokes().len(), series.levels_n.len(), "{series:?}");
        assert!(
            (1..=plan.gauges.len()).contains(&series.gauges.len()),
            "{series:?}"
        );
        assert!(
            series.gauges.iter().all(|gauge| *gauge < plan.gauges.len()),
            "{series:?}"
        );
    }
}

fn is_noise(noise: &poses::PoseNoise) {
    is_covariance(&noise.position_m2);
    if let Some(rotation_rad2) = &noise.rotation_rad2 {
        is_covariance(rotation_rad2);
    }
}

fn is_covariance(covariance: &Matrix3<f64>) {
    assert!(covariance.cholesky().is_some(), "positive: {covariance:?}");
    assert!(
        covariance
            .diagonal()
            .iter()
            .all(|variance| VARIANCE.contains(variance)),
        "{covariance:?}"
    );
    assert!(
        within(covariance.as_slice(), *VARIANCE.end()),
        "{covariance:?}"
    );
}

fn are_poses<const N: usize>(poses: &Poses<N>) {
    is_noise(&poses.noise);
    assert!(
        (1..=MAX_ROWS).contains(&poses.poses.len()),
        "{} poses",
        poses.poses.len()
    );
    for pose in &poses.poses {
        assert!(
            within(&pose.q, FARTHEST) && within(pose.position_m.as_slice(), FARTHEST),
            "{pose:?}"
        );
        if let Some(rotation) = &pose.rotation {
            is_quaternion(rotation.coords.as_slice());
        }
    }
}
