//! Bounded wait for a thread at the end of a command: the disk or the reader that it writes to may hang.

use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Longest wait without progress.
const LAST_WAIT: Duration = Duration::from_secs(5);
/// Pause between two looks.
const REST: Duration = Duration::from_millis(5);

/// Joins a thread; `None` if it does not end, and `progress` does not change, for five seconds. It is left to the end of the process then.
pub(crate) fn join<T>(thread: JoinHandle<T>, progress: impl Fn() -> u64) -> Option<thread::Result<T>> {
    let (mut seen, mut since) = (progress(), Instant::now());
    while !thread.is_finished() {
        if since.elapsed() > LAST_WAIT {
            return None;
        }
        thread::sleep(REST);
        let now = progress();
        if now != seen {
            (seen, since) = (now, Instant::now());
        }
    }
    Some(thread.join())
}
