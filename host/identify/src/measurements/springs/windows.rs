//! Reader of the table of windows.

use std::collections::HashMap;
use std::path::Path;

use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_system::output::Name;
use nalgebra::{SVector, Vector6};

use super::{FileError, MAX_VALUES, NamedGauge, Window};
use crate::measurements::table::{self, CsvTable, TableRow};

/// Rows of a table, with the names of series and of mountings that they count.
pub(super) struct Read<const N: usize> {
    pub(super) windows: Vec<Window<N>>,
    pub(super) series: Vec<Name>,
    pub(super) mountings: Vec<Name>,
}

/// Reads the bytes of a table; `path` names it.
pub(super) fn read<const N: usize>(
    path: &Path,
    bytes: &[u8],
    poses: &[(Name, Pose)],
    gauges: &[NamedGauge],
) -> Result<Read<N>, FileError> {
    let mut reader = Windows {
        poses,
        gauges,
        series: Names::default(),
        mountings: Names::default(),
    };
    let windows = reader.read(path, bytes)?;
    Ok(Read {
        windows,
        series: reader.series.names,
        mountings: reader.mountings.names,
    })
}

/// Reads the table of a set-up that is known; each window with the name of its series.
pub(crate) fn windows_of<const N: usize>(
    table: &Path,
    poses: &[(Name, Pose)],
    gauges: &[NamedGauge],
) -> Result<Vec<(Name, Window<N>)>, FileError> {
    let Read {
        windows, series, ..
    } = read(table, &table::bytes(table)?, poses, gauges)?;
    Ok(windows
        .into_iter()
        .filter_map(|window| Some((series.get(window.series)?.clone(), window)))
        .collect())
}

/// Reader of the table.
struct Windows<'a> {
    poses: &'a [(Name, Pose)],
    gauges: &'a [NamedGauge],
    series: Names,
    mountings: Names,
}

/// Names in the order in which they appear.
#[derive(Default)]
struct Names {
    names: Vec<Name>,
    places: HashMap<Name, usize>,
}

/// First columns, which say where a window belongs.
pub(crate) const WINDOW: [&str; 5] = ["series", "mounting", "pose", "window", "stroke"];
/// Columns of the load.
pub(crate) const LOAD: [&str; 6] = [
    "force_x_n",
    "force_y_n",
    "force_z_n",
    "moment_x_n_m",
    "moment_y_n_m",
    "moment_z_n_m",
];

pub(crate) fn axis_columns<const N: usize>() -> [String; N] {
    std::array::from_fn(|axis| format!("q_{}", axis + 1))
}

impl Windows<'_> {
    fn read<const N: usize>(
        &mut self,
        path: &Path,
        bytes: &[u8],
    ) -> Result<Vec<Window<N>>, FileError> {
        let axes = axis_columns::<N>();
        let pushes: [String; N] = std::array::from_fn(|axis| format!("push_{}_n", axis + 1));
        let mut required: Vec<String> = WINDOW.map(str::to_owned).to_vec();
        required.extend(axes.iter().cloned().chain(LOAD.map(str::to_owned)));
        let columns: Vec<[String; 2]> = self
            .gauges
            .iter()
            .map(|gauge| {
                [
                    format!("{}_um", gauge.name),
                    format!("{}_sd_um", gauge.name),
                ]
            })
            .collect();
        required.extend(columns.iter().map(|[reading, _]| reading.clone()));
        let table = CsvTable::begin(path, bytes, &required, |column| {
            ["time_s", "samples"].contains(&column)
                || pushes.iter().any(|push| push == column)
                || columns.iter().any(|[_, sd]| sd == column)
        })?;
        let pushed: Vec<usize> = (0..N)
            .filter(|axis| pushes.get(*axis).is_some_and(|push| table.has(push)))
            .collect();

        let poses: HashMap<&str, usize> = self
            .poses
            .iter()
            .enumerate()
            .map(|(index, (name, _))| (&**name, index))
            .collect();
        let mut seen = HashMap::new();
        table.rows(|row| {
            let [max_q, _, max_n, _, max_s] = MAX_VALUES;
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
                *q = row.number(column, max_q)?;
            }
            let load = load(row)?;
            let mut pushes_n = SVector::<f64, N>::zeros();
            for axis in &pushed {
                if let (Some(push), Some(column)) = (pushes_n.get_mut(*axis), pushes.get(*axis)) {
                    *push = row.number(column, max_n)?;
                }
            }
            let mut readings_m = Vec::with_capacity(columns.len());
            let mut sds_m = Vec::with_capacity(columns.len());
            for [reading, sd] in &columns {
                readings_m.push(optional_m(row, reading)?);
                let sd_m = optional_m(row, sd)?;
                if sd_m.is_some_and(|sd_m| sd_m <= 0.0) {
                    return Err(row.error(sd, "a standard deviation is above 0"));
                }
                sds_m.push(sd_m);
            }
            let stroke = stroke(row)?;
            let time_s = row.optional_number("time_s", max_s)?;
            let window = row.name("window")?;
            let line = row.line();
            Ok(Window {
                line,
                series,
                mounting,
                pose,
                window,
                stroke,
                q,
                load,
                pushes_n,
                readings_m,
                sds_m,
                time_s,
            })
        })
    }
}

/// Load of a row.
fn load(row: &TableRow<'_>) -> Result<Vector6<f64>, FileError> {
    let [_, _, max_n, max_nm, _] = MAX_VALUES;
    let mut load = Vector6::zeros();
    for (component, (value, column)) in load.iter_mut().zip(LOAD).enumerate() {
        *value = row.number(column, if component < 3 { max_n } else { max_nm })?;
    }
    Ok(load)
}

/// Number of a column in µm, m; `None` where it is empty or there is no such column.
fn optional_m(row: &TableRow<'_>, column: &str) -> Result<Option<f64>, FileError> {
    let [_, max_um, ..] = MAX_VALUES;
    let value_um = row.optional_number(column, max_um)?;
    Ok(value_um.map(|value_um| value_um * 1e-6))
}

/// Returns the stroke of a row.
pub(crate) fn stroke(row: &TableRow<'_>) -> Result<i8, FileError> {
    match row.text("stroke") {
        "1" | "+1" => Ok(1),
        "-1" => Ok(-1),
        "0" => Ok(0),
        other => Err(row.error(
            "stroke",
            format_args!("{other:?} is not 1 (rising), -1 (falling) or 0"),
        )),
    }
}

impl Names {
    /// Returns the index of the name in a column, which is added where it is new.
    fn index_of(&mut self, row: &TableRow<'_>, column: &str) -> Result<usize, FileError> {
        let name = row.name(column)?;
        if let Some(index) = self.places.get(&name) {
            return Ok(*index);
        }
        let index = self.names.len();
        self.names.push(name.clone());
        self.places.insert(name, index);
        Ok(index)
    }
}
