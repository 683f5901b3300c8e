//! Files of results.

use std::path::{Path, PathBuf};

/// A file that cannot be written.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cannot write {path}: {reason}")]
pub struct WriteError {
    path: PathBuf,
    reason: String,
}

/// Writes a whole file.
///
/// # Errors
/// [`WriteError`] with path and reason.
pub fn write(path: &Path, text: &str) -> Result<(), WriteError> {
    std::fs::write(path, text).map_err(|error| WriteError { path: path.to_owned(), reason: error.to_string() })
}
