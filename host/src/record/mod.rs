//! Recordings: one row per tick, written by a separate thread `[T 5.1.2]`, as CSV, as a stream of LabComm or as MCAP.

mod about;
mod columns;
mod csv_file;
mod labcomm_file;
mod mcap;
mod recording;
mod room;
mod seen;
mod tally;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

pub use about::About;
pub use columns::ClientRow;
pub use csv_file::Record;
pub use mcap::{RecoverError, Recovered, recover};
pub use recording::{ParseFormatError, RecordTo, Recording, TickRow};
pub use room::Full;
pub use seen::Seen;
use tally::Tally;
pub use tally::{RecordError, Recorded};

use crate::server::event_log::Event;

/// Pause of the writing thread when the queue is empty.
const REST: Duration = Duration::from_millis(5);
/// Rows that may wait for a slow disk, about eight seconds.
const QUEUE: usize = 8_192;

/// Longest wait at the end for a disk, or a reader, that takes nothing.
const LAST_WAIT: Duration = Duration::from_secs(5);

/// Producer side of a recording: pushing never blocks and never allocates.
#[derive(Debug)]
pub struct Recorder<T, const N: usize> {
    /// Path that was asked for.
    path: PathBuf,
    queue: rtrb::Producer<(T, Vec<Event>)>,
    thread: JoinHandle<Recorded>,
    dropped: u64,
    shared: Arc<Shared>,
}

/// What the writing thread and the producer tell each other.
#[derive(Debug, Default)]
struct Shared {
    has_failed: AtomicBool,
    /// Rows that were taken from the queue.
    taken: AtomicU64,
    /// Rows that were lost before the queue, once it is at its end.
    dropped: AtomicU64,
}

impl<T: TickRow<N>, const N: usize> Recorder<T, N> {
    /// Starts the thread that writes a recording. A blocked disk then blocks nothing else.
    ///
    /// # Errors
    /// [`RecordError`]: there is no further thread.
    pub fn start(mut recording: Recording<N>) -> Result<Self, RecordError> {
        let path = recording.path().to_owned();
        let (queue, mut rows) = rtrb::RingBuffer::<(T, Vec<Event>)>::new(QUEUE);
        let shared = Arc::new(Shared::default());
        let told = Arc::clone(&shared);
        let write = move || {
            // But for its file. Without the right to give them up it has none.
            let _ = crate::privileges::give_up(&[recording.path().to_owned()]);
            drain(&mut rows, |(row, events), _| {
                recording.write(row, events);
                told.taken.fetch_add(1, Ordering::Relaxed);
                told.has_failed.fetch_or(recording.has_failed(), Ordering::Relaxed);
            });
            recording.finish(told.dropped.load(Ordering::Acquire))
        };
        let thread = std::thread::Builder::new().name("recorder".to_owned()).spawn(write);
        let thread = thread.map_err(|error| RecordError { path: path.clone(), reason: error.to_string() })?;
        Ok(Self { path, queue, thread, dropped: 0, shared })
    }

    /// True once rows are lost: the file has failed, or does not take them in time.
    #[must_use]
    pub fn loses_rows(&self) -> bool {
        self.dropped > 0 || self.shared.has_failed.load(Ordering::Relaxed)
    }

    /// Adds a row with what happened in it, or counts it as dropped; the first one is told.
    pub fn push(&mut self, row: T, events: Vec<Event>) {
        if self.queue.push((row, events)).is_err() {
            if self.dropped == 0 {
                tracing::warn!("the recording loses rows: its disk does not take {QUEUE} rows in time");
            }
            self.dropped += 1;
        }
    }

    /// Ends the recording, and adds rows that were dropped before they came here. `None` if the writing thread panicked, which was reported
    /// on stderr. A file whose disk or reader takes nothing for five seconds is left as it is: that is its failure then.
    #[must_use]
    pub fn finish(self, dropped: u64) -> Option<Recorded> {
        let Self { path, queue, thread, dropped: here, shared } = self;
        let lost = here.saturating_add(dropped);
        shared.dropped.store(lost, Ordering::Release);
        drop(queue);
        let (mut taken, mut until) = (0, Instant::now() + LAST_WAIT);
        while !thread.is_finished() {
            std::thread::sleep(REST);
            let now = shared.taken.load(Ordering::Relaxed);
            if now != taken {
                (taken, until) = (now, Instant::now() + LAST_WAIT);
            }
            if Instant::now() > until {
                return Some(Recorded::blocked(&path, taken, lost));
            }
        }
        thread.join().ok()
    }
}

/// Calls `each` with every row, and with true if it is the last one that waits, until the producer is gone and the queue is empty.
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
mod tests {
    use std::fs::OpenOptions;
    use std::io::Read;
    use std::os::unix::fs::OpenOptionsExt;
    use std::process::Command;

    use super::*;
    use crate::robot_file::RobotFile;
    use crate::server::cycle::Row;
    use crate::terminal::logged::logged;

    #[test]
    fn rows_that_were_dropped_before_are_lost_rows() {
        let robot = RobotFile::builtin_l2().unwrap();
        let path = std::env::temp_dir().join(format!("gantry-tau-dropped-{}.csv", std::process::id()));
        let to: RecordTo = path.to_str().unwrap().parse().unwrap();
        let recorder = Recorder::<ClientRow<3>, 3>::start(Recording::create::<ClientRow<3>, _>(&to, &robot).unwrap());
        let recorder = recorder.unwrap();
        assert!(!recorder.loses_rows());
        let recorded = recorder.finish(3).unwrap();
        assert_eq!((recorded.written, recorded.lost, recorded.failure), (0, 3, None));
        assert!(!path.exists(), "no row, no file");
    }

    /// A pipe whose reader takes nothing until the end.
    #[test]
    fn the_first_row_that_is_dropped_is_told_once() {
        let robot = RobotFile::builtin_l2().unwrap();
        let path = std::env::temp_dir().join(format!("gantry-tau-blocked-{}.csv", std::process::id()));
        assert!(Command::new("mkfifo").arg(&path).status().unwrap().success());
        let nonblocking = i32::try_from(rustix::fs::OFlags::NONBLOCK.bits()).unwrap();
        let mut reader = OpenOptions::new().read(true).custom_flags(nonblocking).open(&path).unwrap();
        let to: RecordTo = path.to_str().unwrap().parse().unwrap();
        let mut recorder = Recorder::start(Recording::create::<Row<3>, _>(&to, &robot).unwrap()).unwrap();
        let mut push = |until: u64| {
            let pushed = || {
                while recorder.dropped < until {
                    recorder.push(Row::<3>::listening(), Vec::new());
                }
            };
            logged(pushed).1
        };
        let first = push(1);
        assert!(
            first.contains(" WARN ") && first.contains(&format!("its disk does not take {QUEUE} rows in time")),
            "{first}"
        );
        assert_eq!((first.lines().count(), push(100)), (1, String::new()));
        assert!(recorder.loses_rows());
        let finishing = std::thread::spawn(move || recorder.finish(0));
        while !finishing.is_finished() {
            let _read = reader.read(&mut [0; 65_536]);
        }
        std::fs::remove_file(&path).unwrap();
        let recorded = finishing.join().unwrap().unwrap();
        assert!(recorded.written >= 8_192 && recorded.lost == 100 && recorded.failure.is_none(), "{recorded:?}");
    }

    /// Found from outside: a reader that takes nothing kept the process, and with it the lock of its machine.
    #[test]
    fn a_reader_that_takes_nothing_does_not_keep_the_end() {
        let robot = RobotFile::builtin_l2().unwrap();
        let path = std::env::temp_dir().join(format!("gantry-tau-kept-{}.csv", std::process::id()));
        assert!(Command::new("mkfifo").arg(&path).status().unwrap().success());
        let nonblocking = i32::try_from(rustix::fs::OFlags::NONBLOCK.bits()).unwrap();
        let _reader = OpenOptions::new().read(true).custom_flags(nonblocking).open(&path).unwrap();
        let to: RecordTo = path.to_str().unwrap().parse().unwrap();
        let mut recorder = Recorder::start(Recording::create::<Row<3>, _>(&to, &robot).unwrap()).unwrap();
        (0..5_000).for_each(|_| recorder.push(Row::<3>::listening(), Vec::new()));
        let recorded = recorder.finish(0).unwrap();
        std::fs::remove_file(&path).unwrap();
        let said = recorded.to_string();
        assert!(said.contains("takes nothing") && recorded.written < 5_000, "{said}");
    }
}
