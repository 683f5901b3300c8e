//! A list that one thread extends and another waits for.

use std::fmt::Debug;
use std::sync::{Condvar, Mutex};
use std::time::Instant;

use super::PATIENCE;

/// Entries, as they arrive.
pub(super) struct Journal<T> {
    written: Mutex<Written<T>>,
    more: Condvar,
}

struct Written<T> {
    entries: Vec<T>,
    is_complete: bool,
}

impl<T> Default for Journal<T> {
    fn default() -> Self {
        Self {
            written: Mutex::new(Written {
                entries: Vec::new(),
                is_complete: false,
            }),
            more: Condvar::new(),
        }
    }
}

impl<T: Clone + Debug> Journal<T> {
    /// Adds an entry.
    pub(super) fn push(&self, entry: T) {
        self.written.lock().unwrap().entries.push(entry);
        self.more.notify_all();
    }

    /// Takes note that no further entry will come.
    pub(super) fn complete(&self) {
        self.written.lock().unwrap().is_complete = true;
        self.more.notify_all();
    }

    /// Returns every entry so far.
    pub(super) fn entries(&self) -> Vec<T> {
        self.written.lock().unwrap().entries.clone()
    }

    /// Waits for the first entry that fulfils the condition; `None` if the journal is complete
    /// without one.
    pub(super) fn find(&self, what: &str, is_it: impl Fn(&T) -> bool) -> Option<T> {
        let since = Instant::now();
        let mut written = self.written.lock().unwrap();
        loop {
            let found = written.entries.iter().find(|entry| is_it(entry));
            if found.is_some() || written.is_complete {
                return found.cloned();
            }
            let left = PATIENCE.checked_sub(since.elapsed());
            let left =
                left.unwrap_or_else(|| panic!("no {what} after {:?}", written.entries.last()));
            written = self.more.wait_timeout(written, left).unwrap().0;
        }
    }
}
