//! Set-ups: noise, poses, gauges, and the series of a plan.

use std::path::Path;

use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::linalg::rotation_deviation;
use gantry_tau_machine::elastic::gauge::{Body, Gauge};
use gantry_tau_machine::robot_file::matrix;
use gantry_tau_server::links::gauges::MAX_GAUGES;
use gantry_tau_system::output::Name;
use nalgebra::{Matrix3, Vector3, Vector6};
use serde::{Deserialize, Serialize};

use super::{FORMAT, FileError, MAX_TURN_RAD, NOISE, setup};

/// `format = "gantry-tau springs 1"`.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SpringsFile {
    pub(super) format: String,
    pub(super) model: String,
    pub(super) measurements: String,
    pub(super) noise: Option<Noise>,
    pub(super) setup: Option<SetupNoise>,
    pub(super) pose: Vec<PoseEntry>,
    pub(super) gauge: Vec<GaugeEntry>,
    /// Of a plan.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) series: Vec<SeriesEntry>,
}

/// `[noise]`: standard deviations of the mean of a window.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Noise {
    /// Of a gauge, µm.
    pub gauge_um: f64,
    /// Of each component of the force, N.
    pub force_n: f64,
    /// Of each component of the moment, N m.
    pub moment_nm: f64,
}

impl Noise {
    /// Noise of good instruments: a gauge that repeats to a micrometre, forces to a newton.
    pub const USUAL: Self = Self {
        gauge_um: 1.0,
        force_n: 1.0,
        moment_nm: 0.05,
    };

    /// Variances of a load's components: N^2, (N m)^2.
    #[must_use]
    pub fn load_variances(&self) -> Vector6<f64> {
        let force = self.force_n.powi(2);
        let moment = self.moment_nm.powi(2);
        Vector6::new(force, force, force, moment, moment, moment)
    }
}

/// `[setup]`: standard deviations of what is known of the set-up. A key that is absent is exact.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct SetupNoise {
    /// Each coordinate of the point that a gauge touches, per mounting, mm.
    pub gauge_point_mm: Option<f64>,
    /// Each turn of a gauge's direction, per mounting, mrad.
    pub gauge_axis_mrad: Option<f64>,
    /// Each coordinate of the sensor's origin, mm.
    pub sensor_lever_mm: Option<f64>,
    /// Each turn of the sensor's axes, mrad.
    pub sensor_axes_mrad: Option<f64>,
    /// Each of the sensor's six gains, relative.
    pub sensor_gain: Option<f64>,
}

/// `[[pose]]`.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PoseEntry {
    pub(super) name: Name,
    #[serde(rename = "T")]
    pub(super) position_m: [f64; 3],
    #[serde(rename = "R", default = "identity")]
    pub(super) rotation: [[f64; 3]; 3],
}

const fn identity() -> [[f64; 3]; 3] {
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
}

/// `[[gauge]]`.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct GaugeEntry {
    pub(super) name: Name,
    pub(super) on: String,
    pub(super) point_m: Option<[f64; 3]>,
    pub(super) axis: Option<[f64; 3]>,
    pub(super) axis_number: Option<usize>,
}

/// `[[series]]` of a plan.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SeriesEntry {
    /// Its name.
    pub name: Name,
    /// Pose of the machine, by its name.
    pub pose: Name,
    /// Mounting of strap and gauges, by its name.
    pub mounting: Name,
    /// Hook of the strap, from the tool centre point, world axes, m.
    pub hook_m: [f64; 3],
    /// Direction of its pull, world axes.
    pub direction: [f64; 3],
    /// Forces, in order, N.
    pub levels_n: Vec<f64>,
    /// Gauges that are read, by their names.
    pub gauges: Vec<Name>,
    /// True if compensation runs meanwhile.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub compensated: bool,
    /// Angles of the wrist's joints, rad, from the platform to the tool; absent: all at zero.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub wrist_rad: Vec<f64>,
}

/// A gauge with its name.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedGauge {
    /// Its name: the column `NAME_um`.
    pub name: Name,
    /// The gauge.
    pub gauge: Gauge,
}

/// Checks angles of a wrist with `joints` joints, series by series: none, or one per joint.
pub(in crate::measurements) fn check_wrist<'a>(
    path: &Path,
    mut series: impl Iterator<Item = (&'a str, &'a [f64])>,
    joints: usize,
) -> Result<(), FileError> {
    let wrong = series.find(|(_, angles)| ![0, joints].contains(&angles.len()));
    let Some((name, angles)) = wrong else {
        return Ok(());
    };
    let reason = format!(
        "has {} angles, and the robot file has {joints} [[wrist]] joints",
        angles.len()
    );
    Err(FileError::key(
        path,
        format!("series.{name}.wrist_rad"),
        reason,
    ))
}

/// A set-up: what is to be measured, or was.
#[derive(Clone, Debug, PartialEq)]
pub struct Setup {
    /// Table of the measurements, as the set-up names it.
    pub measurements: String,
    /// Noise of a window; absent: [`Noise::USUAL`], and scaled by what a fit leaves.
    pub noise: Option<Noise>,
    /// Uncertainty of the set-up.
    pub setup: Option<SetupNoise>,
    /// Poses, with their names.
    pub poses: Vec<(Name, Pose)>,
    /// Gauges.
    pub gauges: Vec<NamedGauge>,
    /// The series to measure, if the set-up is a plan.
    pub plan: Vec<SeriesEntry>,
}

/// Reads a set-up without its table, for a machine of `model` whose axes are `metres_per_q` long.
///
/// # Errors
/// [`FileError`].
pub fn read_setup<const N: usize>(
    path: &Path,
    model: &str,
    metres_per_q: &[f64; N],
) -> Result<Setup, FileError> {
    parse_setup(path, &setup::text(path)?, model, metres_per_q)
}

/// As [`read_setup`], of a text; `path` names it.
///
/// # Errors
/// [`FileError`].
pub fn parse_setup<const N: usize>(
    path: &Path,
    text: &str,
    model: &str,
    metres_per_q: &[f64; N],
) -> Result<Setup, FileError> {
    let file: SpringsFile = setup::parse(path, text)?;
    if file.format != FORMAT {
        let reason = format!("is {:?}; expected {FORMAT:?}", file.format);
        return Err(FileError::key(path, "format", reason));
    }
    if file.model != model {
        let reason = format!("is {:?}, and the robot file's is {model:?}", file.model);
        return Err(FileError::key(path, "model", reason));
    }
    checked(file, metres_per_q).map_err(|(key, reason)| FileError::key(path, key, reason))
}

fn checked<const N: usize>(file: SpringsFile, metres_per_q: &[f64; N]) -> Result<Setup, Refused> {
    check_noise(&file)?;
    // `contains` refuses NaN.
    if let Some(entry) = file.series.iter().find(|entry| {
        let mut angles = entry.wrist_rad.iter();
        !angles.all(|angle| (-MAX_TURN_RAD..=MAX_TURN_RAD).contains(angle))
    }) {
        return Err((
            format!("series.{}.wrist_rad", entry.name),
            "is beyond a turn; it is in radians".to_owned(),
        ));
    }
    let poses = poses(&file.pose)?;
    let gauges = gauges(&file.gauge, metres_per_q)?;
    let SpringsFile {
        measurements,
        noise,
        setup,
        series,
        ..
    } = file;
    Ok(Setup {
        measurements,
        noise,
        setup,
        poses,
        gauges,
        plan: series,
    })
}

pub(in crate::measurements) type Refused = (String, String);

fn check_noise(file: &SpringsFile) -> Result<(), Refused> {
    let Noise {
        gauge_um,
        force_n,
        moment_nm,
    } = file.noise.unwrap_or(Noise::USUAL);
    let noise = [
        ("noise.gauge_um", gauge_um),
        ("noise.force_n", force_n),
        ("noise.moment_nm", moment_nm),
    ];
    let setup = file.setup.unwrap_or_default();
    let setup = [
        ("setup.gauge_point_mm", setup.gauge_point_mm),
        ("setup.gauge_axis_mrad", setup.gauge_axis_mrad),
        ("setup.sensor_lever_mm", setup.sensor_lever_mm),
        ("setup.sensor_axes_mrad", setup.sensor_axes_mrad),
        ("setup.sensor_gain", setup.sensor_gain),
    ];
    let setup = setup
        .into_iter()
        .filter_map(|(key, value)| Some((key, value?)));
    let (least, most) = NOISE;
    match noise
        .into_iter()
        .chain(setup)
        .find(|(_, value)| !(least..=most).contains(value))
    {
        Some((key, value)) => Err((
            key.to_owned(),
            format!("{value} is not from {least:e} to {most:e}"),
        )),
        None => Ok(()),
    }
}

fn poses(entries: &[PoseEntry]) -> Result<Vec<(Name, Pose)>, Refused> {
    let mut poses: Vec<(Name, Pose)> = Vec::new();
    for entry in entries {
        let is_duplicate = poses.iter().any(|(name, _)| *name == entry.name);
        let pose = pose(entry, is_duplicate)
            .map_err(|(key, reason)| (format!("pose.{}.{key}", entry.name), reason.to_owned()))?;
        poses.push((entry.name.clone(), pose));
    }
    Ok(poses)
}

fn pose(entry: &PoseEntry, is_duplicate: bool) -> Result<Pose, (&'static str, &'static str)> {
    if is_duplicate {
        return Err(("name", "is a duplicate name"));
    }
    let rotation: Matrix3<f64> = matrix(entry.rotation);
    if rotation_deviation(&rotation) > 1e-6 {
        return Err(("R", "is not a rotation matrix"));
    }
    if !entry
        .position_m
        .iter()
        .all(|coordinate| coordinate.abs() <= 1e3)
    {
        return Err(("T", "is not within a kilometre; it is in metres"));
    }
    Ok(Pose {
        position_m: entry.position_m.into(),
        rotation,
    })
}

pub(super) fn gauges<const N: usize>(
    entries: &[GaugeEntry],
    metres_per_q: &[f64; N],
) -> Result<Vec<NamedGauge>, Refused> {
    if entries.len() > MAX_GAUGES {
        return Err((
            "gauge".to_owned(),
            format!("has {} entries; {MAX_GAUGES} are possible", entries.len()),
        ));
    }
    let mut gauges: Vec<NamedGauge> = Vec::new();
    for entry in entries {
        let is_duplicate = gauges.iter().any(|gauge| gauge.name == entry.name);
        let gauge = gauge(entry, is_duplicate, metres_per_q)
            .map_err(|(key, reason)| (format!("gauge.{}.{key}", entry.name), reason))?;
        gauges.push(NamedGauge {
            name: entry.name.clone(),
            gauge,
        });
    }
    Ok(gauges)
}

/// A key of an entry, and what is wrong with it.
type RefusedKey = (&'static str, String);

fn gauge<const N: usize>(
    entry: &GaugeEntry,
    is_duplicate: bool,
    metres_per_q: &[f64; N],
) -> Result<Gauge, RefusedKey> {
    if is_duplicate {
        return Err(("name", "duplicate name".to_owned()));
    }
    match (
        entry.on.as_str(),
        entry.point_m,
        entry.axis,
        entry.axis_number,
    ) {
        ("platform", Some(point_m), Some(axis), None) => face(Body::Platform, point_m, axis),
        ("tool", Some(point_m), Some(axis), None) => face(Body::Tool, point_m, axis),
        ("axis", None, None, Some(number)) => {
            let axis = number.checked_sub(1);
            let Some((axis, metres_per_q)) =
                axis.and_then(|axis| Some((axis, *metres_per_q.get(axis)?)))
            else {
                let reason = format!("is {number}; the machine has axes 1 to {N}");
                return Err(("axis_number", reason));
            };
            Ok(Gauge::Axis { axis, metres_per_q })
        }
        ("platform" | "tool", ..) => {
            let reason = "a gauge on the platform or the tool has point_m and axis";
            Err(("on", reason.to_owned()))
        }
        ("axis", ..) => Err(("on", "a gauge on an axis has axis_number".to_owned())),
        (other, ..) => {
            let reason = format!("is {other:?}; \"platform\", \"tool\" or \"axis\" are possible");
            Err(("on", reason))
        }
    }
}

/// Gauge that touches a face of a body.
fn face(body: Body, point_m: [f64; 3], axis: [f64; 3]) -> Result<Gauge, RefusedKey> {
    let axis = Vector3::from(axis);
    // `contains` refuses NaN.
    if !(1.0 - 1e-6..=1.0 + 1e-6).contains(&axis.norm()) {
        return Err(("axis", format!("has length {}, not 1", axis.norm())));
    }
    if !point_m.iter().all(|coordinate| coordinate.abs() <= 10.0) {
        let reason = "is more than 10 m away; it is in metres";
        return Err(("point_m", reason.to_owned()));
    }
    Ok(Gauge::Face {
        body,
        point_m: point_m.into(),
        axis: axis.normalize(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(position_m: [f64; 3], turn_rad: f64) -> Option<String> {
        let (sine, cosine) = turn_rad.sin_cos();
        let rotation = [[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]];
        let entry = PoseEntry {
            name: Name::made("home"),
            position_m,
            rotation,
        };
        poses(&[entry])
            .err()
            .map(|(key, reason)| format!("{key}: {reason}"))
    }

    fn entry(name: &str) -> PoseEntry {
        PoseEntry {
            name: Name::made(name),
            position_m: [0.0; 3],
            rotation: identity(),
        }
    }

    fn gauges_of(count: usize) -> Result<Vec<NamedGauge>, Refused> {
        let entries: Vec<GaugeEntry> = (0..count)
            .map(|index| {
                let text = format!("name = \"g{index}\"\non = \"axis\"\naxis_number = 1\n");
                toml::from_str(&text).unwrap()
            })
            .collect();
        gauges(&entries, &[1.0; 3])
    }

    #[test]
    fn a_pose_is_within_a_kilometre_and_has_a_name_of_its_own() {
        assert_eq!(refused([1e3, -1e3, 0.5], 0.3), None);
        for far in [
            [1_000.1, 0.0, 0.0],
            [0.0, -1_000.1, 0.0],
            [0.0, 0.0, f64::NAN],
        ] {
            assert_eq!(
                refused(far, 0.3).unwrap(),
                "pose.home.T: is not within a kilometre; it is in metres"
            );
        }
        assert_eq!(poses(&[entry("a"), entry("b")]).unwrap().len(), 2);
        assert_eq!(
            poses(&[entry("a"), entry("b"), entry("a")]).unwrap_err().0,
            "pose.a.name"
        );
        let mut mirrored = entry("a");
        mirrored.rotation[2][2] = -1.0;
        assert_eq!(
            poses(&[mirrored]).unwrap_err().1,
            "is not a rotation matrix"
        );
    }

    #[test]
    fn a_set_up_has_sixteen_gauges_at_most() {
        assert_eq!(gauges_of(MAX_GAUGES).unwrap().len(), 16);
        let (key, reason) = gauges_of(MAX_GAUGES + 1).unwrap_err();
        assert_eq!(
            (&*key, &*reason),
            ("gauge", "has 17 entries; 16 are possible")
        );
        assert!(gauges_of(MAX_GAUGES + 2).is_err());
    }
}
