//! Tables: CSV with a header, row by row.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use gantry_tau_system::lines::plain;
use gantry_tau_system::output::Name;

use super::FileError;

/// Largest number of rows of a table.
pub const MAX_ROWS: usize = 100_000;
/// Longest table that is read, bytes.
const MAX_LEN: u64 = 64 << 20;

/// A table that is being read.
pub(crate) struct CsvTable<R> {
    name: String,
    reader: csv::Reader<R>,
    header: Vec<String>,
}

/// One row, by the columns of its table.
pub(crate) struct TableRow<'a> {
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
    let mut bytes = Vec::new();
    File::open(path)
        .and_then(|file| file.take(MAX_LEN + 1).read_to_end(&mut bytes))
        .map_err(|error| FileError::whole(&path.display().to_string(), plain(&error)))?;
    if u64::try_from(bytes.len()).is_ok_and(|length| length > MAX_LEN) {
        return Err(FileError::whole(
            &path.display().to_string(),
            "is longer than 64 MiB",
        ));
    }
    Ok(bytes)
}

/// Returns a row of a table, quoted where it must be.
pub(crate) fn row(fields: &[String]) -> String {
    let mut writer = csv::Writer::from_writer(Vec::new());
    // In memory, of one length, from UTF-8: nothing can fail.
    let written = writer
        .write_record(fields)
        .ok()
        .and_then(|()| writer.into_inner().ok());
    written
        .and_then(|bytes| String::from_utf8(bytes).ok())
        .unwrap_or_default()
}

/// Returns the columns that the header of a table has, by their present names.
pub(crate) fn columns(header: &str) -> Vec<String> {
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(header.as_bytes());
    reader.headers().map_or_else(
        |_| Vec::new(),
        |columns| columns.iter().map(present_name).collect(),
    )
}

/// Returns the present name of a column: until version 0.1 moments ended in `_nm`, which is
/// nanometres elsewhere.
fn present_name(column: &str) -> String {
    let axis = column
        .strip_prefix("sensor_")
        .unwrap_or(column)
        .strip_prefix("moment_");
    match axis.and_then(|axis| axis.strip_suffix("_nm")) {
        Some("x" | "y" | "z") => column.trim_end_matches("_nm").to_owned() + "_n_m",
        _ => column.to_owned(),
    }
}

impl<R: Read> CsvTable<R> {
    /// Reads the header of a table, which `path` names. It must have the columns `required`; others
    /// must be `known`.
    pub(crate) fn begin(
        path: &Path,
        bytes: R,
        required: &[String],
        known: impl Fn(&str) -> bool,
    ) -> Result<Self, FileError> {
        let name = path.display().to_string();
        let mut reader = csv::ReaderBuilder::new()
            .trim(csv::Trim::All)
            .from_reader(bytes);
        let header: Vec<String> = reader
            .headers()
            .map_err(|error| FileError::whole(&name, error))?
            .iter()
            .map(present_name)
            .collect();
        if let [one] = header.as_slice() {
            if let Some(separator) = [';', '\t']
                .into_iter()
                .find(|separator| one.contains(*separator))
            {
                let reason = format!(
                    "columns are separated by {separator:?}; expected ',' (and '.' in numbers), as CSV has it"
                );
                return Err(FileError::at(&name, 1, "", reason));
            }
        }
        for (index, column) in header.iter().enumerate() {
            if header.iter().take(index).any(|other| other == column) {
                return Err(FileError::at(&name, 1, column, "duplicate column"));
            }
            if !required.contains(column) && !known(column) {
                return Err(FileError::at(&name, 1, column, "this column is unknown"));
            }
        }
        if let Some(missing) = required.iter().find(|column| !header.contains(column)) {
            return Err(FileError::at(&name, 1, missing, "this column is missing"));
        }
        Ok(Self {
            name,
            reader,
            header,
        })
    }

    /// True if there is such a column.
    pub(super) fn has(&self, column: &str) -> bool {
        self.place(column).is_some()
    }

    /// Index of a column.
    pub(crate) fn place(&self, column: &str) -> Option<usize> {
        self.header.iter().position(|other| other == column)
    }

    /// Error of a row that is not one of this table.
    fn cannot_read(&self, line: u64, error: &csv::Error) -> FileError {
        let csv::ErrorKind::UnequalLengths { len, .. } = error.kind() else {
            return FileError::at(&self.name, line, "", error);
        };
        let len = usize::try_from(*len).unwrap_or(usize::MAX);
        let columns = self.header.len();
        // The first column without a value, or the last one of a row that is too long.
        let column = self
            .header
            .get(len)
            .or(self.header.last())
            .map_or("", String::as_str);
        let reason = format!(
            "the row has {len} values for {columns} columns; complete it, or remove it if the file was cut off"
        );
        FileError::at(&self.name, line, column, reason)
    }

    /// Reads every row, at most [`MAX_ROWS`].
    pub(super) fn rows<T>(
        self,
        mut read: impl FnMut(&TableRow<'_>) -> Result<T, FileError>,
    ) -> Result<Vec<T>, FileError> {
        let mut rows = Vec::new();
        self.each(|row| {
            if rows.len() == MAX_ROWS {
                return Err(row.error("", format_args!("has more than {MAX_ROWS} rows")));
            }
            rows.push(read(row)?);
            Ok(())
        })?;
        Ok(rows)
    }

    /// Reads every row, one after another; the table may have any number of them, and must have
    /// one.
    pub(crate) fn each(
        mut self,
        mut read: impl FnMut(&TableRow<'_>) -> Result<(), FileError>,
    ) -> Result<(), FileError> {
        let mut record = csv::StringRecord::new();
        let mut is_empty = true;
        loop {
            let line = self.reader.position().line();
            match self.reader.read_record(&mut record) {
                Ok(false) => break,
                Ok(true) => {}
                Err(error) => return Err(self.cannot_read(line, &error)),
            }
            let line = record.position().map_or(line, csv::Position::line);
            read(&TableRow {
                table: &self.name,
                header: &self.header,
                line,
                record: &record,
            })?;
            is_empty = false;
        }
        if is_empty {
            Err(FileError::whole(&self.name, "has no rows"))
        } else {
            Ok(())
        }
    }
}

impl TableRow<'_> {
    /// Returns an error about a column of this row.
    pub(crate) fn error(&self, column: &str, reason: impl std::fmt::Display) -> FileError {
        FileError::at(self.table, self.line, column, reason)
    }

    /// Line of this row.
    pub(crate) const fn line(&self) -> u64 {
        self.line
    }

    /// Returns a text; empty where the column does not exist.
    pub(super) fn text(&self, column: &str) -> &str {
        self.place(column).map_or("", |place| self.text_at(place))
    }

    /// Returns the text of a column, by its index; empty where there is none.
    pub(crate) fn text_at(&self, place: usize) -> &str {
        self.record.get(place).unwrap_or_default()
    }

    /// Returns the name in a column.
    pub(super) fn name(&self, column: &str) -> Result<Name, FileError> {
        self.text(column)
            .parse()
            .map_err(|error| self.error(column, error))
    }

    /// Returns the name in a column, by its index.
    pub(crate) fn name_at(&self, place: usize) -> Result<Name, FileError> {
        self.text_at(place)
            .parse()
            .map_err(|error| self.error_at(place, error))
    }

    /// Returns a number from `-most` to `most`.
    pub(super) fn number(&self, column: &str, most: f64) -> Result<f64, FileError> {
        match self.place(column) {
            Some(place) => self.number_at(place, most),
            None => Err(self.error(column, "this column is missing")),
        }
    }

    /// Returns a number from `-most` to `most`; `None` where it is empty or there is no such
    /// column.
    pub(super) fn optional_number(
        &self,
        column: &str,
        most: f64,
    ) -> Result<Option<f64>, FileError> {
        match self.text(column) {
            "" => Ok(None),
            _ => self.number(column, most).map(Some),
        }
    }

    /// Returns a number from `-most` to `most`, by the index of its column.
    pub(crate) fn number_at(&self, place: usize, most: f64) -> Result<f64, FileError> {
        let text = self.text_at(place);
        let value: f64 = text
            .parse()
            .map_err(|_| self.error_at(place, format_args!("{text:?} is not a number")))?;
        if value.abs() <= most {
            return Ok(value);
        }
        Err(self.error_at(
            place,
            format_args!(
                "{value} is not from {:e} to {most:e}; the unit is in the column's name",
                -most
            ),
        ))
    }

    /// Returns an error about a column of this row, by its index.
    pub(crate) fn error_at(&self, place: usize, reason: impl std::fmt::Display) -> FileError {
        self.error(self.header.get(place).map_or("", String::as_str), reason)
    }

    fn place(&self, column: &str) -> Option<usize> {
        self.header.iter().position(|other| other == column)
    }
}
