//! BlackBoxWriter of a folder of black boxes: every window that is received becomes a file, or an
//! error on the log.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use gantry_tau_server::black_box::Window;
use gantry_tau_server::black_box::swap_channel::Receiver;
use gantry_tau_system::last_wait;
use gantry_tau_system::output::{Kind, Output};

use super::{FileError, json, loops, loops_beside};

/// Windows of one run that are kept, the newest: a client that comes and goes for ever must not
/// fill the disk.
const KEPT: usize = 1_000;
/// Windows of sessions that never obtained, as any client can have, that are kept, the newest: they
/// have no part in the room of the others.
const KEPT_OF_PASSERS_BY: usize = 16;

/// Rest between two looks for windows.
const REST: Duration = Duration::from_millis(10);

/// A folder, and the windows that are written into it.
#[derive(Debug)]
pub struct BlackBoxWriter<const N: usize> {
    folder: PathBuf,
    windows: Receiver<N>,
    written: Newest<KEPT>,
    of_passers_by: Newest<KEPT_OF_PASSERS_BY>,
    lost: u64,
    failure: Option<FileError>,
}

impl<const N: usize> BlackBoxWriter<N> {
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

    /// Starts a thread that writes windows as they arrive. A folder on a disk that hangs then
    /// blocks nothing else.
    ///
    /// # Errors
    /// [`FileError`]: there is no further thread.
    pub fn start(mut self) -> Result<Writing, FileError> {
        let has_ended = Arc::new(AtomicBool::new(false));
        let (ended, folder) = (Arc::clone(&has_ended), self.folder.clone());
        let thread = std::thread::Builder::new()
            .name("black boxes".to_owned())
            .spawn(move || {
                // But for its folder. Without the right to give them up it has none.
                let _ = gantry_tau_system::privileges::give_up(std::slice::from_ref(&self.folder));
                while !ended.load(Ordering::Acquire) {
                    self.write_waiting();
                    std::thread::sleep(REST);
                }
                self.finish()
            })
            .map_err(|error| FileError::of(&folder, error))?;
        Ok(Writing {
            folder,
            has_ended,
            thread,
        })
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

    /// Writes a window.
    pub(super) fn write(&mut self, window: &Window<N>, is_of_value: bool) {
        let path = self.folder.join(window.file_name());
        match self.write_files(window, &path) {
            Ok(files) => {
                tracing::info!("black box: {}", files.first().unwrap_or(&path).display());
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
        let path = write_file(path, &json::encode(window))?;
        let mut files = vec![path.clone()];
        if let Some(of_loops) = &window.loops {
            files.push(write_file(&loops_beside(&path), &loops::encode(of_loops))?);
        }
        Ok(files)
    }
}

/// Writes a black box, under a name that is free. Returns its path.
fn write_file(path: &Path, text: &str) -> Result<PathBuf, FileError> {
    Output::new(path, Kind::BlackBox)
        .write(text)
        .map_err(|error| FileError::of(path, error))
}

/// Folder of black boxes that a thread writes.
#[derive(Debug)]
pub struct Writing {
    folder: PathBuf,
    has_ended: Arc<AtomicBool>,
    thread: JoinHandle<Result<(), FileError>>,
}

impl Writing {
    /// Ends with the last windows; the cycle that sends them has ended.
    ///
    /// # Errors
    /// [`FileError`]: as of [`BlackBoxWriter::finish`], or the disk takes nothing for five seconds.
    pub fn finish(self) -> Result<(), FileError> {
        self.has_ended.store(true, Ordering::Release);
        match last_wait::join(self.thread, || 0) {
            Some(Ok(written)) => written,
            // A panic was reported on stderr.
            Some(Err(_)) => Err(FileError::of(
                &self.folder,
                "the writer of black boxes panicked",
            )),
            None => Err(FileError::of(
                &self.folder,
                "the last black boxes are not written: the disk hangs",
            )),
        }
    }
}

/// Files of the newest windows, at most so many windows. Those of earlier runs are not touched.
#[derive(Debug, Default)]
struct Newest<const MAX: usize>(VecDeque<Vec<PathBuf>>);

impl<const MAX: usize> Newest<MAX> {
    /// Keeps the files of a window; removes those of the oldest beyond `MAX`.
    fn keep(&mut self, files: Vec<PathBuf>) {
        self.0.push_back(files);
        if self.0.len() <= MAX {
            return;
        }
        for file in self.0.pop_front().into_iter().flatten() {
            if let Err(error) = std::fs::remove_file(&file) {
                tracing::warn!(
                    "{} is not removed for a newer black box: {error}",
                    file.display()
                );
            }
        }
    }
}
