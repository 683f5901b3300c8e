//! Epochs from a counter that is persisted before use, so that frames of earlier sessions stay invalid.

use std::fmt;
use std::io::Write;
use std::path::{Path, PathBuf};

use gantry_tau_core::units::Epoch;

/// Epochs reserved by one write of the file: the cycle takes from the reserve and never touches the disk.
/// The counter suffices for 2^32 runs of 2^32 sessions.
const RESERVE: u64 = 1 << 32;

/// Reserve of epochs that no other run of the server uses.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Epochs {
    last: u64,
    end: u64,
}

/// Reason why epochs could not be reserved.
#[derive(Debug)]
pub struct EpochError {
    path: PathBuf,
    reason: String,
}

impl fmt::Display for EpochError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "epoch file {} (--epoch-file): {}",
            self.path.display(),
            self.reason
        )
    }
}

impl std::error::Error for EpochError {}

impl Epochs {
    /// Reads the counter, writes it back with the reserve added, then returns the reserve. A missing file counts as zero.
    ///
    /// # Errors
    /// [`EpochError`] naming file and reason. A file without a number is not overwritten: restarting from zero could make an old frame
    /// valid again.
    pub fn reserve(path: &Path) -> Result<Self, EpochError> {
        let fail = |reason: String| EpochError {
            path: path.to_owned(),
            reason,
        };
        let last = match std::fs::read_to_string(path) {
            Ok(text) => text
                .trim()
                .parse::<u64>()
                .map_err(|error| fail(format!("does not contain a counter: {error}")))?,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => 0,
            Err(error) => return Err(fail(error.to_string())),
        };
        let end = last
            .checked_add(RESERVE)
            .ok_or_else(|| fail("the counter is exhausted".to_owned()))?;
        persist(path, end).map_err(|error| fail(error.to_string()))?;
        Ok(Self { last, end })
    }

    /// Epochs that are not persisted, for tests and the demo, whose server ends with it.
    #[must_use]
    pub const fn volatile() -> Self {
        Self {
            last: 0,
            end: u64::MAX,
        }
    }

    /// The last epoch used, by this run or an earlier one.
    #[must_use]
    pub const fn last(&self) -> Epoch {
        Epoch(self.last)
    }

    /// The next epoch to offer. When the reserve is exhausted it is the last one again, which the core refuses.
    #[must_use]
    pub fn next(&self) -> Epoch {
        Epoch(self.last.saturating_add(1).min(self.end))
    }

    /// Records that a session uses `epoch`.
    pub fn taken(&mut self, epoch: Epoch) {
        self.last = self.last.max(epoch.0);
    }
}

/// Default path of the counter, in the user's state folder. `None` if the environment does not name one.
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

/// Folders cannot be flushed on this system.
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
        let mut first = Epochs::reserve(&path).unwrap();
        assert_eq!(first.next(), Epoch(1));
        first.taken(Epoch(1));
        // The first run is killed here; it has written nothing since.
        let second = Epochs::reserve(&path).unwrap();
        assert!(second.next().0 > RESERVE);
        std::fs::write(&path, "seven\n").unwrap();
        let error = Epochs::reserve(&path).unwrap_err().to_string();
        assert!(error.contains("not contain a counter"), "{error}");
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
