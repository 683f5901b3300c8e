//! Plans as files: the text of a set-up, the header of its table, gauges alone.

use std::path::Path;

use serde::Deserialize;

use super::{
    FORMAT, FileError, GaugeEntry, LOAD, NamedGauge, PoseEntry, Setup, SetupFile, WINDOW, axis_columns, setup,
};
use crate::springs::gauge::Gauge;

/// Smallest and largest length of a direction that counts as a unit vector.
const UNIT: (f64, f64) = (1.0 - 1e-6, 1.0 + 1e-6);
/// Largest force of a level, N, and distance of a hook, m.
const MOST: (f64, f64) = (1e5, 10.0);

/// A file of gauges alone.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GaugesFile {
    gauge: Vec<GaugeEntry>,
}

/// Reads a file of `[[gauge]]` tables, for a machine whose axes are `metres_per_q` long.
///
/// # Errors
/// [`FileError`].
pub fn read_gauges<const N: usize>(path: &Path, metres_per_q: &[f64; N]) -> Result<Vec<NamedGauge>, FileError> {
    let file: GaugesFile = setup::read(path)?;
    super::gauges(&file.gauge, metres_per_q).map_err(|(key, reason)| FileError {
        column: Some(key),
        ..FileError::whole(&path.display().to_string(), reason)
    })
}

impl Setup {
    /// Returns the text of the set-up of a machine of `model`.
    ///
    /// # Errors
    /// Of TOML, for numbers that it cannot write.
    pub fn text(&self, model: &str) -> Result<String, toml::ser::Error> {
        let pose = self.poses.iter().map(|(name, pose)| PoseEntry {
            name: name.clone(),
            position_m: pose.position_m.into(),
            rotation: pose.rotation.transpose().into(),
        });
        toml::to_string(&SetupFile {
            format: FORMAT.to_owned(),
            model: model.to_owned(),
            measurements: self.measurements.clone(),
            noise: self.noise,
            setup: self.setup,
            pose: pose.collect(),
            gauge: self.gauges.iter().map(entry).collect(),
            series: self.plan.clone(),
        })
    }

    /// Returns the header of the table of a machine with `N` axes.
    #[must_use]
    pub fn header<const N: usize>(&self) -> String {
        let mut columns: Vec<String> = WINDOW.map(str::to_owned).to_vec();
        columns.extend(axis_columns::<N>());
        columns.extend(LOAD.map(str::to_owned));
        columns.extend(self.gauges.iter().map(|gauge| format!("{}_um", gauge.name)));
        columns.join(",") + "\n"
    }

    /// Checks the series of a plan; `path` is that of the set-up.
    ///
    /// # Errors
    /// [`FileError`] that names series and key.
    pub fn check_plan(&self, path: &Path) -> Result<(), FileError> {
        let refused = |key: String, reason: String| FileError {
            column: Some(key),
            ..FileError::whole(&path.display().to_string(), reason)
        };
        if self.plan.is_empty() {
            return Err(refused(
                "series".to_owned(),
                "is missing: a plan says in [[series]] what to measure".to_owned(),
            ));
        }
        for (index, series) in self.plan.iter().enumerate() {
            let refused = |key: &str, reason: String| Err(refused(format!("series.{}.{key}", series.name), reason));
            if self.plan.iter().take(index).any(|other| other.name == series.name) {
                return refused("name", "stands twice".to_owned());
            }
            if !self.poses.iter().any(|(name, _)| *name == series.pose) {
                return refused("pose", format!("{:?} is not in the set-up", series.pose));
            }
            let unknown = series.gauges.iter().find(|name| !self.gauges.iter().any(|gauge| gauge.name == **name));
            if let Some(unknown) = unknown {
                return refused("gauges", format!("{unknown:?} is not in the set-up"));
            }
            if series.gauges.is_empty() {
                return refused("gauges", "is empty; name the gauges that are read".to_owned());
            }
            let length = series.direction.iter().map(|component| component * component).sum::<f64>().sqrt();
            if !(UNIT.0..=UNIT.1).contains(&length) {
                return refused("direction", format!("has length {length}, not 1"));
            }
            if !series.hook_m.iter().all(|coordinate| coordinate.abs() <= MOST.1) {
                return refused("hook_m", format!("is more than {} m away; it is in metres", MOST.1));
            }
            if let Some(level) = series.levels_n.iter().find(|level| !(0.0..=MOST.0).contains(*level)) {
                return refused("levels_n", format!("{level} is not from 0 to {:e}", MOST.0));
            }
            if series.levels_n.len() < 2 {
                return refused("levels_n", "has fewer than two levels; the zero of a gauge takes one".to_owned());
            }
        }
        Ok(())
    }
}

fn entry(gauge: &NamedGauge) -> GaugeEntry {
    let name = gauge.name.clone();
    match gauge.gauge {
        Gauge::Platform { point_m, axis } => GaugeEntry {
            name,
            on: "platform".to_owned(),
            point_m: Some(point_m.into()),
            axis: Some(axis.into()),
            axis_number: None,
        },
        Gauge::Axis { axis, .. } => {
            GaugeEntry { name, on: "axis".to_owned(), point_m: None, axis: None, axis_number: Some(axis + 1) }
        }
    }
}
