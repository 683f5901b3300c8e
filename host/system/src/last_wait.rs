//! Bounded wait for a thread that writes: its disk or its reader may hang.

use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Longest wait without progress.
const LAST_WAIT: Duration = Duration::from_secs(5);
/// Longest wait in all: what goes on slowly has an end too.
const MAX_WAIT: Duration = Duration::from_secs(30);
/// Pause between two looks.
const REST: Duration = Duration::from_millis(5);

/// Joins a thread; `None` if it does not end, and `progress` does not change, for five seconds, or
/// if it does not end for thirty. It is left to the end of the process then.
pub fn join<T>(thread: JoinHandle<T>, progress: impl Fn() -> u64) -> Option<thread::Result<T>> {
    join_within(thread, progress, LAST_WAIT, MAX_WAIT)
}

fn join_within<T>(
    thread: JoinHandle<T>,
    progress: impl Fn() -> u64,
    without_progress: Duration,
    in_all: Duration,
) -> Option<thread::Result<T>> {
    let began = Instant::now();
    let (mut seen, mut since) = (progress(), began);
    while !thread.is_finished() {
        if since.elapsed() > without_progress || began.elapsed() > in_all {
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

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::sync::mpsc::channel;

    use super::*;

    const LONG: Duration = Duration::from_secs(1_000);

    /// Found from outside: a reader that took a few rows a second kept a server for hours.
    #[test]
    fn what_goes_on_slowly_or_not_at_all_is_left_alone() {
        let short = Duration::from_millis(50);
        for (without_progress, in_all) in [(LONG, short), (short, LONG)] {
            let (end, until_then) = channel::<()>();
            let thread = thread::spawn(move || until_then.recv().is_err());
            let seen = Cell::new(0);
            let ended = join_within(
                thread,
                || {
                    seen.set(seen.get() + u64::from(without_progress == LONG));
                    seen.get()
                },
                without_progress,
                in_all,
            );
            assert!(ended.is_none());
            drop(end);
        }
        assert!(
            join_within(thread::spawn(|| 7), || 0, LONG, LONG)
                .is_some_and(|ended| ended.is_ok_and(|value| value == 7))
        );
    }
}
