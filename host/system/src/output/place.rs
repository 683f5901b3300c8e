//! Target of a path, and the only openings of files for writing.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use super::{WriteError, stream};

/// Target of a path.
pub(super) enum Destination {
    /// No file has this name.
    Free(PathBuf),
    /// A file. A link stays, and the file that it names is replaced.
    File(PathBuf),
    /// A device or a pipe, which takes bytes directly.
    Stream(PathBuf),
}

impl Destination {
    /// Finds the target. A folder and a read-only file are refused.
    pub(super) fn of(path: &Path) -> Result<Self, WriteError> {
        let old = match fs::metadata(path) {
            Ok(old) => old,
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                return Ok(Self::Free(path.to_owned()));
            }
            Err(error) => return Err(WriteError::system(path, &error)),
        };
        let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        if old.is_dir() {
            // In the words of the system, which opening it would say.
            let error = io::Error::from(io::ErrorKind::IsADirectory);
            return Err(WriteError::refused(
                path,
                format_args!("{error} (os error 21); name a file"),
            ));
        }
        if !old.is_file() {
            return Ok(Self::Stream(target));
        }
        if old.permissions().readonly() {
            return Err(WriteError::refused(path, "it is read-only"));
        }
        Ok(Self::File(target))
    }
}

/// Checks that files can be made in the folder of `target`, which was named `named`.
pub(super) fn probe(target: &Path, named: &Path) -> Result<(), WriteError> {
    if can_make_nameless(target) {
        return Ok(());
    }
    let probe = beside(target, usize::MAX);
    create_new(&probe).map_err(|error| WriteError::system(named, &error))?;
    fs::remove_file(&probe).map_err(|error| WriteError::system(named, &error))
}

/// True if the folder of `target` takes a file without a name: one that an interrupted command does
/// not leave there.
#[cfg(target_os = "linux")]
#[allow(
    clippy::disallowed_methods,
    reason = "outputs are opened in this module only"
)]
fn can_make_nameless(target: &Path) -> bool {
    use std::os::unix::fs::OpenOptionsExt;
    let folder = target
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    let nameless = i32::try_from(rustix::fs::OFlags::TMPFILE.bits()).unwrap_or(0);
    OpenOptions::new()
        .write(true)
        .custom_flags(nameless)
        .open(folder)
        .is_ok()
}

/// No file is without a name here.
#[cfg(not(target_os = "linux"))]
fn can_make_nameless(_: &Path) -> bool {
    false
}

/// A hidden name beside a target, of this process.
pub(super) fn beside(target: &Path, number: usize) -> PathBuf {
    let mut name = std::ffi::OsString::from(".");
    name.push(target.file_name().unwrap_or_default());
    name.push(format!(".{}-{number}.new", std::process::id()));
    target.with_file_name(name)
}

/// Creates a file that must not exist.
#[allow(
    clippy::disallowed_methods,
    reason = "outputs are opened in this module only"
)]
pub(super) fn create_new(path: &Path) -> io::Result<File> {
    OpenOptions::new().write(true).create_new(true).open(path)
}

/// Opens a file at its end.
#[allow(
    clippy::disallowed_methods,
    reason = "outputs are opened in this module only"
)]
pub(super) fn append(path: &Path) -> io::Result<File> {
    OpenOptions::new().append(true).open(path)
}

/// Takes the lock of a file that grows: of two programs one writes it.
#[cfg(unix)]
pub(super) fn owned(file: File) -> io::Result<File> {
    use rustix::fs::{FlockOperation, flock};
    match flock(&file, FlockOperation::NonBlockingLockExclusive) {
        Err(rustix::io::Errno::WOULDBLOCK) => Err(io::Error::other("another program writes it")),
        // A file system without locks.
        _ => Ok(file),
    }
}

/// Does nothing: there is no lock here that does not bar readers.
#[cfg(not(unix))]
pub(super) fn owned(file: File) -> io::Result<File> {
    Ok(file)
}

/// Gives the lock of [`owned`] back. Closing the file is not enough: a child process has it too,
/// from its fork to the start of its program.
#[cfg(unix)]
pub(super) fn disown(file: &File) {
    // Closing it does the rest.
    let _unlocked = rustix::fs::flock(file, rustix::fs::FlockOperation::Unlock);
}

#[cfg(not(unix))]
pub(super) fn disown(_: &File) {}

/// Writes to a device or a pipe.
pub(super) fn write_stream(path: &Path, bytes: &[u8]) -> io::Result<()> {
    stream::Bounded(&mut stream::open(path)?).write_all(bytes)
}

/// A path by which a file is known even before it exists: its folder resolved.
pub(super) fn resolved(path: &Path) -> PathBuf {
    let folder = path
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    fs::canonicalize(path)
        .ok()
        .or_else(|| Some(fs::canonicalize(folder).ok()?.join(path.file_name()?)))
        .unwrap_or_else(|| path.to_owned())
}

/// True if both paths name the same existing file.
#[cfg(unix)]
pub(super) fn is_same_file(one: &Path, other: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    match (fs::metadata(one), fs::metadata(other)) {
        (Ok(one), Ok(other)) => (one.dev(), one.ino()) == (other.dev(), other.ino()),
        _ => false,
    }
}

/// True if both paths name the same existing file; hard links are not seen.
#[cfg(not(unix))]
pub(super) fn is_same_file(one: &Path, other: &Path) -> bool {
    matches!((fs::canonicalize(one), fs::canonicalize(other)), (Ok(one), Ok(other)) if one == other)
}
