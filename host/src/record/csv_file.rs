//! CSV: one row per line, units in the header.

use std::fs::File;
use std::path::Path;

use super::{RecordError, Recorded, Tally};

/// One row of a recording.
pub trait Record: Copy + Send + 'static {
    /// Names of the columns, with units.
    fn header() -> Vec<String>;
    /// The values, in the order of the header.
    fn fields(&self) -> Vec<String>;
}

/// CSV file. After its first failure (for instance a full disk) it only counts lost rows.
#[derive(Debug)]
pub struct CsvFile {
    tally: Tally,
    writer: csv::Writer<File>,
}

impl CsvFile {
    /// Creates the file and writes the header of `T`.
    ///
    /// # Errors
    /// [`RecordError`] naming the path and the reason.
    pub fn create<T: Record>(path: &Path) -> Result<Self, RecordError> {
        let fail = |reason: String| RecordError { path: path.to_owned(), reason };
        let writer = create::<T>(path).map_err(|error| fail(error.to_string()))?;
        Ok(Self { tally: Tally::of(path), writer })
    }

    /// Writes a row.
    pub fn write<T: Record>(&mut self, row: &T) {
        let writer = &mut self.writer;
        self.tally.count(|| put(writer, row));
    }

    /// Flushes, and adds the rows that the queue dropped.
    #[must_use]
    pub fn finish(mut self, dropped: u64) -> Recorded {
        self.tally.finish(self.writer.flush(), dropped)
    }
}

/// Creates a file with the header of `T`.
pub(super) fn create<T: Record>(path: &Path) -> csv::Result<csv::Writer<File>> {
    let mut writer = csv::Writer::from_writer(File::create(path)?);
    writer.write_record(T::header())?;
    Ok(writer)
}

/// Writes a row.
pub(super) fn put<T: Record>(writer: &mut csv::Writer<File>, row: &T) -> std::io::Result<()> {
    writer.write_record(row.fields()).map_err(std::io::Error::from)
}
