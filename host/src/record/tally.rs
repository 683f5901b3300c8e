//! Count of the rows that a file has taken, and of those that it has lost.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// Reason why a recording failed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("recording {path}: {reason}")]
pub struct RecordError {
    pub(super) path: PathBuf,
    pub(super) reason: String,
}

/// Outcome of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recorded {
    /// Path of the file.
    pub path: PathBuf,
    /// Rows written; if the file failed, some of the last ones may be lost.
    pub written: u64,
    /// Rows known to be lost, because the queue was full or the file failed.
    pub lost: u64,
    /// The first failure of the file.
    pub failure: Option<RecordError>,
}

impl fmt::Display for Recorded {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let path = self.path.display();
        let (written, lost) = (self.written, self.lost);
        match &self.failure {
            None => write!(f, "recorded {written} rows to {path}, {lost} dropped"),
            // Some of the last rows were still buffered.
            Some(failure) => {
                write!(f, "recorded at most {written} rows to {path}, at least {lost} dropped ({})", failure.reason)
            }
        }
    }
}

/// Rows of one file so far.
#[derive(Debug)]
pub(super) struct Tally {
    path: PathBuf,
    failure: Option<RecordError>,
    written: u64,
    lost: u64,
}

impl Tally {
    pub(super) fn of(path: &Path) -> Self {
        Self { path: path.to_owned(), failure: None, written: 0, lost: 0 }
    }

    /// Writes a row by `write`, unless the file has failed before.
    pub(super) fn count(&mut self, write: impl FnOnce() -> io::Result<()>) {
        if self.failure.is_none() {
            match write() {
                Ok(()) => {
                    self.written += 1;
                    return;
                }
                Err(error) => self.fail(&error),
            }
        }
        self.lost += 1;
    }

    /// Takes the outcome of the last flush, and adds the rows that the queue dropped.
    pub(super) fn finish(&mut self, flushed: io::Result<()>, dropped: u64) -> Recorded {
        if let Err(error) = flushed {
            self.fail(&error);
        }
        let Self { path, failure, written, lost } = self;
        Recorded { path: path.clone(), written: *written, lost: *lost + dropped, failure: failure.clone() }
    }

    fn fail(&mut self, error: &io::Error) {
        let path = self.path.clone();
        self.failure.get_or_insert(RecordError { path, reason: error.to_string() });
    }
}
