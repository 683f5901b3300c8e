//! Writer of a folder of black boxes: every window that is received becomes a file, or an error on the log.
#![allow(clippy::disallowed_methods, reason = "black boxes are new files always")]

use std::collections::VecDeque;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use super::swap_channel::Receiver;
use super::{FileError, Window};

/// Windows of one run that are kept, the newest: a client that comes and goes for ever must not fill the disk.
const KEPT: usize = 1_000;
/// Windows of sessions that never obtained, as any client can have, that are kept, the newest: they have no part in the room of the others.
const KEPT_OF_PASSERS_BY: usize = 16;

/// A folder, and the windows that are written into it.
#[derive(Debug)]
pub struct Writer<const N: usize> {
    folder: PathBuf,
    windows: Receiver<N>,
    written: Newest<KEPT>,
    of_passers_by: Newest<KEPT_OF_PASSERS_BY>,
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
        Ok(Self {
            folder: folder.to_owned(),
            windows,
            written: Newest::default(),
            of_passers_by: Newest::default(),
            lost: 0,
            failure: None,
        })
    }

    /// Writes the windows that have arrived; logs each file, and each loss with its reason.
    pub fn write_waiting(&mut self) {
        while let Some((window, is_of_value)) = self.windows.receive_judged() {
            self.write(&window, is_of_value);
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

    fn write(&mut self, window: &Window<N>, is_of_value: bool) {
        let path = self.folder.join(window.file_name());
        match self.write_files(window, &path) {
            Ok(files) => {
                tracing::info!("black box: {}", path.display());
                if is_of_value {
                    self.written.keep(files);
                } else {
                    self.of_passers_by.keep(files);
                }
            }
            Err(failure) => {
                tracing::error!("black box lost: {failure}");
                self.failure.get_or_insert(failure);
            }
        }
    }

    /// Returns the files of a window.
    fn write_files(&self, window: &Window<N>, path: &Path) -> Result<Vec<PathBuf>, FileError> {
        let mut files = vec![path.to_owned()];
        create(path, &window.encode()).map_err(|error| FileError::of(path, error))?;
        if let Some(loops) = &window.loops {
            let path = self.folder.join(window.loops_file_name());
            create(&path, &loops.encode()).map_err(|error| FileError::of(&path, error))?;
            files.push(path);
        }
        Ok(files)
    }
}

/// Files of the newest windows, at most so many windows. Those of earlier runs are not touched.
#[derive(Debug, Default)]
struct Newest<const MOST: usize>(VecDeque<Vec<PathBuf>>);

impl<const MOST: usize> Newest<MOST> {
    /// Keeps the files of a window; removes those of the oldest beyond the most.
    fn keep(&mut self, files: Vec<PathBuf>) {
        self.0.push_back(files);
        if self.0.len() <= MOST {
            return;
        }
        for file in self.0.pop_front().into_iter().flatten() {
            if let Err(error) = std::fs::remove_file(&file) {
                tracing::warn!("{} is not removed for a newer black box: {error}", file.display());
            }
        }
    }
}

/// Writes a new file: the evidence of another run is never overwritten.
fn create(path: &Path, text: &str) -> std::io::Result<()> {
    File::create_new(path)?.write_all(text.as_bytes())
}
