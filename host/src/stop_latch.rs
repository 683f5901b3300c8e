//! The stop latch on disk: a stop outlives the server that saw it, until somebody re-arms at the machine.
//!
//! The file lies beside the epoch counter. The cycle writes it in the tick that enters or leaves Fault: some bytes into an open file, which the
//! death of the process does not undo. A [`LatchFlusher`] in another thread flushes them: only then do they survive a power failure.
#![allow(clippy::disallowed_methods, reason = "the state of a server has a policy of its own")]

use std::fs::File;
use std::io::{self, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use gantry_tau_core::control::message::Phase;

/// Contents of the file, of one length, so that each replaces the other.
const STOPPED: &str = "stopped \n";
const RELEASED: &str = "released\n";

/// Error of [`StopLatch::open`].
#[derive(Debug, thiserror::Error)]
#[error("stop latch {path} (beside --epoch-file): {reason}")]
pub struct StopLatchError {
    path: PathBuf,
    reason: io::Error,
}

/// The latch of a server.
#[derive(Debug)]
pub struct StopLatch {
    /// Absent if nothing is kept.
    file: Option<File>,
    is_latched: bool,
    is_lost: bool,
}

impl StopLatch {
    /// A latch that ends with the process: for simulations.
    #[must_use]
    pub const fn volatile() -> Self {
        Self { file: None, is_latched: false, is_lost: false }
    }

    /// Opens the latch beside an epoch file. What cannot be read as released is latched; so is a missing file, but in the first run.
    ///
    /// # Errors
    /// [`StopLatchError`]: the file cannot be written, so that a stop could not be kept.
    pub fn open(epoch_file: &Path, is_first_run: bool) -> Result<Self, StopLatchError> {
        let mut path = epoch_file.as_os_str().to_owned();
        path.push(".stop");
        let path = PathBuf::from(path);
        let opened = || {
            let mut file = File::options().read(true).write(true).create(true).truncate(false).open(&path)?;
            let mut text = String::new();
            let is_latched = match file.read_to_string(&mut text) {
                Ok(0) => !is_first_run,
                Ok(_) => text != RELEASED,
                Err(error) if error.kind() == ErrorKind::InvalidData => true,
                Err(error) => return Err(error),
            };
            let mut latch = Self { file: Some(file), is_latched: !is_latched, is_lost: false };
            latch.write(is_latched)?;
            latch.file.as_ref().map_or(Ok(()), File::sync_all)?;
            Ok(latch)
        };
        opened().map_err(|reason| StopLatchError { path: path.clone(), reason })
    }

    /// True after a stop that was not re-armed.
    #[must_use]
    pub const fn is_latched(&self) -> bool {
        self.is_latched
    }

    /// True if the last change could not be written.
    #[must_use]
    pub const fn is_lost(&self) -> bool {
        self.is_lost
    }

    /// Latches or releases. Does nothing if that is so already.
    pub fn set(&mut self, is_latched: bool) {
        if is_latched != self.is_latched || self.is_lost {
            self.is_lost = self.write(is_latched).is_err();
        }
    }

    fn write(&mut self, is_latched: bool) -> io::Result<()> {
        self.is_latched = is_latched;
        let Some(file) = &mut self.file else { return Ok(()) };
        file.seek(SeekFrom::Start(0))?;
        file.write_all(if is_latched { STOPPED } else { RELEASED }.as_bytes())
    }
}

/// Flushes a latch, in a thread that may wait for the disk.
#[derive(Debug)]
pub struct LatchFlusher {
    file: Option<File>,
    is_fault: bool,
}

impl LatchFlusher {
    /// The flusher of a latch.
    #[must_use]
    pub fn of(latch: &StopLatch) -> Self {
        Self { file: latch.file.as_ref().and_then(|file| file.try_clone().ok()), is_fault: latch.is_latched }
    }

    /// Flushes when Fault is entered or left.
    pub fn see(&mut self, phase: Phase) {
        if self.is_fault != (phase == Phase::Fault) {
            self.is_fault = !self.is_fault;
            self.flush();
        }
    }

    /// Flushes.
    pub fn flush(&self) {
        if let Some(Err(error)) = self.file.as_ref().map(File::sync_data) {
            tracing::error!("the stop latch cannot be flushed to the disk: {error}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A folder of this test's own, gone with it.
    struct Folder(PathBuf);

    impl Folder {
        fn new(name: &str) -> Self {
            let path = std::env::temp_dir().join(format!("gantry-tau-latch-{name}-{}", std::process::id()));
            let _ = std::fs::remove_dir_all(&path);
            std::fs::create_dir_all(&path).unwrap();
            Self(path)
        }

        fn open(&self, is_first_run: bool) -> StopLatch {
            StopLatch::open(&self.0.join("epoch"), is_first_run).unwrap()
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }

    #[test]
    fn a_stop_outlives_the_process_until_it_is_released() {
        let folder = Folder::new("outlives");
        let mut latch = folder.open(true);
        assert!(!latch.is_latched());
        latch.set(true);
        drop(latch);
        let mut latch = folder.open(false);
        assert!(latch.is_latched());
        latch.set(false);
        drop(latch);
        assert!(!folder.open(false).is_latched());
    }

    #[test]
    fn what_cannot_be_read_is_latched() {
        let folder = Folder::new("unreadable");
        let file = folder.0.join("epoch.stop");
        assert!(folder.open(false).is_latched(), "it was there, and is gone");
        for content in [&b"released"[..], b"released\nx", b"stopped\n", b"\xff\xff\xff\xff\xff\xff\xff\xff\n"] {
            std::fs::write(&file, content).unwrap();
            assert!(folder.open(true).is_latched(), "{content:?}");
        }
        let error = StopLatch::open(&folder.0.join("nowhere").join("epoch"), true).unwrap_err().to_string();
        assert!(error.contains("epoch.stop") && error.contains("--epoch-file"), "{error}");
    }
}
