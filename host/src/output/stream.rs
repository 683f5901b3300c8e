//! Pipes and devices: their readers may come late, or take nothing.
#![allow(clippy::disallowed_methods, reason = "outputs are opened in this module only")]

use std::fs::{File, OpenOptions};
use std::io;
use std::path::Path;

/// Opens a pipe or a device. A pipe without a reader is waited for, at most five seconds.
pub(super) fn open(path: &Path) -> io::Result<File> {
    system::open(path)
}

/// The same; a write then waits for the reader by [`await_room`] alone.
pub(super) fn open_without_waiting(path: &Path) -> io::Result<File> {
    system::open_without_waiting(path)
}

/// Waits until a reader has taken something, at most five seconds.
pub(super) fn await_room(file: &File) -> io::Result<()> {
    system::await_room(file)
}

#[cfg(unix)]
mod system {
    use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
    use std::time::{Duration, Instant};

    use rustix::event::{PollFd, PollFlags, Timespec, poll};
    use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
    use rustix::io::Errno;

    use super::{File, OpenOptions, Path, io};

    /// Longest wait for a reader.
    const LONGEST_WAIT: Duration = Duration::from_secs(5);
    const LONGEST_POLL: Timespec = Timespec { tv_sec: 5, tv_nsec: 0 };
    /// Pause between two looks.
    const REST: Duration = Duration::from_millis(5);

    pub(super) fn open(path: &Path) -> io::Result<File> {
        let file = open_without_waiting(path)?;
        fcntl_setfl(&file, fcntl_getfl(&file)?.difference(OFlags::NONBLOCK))?;
        Ok(file)
    }

    pub(super) fn open_without_waiting(path: &Path) -> io::Result<File> {
        let mut options = OpenOptions::new();
        options.write(true).custom_flags(OFlags::NONBLOCK.bits() as i32);
        let is_pipe = path.metadata()?.file_type().is_fifo();
        let since = Instant::now();
        loop {
            match options.open(path) {
                Err(error) if !is_pipe || error.raw_os_error() != Some(Errno::NXIO.raw_os_error()) => {
                    return Err(error);
                }
                Err(_) if since.elapsed() >= LONGEST_WAIT => return Err(io::Error::other("no program reads the pipe")),
                Err(_) => std::thread::sleep(REST),
                file => return file,
            }
        }
    }

    pub(super) fn await_room(file: &File) -> io::Result<()> {
        match poll(&mut [PollFd::new(file, PollFlags::OUT)], Some(&LONGEST_POLL)) {
            Ok(0) => Err(io::Error::new(io::ErrorKind::TimedOut, "its reader takes nothing")),
            Ok(_) | Err(Errno::INTR) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }
}

#[cfg(not(unix))]
mod system {
    use super::{File, OpenOptions, Path, io};

    pub(super) fn open(path: &Path) -> io::Result<File> {
        OpenOptions::new().write(true).open(path)
    }

    /// Waits in each write: pipes have no other way here.
    pub(super) fn open_without_waiting(path: &Path) -> io::Result<File> {
        open(path)
    }

    pub(super) fn await_room(_: &File) -> io::Result<()> {
        Err(io::ErrorKind::WouldBlock.into())
    }
}
