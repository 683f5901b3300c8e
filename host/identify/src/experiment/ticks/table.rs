//! The table of ticks, as a live campaign writes it.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use gantry_tau_system::output::GrowingFile;

use super::{TARE, header};
use crate::experiment::ExperimentError;
use crate::experiment::table::WindowRow;
use crate::experiment::windows::InstrumentSample;
use crate::measurements::plan::Plan;
use crate::measurements::table::{columns, row};

/// Part of a series that a tick belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SeriesPart {
    /// The strap is slack, and the sensor is tared before a level in the middle.
    Tare,
    /// A level, by its index.
    Level(usize),
    /// The way from one level to the next.
    Way,
}

/// A table of ticks that is being written.
#[derive(Debug)]
pub(crate) struct TickTable {
    path: PathBuf,
    writer: csv::Writer<GrowingFile>,
    /// The header, until it is written before the first tick.
    header: Option<Vec<String>>,
}

impl TickTable {
    /// Creates the table with its header; where the table of windows is continued, goes on with one
    /// that exists.
    pub(crate) fn open<const N: usize>(
        path: &Path,
        plan: &Plan<N>,
        is_continued: bool,
    ) -> Result<Self, ExperimentError> {
        let header = header::<N>(&plan.gauges);
        let is_begun = is_continued && path.metadata().is_ok_and(|file| file.len() > 0);
        if is_begun {
            check_end(path, &header)?;
        }
        let is_other = !is_begun
            && path
                .metadata()
                .is_ok_and(|file| file.is_file() && file.len() > 0);
        if is_other {
            let reason = "it exists, and the table of windows has no rows that it belongs to; name another file, or move it away";
            return Err(failed(path, reason));
        }
        let file = if is_begun {
            GrowingFile::continuing(path)?
        } else {
            GrowingFile::replacing(path)?
        };
        let header = (!is_begun).then_some(header);
        Ok(Self {
            path: path.to_owned(),
            writer: csv::Writer::from_writer(file),
            header,
        })
    }

    /// Writes a tick of a series. A gauge without a reading is empty.
    pub(crate) fn write<const N: usize>(
        &mut self,
        plan: &Plan<N>,
        (series, part): (usize, SeriesPart),
        time_s: f64,
        sample: &InstrumentSample<N>,
    ) -> Result<(), ExperimentError> {
        let level = if let SeriesPart::Level(level) = part {
            level
        } else {
            0
        };
        let mut fields = WindowRow::names(plan, series, level);
        match part {
            SeriesPart::Level(_) => {}
            SeriesPart::Tare => TARE.clone_into(&mut fields[3]),
            SeriesPart::Way => fields[3..].iter_mut().for_each(String::clear),
        }
        fields.extend([time_s.to_string(), sample.tick.to_string()]);
        fields.extend(sample.q.iter().chain(&sample.wrench).map(f64::to_string));
        let read = &plan.series[series].gauges;
        fields.extend(
            (0..plan.gauges.len()).map(|gauge| match sample.lengths_m.get(gauge) {
                Some(length_m)
                    if length_m.is_finite() && gauge < sample.gauges && read.contains(&gauge) =>
                {
                    (length_m * 1e6).to_string()
                }
                _ => String::new(),
            }),
        );
        let header = self
            .header
            .take()
            .map_or(Ok(()), |header| self.writer.write_record(header));
        let written = header.and_then(|()| self.writer.write_record(fields));
        // Row by row: one that is cut could not be continued.
        written
            .map_err(csv::Error::into)
            .and_then(|()| self.writer.flush())
            .map_err(|error| failed(&self.path, error))
    }

    pub(crate) fn flush(&mut self) -> Result<(), ExperimentError> {
        self.writer
            .flush()
            .map_err(|error| failed(&self.path, error))
    }
}

fn failed(path: &Path, reason: impl std::fmt::Display) -> ExperimentError {
    ExperimentError::Write {
        path: path.display().to_string(),
        reason: reason.to_string(),
    }
}

/// Checks that rows can be added to a table: its columns are `header`, and its last row is whole.
fn check_end(path: &Path, header: &[String]) -> Result<(), ExperimentError> {
    let (first, last) = ends(path).map_err(|error| failed(path, error))?;
    if columns(&first) != header {
        let planned = row(header);
        return Err(failed(
            path,
            format_args!(
                "its columns are not those of this plan: {}",
                planned.trim_end()
            ),
        ));
    }
    if last == b'\n' {
        Ok(())
    } else {
        Err(failed(path, "its last row is not whole; remove that row"))
    }
}

/// First line of a file that is not empty, and its last byte.
fn ends(path: &Path) -> io::Result<(String, u8)> {
    let mut file = BufReader::new(File::open(path)?);
    let mut first = String::new();
    file.by_ref()
        .take(super::MAX_ROW_LEN as u64)
        .read_line(&mut first)?;
    let mut last = [0];
    file.seek(SeekFrom::End(-1))?;
    file.read_exact(&mut last)?;
    let [last] = last;
    Ok((first, last))
}
