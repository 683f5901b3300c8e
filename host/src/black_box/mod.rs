//! Black boxes as files: the content of a frozen [`BlackBox`], one JSON value per line, exact to the bit.
//!
//! | line | content |
//! |---|---|
//! | 1 | `{"format":"gantry-tau black box","version":4,"axes":3,"ticks":129}` |
//! | 2 | `{"config":{...},"parts":{...}}`: the [`Session`] before the oldest tick |
//! | 3 on | `{"input":{...},"output":{...}}`: one [`Entry`] per tick, oldest first; as many as line 1 announces |
//!
//! Fields and variants have the names, the order and the units of core's types, as `serde` writes them: positions in nm, velocities
//! in µm/s, torques in per mille, times in ticks unless the name says otherwise; an absent value is `null`. Integers are written in
//! full: a reader must take 64 bits (128 for `history`), not the 53 of a float.
//!
//! A program in C writes the same content in a binary form (`black_box/binary.rs`), which is read as well.
//!
//! Core validates a session and its configuration on reading. An edited file is replayed like any other, or refused with line, path
//! and reason. A change to the layout, a field of core gained or lost included, is a new version.

mod binary;
mod json;
pub mod loops;
pub mod swap_channel;
pub mod writer;

use std::path::{Path, PathBuf};

use gantry_tau_core::control::message::Cause;
use gantry_tau_core::control::session::{BlackBox, Entry, Session};
use gantry_tau_core::units::{Epoch, Tick};

pub use json::first_difference;
use loops::LoopsWindow;

/// Half of a black box, in ticks: at least so many remain before and after a cause.
pub const HALF: usize = 64;

/// Consecutive ticks, and the session before them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Window<const N: usize> {
    /// Session before the oldest tick.
    pub before: Session<N>,
    /// Ticks, oldest first; at least one.
    pub entries: Vec<Entry<N>>,
    /// The same ticks of the server's position loops, if it has any. A file of its own has them.
    pub loops: Option<LoopsWindow<N>>,
}

/// The end of a session, or a stop, in a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct End {
    /// Index of its entry in the window.
    pub index: usize,
    /// Tick.
    pub tick: Tick,
    /// Epoch of the session.
    pub epoch: Epoch,
    /// Cause; `None` in a window without an end.
    pub cause: Option<Cause>,
}

/// Error of a file: its name, the line (counted from 1) or the part (counted from 0) if there is one, and the reason.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{place}: {reason}")]
pub struct FileError {
    place: String,
    reason: String,
}

impl FileError {
    /// An error of a whole file or folder.
    fn of(path: &Path, reason: impl ToString) -> Self {
        Self { place: path.display().to_string(), reason: reason.to_string() }
    }
}

impl<const N: usize> Window<N> {
    /// Copies the content of a black box; `None` if it is empty.
    #[must_use]
    pub fn of<const HALF: usize>(black_box: &BlackBox<N, HALF>) -> Option<Self> {
        let before = *black_box.before()?;
        let entries: Vec<_> = black_box.entries().cloned().collect();
        (!entries.is_empty()).then_some(Self { before, entries, loops: None })
    }

    /// Reads the window of a file in either form; `name` stands for the file in errors.
    ///
    /// # Errors
    /// [`FileError`]: the first line or part that cannot be read.
    pub fn decode(name: &str, bytes: &[u8]) -> Result<Self, FileError> {
        if binary::is_binary(bytes) { binary::decode(name, bytes) } else { json::decode(name, bytes) }
    }

    /// Returns the first end in the window, which froze the box; its last entry if there is none.
    #[must_use]
    pub fn end(&self) -> End {
        let mut outputs = self.entries.iter().map(|entry| &entry.output);
        let ended = outputs.position(|output| output.ended.is_some());
        let index = ended.unwrap_or(self.entries.len().saturating_sub(1));
        let output = self.entries.get(index).map(|entry| &entry.output);
        End {
            index,
            tick: output.map_or(self.before.last_tick(), |output| output.state.tick),
            epoch: output.map_or(self.before.epoch(), |output| output.state.epoch),
            cause: output.and_then(|output| output.ended),
        }
    }

    /// Returns the name of a file of this window: epoch, tick and cause; of the stops, `Quit` is one that latches nothing.
    #[must_use]
    pub fn file_name(&self) -> String {
        let end = self.end();
        let is_latched = self.entries.get(end.index).is_some_and(|entry| entry.output.latched);
        let cause = match end.cause {
            Some(Cause::Stop) if !is_latched => "Quit",
            cause => cause.map_or("NoEnd", Cause::name),
        };
        format!("epoch-{}-tick-{}-{cause}.jsonl", end.epoch.0, end.tick.0)
    }
}

/// Path of the file of a window's position loops, beside that of the window.
fn loops_beside(window: &Path) -> PathBuf {
    window.with_extension("loops.jsonl")
}

/// True for an end after which the next client is let in without a hand at the machine: any client can bring about as many as it likes.
const fn is_end_by_anyone(cause: Cause) -> bool {
    !matches!(cause, Cause::Stop | Cause::Nominal | Cause::Restart)
}

/// Reads the number of axes that a file announces; `name` stands for the file in errors.
///
/// # Errors
/// [`FileError`] unless the file begins as a black box.
pub fn axes(name: &str, bytes: &[u8]) -> Result<usize, FileError> {
    if binary::is_binary(bytes) { binary::axes(name, bytes) } else { json::axes(name, bytes) }
}

/// Longest file of a black box, bytes: some 100 000 ticks.
const LONGEST: u64 = 256 << 20;

/// Reads the bytes of a file. A device or a pipe may have no end, so it is not read.
///
/// # Errors
/// [`FileError`] with the reason of the system, or for what cannot be a black box.
pub fn bytes(path: &Path) -> Result<Vec<u8>, FileError> {
    let file = std::fs::metadata(path).map_err(|error| FileError::of(path, error))?;
    if file.is_dir() {
        return Err(FileError::of(path, "is a folder; name a file of it"));
    }
    if !file.is_file() {
        return Err(FileError::of(path, "is a device, a pipe or a socket; name a regular file"));
    }
    if file.len() > LONGEST {
        return Err(FileError::of(path, format!("has {} bytes; a black box has at most {LONGEST}", file.len())));
    }
    std::fs::read(path).map_err(|error| FileError::of(path, error))
}

#[cfg(test)]
mod tests;
