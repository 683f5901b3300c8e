//! Tables: CSV with a header, row by row.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::FileError;

/// Largest number of rows of a table.
pub const MAX_ROWS: usize = 100_000;
/// Longest table that is read, bytes.
const MAX_LEN: u64 = 64 << 20;

/// A table that is being read.
pub(super) struct Table<'a> {
    name: String,
    reader: csv::Reader<&'a [u8]>,
    header: Vec<String>,
}

/// One row, by the columns of its table.
pub(super) struct Row<'a> {
    table: &'a str,
    header: &'a [String],
    line: u64,
    record: &'a csv::StringRecord,
}

/// Reads the bytes of a table.
///
/// # Errors
/// [`FileError`].
pub(super) fn bytes(path: &Path) -> Result<Vec<u8>, FileError> {
    let refused = |error| FileError::whole(&path.display().to_string(), error);
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(refused)?;
    file.take(MAX_LEN + 1).read_to_end(&mut bytes).map_err(refused)?;
    if u64::try_from(bytes.len()).is_ok_and(|length| length > MAX_LEN) {
        return Err(FileError::whole(&path.display().to_string(), "is longer than 64 MiB"));
    }
    Ok(bytes)
}

impl<'a> Table<'a> {
    /// Reads the header of a table, which `path` names. It must have the columns `required`; others must be `known`.
    pub(super) fn begin(
        path: &Path,
        bytes: &'a [u8],
        required: &[String],
        known: impl Fn(&str) -> bool,
    ) -> Result<Self, FileError> {
        let name = path.display().to_string();
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(bytes);
        let header: Vec<String> =
            reader.headers().map_err(|error| FileError::whole(&name, error))?.iter().map(str::to_owned).collect();
        for (index, column) in header.iter().enumerate() {
            if header.iter().take(index).any(|other| other == column) {
                return Err(FileError::at(&name, 1, column, "this column stands twice"));
            }
            if !required.contains(column) && !known(column) {
                return Err(FileError::at(&name, 1, column, "this column is unknown"));
            }
        }
        if let Some(missing) = required.iter().find(|column| !header.contains(column)) {
            return Err(FileError::at(&name, 1, missing, "this column is missing"));
        }
        Ok(Self { name, reader, header })
    }

    /// True if there is such a column.
    pub(super) fn has(&self, column: &str) -> bool {
        self.header.iter().any(|other| other == column)
    }

    /// Reads every row.
    pub(super) fn rows<T>(
        mut self,
        mut read: impl FnMut(&Row<'_>) -> Result<T, FileError>,
    ) -> Result<Vec<T>, FileError> {
        let mut rows = Vec::new();
        let mut record = csv::StringRecord::new();
        loop {
            let line = self.reader.position().line();
            match self.reader.read_record(&mut record) {
                Ok(false) => break,
                Ok(true) => {}
                Err(error) => return Err(FileError::at(&self.name, line, "", error)),
            }
            if rows.len() == MAX_ROWS {
                return Err(FileError::at(&self.name, line, "", format_args!("has more than {MAX_ROWS} rows")));
            }
            let line = record.position().map_or(line, csv::Position::line);
            rows.push(read(&Row { table: &self.name, header: &self.header, line, record: &record })?);
        }
        if rows.is_empty() { Err(FileError::whole(&self.name, "has no rows")) } else { Ok(rows) }
    }
}

impl Row<'_> {
    /// Returns an error about a column of this row.
    pub(super) fn error(&self, column: &str, reason: impl std::fmt::Display) -> FileError {
        FileError::at(self.table, self.line, column, reason)
    }

    /// Line of this row.
    pub(super) const fn line(&self) -> u64 {
        self.line
    }

    /// Returns a text; empty where the column does not exist.
    pub(super) fn text(&self, column: &str) -> &str {
        let place = self.header.iter().position(|other| other == column);
        place.and_then(|index| self.record.get(index)).unwrap_or_default()
    }

    /// Returns a number from `-most` to `most`.
    pub(super) fn number(&self, column: &str, most: f64) -> Result<f64, FileError> {
        let text = self.text(column);
        let value: f64 = text.parse().map_err(|_| self.error(column, format_args!("{text:?} is not a number")))?;
        if value.abs() <= most {
            Ok(value)
        } else {
            Err(self.error(
                column,
                format_args!("{value} is not from {:e} to {most:e}; the unit is in the column's name", -most),
            ))
        }
    }
}
