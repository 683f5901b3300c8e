//! Readings of the force sensor with nothing touching the tool, in several orientations of the
//! platform.

use std::collections::HashSet;
use std::path::Path;

use gantry_tau_core::model::statics::Wrench;
use gantry_tau_system::output::Name;
use serde::Deserialize;

use super::repeated::{self, Column};
use super::springs::{LOAD, MAX_VALUES, NOISE, axis_columns};
use super::table::{self, CsvTable};
use super::{FileError, setup};

/// First line of a set-up.
pub const FORMAT: &str = "gantry-tau tool 1";

/// `format = "gantry-tau tool 1"`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ToolFile {
    format: String,
    model: String,
    measurements: String,
    noise: ReadingNoise,
}

/// `[noise]`: standard deviations of a mean reading.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReadingNoise {
    /// Of each component of the force, N.
    pub force_n: f64,
    /// Of each component of the moment, N m.
    pub moment_nm: f64,
}

/// One mean reading.
#[derive(Clone, Debug, PartialEq)]
pub struct ToolReading<const N: usize> {
    /// Line of the table.
    pub line: u64,
    /// Name of the pose.
    pub name: Name,
    /// Positions of the axes, q-units.
    pub q: [f64; N],
    /// Reading, untared, sensor axes, about the sensor's origin.
    pub raw: Wrench,
}

/// Readings and their noise.
#[derive(Clone, Debug, PartialEq)]
pub struct ToolReadings<const N: usize> {
    /// Path of the table, as messages name it.
    pub table: String,
    /// CRC-32 of the table.
    pub crc: u32,
    /// Noise of a reading.
    pub noise: ReadingNoise,
    /// The readings.
    pub readings: Vec<ToolReading<N>>,
}

impl<const N: usize> ToolReadings<N> {
    /// Returns an error about a column of a reading.
    #[must_use]
    pub fn error(
        &self,
        reading: &ToolReading<N>,
        column: &str,
        reason: impl std::fmt::Display,
    ) -> FileError {
        FileError::at(&self.table, reading.line, column, reason)
    }
}

/// Reads a set-up and its table, for a machine of `model` with `N` axes.
///
/// # Errors
/// [`FileError`].
pub fn read<const N: usize>(path: &Path, model: &str) -> Result<ToolReadings<N>, FileError> {
    let file = parse_setup(path, &setup::text(path)?, model)?;
    let bytes = table::bytes(&setup::beside(path, &file.measurements))?;
    readings(path, file, &bytes)
}

/// As [`read`], of the text of a set-up, which `path` names, and the bytes of its table.
///
/// # Errors
/// [`FileError`].
pub fn parse<const N: usize>(
    path: &Path,
    text: &str,
    model: &str,
    table: &[u8],
) -> Result<ToolReadings<N>, FileError> {
    readings(path, parse_setup(path, text, model)?, table)
}

fn parse_setup(path: &Path, text: &str, model: &str) -> Result<ToolFile, FileError> {
    let file: ToolFile = setup::parse(path, text)?;
    if file.format != FORMAT {
        let reason = format!("is {:?}; expected {FORMAT:?}", file.format);
        return Err(FileError::key(path, "format", reason));
    }
    if file.model != model {
        let reason = format!("is {:?}, and the robot file's is {model:?}", file.model);
        return Err(FileError::key(path, "model", reason));
    }
    let (least, most) = NOISE;
    for (key, value) in [
        ("noise.force_n", file.noise.force_n),
        ("noise.moment_nm", file.noise.moment_nm),
    ] {
        if !(least..=most).contains(&value) {
            let reason = format!("{value} is not from {least:e} to {most:e}");
            return Err(FileError::key(path, key, reason));
        }
    }
    Ok(file)
}

fn readings<const N: usize>(
    path: &Path,
    file: ToolFile,
    bytes: &[u8],
) -> Result<ToolReadings<N>, FileError> {
    let path = setup::beside(path, &file.measurements);
    let readings = rows(&path, bytes)?;
    let table = path.display().to_string();
    let lines: Vec<u64> = readings.iter().map(|reading| reading.line).collect();
    let columns = columns(&file.noise, &readings);
    repeated::check(&table, &lines, "pose", &columns)?;
    repeated::check_still(&table, &lines, repeated::MANY, columns.iter())?;
    Ok(ToolReadings {
        table,
        crc: crc32fast::hash(bytes),
        noise: file.noise,
        readings,
    })
}

/// Columns of forces and moments.
fn columns<const N: usize>(noise: &ReadingNoise, readings: &[ToolReading<N>]) -> Vec<Column> {
    let sds = [[noise.force_n; 3], [noise.moment_nm; 3]].concat();
    LOAD.into_iter()
        .zip(sds)
        .enumerate()
        .map(|(component, (name, sd))| Column {
            name: name.to_owned(),
            sd: Some(sd),
            values: readings
                .iter()
                .map(|reading| reading.raw.to_array().get(component).copied())
                .collect(),
        })
        .collect()
}

fn rows<const N: usize>(path: &Path, bytes: &[u8]) -> Result<Vec<ToolReading<N>>, FileError> {
    let axes = axis_columns::<N>();
    let mut required = vec!["pose".to_owned()];
    required.extend(axes.iter().cloned().chain(LOAD.map(str::to_owned)));
    let mut names = HashSet::new();
    CsvTable::begin(path, bytes, &required, |_| false)?.rows(|row| {
        let [max_q, _, max_n, max_nm, _] = MAX_VALUES;
        let name = row.name("pose")?;
        if !names.insert(name.clone()) {
            return Err(row.error("pose", format_args!("duplicate name {name:?}")));
        }
        let mut q = [0.0; N];
        for (q, column) in q.iter_mut().zip(&axes) {
            *q = row.number(column, max_q)?;
        }
        let mut raw = [0.0; 6];
        for (component, (value, column)) in raw.iter_mut().zip(LOAD).enumerate() {
            *value = row.number(column, if component < 3 { max_n } else { max_nm })?;
        }
        Ok(ToolReading {
            line: row.line(),
            name,
            q,
            raw: Wrench::from_array(raw),
        })
    })
}
