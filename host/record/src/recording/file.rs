//! A recording in the format that its file's name asks for.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use gantry_tau_labcomm::Version;
use gantry_tau_machine::figure::MovingMachine;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_server::publication::Samples;
use gantry_tau_server::record::Event;
use gantry_tau_system::output::GrowingFile;

use super::about::{About, ENDING};
use super::free_space::FreeSpace;
use super::labcomm_file::LabcommFile;
use super::mcap::McapFile;
use super::{CsvRecord, RecordError, Recorded, Tally, csv_file};

/// One tick of a recording, for every format.
pub trait TickRow<const N: usize>: CsvRecord {
    /// Returns the samples of the tick.
    fn samples(&self) -> Samples<N>;
}

/// Format of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FileFormat {
    Csv,
    Labcomm,
    Mcap,
}

/// File of a recording, whose extension names the format, its largest size, and the version of
/// LabComm for that format.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordTo {
    path: PathBuf,
    format: FileFormat,
    version: Version,
    limit: Option<u64>,
}

/// A file name without a known extension.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "a recording is a file FILE.csv, FILE.labcomm or FILE.mcap: its extension chooses the format"
)]
pub struct ParseFormatError;

impl FromStr for RecordTo {
    type Err = ParseFormatError;

    fn from_str(text: &str) -> Result<Self, ParseFormatError> {
        let path = PathBuf::from(text);
        let format = match path.extension().and_then(std::ffi::OsStr::to_str) {
            Some("csv") => FileFormat::Csv,
            Some("labcomm") => FileFormat::Labcomm,
            Some("mcap") => FileFormat::Mcap,
            _ => return Err(ParseFormatError),
        };
        Ok(Self {
            path,
            format,
            version: Version::V2014,
            limit: None,
        })
    }
}

impl RecordTo {
    /// Path that is asked for; a recording gets another one if it is taken.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Checks that the file can be made, for a recording that is created later. No file is made; a
    /// device or a pipe is opened, and stays so until the value is dropped.
    ///
    /// # Errors
    /// [`RecordError`] naming the path and the reason.
    pub fn probe(&self) -> Result<GrowingFile, RecordError> {
        GrowingFile::fresh(&self.path, None).map_err(|error| RecordError {
            path: self.path.clone(),
            reason: error.to_string(),
        })
    }

    /// Sets the version of LabComm, which is 2014 otherwise.
    #[must_use]
    pub fn with_version(self, version: Version) -> Self {
        Self { version, ..self }
    }

    /// Ends the recording at this size, bytes.
    #[must_use]
    pub fn with_limit(self, limit: Option<u64>) -> Self {
        Self { limit, ..self }
    }
}

/// Opens the next file of a recording.
type Open = Box<dyn FnMut() -> io::Result<(PathBuf, FormatWriter)> + Send>;

/// A recording. Its file is made with the first row, under a name that is free: `FILE.csv`, or else
/// `FILE-2.csv` and so on. After its first failure (for instance a full disk) it only counts lost
/// rows.
pub struct Recording<const N: usize> {
    /// Path that was asked for.
    asked: PathBuf,
    limit: Option<u64>,
    open: Open,
    file: Option<OpenFile>,
    tally: Tally,
}

struct OpenFile {
    writer: FormatWriter,
    free_space: FreeSpace,
}

impl<const N: usize> fmt::Debug for Recording<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Recording")
            .field("asked", &self.asked)
            .field("tally", &self.tally)
            .finish_non_exhaustive()
    }
}

#[derive(Debug)]
enum FormatWriter {
    Csv(Box<csv::Writer<GrowingFile>>),
    Labcomm(LabcommFile),
    Mcap(Box<McapFile>),
}

impl<const N: usize> Recording<N> {
    /// Prepares a recording of rows `T` of a machine, which MCAP draws. No file is made yet; a
    /// device or a pipe is opened.
    ///
    /// # Errors
    /// [`RecordError`] naming the path and the reason.
    pub fn create<T: TickRow<N>, K: MachineKind<N>>(
        to: &RecordTo,
        robot: &RobotFile<K, N>,
    ) -> Result<Self, RecordError> {
        let file = GrowingFile::fresh(&to.path, None)
            .map_err(|error| RecordError::new(&to.path, &error))?
            .that_waits()
            .map_err(|error| RecordError::new(&to.path, &error))?;
        let mut stream = file.is_open().then_some(file);
        let (of, robot) = (to.clone(), robot.clone());
        let open: Open = Box::new(move || {
            let mut file = match stream.take() {
                Some(stream) => stream,
                None => GrowingFile::fresh(&of.path, Some(ENDING))
                    .map_err(io::Error::other)?
                    .that_waits()?,
            };
            file.open()?;
            let path = file.path().to_owned();
            let about = About::now(&robot);
            if of.format != FileFormat::Mcap {
                about.write_beside(&path)?;
            }
            Ok((
                path,
                FormatWriter::create::<T, K, N>(&of, &robot, file, &about)?,
            ))
        });
        Ok(Self {
            asked: to.path.clone(),
            limit: to.limit,
            open,
            file: None,
            tally: Tally::of(&to.path),
        })
    }

    /// Path of the file, or, before its first row, the one that was asked for.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.tally.path()
    }

    /// Makes the file. What cannot be written costs the recording, and no session.
    fn begin(&mut self) {
        match (self.open)() {
            Ok((path, writer)) => {
                if path != self.asked {
                    tracing::info!(
                        "{} exists; recording to {}",
                        self.asked.display(),
                        path.display()
                    );
                }
                self.tally.at(&path);
                self.file = Some(OpenFile {
                    writer,
                    free_space: FreeSpace::of(&path, self.limit),
                });
            }
            Err(error) => {
                tracing::warn!("recording {}: {error}", self.asked.display());
                self.tally.fail(&error);
            }
        }
    }

    /// True if the recording draws the machine.
    pub fn draws(&self) -> bool {
        self.asked
            .extension()
            .is_some_and(|extension| extension == "mcap")
    }

    /// Writes a row, and what happened in its tick.
    pub fn write<T: TickRow<N>>(&mut self, row: &T, events: &[Event]) {
        if self.file.is_none() && !self.tally.counts_alone() {
            self.begin();
        }
        let Some(OpenFile { writer, free_space }) =
            self.file.as_mut().filter(|_| !self.tally.counts_alone())
        else {
            self.tally.lose();
            return;
        };
        self.tally.count(|| writer.write(row, events));
        if let Some(full) = free_space.full() {
            tracing::warn!("recording {}: {full}; it ends here", self.path().display());
            let finished = self.finish_file();
            self.tally.end(full, finished);
        }
    }

    /// True if the file has failed, so that rows are lost.
    pub(crate) const fn has_failed(&self) -> bool {
        self.tally.has_failed()
    }

    fn finish_file(&mut self) -> io::Result<()> {
        self.file.take().map_or(Ok(()), |file| file.writer.finish())
    }

    /// Completes the file; the next row begins another one. `None` if it has no rows.
    pub fn begin_next(&mut self) -> Option<Recorded> {
        if self.file.is_none() && self.tally.is_empty() {
            return None;
        }
        let finished = self.finish_file();
        let recorded = self.tally.finish(finished, 0);
        self.tally = Tally::of(&self.asked);
        Some(recorded)
    }

    /// Completes the file, and adds the rows that the queue dropped.
    #[must_use]
    pub fn finish(mut self, dropped: u64) -> Recorded {
        let finished = self.finish_file();
        self.tally.finish(finished, dropped)
    }
}

impl FormatWriter {
    fn create<T: TickRow<N>, K: MachineKind<N>, const N: usize>(
        to: &RecordTo,
        robot: &RobotFile<K, N>,
        file: GrowingFile,
        about: &About,
    ) -> io::Result<Self> {
        match to.format {
            FileFormat::Csv => Ok(Self::Csv(Box::new(csv_file::create::<T>(file)?))),
            FileFormat::Labcomm => Ok(Self::Labcomm(LabcommFile::create::<N>(file, to.version)?)),
            FileFormat::Mcap => {
                let machine = MovingMachine::new(robot.clone()).map_err(io::Error::other)?;
                Ok(Self::Mcap(Box::new(McapFile::create::<N>(
                    file,
                    about,
                    Box::new(machine),
                )?)))
            }
        }
    }

    fn write<T: TickRow<N>, const N: usize>(
        &mut self,
        row: &T,
        events: &[Event],
    ) -> io::Result<()> {
        match self {
            Self::Csv(writer) => csv_file::put(writer, row),
            Self::Labcomm(file) => file.write(&row.samples(), events),
            Self::Mcap(file) => file.write(&row.samples(), events),
        }
    }

    fn finish(self) -> io::Result<()> {
        match self {
            Self::Csv(mut writer) => writer.flush(),
            Self::Labcomm(mut file) => file.sync(),
            Self::Mcap(file) => file.finish(),
        }
    }
}
