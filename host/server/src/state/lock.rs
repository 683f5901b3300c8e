//! Exclusive lock of a file, held for the life of a process. The system releases it however the
//! process ends.

use std::fs::File;
use std::io::{self, ErrorKind, Seek, SeekFrom, Write};
use std::path::Path;

use gantry_tau_system::output::printable;

use super::regular_file::{self, Access};

/// An exclusive lock; released when it is dropped. Its file stays, with the name of the last owner:
/// a file that was removed could be locked twice, and a disk that hangs must not hold up the end.
#[derive(Debug)]
pub struct Lock {
    file: File,
}

/// Reason why a lock is not acquired.
#[derive(Debug)]
pub(super) enum LockError {
    /// Its file cannot be used.
    Io(io::Error),
    /// Another process has it.
    InUse {
        /// Text of that process.
        owner: String,
    },
}

impl From<io::Error> for LockError {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

impl Lock {
    /// Acquires the lock and leaves the owner's text in the file.
    pub(super) fn acquire(path: &Path, owner: &str) -> Result<Self, LockError> {
        regular_file::check(path)?;
        let file = match open_locked(path) {
            Ok(file) => file,
            // Of another user: it may still tell who has it.
            Err(error) if error.kind() == ErrorKind::PermissionDenied => match open_to_read(path) {
                Ok(None) => None,
                _ => return Err(error.into()),
            },
            Err(error) => return Err(error.into()),
        };
        let Some(mut file) = file else {
            return Err(LockError::InUse {
                owner: owner_of(path),
            });
        };
        let text = regular_file::read(&mut file)?;
        if !text.is_empty() && !text.starts_with(b"pid ") {
            return Err(LockError::Io(io::Error::new(
                ErrorKind::InvalidInput,
                "is another file, not a lock of gantry-tau",
            )));
        }
        file.set_len(0)?;
        file.seek(SeekFrom::Start(0))?;
        writeln!(file, "pid {} ({owner})", std::process::id())?;
        Ok(Self { file })
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        unlock(&self.file);
    }
}

/// Returns what the owner has written; it may not have come to it yet.
fn owner_of(path: &Path) -> String {
    for _attempt in 0..20 {
        let text = regular_file::open(path, Access::Read)
            .and_then(|mut file| regular_file::read(&mut file))
            .unwrap_or_default();
        let text = String::from_utf8_lossy(&text);
        if let Some(line) = text.lines().next() {
            return printable(line);
        }
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    "another server".to_owned()
}

/// Opens and locks a file; `None` if another process has the lock.
#[cfg(unix)]
fn open_locked(path: &Path) -> io::Result<Option<File>> {
    locked(regular_file::open(path, Access::Create)?)
}

/// The same for a user who may only read it.
#[cfg(unix)]
fn open_to_read(path: &Path) -> io::Result<Option<File>> {
    locked(regular_file::open(path, Access::Read)?)
}

#[cfg(unix)]
fn locked(file: File) -> io::Result<Option<File>> {
    use rustix::fs::{FlockOperation, flock};
    match flock(&file, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => Ok(Some(file)),
        Err(rustix::io::Errno::WOULDBLOCK) => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// Releases the lock. Closing the file is not enough: a child process has it too, from its fork to
/// the start of its program.
#[cfg(unix)]
fn unlock(file: &File) {
    // Closing it does the rest.
    let _unlocked = rustix::fs::flock(file, rustix::fs::FlockOperation::Unlock);
}

/// Opens a file that others may then only read; `None` if another process has it open so.
#[cfg(windows)]
fn open_locked(path: &Path) -> io::Result<Option<File>> {
    use std::os::windows::fs::OpenOptionsExt;
    const FILE_SHARE_READ: u32 = 1;
    const ERROR_SHARING_VIOLATION: i32 = 32;
    let mut options = File::options();
    options
        .read(true)
        .write(true)
        .create(true)
        .truncate(false)
        .share_mode(FILE_SHARE_READ);
    match options.open(path) {
        Ok(file) => Ok(Some(file)),
        Err(error) if error.raw_os_error() == Some(ERROR_SHARING_VIOLATION) => Ok(None),
        Err(error) => Err(error),
    }
}

#[cfg(windows)]
fn open_to_read(path: &Path) -> io::Result<Option<File>> {
    regular_file::open(path, Access::Read).map(Some)
}

/// Does nothing: children inherit no open files here.
#[cfg(windows)]
fn unlock(_: &File) {}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn it_is_released_while_a_child_still_has_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lock");
        let lock = Lock::acquire(&path, "first").unwrap();
        let of_child = lock.file.try_clone().unwrap();
        assert!(matches!(
            Lock::acquire(&path, "second"),
            Err(LockError::InUse { .. })
        ));
        drop(lock);
        drop(Lock::acquire(&path, "second").unwrap());
        drop(of_child);
    }
}
