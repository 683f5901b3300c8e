//! The stop latch on disk: a stop outlives the server that saw it, until somebody re-arms at the
//! machine.
//!
//! The file lies beside the epoch counter. In the tick that latches or releases a stop some bytes
//! are written into the open file, which the death of the process does not undo: by a
//! [`LatchWriter`] for which the cycle waits a moment. A [`LatchFlusher`] in another thread flushes
//! them: only then do they survive a power failure.

use std::fs::File;
use std::io::{self, ErrorKind};
use std::path::Path;
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use gantry_tau_system::last_wait;

use super::StateError;
use super::epoch::sync_folder;
use super::latch_writer::{LENGTH, LatchWriter, RELEASED, write_position};
use super::regular_file::{self, Access};

/// Reads a latch: true if it is latched, or cannot be understood; `None` without a file.
///
/// # Errors
/// [`StateError`]: not a regular file, too long for a latch, or it cannot be read.
pub(super) fn read(path: &Path) -> Result<Option<bool>, StateError> {
    match regular_file::open(path, Access::Read).and_then(|mut file| regular_file::read(&mut file))
    {
        // Damage makes none that is longer.
        Ok(text) if text.len() > LENGTH => {
            let reason = "is another file, not a stop latch of gantry-tau; move it away: the server then starts in Fault";
            Err(failed(
                path,
                &io::Error::new(ErrorKind::InvalidInput, reason),
            ))
        }
        Ok(text) => Ok(Some(text != RELEASED)),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(failed(path, &error)),
    }
}

/// Creates the file of a latch, with its position.
fn create(path: &Path, is_latched: bool) -> io::Result<File> {
    let mut file = regular_file::open(path, Access::Create)?;
    write_position(&mut file, is_latched)?;
    file.set_len(LENGTH as u64)?;
    file.sync_all()?;
    sync_folder(path)?;
    Ok(file)
}

fn failed(path: &Path, error: &io::Error) -> StateError {
    StateError::File {
        file: "stop latch",
        path: path.to_owned(),
        reason: error.to_string(),
    }
}

/// Storage of a latch.
#[derive(Debug)]
enum Store {
    /// Nowhere.
    None,
    /// Written by the thread that sets the latch.
    File(File),
    /// Written by a thread of its own.
    Writer(LatchWriter, File),
}

/// The latch of a server.
#[derive(Debug)]
pub struct StopLatch {
    store: Store,
    is_latched: bool,
    is_lost: bool,
}

impl StopLatch {
    /// A latch that ends with the process: for simulations.
    #[must_use]
    pub const fn volatile() -> Self {
        Self {
            store: Store::None,
            is_latched: false,
            is_lost: false,
        }
    }

    /// Opens a latch for writing, and writes its position.
    ///
    /// # Errors
    /// [`StateError`]: the file cannot be written, so that a stop could not be kept.
    pub(super) fn open(path: &Path, is_latched: bool) -> Result<Self, StateError> {
        let file = create(path, is_latched).map_err(|error| failed(path, &error))?;
        Ok(Self {
            store: Store::File(file),
            is_latched,
            is_lost: false,
        })
    }

    /// From here on a thread of its own writes the latch. It has priority and privileges of the
    /// calling thread, which is the one that sets the latch and waits for each change, at most as
    /// long as `patience`.
    ///
    /// # Errors
    /// The system's: there is no further thread or open file.
    pub fn start_writer(&mut self, patience: Duration) -> io::Result<()> {
        if let Store::File(file) = &self.store {
            let theirs = file.try_clone()?;
            self.store = Store::Writer(LatchWriter::start(theirs, patience)?, file.try_clone()?);
        }
        Ok(())
    }

    /// True after a stop that was not re-armed.
    #[must_use]
    pub const fn is_latched(&self) -> bool {
        self.is_latched
    }

    /// True if the last change is not written, or not yet.
    #[must_use]
    pub const fn is_lost(&self) -> bool {
        self.is_lost
    }

    /// Returns what the file says; `None` if the last change is not written.
    #[must_use]
    pub fn stored(&self) -> Option<bool> {
        (!self.is_lost).then_some(self.is_latched)
    }

    /// Latches or releases. Tries again what could not be written, and otherwise does nothing if it
    /// is so already.
    pub fn set(&mut self, is_latched: bool) {
        let is_change = is_latched != self.is_latched;
        if is_change || self.is_lost {
            self.is_latched = is_latched;
            self.is_lost = match &mut self.store {
                Store::None => false,
                Store::File(file) => write_position(file, is_latched).is_err(),
                Store::Writer(writer, _) if is_change => !writer.write(is_latched),
                Store::Writer(writer, _) => !writer.is_written(is_latched),
            };
        }
    }

    /// Returns the file; `None` if nothing is kept.
    const fn file(&self) -> Option<&File> {
        match &self.store {
            Store::None => None,
            Store::File(file) | Store::Writer(_, file) => Some(file),
        }
    }
}

/// Flushes a latch, in a thread of its own: it may wait for the disk.
#[derive(Debug)]
pub struct LatchFlusher {
    /// Absent if nothing is kept.
    thread: Option<(Sender<()>, JoinHandle<()>)>,
    is_latched: bool,
    is_lost: bool,
}

impl LatchFlusher {
    /// Starts the flusher of a latch.
    ///
    /// # Errors
    /// The system's: there is no further thread or open file.
    pub fn of(latch: &StopLatch) -> io::Result<Self> {
        Ok(Self {
            thread: latch.file().map(start_flushing).transpose()?,
            is_latched: latch.is_latched,
            is_lost: latch.is_lost,
        })
    }

    /// Asks for a flush when a stop is latched or released, and when that is written later, and
    /// returns true if it does. In a quit the phase does not tell when.
    pub fn see(&mut self, is_latched: bool, is_lost: bool) -> bool {
        let changed = self.is_latched != is_latched || self.is_lost && !is_lost;
        (self.is_latched, self.is_lost) = (is_latched, is_lost);
        if changed {
            self.ask();
        }
        changed
    }

    fn ask(&self) {
        if let Some((changes, _)) = &self.thread {
            // The thread ends after this end of the channel.
            let _sent = changes.send(());
        }
    }

    /// Flushes once more, at the end; a disk that hangs is waited for five seconds.
    pub fn finish(self) {
        self.ask();
        let Some((changes, thread)) = self.thread else {
            return;
        };
        drop(changes);
        if last_wait::join(thread, || 0).is_none() {
            tracing::error!(
                "the stop latch is not flushed, because the disk hangs: a power failure may undo the last change"
            );
        }
    }
}

/// Starts the thread that flushes a file after each change.
fn start_flushing(file: &File) -> io::Result<(Sender<()>, JoinHandle<()>)> {
    let file = file.try_clone()?;
    let (changes, asked) = channel();
    let thread = std::thread::Builder::new()
        .name("stop latch".to_owned())
        .spawn(move || {
            // It needs none; without the right to give them up it has none.
            let _ = gantry_tau_system::privileges::give_up(&[]);
            asked.iter().for_each(|()| flush(&file));
        })?;
    Ok((changes, thread))
}

fn flush(file: &File) {
    if let Err(error) = file.sync_data() {
        tracing::error!("the stop latch cannot be flushed to the disk: {error}");
    }
}
