//! Campaigns of forces and gauges: windows of a load, and what the gauges showed.

use std::collections::HashMap;
use std::path::Path;

use nalgebra::{Matrix3, SVector, Vector3, Vector6};
use serde::{Deserialize, Serialize};

use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::linalg::rotation_deviation;

use super::plan::before_remount;
use super::table::{self, Row, Table};
use super::{FileError, setup};
use crate::robot_file::matrix;
use crate::springs::gauge::{Body, Gauge};

mod plan;

pub use plan::{parse_gauges, read_gauges};

/// First line of a set-up.
pub const FORMAT: &str = "gantry-tau springs 1";
/// Largest number of gauges.
pub const MAX_GAUGES: usize = 16;
/// Largest position of an axis, q-units; reading, µm; force, N; moment, N m; time, s.
pub(crate) const MOST: [f64; 5] = [1e3, 2e4, 1e5, 1e5, 1e9];
/// Largest angle of a wrist's joint, rad: a turn.
pub const MOST_TURNED_RAD: f64 = std::f64::consts::TAU;
/// Range of a standard deviation, in the unit of its key.
pub(super) const NOISE: (f64, f64) = (1e-6, 1e6);

/// `format = "gantry-tau springs 1"`.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct SetupFile {
    format: String,
    model: String,
    measurements: String,
    noise: Option<Noise>,
    setup: Option<SetupNoise>,
    pose: Vec<PoseEntry>,
    gauge: Vec<GaugeEntry>,
    /// Of a plan.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    series: Vec<SeriesEntry>,
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
    pub const USUAL: Self = Self { gauge_um: 1.0, force_n: 1.0, moment_nm: 0.05 };

    /// Variances of a load's components: N^2, (N m)^2.
    #[must_use]
    pub fn load_variances(&self) -> Vector6<f64> {
        let (force, moment) = (self.force_n.powi(2), self.moment_nm.powi(2));
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
struct PoseEntry {
    name: String,
    #[serde(rename = "T")]
    position_m: [f64; 3],
    #[serde(rename = "R", default = "identity")]
    rotation: [[f64; 3]; 3],
}

const fn identity() -> [[f64; 3]; 3] {
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
}

/// `[[gauge]]`.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct GaugeEntry {
    name: String,
    on: String,
    point_m: Option<[f64; 3]>,
    axis: Option<[f64; 3]>,
    axis_number: Option<usize>,
}

/// `[[series]]` of a plan.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SeriesEntry {
    /// Its name.
    pub name: String,
    /// Pose of the machine, by its name.
    pub pose: String,
    /// Mounting of strap and gauges, by its name.
    pub mounting: String,
    /// Where the strap pulls, from the tool centre point, world axes, m.
    pub hook_m: [f64; 3],
    /// Direction of its pull, world axes.
    pub direction: [f64; 3],
    /// Forces, in order, N.
    pub levels_n: Vec<f64>,
    /// Gauges that are read, by their names.
    pub gauges: Vec<String>,
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
    pub name: String,
    /// The gauge.
    pub gauge: Gauge,
}

/// One window.
#[derive(Clone, Debug, PartialEq)]
pub struct Window<const N: usize> {
    /// Line of the table.
    pub line: u64,
    /// Series, by index: one mounting of strap and gauges, whose zeros are its own.
    pub series: usize,
    /// Mounting, by index.
    pub mounting: usize,
    /// Pose, by index.
    pub pose: usize,
    /// Name or number of the window in its series.
    pub window: String,
    /// 1 rising, -1 falling, 0 start.
    pub stroke: i8,
    /// Positions of the axes, q-units.
    pub q: [f64; N],
    /// Load on the platform, about the tool centre point where it is, world axes, tared; N, N m.
    pub load: Vector6<f64>,
    /// Loads on the axes, newtons along `+q`.
    pub pushes_n: SVector<f64, N>,
    /// Readings, m, gauge by gauge.
    pub readings_m: Vec<Option<f64>>,
    /// Standard deviations of the readings, m, where the table has its own.
    pub sds_m: Vec<Option<f64>>,
    /// Time, s.
    pub time_s: Option<f64>,
}

/// A campaign.
#[derive(Clone, Debug, PartialEq)]
pub struct Campaign<const N: usize> {
    /// Path of the table, as messages name it.
    pub table: String,
    /// CRC-32 of the table.
    pub crc: u32,
    /// Length of each axis per unit of `q`, m.
    pub metres_per_q: [f64; N],
    /// Noise of a window.
    pub noise: Noise,
    /// False if the set-up states none: then [`Noise::USUAL`], which is good for ratios only.
    pub is_noise_stated: bool,
    /// What is known of the set-up.
    pub setup: SetupNoise,
    /// Poses, with their names.
    pub poses: Vec<(String, Pose)>,
    /// Gauges.
    pub gauges: Vec<NamedGauge>,
    /// Names of the series.
    pub series: Vec<String>,
    /// Names of the mountings.
    pub mountings: Vec<String>,
    /// The windows.
    pub windows: Vec<Window<N>>,
    /// The plan, if the set-up is one.
    pub plan: Vec<SeriesEntry>,
}

impl<const N: usize> Campaign<N> {
    /// Puts a campaign together from a set-up, the path and CRC-32 of its table, and names of series and mountings.
    pub(crate) fn of(
        setup: Setup,
        table: &Path,
        crc: u32,
        metres_per_q: &[f64; N],
        [series, mountings]: [Vec<String>; 2],
        windows: Vec<Window<N>>,
    ) -> Self {
        let Setup { noise, setup, poses, gauges, plan, .. } = setup;
        Self {
            table: table.display().to_string(),
            crc,
            metres_per_q: *metres_per_q,
            noise: noise.unwrap_or(Noise::USUAL),
            is_noise_stated: noise.is_some(),
            setup: setup.unwrap_or_default(),
            poses,
            gauges,
            series,
            mountings,
            windows,
            plan,
        }
    }

    /// Angles of the wrist in a series, by its name or by that of the series of the plan that it is mounted anew of; rad. Empty: at zero.
    #[must_use]
    pub fn wrist_rad(&self, series: &str) -> &[f64] {
        let planned = |name: &str| self.plan.iter().find(|entry| entry.name == name);
        planned(series).or_else(|| planned(before_remount(series))).map_or(&[], |entry| &entry.wrist_rad)
    }

    /// Checks that the angles of the wrist are those of a wrist with `joints` joints; `path` names the set-up.
    ///
    /// # Errors
    /// [`FileError`], naming the series.
    pub fn check_wrist(&self, path: &Path, joints: usize) -> Result<(), FileError> {
        check_wrist(path, self.plan.iter().map(|entry| (&*entry.name, &*entry.wrist_rad)), joints)
    }

    /// Returns an error about a column of a window.
    #[must_use]
    pub fn error(&self, window: &Window<N>, column: &str, reason: impl std::fmt::Display) -> FileError {
        FileError::at(&self.table, window.line, column, reason)
    }
}

/// Checks angles of a wrist with `joints` joints, series by series: none, or one per joint.
pub(super) fn check_wrist<'a>(
    path: &Path,
    mut series: impl Iterator<Item = (&'a str, &'a [f64])>,
    joints: usize,
) -> Result<(), FileError> {
    let wrong = series.find(|(_, angles)| ![0, joints].contains(&angles.len()));
    let Some((name, angles)) = wrong else { return Ok(()) };
    let reason = format!("has {} angles, and the robot file has {joints} [[wrist]] joints", angles.len());
    Err(FileError::key(path, format!("series.{name}.wrist_rad"), reason))
}

/// A set-up: what is to be measured, or was.
#[derive(Clone, Debug, PartialEq)]
pub struct Setup {
    /// Table of the measurements, as the set-up names it.
    pub measurements: String,
    /// Noise of a window; absent: [`Noise::USUAL`], and scaled by what a fit leaves.
    pub noise: Option<Noise>,
    /// What is known of the set-up.
    pub setup: Option<SetupNoise>,
    /// Poses, with their names.
    pub poses: Vec<(String, Pose)>,
    /// Gauges.
    pub gauges: Vec<NamedGauge>,
    /// The series to measure, if the set-up is a plan.
    pub plan: Vec<SeriesEntry>,
}

/// Reads a set-up without its table, for a machine of `model` whose axes are `metres_per_q` long.
///
/// # Errors
/// [`FileError`].
pub fn read_setup<const N: usize>(path: &Path, model: &str, metres_per_q: &[f64; N]) -> Result<Setup, FileError> {
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
    let file: SetupFile = setup::parse(path, text)?;
    let refused = |key: &str, reason: String| FileError::key(path, key, reason);
    if file.format != FORMAT {
        return Err(refused("format", format!("is {:?}; this program reads {FORMAT:?}", file.format)));
    }
    if file.model != model {
        return Err(refused("model", format!("is {:?}, and the robot file's is {model:?}", file.model)));
    }
    check_noise(&file).map_err(|(key, reason)| refused(&key, reason))?;
    // `contains` refuses NaN.
    let is_turn = |angle: &f64| (-MOST_TURNED_RAD..=MOST_TURNED_RAD).contains(angle);
    if let Some(entry) = file.series.iter().find(|entry| !entry.wrist_rad.iter().all(is_turn)) {
        return Err(refused(
            &format!("series.{}.wrist_rad", entry.name),
            "is beyond a turn; it is in radians".to_owned(),
        ));
    }
    let poses = poses(&file.pose).map_err(|(key, reason)| refused(&key, reason))?;
    let gauges = gauges(&file.gauge, metres_per_q).map_err(|(key, reason)| refused(&key, reason))?;
    let SetupFile { measurements, noise, setup, series, .. } = file;
    Ok(Setup { measurements, noise, setup, poses, gauges, plan: series })
}

/// Reads a set-up and its table, for a machine of `model` whose axes are `metres_per_q` long.
///
/// # Errors
/// [`FileError`].
pub fn read<const N: usize>(path: &Path, model: &str, metres_per_q: &[f64; N]) -> Result<Campaign<N>, FileError> {
    let setup = read_setup(path, model, metres_per_q)?;
    let table = setup::beside(path, &setup.measurements);
    campaign(setup, &table, &table::bytes(&table)?, metres_per_q)
}

/// Reads a set-up, and another table than it names.
///
/// # Errors
/// [`FileError`].
pub fn read_table<const N: usize>(
    path: &Path,
    table: &Path,
    model: &str,
    metres_per_q: &[f64; N],
) -> Result<Campaign<N>, FileError> {
    campaign(read_setup(path, model, metres_per_q)?, table, &table::bytes(table)?, metres_per_q)
}

/// Reads the bytes of the table of a set-up, for a machine whose axes are `metres_per_q` long; `table` names it.
///
/// # Errors
/// [`FileError`].
pub fn campaign<const N: usize>(
    setup: Setup,
    table: &Path,
    bytes: &[u8],
    metres_per_q: &[f64; N],
) -> Result<Campaign<N>, FileError> {
    let mut reader =
        Windows { poses: &setup.poses, gauges: &setup.gauges, series: Names::default(), mountings: Names::default() };
    let windows = reader.read::<N>(table, bytes)?;
    let names = [reader.series.names, reader.mountings.names];
    Ok(Campaign::of(setup, table, crc32fast::hash(bytes), metres_per_q, names, windows))
}

pub(super) type Refused = (String, String);

fn check_noise(file: &SetupFile) -> Result<(), Refused> {
    let Noise { gauge_um, force_n, moment_nm } = file.noise.unwrap_or(Noise::USUAL);
    let noise = [("noise.gauge_um", gauge_um), ("noise.force_n", force_n), ("noise.moment_nm", moment_nm)];
    let setup = file.setup.unwrap_or_default();
    let setup = [
        ("setup.gauge_point_mm", setup.gauge_point_mm),
        ("setup.gauge_axis_mrad", setup.gauge_axis_mrad),
        ("setup.sensor_lever_mm", setup.sensor_lever_mm),
        ("setup.sensor_axes_mrad", setup.sensor_axes_mrad),
        ("setup.sensor_gain", setup.sensor_gain),
    ];
    let setup = setup.into_iter().filter_map(|(key, value)| Some((key, value?)));
    let (least, most) = NOISE;
    match noise.into_iter().chain(setup).find(|(_, value)| !(least..=most).contains(value)) {
        Some((key, value)) => Err((key.to_owned(), format!("{value} is not from {least:e} to {most:e}"))),
        None => Ok(()),
    }
}

fn poses(entries: &[PoseEntry]) -> Result<Vec<(String, Pose)>, Refused> {
    let mut poses: Vec<(String, Pose)> = Vec::new();
    for entry in entries {
        let key = |name: &str| format!("pose.{}.{name}", entry.name);
        if poses.iter().any(|(name, _)| *name == entry.name) {
            return Err((key("name"), "stands twice".to_owned()));
        }
        let rotation: Matrix3<f64> = matrix(entry.rotation);
        if rotation_deviation(&rotation) > 1e-6 {
            return Err((key("R"), "is not a rotation matrix".to_owned()));
        }
        if !entry.position_m.iter().all(|coordinate| coordinate.abs() <= 1e3) {
            return Err((key("T"), "is not within a kilometre; it is in metres".to_owned()));
        }
        poses.push((entry.name.clone(), Pose { position_m: entry.position_m.into(), rotation }));
    }
    Ok(poses)
}

fn gauges<const N: usize>(entries: &[GaugeEntry], metres_per_q: &[f64; N]) -> Result<Vec<NamedGauge>, Refused> {
    if entries.len() > MAX_GAUGES {
        return Err(("gauge".to_owned(), format!("has {} entries; {MAX_GAUGES} are possible", entries.len())));
    }
    let mut gauges: Vec<NamedGauge> = Vec::new();
    for entry in entries {
        let key = |name: &str| format!("gauge.{}.{name}", entry.name);
        if gauges.iter().any(|gauge| gauge.name == entry.name) {
            return Err((key("name"), "stands twice".to_owned()));
        }
        let gauge = match (entry.on.as_str(), entry.point_m, entry.axis, entry.axis_number) {
            (body @ ("platform" | "tool"), Some(point_m), Some(axis), None) => {
                let body = if body == "tool" { Body::Tool } else { Body::Platform };
                let axis = Vector3::from(axis);
                // `contains` refuses NaN.
                if !(1.0 - 1e-6..=1.0 + 1e-6).contains(&axis.norm()) {
                    return Err((key("axis"), format!("has length {}, not 1", axis.norm())));
                }
                if !point_m.iter().all(|coordinate| coordinate.abs() <= 10.0) {
                    return Err((key("point_m"), "is more than 10 m away; it is in metres".to_owned()));
                }
                Gauge::Face { body, point_m: point_m.into(), axis: axis.normalize() }
            }
            ("axis", None, None, Some(number)) => {
                let metres =
                    number.checked_sub(1).and_then(|index| metres_per_q.get(index).map(|metres| (index, metres)));
                let Some((axis, metres_per_q)) = metres else {
                    return Err((key("axis_number"), format!("is {number}; the machine has axes 1 to {N}")));
                };
                Gauge::Axis { axis, metres_per_q: *metres_per_q }
            }
            ("platform" | "tool", ..) => {
                return Err((key("on"), "a gauge on the platform or the tool has point_m and axis".to_owned()));
            }
            ("axis", ..) => return Err((key("on"), "a gauge on an axis has axis_number".to_owned())),
            (other, ..) => {
                return Err((key("on"), format!("is {other:?}; \"platform\", \"tool\" or \"axis\" are possible")));
            }
        };
        gauges.push(NamedGauge { name: entry.name.clone(), gauge });
    }
    Ok(gauges)
}

/// Reads the table of a set-up that is known; each window with the name of its series.
pub(crate) fn windows_of<const N: usize>(
    table: &Path,
    poses: &[(String, Pose)],
    gauges: &[NamedGauge],
) -> Result<Vec<(String, Window<N>)>, FileError> {
    let mut reader = Windows { poses, gauges, series: Names::default(), mountings: Names::default() };
    let windows = reader.read(table, &table::bytes(table)?)?;
    let name = |window: &Window<N>| reader.series.names.get(window.series).cloned().unwrap_or_default();
    Ok(windows.into_iter().map(|window| (name(&window), window)).collect())
}

/// Reader of the table.
struct Windows<'a> {
    poses: &'a [(String, Pose)],
    gauges: &'a [NamedGauge],
    series: Names,
    mountings: Names,
}

/// Names in the order in which they appear.
#[derive(Default)]
struct Names {
    names: Vec<String>,
    places: HashMap<String, usize>,
}

/// First columns, which say where a window belongs.
pub(crate) const WINDOW: [&str; 5] = ["series", "mounting", "pose", "window", "stroke"];
/// Columns of the load.
pub(crate) const LOAD: [&str; 6] = ["force_x_n", "force_y_n", "force_z_n", "moment_x_nm", "moment_y_nm", "moment_z_nm"];

pub(crate) fn axis_columns<const N: usize>() -> [String; N] {
    std::array::from_fn(|axis| format!("q_{}", axis + 1))
}

impl Windows<'_> {
    fn read<const N: usize>(&mut self, path: &Path, bytes: &[u8]) -> Result<Vec<Window<N>>, FileError> {
        let axes = axis_columns::<N>();
        let pushes: [String; N] = std::array::from_fn(|axis| format!("push_{}_n", axis + 1));
        let mut required: Vec<String> = WINDOW.map(str::to_owned).to_vec();
        required.extend(axes.iter().cloned().chain(LOAD.map(str::to_owned)));
        let columns: Vec<[String; 2]> =
            self.gauges.iter().map(|gauge| [format!("{}_um", gauge.name), format!("{}_sd_um", gauge.name)]).collect();
        required.extend(columns.iter().map(|[reading, _]| reading.clone()));
        let known = |column: &str| {
            ["time_s", "samples"].contains(&column)
                || pushes.iter().any(|push| push == column)
                || columns.iter().any(|[_, sd]| sd == column)
        };
        let table = Table::begin(path, bytes, &required, known)?;
        let has_time = table.has("time_s");
        let pushed: Vec<usize> = (0..N).filter(|axis| pushes.get(*axis).is_some_and(|push| table.has(push))).collect();
        let has_sd: Vec<bool> = columns.iter().map(|[_, sd]| table.has(sd)).collect();
        let poses: HashMap<&str, usize> =
            self.poses.iter().enumerate().map(|(index, (name, _))| (name.as_str(), index)).collect();
        let mut seen = HashMap::new();
        table.rows(|row| {
            let [most_q, most_um, most_n, most_nm, most_s] = MOST;
            let series = self.series.index_of(row, "series")?;
            let mounting = self.mountings.index_of(row, "mounting")?;
            let pose_name = row.text("pose");
            let Some(&pose) = poses.get(pose_name) else {
                return Err(row.error("pose", format_args!("{pose_name:?} is not in the set-up")));
            };
            if *seen.entry(series).or_insert((mounting, pose)) != (mounting, pose) {
                return Err(row.error("series", "a series has one mounting and one pose"));
            }
            let mut q = [0.0; N];
            for (q, column) in q.iter_mut().zip(&axes) {
                *q = row.number(column, most_q)?;
            }
            let mut load = Vector6::zeros();
            for (component, (value, column)) in load.iter_mut().zip(LOAD).enumerate() {
                *value = row.number(column, if component < 3 { most_n } else { most_nm })?;
            }
            let mut pushes_n = SVector::<f64, N>::zeros();
            for axis in &pushed {
                if let (Some(push), Some(column)) = (pushes_n.get_mut(*axis), pushes.get(*axis)) {
                    *push = row.number(column, most_n)?;
                }
            }
            let optional = |column: &str, most: f64| match row.text(column) {
                "" => Ok(None),
                _ => row.number(column, most).map(|value| Some(value * 1e-6)),
            };
            let mut readings_m = Vec::with_capacity(columns.len());
            let mut sds_m = Vec::with_capacity(columns.len());
            for ([reading, sd], has_sd) in columns.iter().zip(&has_sd) {
                readings_m.push(optional(reading, most_um)?);
                sds_m.push(if *has_sd { optional(sd, most_um)? } else { None });
                if sds_m.last().is_some_and(|sd| sd.is_some_and(|sd| sd <= 0.0)) {
                    return Err(row.error(sd, "a standard deviation is above 0"));
                }
            }
            let stroke = stroke(row)?;
            let time_s =
                if has_time && !row.text("time_s").is_empty() { Some(row.number("time_s", most_s)?) } else { None };
            let window = row.text("window").to_owned();
            let line = row.line();
            Ok(Window { line, series, mounting, pose, window, stroke, q, load, pushes_n, readings_m, sds_m, time_s })
        })
    }
}

/// Returns the stroke of a row.
pub(crate) fn stroke(row: &Row<'_>) -> Result<i8, FileError> {
    match row.text("stroke") {
        "1" | "+1" => Ok(1),
        "-1" => Ok(-1),
        "0" => Ok(0),
        other => Err(row.error("stroke", format_args!("{other:?} is not 1 (rising), -1 (falling) or 0"))),
    }
}

impl Names {
    /// Returns the index of the name in a column, which is added where it is new.
    fn index_of(&mut self, row: &Row<'_>, column: &str) -> Result<usize, FileError> {
        let name = row.text(column);
        if name.is_empty() {
            return Err(row.error(column, "is empty"));
        }
        if let Some(index) = self.places.get(name) {
            return Ok(*index);
        }
        let index = self.names.len();
        self.names.push(name.to_owned());
        self.places.insert(name.to_owned(), index);
        Ok(index)
    }
}
