//! Bounded wait for a thread that writes: its disk or its reader may hang.

use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Longest wait without progress.
const LAST_WAIT: Duration = Duration::from_secs(5);
/// Pause between two looks.
const REST: Duration = Duration::from_millis(5);

/// Joins a thread; `None` if it does not end, and `progress` does not change, for five seconds. It is left to the end of the process then.
pub(crate) fn join<T>(thread: JoinHandle<T>, progress: impl Fn() -> u64) -> Option<thread::Result<T>> {
    until(|| thread.is_finished(), progress).then(|| thread.join())
}

/// Waits until something is done; false if it is not, and `progress` does not change, for five seconds.
pub(crate) fn until(is_done: impl Fn() -> bool, progress: impl Fn() -> u64) -> bool {
    let (mut seen, mut since) = (progress(), Instant::now());
    while !is_done() {
        if since.elapsed() > LAST_WAIT {
            return false;
        }
        thread::sleep(REST);
        let now = progress();
        if now != seen {
            (seen, since) = (now, Instant::now());
        }
    }
    true
}
