//! A recording in the format that its file's name asks for.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use gantry_tau_labcomm::Version;

use super::csv_file;
use super::labcomm_file::LabcommFile;
use super::mcap::McapFile;
use super::{Record, RecordError, Recorded, Tally};
use crate::draw::figure::Machine;
use crate::model::MachineKind;
use crate::publication::Samples;
use crate::robot_file::RobotFile;
use crate::server::event_log::Event;

/// One tick of a recording, for every format.
pub trait TickRow<const N: usize>: Record {
    /// Returns the samples of the tick.
    fn samples(&self) -> Samples<N>;
}

/// Format of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Csv,
    Labcomm,
    Mcap,
}

/// File of a recording, whose extension names the format, and the version of LabComm for that format.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordTo {
    path: PathBuf,
    format: Format,
    version: Version,
}

/// A file name without a known extension.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a recording is a file FILE.csv, FILE.labcomm or FILE.mcap: its extension chooses the format")]
pub struct ParseFormatError;

impl FromStr for RecordTo {
    type Err = ParseFormatError;

    fn from_str(text: &str) -> Result<Self, ParseFormatError> {
        let path = PathBuf::from(text);
        let format = match path.extension().and_then(std::ffi::OsStr::to_str) {
            Some("csv") => Format::Csv,
            Some("labcomm") => Format::Labcomm,
            Some("mcap") => Format::Mcap,
            _ => return Err(ParseFormatError),
        };
        Ok(Self { path, format, version: Version::V2014 })
    }
}

impl RecordTo {
    /// Sets the version of LabComm, which is 2014 otherwise.
    #[must_use]
    pub fn with_version(self, version: Version) -> Self {
        Self { version, ..self }
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// File of a recording. After its first failure (for instance a full disk) it only counts lost rows.
#[derive(Debug)]
pub struct Recording<const N: usize> {
    path: PathBuf,
    tally: Tally,
    writer: Writer,
}

#[derive(Debug)]
enum Writer {
    Csv(Box<csv::Writer<File>>),
    Labcomm(LabcommFile),
    Mcap(Box<McapFile>),
}

impl<const N: usize> Recording<N> {
    /// Creates the file of a recording of rows `T` of a machine, which MCAP draws.
    ///
    /// # Errors
    /// [`RecordError`] naming the path and the reason.
    pub fn create<T: TickRow<N>, K: MachineKind<N>>(
        to: &RecordTo,
        robot: &RobotFile<K, N>,
    ) -> Result<Self, RecordError> {
        let path = to.path.clone();
        match Writer::create::<T, K, N>(to, robot) {
            Ok(writer) => Ok(Self { tally: Tally::of(&path), path, writer }),
            Err(error) => Err(RecordError { path, reason: error.to_string() }),
        }
    }

    /// Path of the file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// True if the recording draws the machine.
    pub(crate) const fn draws(&self) -> bool {
        matches!(self.writer, Writer::Mcap(_))
    }

    /// Writes a row, and what happened in its tick.
    pub fn write<T: TickRow<N>>(&mut self, row: &T, events: &[Event]) {
        let writer = &mut self.writer;
        self.tally.count(|| match writer {
            Writer::Csv(writer) => csv_file::put(writer, row),
            Writer::Labcomm(file) => file.write(&row.samples(), events),
            Writer::Mcap(file) => file.write(&row.samples(), events),
        });
    }

    /// Completes the file, and adds the rows that the queue dropped.
    #[must_use]
    pub fn finish(mut self, dropped: u64) -> Recorded {
        let finished = match &mut self.writer {
            Writer::Csv(writer) => writer.flush(),
            Writer::Labcomm(file) => file.flush(),
            Writer::Mcap(file) => file.finish(),
        };
        self.tally.finish(finished, dropped)
    }
}

impl Writer {
    fn create<T: TickRow<N>, K: MachineKind<N>, const N: usize>(
        to: &RecordTo,
        robot: &RobotFile<K, N>,
    ) -> io::Result<Self> {
        match to.format {
            Format::Csv => Ok(Self::Csv(Box::new(csv_file::create::<T>(&to.path)?))),
            Format::Labcomm => Ok(Self::Labcomm(LabcommFile::create::<N>(&to.path, to.version)?)),
            Format::Mcap => {
                let machine = Machine::new(robot.clone()).map_err(io::Error::other)?;
                Ok(Self::Mcap(Box::new(McapFile::create::<N>(&to.path, &robot.name, Box::new(machine))?)))
            }
        }
    }
}
