//! Table of every tick in which a strap pulls: what windows are made of.

use std::fs::File;
use std::path::{Path, PathBuf};

use nalgebra::Vector6;

use super::ExperimentError;
use super::table::Row;
use super::windows::Sample;
use crate::measurements::plan::Plan;
use crate::measurements::springs::LOAD;

/// A table of ticks.
#[derive(Debug)]
pub(crate) struct RawTable {
    path: PathBuf,
    writer: csv::Writer<File>,
}

impl RawTable {
    /// Creates the table with its header.
    pub(crate) fn create<const N: usize>(path: &Path, plan: &Plan<N>) -> Result<Self, ExperimentError> {
        let failed = |reason: String| ExperimentError::Write { path: path.display().to_string(), reason };
        let mut writer = csv::Writer::from_path(path).map_err(|error| failed(error.to_string()))?;
        let mut header: Vec<String> =
            ["series", "mounting", "pose", "window", "stroke", "tick"].map(str::to_owned).into();
        header.extend((1..=N).map(|axis| format!("q_{axis}")));
        header.extend(LOAD.map(str::to_owned));
        header.extend(plan.gauges.iter().map(|gauge| format!("{}_um", gauge.name)));
        writer.write_record(header).map_err(|error| failed(error.to_string()))?;
        Ok(Self { path: path.to_owned(), writer })
    }

    /// Writes a tick of a window (series, level), with the load on the platform. A gauge without a reading is empty.
    pub(crate) fn write<const N: usize>(
        &mut self,
        plan: &Plan<N>,
        (series, level): (usize, usize),
        sample: &Sample<N>,
        load: &Vector6<f64>,
    ) -> Result<(), ExperimentError> {
        let mut fields = Row::names(plan, series, level);
        fields.push(sample.tick.to_string());
        fields.extend(sample.q.iter().chain(load.iter()).map(f64::to_string));
        let read = &plan.series[series].gauges;
        fields.extend((0..plan.gauges.len()).map(|gauge| match sample.lengths_m.get(gauge) {
            Some(length_m) if length_m.is_finite() && gauge < sample.gauges && read.contains(&gauge) => {
                (length_m * 1e6).to_string()
            }
            _ => String::new(),
        }));
        self.writer.write_record(fields).map_err(|error| self.failed(&error))
    }

    pub(crate) fn flush(&mut self) -> Result<(), ExperimentError> {
        self.writer.flush().map_err(|error| self.failed(&error))
    }

    fn failed(&self, error: &dyn std::fmt::Display) -> ExperimentError {
        ExperimentError::Write { path: self.path.display().to_string(), reason: error.to_string() }
    }
}
