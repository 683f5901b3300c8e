//! Count of the rows that a file has taken, and of those that it has lost.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use super::free_space::Full;

/// Reason why a recording failed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("recording {path}: {reason}")]
pub struct RecordError {
    pub(super) path: PathBuf,
    pub(super) reason: String,
}

impl RecordError {
    pub(super) fn new(path: &Path, reason: &impl ToString) -> Self {
        Self {
            path: path.to_owned(),
            reason: reason.to_string(),
        }
    }
}

/// Outcome of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recorded {
    /// Path of the file.
    pub path: PathBuf,
    /// Rows written; if the file failed, some of the last ones may be lost.
    pub written: u64,
    /// Rows known to be lost, because the queue was full, the file failed or there was no room for
    /// it.
    pub lost: u64,
    /// The first failure of the file, a disk that was nearly full among them.
    pub failure: Option<RecordError>,
    /// Reason why it ended before its rows.
    pub full: Option<Full>,
}

impl Recorded {
    /// A recording whose disk or reader takes nothing more.
    pub(super) fn blocked(path: &Path, taken: u64, lost: u64) -> Self {
        let reason = "its disk or reader takes nothing; what waits for it is lost";
        Self {
            path: path.to_owned(),
            written: taken,
            lost,
            failure: Some(RecordError::new(path, &reason)),
            full: None,
        }
    }
}

impl fmt::Display for Recorded {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let path = self.path.display();
        let (written, lost) = (self.written, self.lost);
        match (&self.failure, &self.full) {
            (_, Some(full)) => write!(
                f,
                "recorded {written} rows to {path}, {lost} dropped after {full}"
            ),
            (None, None) => write!(f, "recorded {written} rows to {path}, {lost} dropped"),
            // Some of the last rows may not have reached the disk.
            (Some(failure), None) => {
                write!(
                    f,
                    "recorded at most {written} rows to {path}, at least {lost} dropped ({})",
                    failure.reason
                )
            }
        }
    }
}

/// Rows of one file so far.
#[derive(Debug)]
pub(super) struct Tally {
    path: PathBuf,
    failure: Option<RecordError>,
    full: Option<Full>,
    written: u64,
    lost: u64,
}

impl Tally {
    pub(super) fn of(path: &Path) -> Self {
        Self {
            path: path.to_owned(),
            failure: None,
            full: None,
            written: 0,
            lost: 0,
        }
    }

    /// Names the file as it was made.
    pub(super) fn at(&mut self, path: &Path) {
        path.clone_into(&mut self.path);
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) const fn is_empty(&self) -> bool {
        self.written == 0 && self.lost == 0
    }

    /// True if further rows are only counted.
    pub(super) const fn counts_alone(&self) -> bool {
        self.failure.is_some() || self.full.is_some()
    }

    pub(super) const fn has_failed(&self) -> bool {
        self.failure.is_some()
    }

    /// Counts a row that is lost.
    pub(super) fn lose(&mut self) {
        self.lost += 1;
    }

    /// Writes a row by `write`.
    pub(super) fn count(&mut self, write: impl FnOnce() -> io::Result<()>) {
        match write() {
            Ok(()) => self.written += 1,
            Err(error) => {
                self.fail(&error);
                self.lost += 1;
            }
        }
    }

    /// Takes the end of a file for which there is no more room, and the outcome of completing it.
    /// The limit is a wish, a full disk a failure.
    pub(super) fn end(&mut self, full: Full, finished: io::Result<()>) {
        match (finished, &full) {
            (Err(error), _) => self.fail(&error),
            (Ok(()), Full::Disk { .. }) => self.fail(&io::Error::other(full.to_string())),
            (Ok(()), Full::Limit(_)) => {}
        }
        self.full = Some(full);
    }

    /// Takes the outcome of the last flush, and adds the rows that the queue dropped.
    pub(super) fn finish(&mut self, flushed: io::Result<()>, dropped: u64) -> Recorded {
        if let Err(error) = flushed {
            self.fail(&error);
        }
        let Self {
            path,
            failure,
            full,
            written,
            lost,
        } = self;
        let lost = *lost + dropped;
        Recorded {
            path: path.clone(),
            written: *written,
            lost,
            failure: failure.clone(),
            full: full.clone(),
        }
    }

    /// Keeps the first failure.
    pub(super) fn fail(&mut self, error: &io::Error) {
        let path = self.path.clone();
        if self.failure.is_none() {
            tracing::warn!(
                "recording {}: {error}; its rows are lost from here on",
                path.display()
            );
        }
        self.failure.get_or_insert(RecordError {
            path,
            reason: error.to_string(),
        });
    }
}
