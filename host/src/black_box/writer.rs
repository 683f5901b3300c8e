//! Writer of a folder of black boxes: every window that is received becomes a file, or an error on the log.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use super::swap_channel::Receiver;
use super::{FileError, Window};

/// Largest number of files of one run: a client that comes and goes for ever must not fill the disk.
const MAX_FILES: u64 = 1_000;

/// A folder, and the windows that are written into it.
#[derive(Debug)]
pub struct Writer<const N: usize> {
    folder: PathBuf,
    windows: Receiver<N>,
    written: u64,
    lost: u64,
    failure: Option<FileError>,
}

impl<const N: usize> Writer<N> {
    /// Creates the folder, unless it exists.
    ///
    /// # Errors
    /// [`FileError`] with the folder and the reason.
    pub fn open(folder: &Path, windows: Receiver<N>) -> Result<Self, FileError> {
        std::fs::create_dir_all(folder).map_err(|error| FileError::of(folder, error))?;
        Ok(Self { folder: folder.to_owned(), windows, written: 0, lost: 0, failure: None })
    }

    /// Writes the windows that have arrived; logs each file, and each loss with its reason.
    pub fn write_waiting(&mut self) {
        while let Some(window) = self.windows.receive() {
            self.write(&window);
        }
        let lost = self.windows.take_lost();
        if lost > 0 {
            self.lost += lost;
            tracing::error!("{lost} black box(es) lost: sessions end faster than they are written");
        }
    }

    /// Writes the last windows.
    ///
    /// # Errors
    /// [`FileError`], the first failure; [`Self::write_waiting`] has logged every one.
    pub fn finish(mut self) -> Result<(), FileError> {
        self.write_waiting();
        match self.failure {
            Some(failure) => Err(failure),
            None if self.lost > 0 => {
                let reason = format!("{} black box(es) lost", self.lost);
                Err(FileError::of(&self.folder, reason))
            }
            None => Ok(()),
        }
    }

    fn write(&mut self, window: &Window<N>) {
        let path = self.folder.join(window.file_name());
        let written = if self.written < MAX_FILES {
            create(&path, &window.encode()).map_err(|error| FileError::of(&path, error)).and_then(|()| {
                let Some(loops) = &window.loops else { return Ok(()) };
                let path = self.folder.join(window.loops_file_name());
                create(&path, &loops.encode()).map_err(|error| FileError::of(&path, error))
            })
        } else {
            let reason = format!("{MAX_FILES} black boxes are written; a run writes no more");
            Err(FileError::of(&path, reason))
        };
        match written {
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

/// Writes a new file: the evidence of another run is never overwritten.
fn create(path: &Path, text: &str) -> std::io::Result<()> {
    File::create_new(path)?.write_all(text.as_bytes())
}
