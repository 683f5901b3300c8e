//! Pipes and devices: their readers may come late, or take nothing.
#![allow(
    clippy::disallowed_methods,
    reason = "outputs are opened in this module only"
)]

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::Path;

/// Opens a pipe or a device. A pipe without a reader is waited for, at most five seconds;
/// [`Bounded`] then waits as long in each write.
pub(super) fn open(path: &Path) -> io::Result<File> {
    system::open(path)
}

/// From here on a write waits for as long as the reader takes nothing.
pub(super) fn let_wait(file: &File) -> io::Result<()> {
    system::let_wait(file)
}

/// Writes with a bounded wait: a pipe or device that takes nothing for five seconds is an error.
pub(super) struct Bounded<'a>(pub(super) &'a mut File);

impl Write for Bounded<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        loop {
            match self.0.write(bytes) {
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                    system::await_room(self.0)?
                }
                written => return written,
            }
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
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
    const MAX_WAIT: Duration = Duration::from_secs(5);
    const MAX_POLL: Timespec = Timespec {
        tv_sec: 5,
        tv_nsec: 0,
    };
    /// Pause between two looks.
    const REST: Duration = Duration::from_millis(5);

    pub(super) fn let_wait(file: &File) -> io::Result<()> {
        Ok(fcntl_setfl(
            file,
            fcntl_getfl(file)?.difference(OFlags::NONBLOCK),
        )?)
    }

    pub(super) fn open(path: &Path) -> io::Result<File> {
        let mut options = OpenOptions::new();
        options
            .write(true)
            .custom_flags(OFlags::NONBLOCK.bits() as i32);
        let is_pipe = path.metadata()?.file_type().is_fifo();
        let since = Instant::now();
        loop {
            match options.open(path) {
                Err(error)
                    if !is_pipe || error.raw_os_error() != Some(Errno::NXIO.raw_os_error()) =>
                {
                    return Err(error);
                }
                Err(_) if since.elapsed() >= MAX_WAIT => {
                    return Err(io::Error::other("no program reads the pipe"));
                }
                Err(_) => std::thread::sleep(REST),
                file => return file,
            }
        }
    }

    pub(super) fn await_room(file: &File) -> io::Result<()> {
        match poll(&mut [PollFd::new(file, PollFlags::OUT)], Some(&MAX_POLL)) {
            Ok(0) => Err(io::Error::new(
                io::ErrorKind::TimedOut,
                "its reader takes nothing",
            )),
            Ok(_) | Err(Errno::INTR) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }
}

#[cfg(not(unix))]
mod system {
    use super::{File, OpenOptions, Path, io};

    /// Its writes may wait: pipes have no other way here.
    pub(super) fn open(path: &Path) -> io::Result<File> {
        OpenOptions::new().write(true).open(path)
    }

    pub(super) fn let_wait(_: &File) -> io::Result<()> {
        Ok(())
    }

    pub(super) fn await_room(_: &File) -> io::Result<()> {
        Err(io::ErrorKind::WouldBlock.into())
    }
}
