//! State of a machine that outlives its server: epochs that were given away, and the stop latch.
//!
//! Three files lie beside each other: the epoch counter (`epoch`, or the file of `--epoch-file`),
//! the stop latch (`.stop`) and the lock (`.lock`). T9 and T23 assume that one server at a time
//! reads and writes them: [`MachineState::own`] takes the lock before it reads anything, and the
//! lock is held until the server has ended.
#![allow(
    clippy::disallowed_methods,
    reason = "the state of a server has a policy of its own"
)]

mod epoch;
mod latch_writer;
mod lock;
mod place;
pub(crate) mod regular_file;
mod stop_latch;

use std::path::{Path, PathBuf};

use gantry_tau_core::units::EpochRange;

pub use lock::Lock;
use lock::LockError;
pub use place::{Environment, MachineName, ParseMachineNameError, PlaceError, StatePlace};
pub use stop_latch::{LatchFlusher, StopLatch};

/// Error of a machine's state.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StateError {
    /// Another server owns the state.
    #[error(
        "epoch file {}: in use by {owner}; a machine has one server: end that one, or name another machine with --name or --epoch-file",
        path.display()
    )]
    InUse {
        /// The epoch file.
        path: PathBuf,
        /// The owner: process and machine.
        owner: String,
    },
    /// A file cannot be read or written, or is not one of ours.
    #[error("{file} {}: {reason}", path.display())]
    File {
        /// Name of its purpose.
        file: &'static str,
        /// Its path.
        path: PathBuf,
        /// The reason, and what to do.
        reason: String,
    },
    /// A first run was declared, and the state of an earlier one is there.
    #[error("--first-run: {} is there, so the machine has run before; leave the option out", path.display())]
    NotFirst {
        /// The file that is there.
        path: PathBuf,
    },
}

/// Knowledge of the user or of the command line about a machine without state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FirstRun {
    /// `--first-run`: the machine has never run.
    Declared,
    /// Nothing can be hurt: a simulated machine that only this computer reaches.
    Harmless,
    /// The state may have been lost.
    Unexpected,
}

/// Stop latch of a server that starts, with the reason.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Condition {
    /// Released: the last stop was re-armed, or there was none.
    #[error("no stop is latched")]
    Released,
    /// Latched.
    #[error(
        "a stop was not re-armed before this server started: it starts in Fault; type `rearm` when the machine may move"
    )]
    Stopped,
    /// Latched: a part of the state is missing.
    #[error("{} is missing: a stop may be forgotten, so the server starts in Fault; check the machine, then type `rearm`", path.display())]
    Incomplete {
        /// The missing file.
        path: PathBuf,
    },
    /// Latched: the whole state is missing.
    #[error(
        "no state of this machine at {}: if it has run before, a stop may be forgotten; the server starts in Fault: check the machine, then type `rearm`. \
         Start a machine's first run with --first-run",
        path.display()
    )]
    Missing {
        /// The epoch file.
        path: PathBuf,
    },
}

impl Condition {
    /// True if the server starts in Fault.
    #[must_use]
    pub fn is_latched(&self) -> bool {
        *self != Self::Released
    }
}

/// State of a machine, owned and read; nothing is written yet.
#[derive(Debug)]
pub struct MachineState {
    epoch_file: PathBuf,
    /// Last epoch that was given away; `None` without a file.
    used: Option<u64>,
    /// `None` without a file.
    is_latched: Option<bool>,
    lock: Lock,
}

/// State of a server that begins.
#[derive(Debug)]
pub struct Begun {
    /// Epochs that no other run uses.
    pub epochs: EpochRange,
    /// The stop latch.
    pub latch: StopLatch,
    /// Its position at the start, with the reason.
    pub condition: Condition,
    /// Ownership of the state: to be held until the latch is not written any more.
    pub lock: Lock,
}

impl MachineState {
    /// Takes the lock, then reads epochs and latch. `owner` is what another server is shown that
    /// asks for the same state.
    ///
    /// # Errors
    /// [`StateError`]: another server owns the state, or a file is not one of ours, damaged or
    /// unreachable. Nothing was changed but that the folder and the lock's file exist.
    pub fn own(place: &StatePlace, owner: &str) -> Result<Self, StateError> {
        let path = &place.epoch_file;
        // Before a file is created beside something that cannot be an epoch file.
        regular_file::check(path).map_err(|error| place.unreachable("epoch file", path, &error))?;
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder)
                .map_err(|error| place.unreachable("epoch file", path, &error))?;
        }
        let lock_file = beside(path, "lock");
        let lock = Lock::acquire(&lock_file, owner).map_err(|error| match error {
            LockError::Io(error) => place.unreachable("lock", &lock_file, &error),
            LockError::InUse { owner } => StateError::InUse {
                path: path.clone(),
                owner,
            },
        })?;
        let used = epoch::read(path)?;
        epoch::check_second(path)?;
        let is_latched = stop_latch::read(&beside(path, "stop"))?;
        Ok(Self {
            epoch_file: path.clone(),
            used,
            is_latched,
            lock,
        })
    }

    /// Reserves epochs and opens the latch: from here on the state is that of this run.
    ///
    /// # Errors
    /// [`StateError`]: a first run was declared and is none, or a file cannot be written.
    pub fn begin(self, first_run: FirstRun) -> Result<Begun, StateError> {
        let condition = self.condition(first_run)?;
        let epochs = epoch::reserve(&self.epoch_file, self.used.unwrap_or(0))?;
        let latch = StopLatch::open(&beside(&self.epoch_file, "stop"), condition.is_latched())?;
        Ok(Begun {
            epochs,
            latch,
            condition,
            lock: self.lock,
        })
    }

    fn condition(&self, first_run: FirstRun) -> Result<Condition, StateError> {
        let [epoch, latch] = [self.epoch_file.clone(), beside(&self.epoch_file, "stop")];
        Ok(match (self.used, self.is_latched) {
            (None, None) if first_run == FirstRun::Unexpected => Condition::Missing {
                path: self.epoch_file.clone(),
            },
            (None, None) => Condition::Released,
            _ if first_run == FirstRun::Declared => {
                return Err(StateError::NotFirst {
                    path: if self.used.is_some() { epoch } else { latch },
                });
            }
            (_, Some(true)) => Condition::Stopped,
            (None, Some(false)) => Condition::Incomplete { path: epoch },
            (Some(_), None) => Condition::Incomplete { path: latch },
            (Some(_), Some(false)) => Condition::Released,
        })
    }
}

impl StatePlace {
    /// Returns the error of a file, with the remedy unless it is another program's.
    fn unreachable(&self, file: &'static str, path: &Path, error: &std::io::Error) -> StateError {
        let reason = match error.kind() {
            std::io::ErrorKind::InvalidInput => error.to_string(),
            _ => format!("{error}; {}", self.remedy),
        };
        StateError::File {
            file,
            path: path.to_owned(),
            reason,
        }
    }
}

/// Returns the path of a file beside the epoch file.
fn beside(epoch_file: &Path, extension: &str) -> PathBuf {
    let mut path = epoch_file.as_os_str().to_owned();
    path.push(".");
    path.push(extension);
    PathBuf::from(path)
}

#[cfg(test)]
mod tests;
