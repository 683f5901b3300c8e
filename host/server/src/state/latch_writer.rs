//! Writer of a stop latch, in a thread of its own: a disk that hangs holds up this thread, and the
//! cycle for a moment only.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{self, Builder, Thread};
use std::time::{Duration, Instant};

/// Contents of the file, of one length, so that each replaces the other.
const STOPPED: &[u8; LENGTH] = b"stopped \n";
pub(super) const RELEASED: &[u8; LENGTH] = b"released\n";
/// Length of the file, bytes.
pub(super) const LENGTH: usize = 9;

/// Writes a position over the one in the file.
pub(super) fn write_position(file: &mut File, is_latched: bool) -> io::Result<()> {
    file.seek(SeekFrom::Start(0))?;
    file.write_all(if is_latched { STOPPED } else { RELEASED })
}

/// The writer, for the thread that asks it.
#[derive(Debug)]
pub(super) struct LatchWriter {
    shared: Arc<Shared>,
    thread: Thread,
    /// Longest wait for a change.
    patience: Duration,
    /// Changes that were asked for.
    asked: u64,
}

/// Exchange between the two threads. The number of a change and one bit make one word, so that
/// neither waits for a lock.
#[derive(Debug, Default)]
struct Shared {
    /// The last change that was asked for, and its position.
    asked: AtomicU64,
    /// The last change that was tried, and whether it is written.
    tried: AtomicU64,
    has_ended: AtomicBool,
}

impl LatchWriter {
    /// Starts the writer of a file. It has priority and privileges of the calling thread, which is
    /// the one that asks.
    ///
    /// # Errors
    /// The system's: there is no further thread.
    pub(super) fn start(file: File, patience: Duration) -> io::Result<Self> {
        let shared = Arc::new(Shared::default());
        let (theirs, asking) = (Arc::clone(&shared), thread::current());
        let thread = Builder::new()
            .name("latch writer".to_owned())
            .spawn(move || theirs.write_each(file, &asking))?
            .thread()
            .clone();
        Ok(Self {
            shared,
            thread,
            patience,
            asked: 0,
        })
    }

    /// Asks for a position and waits until it is written, at most as long as the patience, and not
    /// at all behind a change that has not been tried yet. Returns true if it is written.
    pub(super) fn write(&mut self, is_latched: bool) -> bool {
        let patience = if self.outcome().is_some() {
            self.patience
        } else {
            Duration::ZERO
        };
        self.ask(is_latched);
        let since = Instant::now();
        loop {
            let left = patience.saturating_sub(since.elapsed());
            match self.outcome() {
                Some(is_written) => return is_written,
                None if left.is_zero() => return false,
                None => thread::park_timeout(left),
            }
        }
    }

    /// Returns true if the last change is written by now; asks again, and does not wait, if it
    /// could not be.
    pub(super) fn is_written(&mut self, is_latched: bool) -> bool {
        let outcome = self.outcome();
        if outcome == Some(false) {
            self.ask(is_latched);
        }
        outcome == Some(true)
    }

    fn ask(&mut self, is_latched: bool) {
        self.asked = self.asked.wrapping_add(1);
        self.shared
            .asked
            .store(word(self.asked, is_latched), Ordering::Release);
        self.thread.unpark();
    }

    /// Returns whether the last change is written; `None` before it was tried.
    fn outcome(&self) -> Option<bool> {
        let (change, is_written) = parts(self.shared.tried.load(Ordering::Acquire));
        (change == self.asked).then_some(is_written)
    }
}

impl Drop for LatchWriter {
    /// Ends the thread, and does not wait for it.
    fn drop(&mut self) {
        self.shared.has_ended.store(true, Ordering::Release);
        self.thread.unpark();
    }
}

impl Shared {
    /// Writes the newest change, until the other end is dropped.
    fn write_each(&self, mut file: File, asking: &Thread) {
        let mut tried = 0;
        while !self.has_ended.load(Ordering::Acquire) {
            let (change, is_latched) = parts(self.asked.load(Ordering::Acquire));
            if change == tried {
                thread::park();
                continue;
            }
            let is_written = write_position(&mut file, is_latched).is_ok();
            tried = change;
            self.tried
                .store(word(change, is_written), Ordering::Release);
            asking.unpark();
        }
    }
}

fn word(change: u64, bit: bool) -> u64 {
    change << 1 | u64::from(bit)
}

const fn parts(word: u64) -> (u64, bool) {
    (word >> 1, word & 1 == 1)
}
