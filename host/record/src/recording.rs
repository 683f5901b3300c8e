//! Recordings: one row per tick, written by a separate thread `[T 5.1.2]`, as CSV, as a stream of
//! LabComm or as MCAP.

mod about;
mod columns;
mod csv_file;
mod file;
mod free_space;
mod labcomm_file;
mod mcap;
mod session_events;
mod tally;

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use gantry_tau_server::record::Event;
use gantry_tau_system::last_wait;

pub use about::About;
pub use columns::ClientRow;
pub use csv_file::CsvRecord;
pub use file::{ParseFormatError, RecordTo, Recording, TickRow};
pub use free_space::Full;
pub use mcap::{RecoverError, Recovered, recover};
pub use session_events::SessionEvents;
use tally::Tally;
pub use tally::{RecordError, Recorded};

/// Pause of the writing thread when the queue is empty.
const REST: Duration = Duration::from_millis(5);
/// Rows that may wait for a slow disk, about eight seconds.
const QUEUE: usize = 8_192;
/// Time that a producer that may wait does so in all.
const PATIENCE: Duration = Duration::from_secs(5);

/// Producer side of a recording: [`push`](Self::push) never blocks and never allocates.
#[derive(Debug)]
pub struct Recorder<T, const N: usize> {
    /// Path that was asked for.
    path: PathBuf,
    queue: rtrb::Producer<Item<T>>,
    thread: JoinHandle<Recorded>,
    dropped: u64,
    /// The next row begins another file.
    begins_file: bool,
    /// Rest of [`PATIENCE`].
    patience: Duration,
    shared: Arc<Shared>,
}

/// Item of the queue.
#[derive(Debug)]
struct Item<T> {
    row: T,
    events: Vec<Event>,
    /// The row begins another file.
    begins_file: bool,
}

/// Exchange between the writing thread and the producer.
#[derive(Debug, Default)]
struct Shared {
    has_failed: AtomicBool,
    /// Path of the file, once it has its name.
    path: Mutex<Option<PathBuf>>,
    /// Rows of the file that were taken from the queue.
    taken: AtomicU64,
    /// Rows that were lost before the queue, once it is at its end.
    dropped: AtomicU64,
}

impl<T: TickRow<N>, const N: usize> Recorder<T, N> {
    /// Starts the thread that writes a recording. A blocked disk then blocks nothing else.
    ///
    /// # Errors
    /// [`RecordError`]: there is no further thread.
    pub fn start(recording: Recording<N>) -> Result<Self, RecordError> {
        let path = recording.path().to_owned();
        let (queue, mut rows) = rtrb::RingBuffer::new(QUEUE);
        let shared = Arc::new(Shared::default());
        let of_thread = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("recorder".to_owned())
            .spawn(move || write_rows(recording, &mut rows, &of_thread))
            .map_err(|error| RecordError::new(&path, &error))?;
        Ok(Self {
            path,
            queue,
            thread,
            dropped: 0,
            begins_file: false,
            patience: PATIENCE,
            shared,
        })
    }

    /// True once rows are lost: the file has failed, or does not take them in time.
    #[must_use]
    pub fn loses_rows(&self) -> bool {
        self.dropped > 0 || self.shared.has_failed.load(Ordering::Relaxed)
    }

    /// Adds a row with what happened in it, or counts it as dropped; the first one is logged.
    pub fn push(&mut self, row: T, events: Vec<Event>) {
        let item = Item {
            row,
            events,
            begins_file: self.begins_file,
        };
        if self.queue.push(item).is_ok() {
            self.begins_file = false;
        } else {
            if self.dropped == 0 {
                tracing::warn!(
                    "the recording loses rows: its disk does not take {QUEUE} rows in time"
                );
            }
            self.dropped += 1;
        }
    }

    /// The same, for a thread that may wait for room: five seconds in all.
    pub fn push_patiently(&mut self, row: T, events: Vec<Event>) {
        while self.queue.is_full() && !self.patience.is_zero() {
            self.patience = self.patience.saturating_sub(REST);
            std::thread::sleep(REST);
        }
        self.push(row, events);
    }

    /// The next row begins another file.
    pub const fn begin_next(&mut self) {
        self.begins_file = true;
    }

    /// Ends the recording, and adds rows that were dropped before they came here. `None` if the
    /// writing thread panicked, which was reported on stderr. A file whose disk or reader takes
    /// nothing for five seconds, or not all in thirty, is left as it is: that is its failure then.
    #[must_use]
    pub fn finish(self, dropped: u64) -> Option<Recorded> {
        let Self {
            path,
            queue,
            thread,
            dropped: here,
            shared,
            ..
        } = self;
        let lost = here.saturating_add(dropped);
        shared.dropped.store(lost, Ordering::Release);
        drop(queue);
        match last_wait::join(thread, || shared.taken.load(Ordering::Relaxed)) {
            Some(ended) => ended.ok(),
            None => {
                let named = shared
                    .path
                    .lock()
                    .unwrap_or_else(PoisonError::into_inner)
                    .take();
                let taken = shared.taken.load(Ordering::Relaxed);
                Some(Recorded::blocked(&named.unwrap_or(path), taken, lost))
            }
        }
    }
}

/// Writes the rows of a queue until its producer is gone.
fn write_rows<T: TickRow<N>, const N: usize>(
    mut recording: Recording<N>,
    rows: &mut rtrb::Consumer<Item<T>>,
    shared: &Shared,
) -> Recorded {
    // But for its file. Without the right to give them up it has none.
    let _ = gantry_tau_system::privileges::give_up(&[recording.path().to_owned()]);
    drain(rows, |item, _| {
        if item.begins_file {
            shared.taken.store(0, Ordering::Relaxed);
            if let Some(recorded) = recording.begin_next() {
                tracing::info!("{recorded}; the next connection begins another file");
            }
        }
        recording.write(&item.row, &item.events);
        if shared.taken.fetch_add(1, Ordering::Relaxed) == 0 {
            *shared.path.lock().unwrap_or_else(PoisonError::into_inner) =
                Some(recording.path().to_owned());
        }
        shared
            .has_failed
            .fetch_or(recording.has_failed(), Ordering::Relaxed);
    });
    recording.finish(shared.dropped.load(Ordering::Acquire))
}

/// Calls `each` with every row, and with true if it is the last one that waits, until the producer
/// is gone and the queue is empty.
pub fn drain<T>(rows: &mut rtrb::Consumer<T>, mut each: impl FnMut(&T, bool)) {
    loop {
        let gone = rows.is_abandoned();
        while let Ok(row) = rows.pop() {
            each(&row, rows.is_empty());
        }
        if gone {
            return;
        }
        std::thread::sleep(REST);
    }
}

#[cfg(test)]
mod tests;
