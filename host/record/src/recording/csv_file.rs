//! CSV: one row per line, units in the header.

use std::io;

use gantry_tau_system::output::GrowingFile;

/// Room for a row: each is written whole, so that the file ends with a whole line whenever the
/// process ends.
const MAX_ROW: usize = 1 << 16;

/// One row of a recording.
pub trait CsvRecord: Copy + Send + 'static {
    /// Names of the columns, with units.
    fn header() -> Vec<String>;
    /// The values, in the order of the header.
    fn fields(&self) -> Vec<String>;
}

/// Begins a table with the header of `T`.
pub(super) fn create<T: CsvRecord>(file: GrowingFile) -> io::Result<csv::Writer<GrowingFile>> {
    let mut writer = csv::WriterBuilder::new()
        .buffer_capacity(MAX_ROW)
        .from_writer(file);
    writer.write_record(T::header())?;
    writer.flush()?;
    Ok(writer)
}

/// Writes a row.
pub(super) fn put<T: CsvRecord>(writer: &mut csv::Writer<GrowingFile>, row: &T) -> io::Result<()> {
    writer.write_record(row.fields())?;
    writer.flush()
}
