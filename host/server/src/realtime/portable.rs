//! Other systems: clock, sleep and sockets of the standard library. Sufficient for a client,
//! `solve` and lock-step.

use std::net::TcpListener;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use super::{Denied, Socket};

/// Resolution of the standard sleep, ns; the rest of a wait is spent spinning.
const COARSE_NS: u64 = 200_000;

/// Monotonic time in ns since the first call.
#[must_use]
pub fn now_ns() -> u64 {
    static START: OnceLock<Instant> = OnceLock::new();
    let elapsed = START.get_or_init(Instant::now).elapsed();
    u64::try_from(elapsed.as_nanos()).unwrap_or(u64::MAX)
}

/// Sleeps until [`now_ns`] would return at least `deadline`.
pub fn sleep_until_ns(deadline: u64) {
    loop {
        let left = deadline.saturating_sub(now_ns());
        if left == 0 {
            return;
        }
        if left > COARSE_NS {
            std::thread::sleep(Duration::from_nanos(left - COARSE_NS));
        } else {
            std::hint::spin_loop();
        }
    }
}

/// Waits until `socket` (non-blocking) has bytes (or is closed), at most until the deadline.
/// Returns true if there is something to read.
#[must_use]
pub fn wait_readable_until_ns(socket: Socket<'_>, deadline: u64) -> bool {
    wait_any_readable_until_ns(&[socket], deadline)
}

/// As [`wait_readable_until_ns`], for any of `sockets`.
pub fn wait_any_readable_until_ns(sockets: &[Socket<'_>], deadline: u64) -> bool {
    loop {
        if sockets.iter().any(is_readable) {
            return true;
        }
        let now = now_ns();
        if now >= deadline {
            return false;
        }
        sleep_until_ns(deadline.min(now.saturating_add(COARSE_NS)));
    }
}

/// True: that a connection waits to be accepted is found out by accepting it.
pub(crate) fn is_acceptable(_listener: &TcpListener) -> bool {
    true
}

fn is_readable(socket: &Socket<'_>) -> bool {
    let peeked = match socket {
        Socket::Stream(stream) => stream.peek(&mut [0]),
        Socket::Datagram(socket) => socket.peek(&mut [0]),
    };
    !matches!(peeked, Err(error) if error.kind() == std::io::ErrorKind::WouldBlock)
}

/// Not available here.
///
/// # Errors
/// [`Denied`], always.
pub fn lock_memory() -> Result<(), Denied> {
    Err(Denied::locked_memory("not available on this system"))
}
