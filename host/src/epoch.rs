//! Epochs from a counter that is persisted before use, so that an old frame can never revive.

use std::fmt;
use std::io::Write;
use std::path::{Path, PathBuf};

use gantry_tau_core::units::Epoch;

/// Epochs reserved by one write of the file. The cycle takes from the reserve and never touches the disk.
/// 2^32 sessions per run, 2^32 runs: neither is ever used up.
const RESERVE: u64 = 1 << 32;

/// A reserve of epochs that no other run of the server will give again.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Epochs {
    last: u64,
    end: u64,
}

/// Why no epochs could be reserved.
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
    /// Reads the counter, writes it back with the reserve added, and only then hands the reserve out. A missing file counts as zero.
    ///
    /// # Errors
    /// [`EpochError`] naming file and reason. A file that is no number is not overwritten: restarting from zero could revive an old frame.
    pub fn reserve(path: &Path) -> Result<Self, EpochError> {
        let fail = |reason: String| EpochError {
            path: path.to_owned(),
            reason,
        };
        let last = match std::fs::read_to_string(path) {
            Ok(text) => text
                .trim()
                .parse::<u64>()
                .map_err(|error| fail(format!("its content is no counter: {error}")))?,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => 0,
            Err(error) => return Err(fail(error.to_string())),
        };
        let end = last
            .checked_add(RESERVE)
            .ok_or_else(|| fail("the counter is used up".to_owned()))?;
        persist(path, end).map_err(|error| fail(error.to_string()))?;
        Ok(Self { last, end })
    }

    /// Epochs for a run that leaves nothing behind: tests, and a demo whose server ends with it.
    #[must_use]
    pub const fn volatile() -> Self {
        Self {
            last: 0,
            end: u64::MAX,
        }
    }

    /// The last epoch given, by this run or an earlier one.
    #[must_use]
    pub const fn last(&self) -> Epoch {
        Epoch(self.last)
    }

    /// The next epoch to offer. When the reserve is used up it is the last one again, which the core refuses to give.
    #[must_use]
    pub fn next(&self) -> Epoch {
        Epoch(self.last.saturating_add(1).min(self.end))
    }

    /// The session has taken `epoch`.
    pub fn taken(&mut self, epoch: Epoch) {
        self.last = self.last.max(epoch.0);
    }
}

/// Where the counter lives unless a flag says otherwise: the user's state folder, which survives a boot. `None` where the system names none.
#[must_use]
pub fn default_path() -> Option<PathBuf> {
    let from = |name: &str| std::env::var_os(name).map(PathBuf::from);
    let base = from("XDG_STATE_HOME")
        .or_else(|| from("LOCALAPPDATA"))
        .or_else(|| from("HOME").map(|home| home.join(".local").join("state")))?;
    Some(base.join("gantry-tau").join("epoch"))
}

/// Writes beside the file, flushes to the disk, and renames: a crash leaves the old or the new number, never half of one.
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

/// The rename itself survives a power failure only once the folder is on the disk.
#[cfg(unix)]
fn sync_folder(folder: &Path) -> std::io::Result<()> {
    let here = folder.as_os_str().is_empty();
    std::fs::File::open(if here { Path::new(".") } else { folder })?.sync_all()
}

/// Folders cannot be flushed here; the system does so by itself.
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
        assert!(error.contains("no counter"), "{error}");
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
