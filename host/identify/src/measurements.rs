//! Files of measurements: a set-up (TOML) and its table (CSV), read strictly. An unknown or missing
//! key or column, or a number that cannot be, is an error that names file, line and column.

pub mod frame;
pub(crate) mod mistaken_columns;
pub mod moved_rows;
pub mod plan;
pub mod poses;
pub(crate) mod repeated;
pub mod setup;
pub mod springs;
pub(crate) mod table;
pub mod tool;
pub mod wrench_columns;

use std::fmt;
use std::path::{Path, PathBuf};

use gantry_tau_system::output::printable;
use serde::Deserialize;

pub use table::MAX_ROWS;

/// First key of a set-up; all others are ignored.
#[derive(Deserialize)]
struct Format {
    format: String,
}

/// Name of the table in a set-up; all other keys are ignored.
#[derive(Deserialize)]
struct NamedTable {
    measurements: String,
}

/// Returns the format that a set-up states.
///
/// # Errors
/// [`FileError`].
pub fn format_of(path: &Path) -> Result<String, FileError> {
    setup::parse::<Format>(path, &setup::text(path)?).map(|format| format.format)
}

/// Returns the table that a set-up names, if the file is one. A pipe is not looked into: it is read
/// once, by the command.
#[must_use]
pub fn table_of(path: &Path) -> Option<PathBuf> {
    if !path.is_file() {
        return None;
    }
    let named = setup::parse::<NamedTable>(path, &setup::text(path).ok()?).ok()?;
    Some(setup::beside(path, &named.measurements))
}

/// Error of a file of measurements, in one line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileError {
    /// Path of the file.
    pub file: String,
    /// Line, counted from 1.
    pub line: Option<u64>,
    /// Column or key.
    pub column: Option<String>,
    /// Description of the error.
    pub reason: String,
}

impl FileError {
    pub(crate) fn whole(file: &str, reason: impl fmt::Display) -> Self {
        Self {
            file: one_line(file),
            line: None,
            column: None,
            reason: one_line(&reason.to_string()),
        }
    }

    /// An error of a key.
    #[must_use]
    pub fn key(file: &Path, key: impl AsRef<str>, reason: impl fmt::Display) -> Self {
        // Names of series and gauges are anything that TOML can quote.
        Self {
            column: Some(one_line(key.as_ref())),
            ..Self::whole(&file.display().to_string(), reason)
        }
    }

    pub(crate) fn at(file: &str, line: u64, column: &str, reason: impl fmt::Display) -> Self {
        let column = (!column.is_empty()).then(|| one_line(column));
        Self {
            line: Some(line),
            column,
            ..Self::whole(file, reason)
        }
    }
}

fn one_line(text: &str) -> String {
    printable(&text.split_whitespace().collect::<Vec<_>>().join(" "))
}

impl fmt::Display for FileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.file)?;
        if let Some(line) = self.line {
            write!(f, ":{line}")?;
        }
        if let Some(column) = &self.column {
            write!(f, ": {column}")?;
        }
        write!(f, ": {}", self.reason)
    }
}

impl std::error::Error for FileError {}
