//! A folder of black boxes: every window that is handed over becomes a file, or a word about why it did not.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use super::handover::Receiver;
use super::{FileError, Window};

/// Files of one run. A client that comes and goes for ever must not fill the disk.
const MOST_FILES: u64 = 1_000;

/// The folder, and where its files come from.
#[derive(Debug)]
pub struct Archive<const N: usize> {
    folder: PathBuf,
    windows: Receiver<N>,
    written: u64,
    lost: u64,
    failure: Option<FileError>,
}

impl<const N: usize> Archive<N> {
    /// Makes the folder, unless it is there.
    ///
    /// # Errors
    /// [`FileError`] naming the folder and the reason.
    pub fn open(folder: &Path, windows: Receiver<N>) -> Result<Self, FileError> {
        std::fs::create_dir_all(folder).map_err(|error| failure(folder, &error.to_string()))?;
        Ok(Self {
            folder: folder.to_owned(),
            windows,
            written: 0,
            lost: 0,
            failure: None,
        })
    }

    /// Writes whatever has been handed over; says on the log what was written, and what was lost and why.
    pub fn write_waiting(&mut self) {
        while let Some(window) = self.windows.receive() {
            self.keep(&window);
        }
        let lost = self.windows.take_lost();
        if lost > 0 {
            self.lost += lost;
            tracing::error!("{lost} black box(es) lost: sessions end faster than they are written");
        }
    }

    /// The last look.
    ///
    /// # Errors
    /// [`FileError`], the first failure; [`Self::write_waiting`] has told of every one.
    pub fn finish(mut self) -> Result<(), FileError> {
        self.write_waiting();
        match self.failure {
            Some(failure) => Err(failure),
            None if self.lost > 0 => Err(failure(
                &self.folder,
                &format!("{} black box(es) lost", self.lost),
            )),
            None => Ok(()),
        }
    }

    fn keep(&mut self, window: &Window<N>) {
        let path = self.folder.join(window.file_name());
        let kept = if self.written < MOST_FILES {
            create(&path, &window.encode())
        } else {
            let reason = format!("{MOST_FILES} black boxes are written, no more in this run");
            Err(failure(&path, &reason))
        };
        match kept {
            Ok(()) => {
                self.written += 1;
                tracing::info!("black box: {}", path.display());
            }
            Err(failure) => {
                tracing::error!("black box lost: {failure}");
                self.failure.get_or_insert(failure);
            }
        }
    }
}

/// Writes a file that is not there yet: the evidence of another run is never overwritten.
fn create(path: &Path, text: &str) -> Result<(), FileError> {
    let written = File::create_new(path).and_then(|mut file| file.write_all(text.as_bytes()));
    written.map_err(|error| failure(path, &error.to_string()))
}

fn failure(path: &Path, reason: &str) -> FileError {
    FileError {
        file: path.display().to_string(),
        line: None,
        reason: reason.to_owned(),
    }
}
