//! Plans as files: the text of a set-up, the header of its table, gauges alone.

use std::path::Path;

use gantry_tau_machine::elastic::gauge::{Body, Gauge};
use serde::Deserialize;

use super::setup_file::{GaugeEntry, PoseEntry, SpringsFile, gauges};
use super::{FORMAT, FileError, LOAD, NamedGauge, Setup, WINDOW, axis_columns, setup, table};

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
pub fn read_gauges<const N: usize>(
    path: &Path,
    metres_per_q: &[f64; N],
) -> Result<Vec<NamedGauge>, FileError> {
    parse_gauges(path, &setup::text(path)?, metres_per_q)
}

/// As [`read_gauges`], of a text; `path` names it.
///
/// # Errors
/// [`FileError`].
pub fn parse_gauges<const N: usize>(
    path: &Path,
    text: &str,
    metres_per_q: &[f64; N],
) -> Result<Vec<NamedGauge>, FileError> {
    let file: GaugesFile = setup::parse(path, text)?;
    gauges(&file.gauge, metres_per_q).map_err(|(key, reason)| FileError::key(path, key, reason))
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
        toml::to_string(&SpringsFile {
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
        table::row(&columns)
    }
}

fn entry(gauge: &NamedGauge) -> GaugeEntry {
    let name = gauge.name.clone();
    match gauge.gauge {
        Gauge::Face {
            body,
            point_m,
            axis,
        } => GaugeEntry {
            name,
            on: match body {
                Body::Platform => "platform".to_owned(),
                Body::Tool => "tool".to_owned(),
            },
            point_m: Some(point_m.into()),
            axis: Some(axis.into()),
            axis_number: None,
        },
        Gauge::Axis { axis, .. } => GaugeEntry {
            name,
            on: "axis".to_owned(),
            point_m: None,
            axis: None,
            axis_number: Some(axis + 1),
        },
    }
}
