//! Black boxes as files: the content of a frozen `BlackBox`, one JSON value per line, exact to
//! the bit.
//!
//! | line | content |
//! |---|---|
//! | 1 | `{"format":"gantry-tau black box","version":8,"axes":3,"ticks":129}` |
//! | 2 | `{"config":{...},"parts":{...}}`: the `Session` before the oldest tick |
//! | 3 on | `{"input":{...},"output":{...}}`: one `Entry` per tick, oldest first; as many as line 1 announces |
//!
//! Fields and variants have the names, the order and the units of core's types, as `serde` writes
//! them: positions in nm, velocities in µm/s, torques in per mille, times in ticks unless the name
//! says otherwise; an absent value is `null`. Integers are written in full: a reader must take 64
//! bits (128 for `history`), not the 53 of a float.
//!
//! A program in C writes the same content in a binary form (`black_box/binary.rs`), which is read
//! as well.
//!
//! Version 4, which has no agitation budgets, is read as well.
//!
//! Core validates a session and its configuration on reading. An edited file is replayed like any
//! other, or refused with line, path and reason. A change to the layout, a field of core gained or
//! lost included, is a new version.

mod binary;
mod json;
pub mod loops;
pub mod writer;

use std::path::{Path, PathBuf};

use gantry_tau_server::black_box::Window;

pub use json::{encode, first_difference};

/// Error of a file: its name, the line (counted from 1) or the part (counted from 0) if there is
/// one, and the reason.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{place}: {reason}")]
pub struct FileError {
    place: String,
    reason: String,
}

impl FileError {
    /// An error of a whole file or folder.
    fn of(path: &Path, reason: impl ToString) -> Self {
        Self {
            place: path.display().to_string(),
            reason: reason.to_string(),
        }
    }
}

/// Reads the window of a file in either form; `name` stands for the file in errors.
///
/// # Errors
/// [`FileError`]: the first line or part that cannot be read.
pub fn decode<const N: usize>(name: &str, bytes: &[u8]) -> Result<Window<N>, FileError> {
    if binary::is_binary(bytes) {
        binary::decode(name, bytes)
    } else {
        json::decode(name, bytes)
    }
}

/// Path of the file of a window's position loops, beside that of the window.
fn loops_beside(window: &Path) -> PathBuf {
    window.with_extension("loops.jsonl")
}

/// Reads the number of axes that a file announces; `name` stands for the file in errors.
///
/// # Errors
/// [`FileError`] unless the file begins as a black box.
pub fn axes(name: &str, bytes: &[u8]) -> Result<usize, FileError> {
    if binary::is_binary(bytes) {
        binary::axes(name, bytes)
    } else {
        json::axes(name, bytes)
    }
}

/// Longest file of a black box, bytes: some 100 000 ticks.
const MAX_FILE: u64 = 256 << 20;

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
        return Err(FileError::of(
            path,
            "is a device, a pipe or a socket; name a regular file",
        ));
    }
    if file.len() > MAX_FILE {
        return Err(FileError::of(
            path,
            format!(
                "has {} bytes; a black box has at most {MAX_FILE}",
                file.len()
            ),
        ));
    }
    std::fs::read(path).map_err(|error| FileError::of(path, error))
}

#[cfg(test)]
mod tests;
