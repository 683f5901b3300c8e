//! Epochs from a counter that is persisted before use, so that frames of earlier sessions stay
//! invalid.

use std::fs::File;
use std::io::{self, ErrorKind, Write};
use std::path::Path;

use gantry_tau_core::units::{Epoch, EpochRange};

use super::regular_file::{self, Access};
use super::{StateError, beside};

/// Epochs reserved by one write of the file: 2^32 sessions per run, for 2^32 runs. The cycle never
/// touches the disk.
const RESERVE: u64 = 1 << 32;

/// Reads the last epoch that was given away; `None` without a file.
///
/// # Errors
/// [`StateError`]. A file that is not a number is not overwritten: restarting from zero could make
/// an old frame valid.
pub(super) fn read(path: &Path) -> Result<Option<u64>, StateError> {
    let bytes = match regular_file::open(path, Access::Read)
        .and_then(|mut file| regular_file::read(&mut file))
    {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(failed(path, error.to_string())),
    };
    let counter = std::str::from_utf8(&bytes)
        .ok()
        .and_then(|text| text.trim().parse().ok());
    counter.map(Some).ok_or_else(|| {
        let reason = "does not contain a counter (one decimal number, the last epoch that was given away); put it back \
                      from a copy, or move the file away: the server then starts in Fault, with epochs from 1";
        failed(path, reason.to_owned())
    })
}

/// Reserves epochs that no other run of the server uses: writes the counter with the reserve added,
/// and only then returns the range. The caller owns the file, and `used` is its content.
///
/// # Errors
/// [`StateError`]: the counter is used up, or cannot be written.
pub(super) fn reserve(path: &Path, used: u64) -> Result<EpochRange, StateError> {
    let last = used
        .checked_add(RESERVE)
        .ok_or_else(|| failed(path, "the counter is used up".to_owned()))?;
    persist(path, last).map_err(|error| failed(path, error.to_string()))?;
    Ok(EpochRange {
        first: Epoch(used + 1),
        last: Epoch(last),
    })
}

fn failed(path: &Path, reason: String) -> StateError {
    StateError::File {
        file: "epoch file",
        path: path.to_owned(),
        reason,
    }
}

/// Checks that the name of the second file is free, or has what a crash has left there: a number,
/// or its beginning.
///
/// # Errors
/// [`StateError`]: another file has the name, the counter of another machine for one, or it cannot
/// be read.
pub(super) fn check_second(path: &Path) -> Result<(), StateError> {
    let second = beside(path, "new");
    if beside(&second, "lock").symlink_metadata().is_ok() {
        return Err(failed(
            &second,
            "is the counter of another machine; name another file".to_owned(),
        ));
    }
    match regular_file::open(&second, Access::Read)
        .and_then(|mut file| regular_file::read(&mut file))
    {
        Ok(text)
            if text
                .iter()
                .all(|byte| byte.is_ascii_digit() || *byte == b'\n') =>
        {
            Ok(())
        }
        Ok(_) => Err(failed(
            &second,
            "is another file, not a counter of gantry-tau; move it away".to_owned(),
        )),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
        Err(error) => Err(failed(&second, error.to_string())),
    }
}

/// Writes a second file, flushes it to the disk, and renames it: a crash leaves the old or the new
/// number. The second file of a crash is replaced by that of the next run.
fn persist(path: &Path, value: u64) -> io::Result<()> {
    let second = beside(path, "new");
    match std::fs::remove_file(&second) {
        Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    let mut file = File::create_new(&second)?;
    writeln!(file, "{value}")?;
    file.sync_all()?;
    std::fs::rename(&second, path)?;
    sync_folder(path)
}

/// Flushes the folder of a file: only then does a new name survive a power failure.
#[cfg(unix)]
pub(super) fn sync_folder(path: &Path) -> io::Result<()> {
    let folder = path
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty());
    File::open(folder.unwrap_or(Path::new(".")))?.sync_all()
}

/// Does nothing: folders cannot be flushed on this system, which does so by itself.
#[cfg(not(unix))]
pub(super) fn sync_folder(_: &Path) -> io::Result<()> {
    Ok(())
}
