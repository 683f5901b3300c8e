//! Services of the operating system: an absolute timer, real-time priority, locked memory, waiting
//! for bytes.
//!
//! One file per system behind one interface, so that client, server and `solve` build on Linux,
//! Windows and macOS.

use std::net::{TcpStream, UdpSocket};

#[cfg(target_os = "linux")]
#[path = "realtime/linux.rs"]
mod system;
#[cfg(not(target_os = "linux"))]
#[path = "realtime/portable.rs"]
mod system;
// Compiled and tested on Linux as well.
#[cfg(all(test, target_os = "linux"))]
#[allow(unreachable_pub, reason = "public on the systems it is for")]
mod portable;

pub(crate) use system::is_acceptable;
pub use system::{
    lock_memory, now_ns, sleep_until_ns, wait_any_readable_until_ns, wait_readable_until_ns,
};

/// A socket to wait on.
#[derive(Clone, Copy, Debug)]
pub enum Socket<'a> {
    /// TCP.
    Stream(&'a TcpStream),
    /// UDP.
    Datagram(&'a UdpSocket),
}

/// Priority under SCHED_FIFO: above ordinary threads, below the kernel's own.
const PRIORITY: u8 = 80;

/// A privilege that was not granted. The program runs on without it, with more jitter.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Denied {
    /// Name of the privilege.
    pub privilege: &'static str,
    /// Reason given by the system.
    pub reason: String,
}

impl Denied {
    fn priority(reason: impl ToString) -> Self {
        Self {
            privilege: "real-time priority (SCHED_FIFO)",
            reason: reason.to_string(),
        }
    }

    fn locked_memory(reason: impl ToString) -> Self {
        Self {
            privilege: "locked memory (mlockall)",
            reason: reason.to_string(),
        }
    }
}

/// Requests real-time priority for the calling thread.
///
/// # Errors
/// [`Denied`] when the system refuses, as it does for ordinary users.
pub fn raise_priority() -> Result<(), Denied> {
    use thread_priority::{ThreadPriority, ThreadPriorityValue};
    let value = ThreadPriorityValue::try_from(PRIORITY).map_err(Denied::priority)?;
    set_realtime(ThreadPriority::Crossplatform(value)).map_err(Denied::priority)
}

#[cfg(unix)]
fn set_realtime(priority: thread_priority::ThreadPriority) -> Result<(), thread_priority::Error> {
    use thread_priority::unix::{
        RealtimeThreadSchedulePolicy, ThreadSchedulePolicy, set_thread_priority_and_policy,
        thread_native_id,
    };
    let fifo = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    set_thread_priority_and_policy(thread_native_id(), priority, fifo)
}

#[cfg(not(unix))]
fn set_realtime(priority: thread_priority::ThreadPriority) -> Result<(), thread_priority::Error> {
    thread_priority::set_current_thread_priority(priority)
}

/// Largest shift of a deadline, ns: a thousandth of a cycle of 1 ms.
pub const MAX_SHIFT_NS: i64 = 1_000;

/// An absolute cycle timer: each cycle's deadline is a whole number of periods after the start, and
/// after its shifts.
#[derive(Clone, Copy, Debug)]
pub struct CycleTimer {
    period_ns: u64,
    deadline_ns: u64,
}

impl CycleTimer {
    /// A timer whose first deadline is one period from now.
    #[must_use]
    pub fn starting_now(period_ns: u64) -> Self {
        let period_ns = period_ns.max(1);
        let deadline_ns = now_ns().saturating_add(period_ns);
        Self {
            period_ns,
            deadline_ns,
        }
    }

    /// A timer with this first deadline.
    #[must_use]
    pub fn starting_at(period_ns: u64, deadline_ns: u64) -> Self {
        Self {
            period_ns: period_ns.max(1),
            deadline_ns,
        }
    }

    /// Moves the next deadline, and those after it, by at most [`MAX_SHIFT_NS`].
    pub fn shift(&mut self, by_ns: i64) {
        let by_ns = by_ns.clamp(-MAX_SHIFT_NS, MAX_SHIFT_NS);
        self.deadline_ns = self.deadline_ns.saturating_add_signed(by_ns);
    }

    /// The next deadline.
    #[must_use]
    pub const fn deadline_ns(&self) -> u64 {
        self.deadline_ns
    }

    /// Sleeps until the deadline. Returns the number of elapsed cycles: 1 when on time, more after
    /// an overrun. The next deadline stays on the grid: skipped cycles are not caught up.
    pub fn wait(&mut self) -> u32 {
        sleep_until_ns(self.deadline_ns);
        let late_ns = now_ns().saturating_sub(self.deadline_ns);
        let elapsed = late_ns / self.period_ns + 1;
        self.deadline_ns = self
            .deadline_ns
            .saturating_add(elapsed.saturating_mul(self.period_ns));
        u32::try_from(elapsed).unwrap_or(u32::MAX)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;
    use std::net::TcpListener;

    use super::*;

    /// Two ends of a connection, the second non-blocking.
    fn pair() -> (TcpStream, TcpStream) {
        let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
        let near = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let (far, _) = listener.accept().unwrap();
        far.set_nonblocking(true).unwrap();
        (near, far)
    }

    /// The clock advances, the sleep is not too short, the wait ends with a byte or with its
    /// deadline.
    fn check(
        now: fn() -> u64,
        sleep_until: fn(u64),
        wait_readable_until: fn(Socket<'_>, u64) -> bool,
    ) {
        let deadline = now() + 2_000_000;
        sleep_until(deadline);
        assert!(now() >= deadline);
        let (mut near, far) = pair();
        let deadline = now() + 2_000_000;
        assert!(!wait_readable_until(Socket::Stream(&far), deadline));
        assert!(now() >= deadline);
        near.write_all(b"x").unwrap();
        assert!(wait_readable_until(
            Socket::Stream(&far),
            now() + 10_000_000_000
        ));
        let (near, far) = pair();
        drop(near);
        assert!(
            wait_readable_until(Socket::Stream(&far), now() + 10_000_000_000),
            "a closed stream is readable"
        );
    }

    #[test]
    fn this_system_sleeps_and_waits_as_stated() {
        check(now_ns, sleep_until_ns, wait_readable_until_ns);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn the_portable_file_sleeps_and_waits_as_stated() {
        use portable as p;
        check(p::now_ns, p::sleep_until_ns, p::wait_readable_until_ns);
        assert!(p::lock_memory().is_err());
        assert!(p::is_acceptable(&TcpListener::bind("127.0.0.1:0").unwrap()));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_connection_that_waits_is_seen_until_it_is_accepted() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        assert!(!is_acceptable(&listener));
        let _near = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        assert!(is_acceptable(&listener));
        let _far = listener.accept().unwrap();
        assert!(!is_acceptable(&listener));
    }

    #[test]
    fn a_shift_moves_the_grid_by_a_bounded_time() {
        let mut timer = CycleTimer::starting_at(1_000_000, now_ns() + 1_000_000);
        let first = timer.deadline_ns();
        for (by_ns, moved_ns) in [(300, 300), (-5_000, -1_000), (i64::MAX, 1_000)] {
            let before = timer.deadline_ns();
            timer.shift(by_ns);
            assert_eq!(timer.deadline_ns(), before.saturating_add_signed(moved_ns));
        }
        timer.wait();
        assert_eq!(
            (timer.deadline_ns() - first) % 1_000_000,
            300,
            "the new grid"
        );
    }

    #[test]
    fn an_overrun_is_counted_and_not_caught_up() {
        let mut timer = CycleTimer::starting_now(1_000_000);
        let first = timer.deadline_ns();
        sleep_until_ns(first + 2_500_000);
        let before = now_ns();
        let elapsed = timer.wait();
        assert!(elapsed >= 3, "{elapsed} cycles");
        assert!(timer.deadline_ns() > before, "the next deadline was ahead");
        assert_eq!((timer.deadline_ns() - first) % 1_000_000, 0, "on the grid");
    }
}
