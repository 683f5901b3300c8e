//! Linux: `clock_nanosleep` with absolute time, `ppoll`, `mlockall`.

use std::net::TcpListener;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use rustix::thread::{ClockId, clock_nanosleep_absolute};
use rustix::time::clock_gettime;

use super::{Denied, Socket};

const NS_PER_S: u64 = 1_000_000_000;

/// Monotonic time in ns.
#[must_use]
pub fn now_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    let seconds = u64::try_from(now.tv_sec).unwrap_or(0);
    let rest = u64::try_from(now.tv_nsec).unwrap_or(0);
    seconds.saturating_mul(NS_PER_S).saturating_add(rest)
}

fn timespec(ns: u64) -> Timespec {
    Timespec {
        tv_sec: i64::try_from(ns / NS_PER_S).unwrap_or(i64::MAX),
        tv_nsec: i64::try_from(ns % NS_PER_S).unwrap_or(0),
    }
}

/// Sleeps until [`now_ns`] would return at least `deadline`.
pub fn sleep_until_ns(deadline: u64) {
    while now_ns() < deadline {
        // A signal may wake the thread early.
        let _interrupted = clock_nanosleep_absolute(ClockId::Monotonic, &timespec(deadline));
    }
}

/// Waits until `socket` has bytes (or is closed), at most until the deadline. Returns true if there
/// is something to read.
#[must_use]
pub fn wait_readable_until_ns(socket: Socket<'_>, deadline: u64) -> bool {
    poll_until_ns(&mut [poll_fd(&socket)], deadline)
}

/// As [`wait_readable_until_ns`], for any of `sockets`. Allocates.
pub fn wait_any_readable_until_ns(sockets: &[Socket<'_>], deadline: u64) -> bool {
    let mut fds: Vec<PollFd<'_>> = sockets.iter().map(poll_fd).collect();
    poll_until_ns(&mut fds, deadline)
}

/// True if a connection waits to be accepted. Asking takes a fraction of the time of an accept that
/// finds none, which makes a socket first.
pub(crate) fn is_acceptable(listener: &TcpListener) -> bool {
    let mut listeners = [PollFd::new(listener, PollFlags::IN)];
    !matches!(poll(&mut listeners, Some(&timespec(0))), Ok(0))
}

fn poll_fd<'a>(socket: &'a Socket<'_>) -> PollFd<'a> {
    match socket {
        Socket::Stream(stream) => PollFd::new(stream, PollFlags::IN),
        Socket::Datagram(socket) => PollFd::new(socket, PollFlags::IN),
    }
}

fn poll_until_ns(fds: &mut [PollFd<'_>], deadline: u64) -> bool {
    let left = deadline.saturating_sub(now_ns());
    left > 0 && matches!(poll(fds, Some(&timespec(left))), Ok(ready) if ready > 0)
}

/// Locks all memory of the process, so that the cycle never waits for a page.
///
/// # Errors
/// [`Denied`] under a limit on locked memory that the process may not lift: locking future memory
/// under a limit would make a later allocation fail, which is worse than a page fault.
/// `CAP_IPC_LOCK` overrides the limit for as long as a thread has it, and a server gives it up.
pub fn lock_memory() -> Result<(), Denied> {
    // Permitted where the hard limit is lifted already, and with CAP_SYS_RESOURCE. The superuser of
    // a namespace or container may have neither.
    let lifted = setrlimit(
        Resource::Memlock,
        Rlimit {
            current: None,
            maximum: None,
        },
    );
    if let (Some(limit), Err(_)) = (getrlimit(Resource::Memlock).current, lifted) {
        let kib = limit / 1024;
        return Err(Denied::locked_memory(format_args!(
            "it is limited to {kib} KiB; lift the limit (`ulimit -l unlimited` as root, or LimitMEMLOCK=infinity of a service)"
        )));
    }
    mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE).map_err(Denied::locked_memory)
}
