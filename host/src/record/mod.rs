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

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

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

/// Producer side of a recording: pushing never blocks and never allocates.
#[derive(Debug)]
pub struct Recorder<T, const N: usize> {
    queue: rtrb::Producer<(T, Vec<Event>)>,
    thread: JoinHandle<Recording<N>>,
    dropped: u64,
    has_failed: Arc<AtomicBool>,
}

impl<T: TickRow<N>, const N: usize> Recorder<T, N> {
    /// Starts the thread that writes a recording. A blocked disk then blocks nothing else.
    ///
    /// # Errors
    /// [`RecordError`]: there is no further thread.
    pub fn start(mut recording: Recording<N>) -> Result<Self, RecordError> {
        let path = recording.path().to_owned();
        let (queue, mut rows) = rtrb::RingBuffer::<(T, Vec<Event>)>::new(QUEUE);
        let has_failed = Arc::new(AtomicBool::new(false));
        let fails = Arc::clone(&has_failed);
        let thread = std::thread::Builder::new()
            .name("recorder".to_owned())
            .spawn(move || {
                // But for its file. Without the right to give them up it has none.
                let _ = crate::privileges::give_up(&[recording.path().to_owned()]);
                drain(&mut rows, |(row, events), _| {
                    recording.write(row, events);
                    if recording.has_failed() {
                        fails.store(true, Ordering::Relaxed);
                    }
                });
                recording
            })
            .map_err(|error| RecordError { path, reason: error.to_string() })?;
        Ok(Self { queue, thread, dropped: 0, has_failed })
    }

    /// True once rows are lost: the file has failed, or does not take them in time.
    #[must_use]
    pub fn loses_rows(&self) -> bool {
        self.dropped > 0 || self.has_failed.load(Ordering::Relaxed)
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
    /// on stderr.
    #[must_use]
    pub fn finish(self, dropped: u64) -> Option<Recorded> {
        let Self { queue, thread, dropped: here, .. } = self;
        drop(queue);
        thread.join().ok().map(|recording| recording.finish(here + dropped))
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
    use super::*;
    use crate::robot_file::RobotFile;

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
}
