//! The table of a campaign: one row per window, flushed row by row, continued where it ended.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use gantry_tau_system::output::{GrowingFile, Name, rows};
use nalgebra::Vector6;

use super::ExperimentError;
use crate::measurements::plan::Plan;
use crate::measurements::springs::{LOAD, windows_of};
use crate::measurements::table::{columns, row};

/// A window as it was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct WindowRow<const N: usize> {
    /// Series, by index in the plan.
    pub series: usize,
    /// Level, by index in the series.
    pub level: usize,
    /// Positions of the axes, q-units.
    pub q: [f64; N],
    /// Load on the platform, about the tool centre point where it is, world axes, tared; N, N m.
    pub load: Vector6<f64>,
    /// Mean of each gauge of the plan, m; `None` where the series does not read it.
    pub readings_m: Vec<Option<f64>>,
    /// Standard deviation of each mean, m.
    pub sds_m: Vec<Option<f64>>,
    /// Time since the campaign began, s.
    pub time_s: f64,
    /// Samples of the mean.
    pub samples: u64,
}

/// Names of the columns. Standard deviations have columns where they are measured.
#[must_use]
pub fn header<const N: usize>(plan: &Plan<N>, has_sds: bool) -> Vec<String> {
    let mut header: Vec<String> = ["series", "mounting", "pose", "window", "stroke"]
        .map(str::to_owned)
        .into();
    header.extend((1..=N).map(|axis| format!("q_{axis}")));
    header.extend(LOAD.map(str::to_owned));
    header.extend(plan.gauges.iter().map(|gauge| format!("{}_um", gauge.name)));
    if has_sds {
        header.extend(
            plan.gauges
                .iter()
                .map(|gauge| format!("{}_sd_um", gauge.name)),
        );
    }
    header.extend(["time_s", "samples"].map(str::to_owned));
    header
}

/// Name of a window: the number of its level, from 1.
#[must_use]
pub fn window_name(level: usize) -> Name {
    Name::made(level + 1)
}

impl<const N: usize> WindowRow<N> {
    /// Series, mounting, pose, window and stroke, as the table has them.
    #[must_use]
    pub fn names(plan: &Plan<N>, series: usize, level: usize) -> Vec<String> {
        let planned = &plan.series[series];
        let (pose, _) = &plan.poses[planned.pose];
        let names = [
            &planned.name,
            &plan.mountings[planned.mounting],
            pose,
            &window_name(level),
        ]
        .map(Name::to_string);
        names
            .into_iter()
            .chain([planned.strokes()[level].to_string()])
            .collect()
    }

    /// The values, in the order of the header.
    fn fields(&self, plan: &Plan<N>, has_sds: bool) -> Vec<String> {
        let mut fields = Self::names(plan, self.series, self.level);
        fields.extend(self.q.iter().chain(self.load.iter()).map(f64::to_string));
        let lengths = if has_sds {
            [&*self.readings_m, &*self.sds_m].concat()
        } else {
            self.readings_m.clone()
        };
        fields.extend(
            lengths
                .into_iter()
                .map(|length| length.map_or_else(String::new, |metres| (metres * 1e6).to_string())),
        );
        fields.extend([self.time_s.to_string(), self.samples.to_string()]);
        fields
    }
}

/// A table that is being written.
#[derive(Debug)]
pub struct WindowTable {
    path: PathBuf,
    writer: csv::Writer<GrowingFile>,
    /// The header, until it is written before the first row.
    header: Option<Vec<String>>,
    has_sds: bool,
    taken: HashSet<(Name, Name)>,
    last_s: f64,
}

impl WindowTable {
    /// Opens a table. Rows that are there stay as they are; a table without rows is made with the
    /// first one.
    ///
    /// # Errors
    /// [`ExperimentError`]: it cannot be written, or is not a table of this plan.
    pub fn open<const N: usize>(
        path: &Path,
        plan: &Plan<N>,
        has_sds: bool,
    ) -> Result<Self, ExperimentError> {
        let expected = header(plan, has_sds);
        let old = match path.metadata() {
            // A device or a pipe takes rows, and has none.
            Ok(old) if !old.is_file() && !old.is_dir() => String::new(),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
            _ => std::fs::read_to_string(path).map_err(|error| failed(path, error))?,
        };
        let rows = rows(&old);
        // An empty table has a header; anything else was not meant.
        if rows == 0 && !old.trim().is_empty() && !old.starts_with("series,") {
            return Err(failed(path, "it exists and is not a table of windows"));
        }
        let mut taken = HashSet::new();
        let mut last_s = 0.0;
        if rows > 0 {
            if columns(old.split(['\n', '\r']).next().unwrap_or_default()) != expected {
                let reason = format!(
                    "its columns are not those of this plan: {}",
                    row(&expected).trim_end()
                );
                return Err(failed(path, reason));
            }
            if !old.ends_with('\n') {
                return Err(failed(path, "its last row is not whole; remove that row"));
            }
            let windows = windows_of::<N>(path, &plan.poses, &plan.gauges)?;
            last_s = windows
                .iter()
                .filter_map(|(_, window)| window.time_s)
                .fold(0.0, f64::max);
            taken = windows
                .into_iter()
                .map(|(series, window)| (series, window.window))
                .collect();
        }
        // A table without rows may come from a plan, which knows less of the columns.
        let file = if rows > 0 {
            GrowingFile::continuing(path)?
        } else {
            GrowingFile::replacing(path)?
        };
        let header = (rows == 0).then_some(expected);
        Ok(Self {
            path: path.to_owned(),
            writer: csv::Writer::from_writer(file),
            header,
            has_sds,
            taken,
            last_s,
        })
    }

    /// True if a window was taken before.
    #[must_use]
    pub fn has<const N: usize>(&self, plan: &Plan<N>, series: usize, level: usize) -> bool {
        self.taken
            .contains(&(plan.series[series].name.clone(), window_name(level)))
    }

    /// True if no window was taken before.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.taken.is_empty()
    }

    /// Adds the series that were mounted again in the middle to a plan, as [`Plan::remount`] names
    /// them. Returns the windows (series, level) of those that they replace, which are not to be
    /// taken any more.
    pub fn remounted<const N: usize>(&self, plan: &mut Plan<N>) -> HashSet<(usize, usize)> {
        let mut replaced = HashSet::new();
        let mut series = 0;
        while series < plan.series.len() {
            let again = plan.name_again(series);
            if self.taken.iter().any(|(name, _)| *name == again) {
                plan.remount(series);
                replaced
                    .extend((0..plan.series[series].levels_n.len()).map(|level| (series, level)));
            }
            series += 1;
        }
        replaced
    }

    /// Time of the last row, s; 0 in a new table.
    #[must_use]
    pub const fn last_s(&self) -> f64 {
        self.last_s
    }

    /// Writes a row, to the disk.
    ///
    /// # Errors
    /// [`ExperimentError::Write`].
    pub fn write<const N: usize>(
        &mut self,
        plan: &Plan<N>,
        row: &WindowRow<N>,
    ) -> Result<(), ExperimentError> {
        let header = self
            .header
            .take()
            .map_or(Ok(()), |header| self.writer.write_record(header));
        let written =
            header.and_then(|()| self.writer.write_record(row.fields(plan, self.has_sds)));
        written.map_err(|error| failed(&self.path, error))?;
        self.writer
            .flush()
            .map_err(|error| failed(&self.path, error))?;
        self.taken
            .insert((plan.series[row.series].name.clone(), window_name(row.level)));
        Ok(())
    }
}

fn failed(path: &Path, reason: impl std::fmt::Display) -> ExperimentError {
    ExperimentError::Write {
        path: path.display().to_string(),
        reason: reason.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::fixture::{Folder, campaign_a, first_series, plan_in};

    #[cfg(target_os = "linux")]
    #[test]
    fn a_row_that_is_not_written_is_an_error_and_is_not_taken() {
        let folder = Folder::new("full");
        let plan = plan_in(&folder, &first_series(&campaign_a("", &[0, 60]), 1));
        let mut table = WindowTable::open(Path::new("/dev/full"), &plan, true).unwrap();

        let row = WindowRow {
            series: 0,
            level: 0,
            q: [0.0; 3],
            load: Vector6::zeros(),
            readings_m: vec![Some(0.0); 9],
            sds_m: vec![Some(1e-6); 9],
            time_s: 1.0,
            samples: 2_000,
        };
        let error = table.write(&plan, &row).unwrap_err().to_string();
        assert!(
            error.contains("/dev/full") && error.contains("No space left"),
            "{error}"
        );
        assert!(!table.has(&plan, 0, 0));
    }
}
