//! Files of the server's own: regular files, opened without following a link and without waiting,
//! of which a bounded part is read.

use std::fs::{File, FileType, OpenOptions};
use std::io::{self, Error, ErrorKind, Read};
use std::path::Path;

/// Longest content that is read, bytes. Every file here is shorter.
const MAX_FILE: u64 = 256;

/// Access to a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Access {
    /// Reading a file that exists.
    Read,
    /// Reading and writing; the file is created if it does not exist.
    Create,
}

/// Checks that nothing, or a regular file, has this path. Nothing is opened: opening a device can
/// have effects.
pub(crate) fn check(path: &Path) -> io::Result<()> {
    if path.file_name().is_none() {
        return Err(Error::new(
            ErrorKind::InvalidInput,
            "names a folder; name a file",
        ));
    }
    match std::fs::symlink_metadata(path) {
        Ok(metadata) => expect_regular(metadata.file_type()),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
        Err(error) => Err(error),
    }
}

/// Opens a file.
pub(crate) fn open(path: &Path, access: Access) -> io::Result<File> {
    check(path)?;
    let mut options = File::options();
    options.read(true);
    if access == Access::Create {
        options.write(true).create(true).truncate(false);
    }
    neither_follow_nor_wait(&mut options);
    let file = options.open(path)?;
    // It may have been exchanged since.
    expect_regular(file.metadata()?.file_type())?;
    Ok(file)
}

/// Reads a whole file, or the beginning of a longer one.
pub(crate) fn read(file: &mut File) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    file.take(MAX_FILE).read_to_end(&mut bytes)?;
    Ok(bytes)
}

#[cfg(unix)]
fn neither_follow_nor_wait(options: &mut OpenOptions) {
    use rustix::fs::OFlags;
    use std::os::unix::fs::OpenOptionsExt;
    options.custom_flags((OFlags::NOFOLLOW | OFlags::NONBLOCK).bits() as i32);
}

/// Does nothing: the file is checked before and after it is opened.
#[cfg(not(unix))]
fn neither_follow_nor_wait(_: &mut OpenOptions) {}

fn expect_regular(found: FileType) -> io::Result<()> {
    let found = if found.is_file() {
        return Ok(());
    } else if found.is_symlink() {
        "a symbolic link; name the file itself"
    } else if found.is_dir() {
        "a folder; name a file"
    } else {
        "a device, a pipe or a socket; name a regular file"
    };
    Err(Error::new(ErrorKind::InvalidInput, format!("is {found}")))
}
