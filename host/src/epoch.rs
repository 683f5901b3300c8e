//! Epochs from a counter that is persisted before use, so that frames of earlier sessions stay invalid.
#![allow(clippy::disallowed_methods, reason = "the state of a server has a policy of its own")]

use std::io::Write;
use std::path::{Path, PathBuf};

use gantry_tau_core::units::{Epoch, EpochRange};

/// Epochs reserved by one write of the file: 2^32 sessions per run, for 2^32 runs. The cycle never touches the disk.
const RESERVE: u64 = 1 << 32;

/// Error of [`reserve`].
#[derive(Debug, thiserror::Error)]
#[error("epoch file {path} (--epoch-file): {reason}")]
pub struct EpochError {
    path: PathBuf,
    reason: String,
}

/// Reserves epochs that no other run of the server uses: reads the counter, writes it back with the reserve added, and only then
/// returns the range. A missing file counts as zero.
///
/// # Errors
/// [`EpochError`] with file and reason. A file that is not a number is not overwritten: restarting from zero could make an old frame valid.
pub fn reserve(path: &Path) -> Result<EpochRange, EpochError> {
    let fail = |reason: String| EpochError { path: path.to_owned(), reason };
    let used = match std::fs::read_to_string(path) {
        Ok(text) => text.trim().parse::<u64>().map_err(|error| fail(format!("does not contain a counter: {error}")))?,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => 0,
        Err(error) => return Err(fail(error.to_string())),
    };
    let last = used.checked_add(RESERVE).ok_or_else(|| fail("the counter is used up".to_owned()))?;
    persist(path, last).map_err(|error| fail(error.to_string()))?;
    Ok(EpochRange { first: Epoch(used + 1), last: Epoch(last) })
}

/// Returns the default place of the counter: the user's state folder, which survives a boot. `None` where the system names none.
#[must_use]
pub fn default_path() -> Option<PathBuf> {
    let from = |name: &str| std::env::var_os(name).map(PathBuf::from);
    let base = from("XDG_STATE_HOME")
        .or_else(|| from("LOCALAPPDATA"))
        .or_else(|| from("HOME").map(|home| home.join(".local").join("state")))?;
    Some(base.join("gantry-tau").join("epoch"))
}

/// Writes a second file, flushes it to the disk, and renames it: a crash leaves the old or the new number.
fn persist(path: &Path, value: u64) -> std::io::Result<()> {
    let folder = path.parent().unwrap_or(Path::new(""));
    std::fs::create_dir_all(folder)?;
    let mut beside = path.as_os_str().to_owned();
    beside.push(format!(".{}", std::process::id()));
    let mut file = std::fs::File::create(&beside)?;
    writeln!(file, "{value}")?;
    file.sync_all()?;
    std::fs::rename(&beside, path)?;
    sync_folder(folder)
}

/// Flushes the folder: only then does the rename survive a power failure.
#[cfg(unix)]
fn sync_folder(folder: &Path) -> std::io::Result<()> {
    let here = folder.as_os_str().is_empty();
    std::fs::File::open(if here { Path::new(".") } else { folder })?.sync_all()
}

/// Does nothing: folders cannot be flushed on this system, which does so by itself.
#[cfg(not(unix))]
fn sync_folder(_: &Path) -> std::io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_epoch_is_given_twice_across_restarts() {
        let folder = std::env::temp_dir().join(format!("gantry-tau-epoch-{}", std::process::id()));
        let path = folder.join("epoch");
        let _ = std::fs::remove_dir_all(&folder);
        let first = reserve(&path).unwrap();
        assert_eq!(first.first, Epoch(1));
        // The first run is killed here; it has written nothing since.
        let second = reserve(&path).unwrap();
        assert_eq!(second.first.0, first.last.0 + 1);
        std::fs::write(&path, "seven\n").unwrap();
        let error = reserve(&path).unwrap_err().to_string();
        assert!(error.contains("does not contain a counter"), "{error}");
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
