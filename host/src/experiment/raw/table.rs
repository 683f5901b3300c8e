//! The table of ticks, as a live campaign writes it.

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::{TARE, header};
use crate::experiment::ExperimentError;
use crate::experiment::table::Row;
use crate::experiment::windows::Sample;
use crate::measurements::plan::Plan;
use crate::measurements::table::{columns, row};
use crate::output::GrowingFile;

/// Part of a series that a tick belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    /// The strap is slack, and the sensor is tared before a level in the middle.
    Tare,
    /// A level, by its index.
    Level(usize),
    /// The way from one level to the next.
    Way,
}

/// A table of ticks that is being written.
#[derive(Debug)]
pub(crate) struct RawTable {
    path: PathBuf,
    writer: csv::Writer<GrowingFile>,
    /// The header, until it is written before the first tick.
    header: Option<Vec<String>>,
}

impl RawTable {
    /// Creates the table with its header; where the table of windows is continued, goes on with one that exists.
    pub(crate) fn open<const N: usize>(
        path: &Path,
        plan: &Plan<N>,
        is_continued: bool,
    ) -> Result<Self, ExperimentError> {
        let failed = |reason: String| ExperimentError::Write { path: path.display().to_string(), reason };
        let header = header::<N>(&plan.gauges);
        let is_begun = is_continued && path.metadata().is_ok_and(|file| file.len() > 0);
        if is_begun {
            check_end(path, &header).map_err(failed)?;
        }
        let is_other = !is_begun && path.metadata().is_ok_and(|file| file.is_file() && file.len() > 0);
        if is_other {
            let reason = "it exists, and the table of windows has no rows that it belongs to; name another file, or move it away";
            return Err(failed(reason.to_owned()));
        }
        let file = if is_begun { GrowingFile::continuing(path)? } else { GrowingFile::replacing(path)? };
        let header = (!is_begun).then_some(header);
        Ok(Self { path: path.to_owned(), writer: csv::Writer::from_writer(file), header })
    }

    /// Writes a tick of a series. A gauge without a reading is empty.
    pub(crate) fn write<const N: usize>(
        &mut self,
        plan: &Plan<N>,
        (series, part): (usize, Part),
        time_s: f64,
        sample: &Sample<N>,
    ) -> Result<(), ExperimentError> {
        let level = if let Part::Level(level) = part { level } else { 0 };
        let mut fields = Row::names(plan, series, level);
        match part {
            Part::Level(_) => {}
            Part::Tare => TARE.clone_into(&mut fields[3]),
            Part::Way => fields[3..].iter_mut().for_each(String::clear),
        }
        fields.extend([time_s.to_string(), sample.tick.to_string()]);
        fields.extend(sample.q.iter().chain(&sample.wrench).map(f64::to_string));
        let read = &plan.series[series].gauges;
        fields.extend((0..plan.gauges.len()).map(|gauge| match sample.lengths_m.get(gauge) {
            Some(length_m) if length_m.is_finite() && gauge < sample.gauges && read.contains(&gauge) => {
                (length_m * 1e6).to_string()
            }
            _ => String::new(),
        }));
        let header = self.header.take().map_or(Ok(()), |header| self.writer.write_record(header));
        let written = header.and_then(|()| self.writer.write_record(fields));
        // Row by row: one that is cut could not be continued.
        written.map_err(csv::Error::into).and_then(|()| self.writer.flush()).map_err(|error| self.failed(&error))
    }

    pub(crate) fn flush(&mut self) -> Result<(), ExperimentError> {
        self.writer.flush().map_err(|error| self.failed(&error))
    }

    fn failed(&self, error: &dyn std::fmt::Display) -> ExperimentError {
        ExperimentError::Write { path: self.path.display().to_string(), reason: error.to_string() }
    }
}

/// Checks that rows can be added to a table: its columns are `header`, and its last row is whole.
fn check_end(path: &Path, header: &[String]) -> Result<(), String> {
    let said = |error: std::io::Error| error.to_string();
    let mut file = BufReader::new(File::open(path).map_err(said)?);
    let mut first = String::new();
    file.by_ref().take(super::LONGEST_ROW as u64).read_line(&mut first).map_err(said)?;
    if columns(&first) != header {
        return Err(format!("its columns are not those of this plan: {}", row(header).trim_end()));
    }
    let mut last = [0];
    file.seek(SeekFrom::End(-1)).map_err(said)?;
    file.read_exact(&mut last).map_err(said)?;
    if last == *b"\n" { Ok(()) } else { Err("its last row is not whole; remove that row".to_owned()) }
}
