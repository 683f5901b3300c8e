//! A stream behind a bounded queue: a thread writes, and who prints never waits.

use std::collections::VecDeque;
#[cfg(unix)]
use std::fs::File;
use std::io::{self, ErrorKind, Write};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Bytes that may wait for a slow stream.
const CAPACITY: usize = 1 << 20;
/// Pause before the stream is tried again to tell what was lost, if nothing else is printed.
const RETRY: Duration = Duration::from_secs(1);
/// Pause before a stream that does not wait by itself is tried again.
const REST: Duration = Duration::from_millis(10);

/// Queue of a stream.
#[derive(Debug)]
pub(super) struct Queue {
    name: &'static str,
    /// Queue for sentences about this one; `None`: itself.
    log: Option<&'static Self>,
    state: Mutex<QueueState>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct QueueState {
    waiting: VecDeque<Vec<u8>>,
    /// Bytes in `waiting`.
    bytes: usize,
    is_writing: bool,
    /// Lines that found the queue full, and are not reported yet.
    refused: u64,
    /// Lines that could not be written, and the reason.
    failed: Option<Failed>,
}

#[derive(Clone, Debug)]
struct Failed {
    lines: u64,
    reason: String,
    /// The reader has ended.
    is_broken: bool,
    /// The stream ends within a line.
    within_line: bool,
}

impl Queue {
    /// Starts the thread that writes to `stream`, for the rest of the process. Sentences about lost
    /// lines go to `log`.
    pub(super) fn start(
        name: &'static str,
        stream: impl Write + Send + 'static,
        log: Option<&'static Self>,
    ) -> io::Result<&'static Self> {
        let queue: &'static Self = Box::leak(Box::new(Self {
            name,
            log,
            state: Mutex::default(),
            changed: Condvar::new(),
        }));
        std::thread::Builder::new()
            .name(name.to_owned())
            .spawn(move || {
                // It writes to what is open; without the right to give them up it has none.
                let _ = gantry_tau_system::privileges::give_up(&[]);
                queue.write_to(stream)
            })?;
        Ok(queue)
    }

    /// Adds whole lines, or counts them as lost.
    pub(super) fn push(&self, lines: Vec<u8>) {
        let mut state = self.lock();
        if state.bytes.saturating_add(lines.len()) <= CAPACITY {
            self.tell_of_refused(&mut state);
            state.add(lines);
            self.changed.notify_all();
            return;
        }
        if state.refused == 0 {
            self.tell(Some(format!(
                "lines of the {} are lost: the reader does not take them",
                self.name
            )));
        }
        state.refused += count(&lines);
    }

    /// True if everything was written.
    pub(super) fn is_idle(&self) -> bool {
        let state = self.lock();
        state.waiting.is_empty() && !state.is_writing
    }

    /// True if the reader has ended.
    pub(super) fn is_broken(&self) -> bool {
        self.lock()
            .failed
            .as_ref()
            .is_some_and(|failed| failed.is_broken)
    }

    /// Waits until everything is written, but not longer than `until`. Returns a line that tells
    /// what was lost and is not reported yet.
    pub(super) fn finish(&self, until: Instant) -> Option<Vec<u8>> {
        let mut state = self.lock();
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() || state.waiting.is_empty() && !state.is_writing && state.refused == 0
            {
                break;
            }
            state = self
                .changed
                .wait_timeout(state, left)
                .unwrap_or_else(PoisonError::into_inner)
                .0;
        }
        let waiting: u64 = state.waiting.iter().map(|lines| count(lines)).sum();
        let blocked = state.refused + waiting + u64::from(state.is_writing);
        let (lines, reason) = match &state.failed {
            None if blocked == 0 => return None,
            None => (blocked, "the reader does not take them"),
            Some(failed) => (failed.lines + blocked, failed.reason.as_str()),
        };
        Some(sentence(&self.lost(lines, reason)))
    }

    fn lock(&self) -> MutexGuard<'_, QueueState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn lost(&self, lines: u64, reason: &str) -> String {
        let noun = if lines == 1 { "line" } else { "lines" };
        format!("{lines} {noun} of the {} lost: {reason}", self.name)
    }

    /// Tells how many lines were refused, once there is room again; the log tells it of itself,
    /// where the gap is.
    fn tell_of_refused(&self, state: &mut QueueState) {
        let refused = std::mem::take(&mut state.refused);
        if refused == 0 {
            return;
        }
        let told = self.lost(refused, "the reader did not take them");
        if self.log.is_some() {
            self.tell(Some(told));
        } else {
            state.add(sentence(&told));
        }
    }

    /// Adds a sentence to the log of another queue. Under the lock of this one, no waiter sees it
    /// finished before the log has the sentence.
    fn tell(&self, told: Option<String>) {
        if let (Some(log), Some(told)) = (self.log, told) {
            log.push(sentence(&told));
        }
    }

    /// Writes what is added, for ever. The log first tells what it has lost.
    fn write_to(&self, mut stream: impl Write) {
        loop {
            let lines = self.next_lines();
            let before = self.lock().failed.clone();
            let told = match &before {
                Some(failed) if self.log.is_none() => {
                    failed.on_a_line(&self.lost(failed.lines, &failed.reason))
                }
                _ => Vec::new(),
            };
            let outcome = write(&mut stream, &[told.as_slice(), &lines].concat());
            let failed = outcome.err().map(|(error, written)| {
                let was_told = before.is_none() || self.log.is_none() && written >= told.len();
                let earlier = before
                    .as_ref()
                    .filter(|_| !was_told)
                    .map_or(0, |failed| failed.lines);
                Failed {
                    lines: earlier + count(&lines),
                    reason: error.to_string(),
                    is_broken: error.kind() == ErrorKind::BrokenPipe,
                    within_line: written > 0,
                }
            });
            let told = match (&before, &failed) {
                (None, Some(failed)) => Some(format!(
                    "lines of the {} are lost: {}",
                    self.name, failed.reason
                )),
                (Some(before), None) => Some(self.lost(before.lines, &before.reason)),
                _ => None,
            };
            // Before it counts as written, so that the log has it when the output is finished.
            self.tell(told);
            let mut state = self.lock();
            state.failed = failed;
            state.is_writing = false;
            drop(state);
            self.changed.notify_all();
        }
    }

    /// Waits for lines, and removes them from the queue. Returns no line if the log should try to
    /// tell what it has lost.
    fn next_lines(&self) -> Vec<u8> {
        let mut state = self.lock();
        loop {
            if let Some(lines) = state.waiting.pop_front() {
                state.bytes -= lines.len();
                state.is_writing = true;
                return lines;
            }
            if state.refused > 0 {
                self.tell_of_refused(&mut state);
                // Whoever waits for the end waits for this as well.
                self.changed.notify_all();
            } else if state.failed.is_some() && self.log.is_none() {
                let (after, pause) = self
                    .changed
                    .wait_timeout(state, RETRY)
                    .unwrap_or_else(PoisonError::into_inner);
                state = after;
                if pause.timed_out() && state.waiting.is_empty() {
                    state.is_writing = true;
                    return Vec::new();
                }
            } else {
                state = self
                    .changed
                    .wait(state)
                    .unwrap_or_else(PoisonError::into_inner);
            }
        }
    }
}

impl QueueState {
    fn add(&mut self, lines: Vec<u8>) {
        self.bytes += lines.len();
        self.waiting.push_back(lines);
    }
}

impl Failed {
    /// Returns a sentence on a line of its own.
    fn on_a_line(&self, text: &str) -> Vec<u8> {
        let end: &[u8] = if self.within_line { b"\n" } else { b"" };
        [end, &sentence(text)].concat()
    }
}

fn sentence(text: &str) -> Vec<u8> {
    format!("gantry-tau: {text}\n").into_bytes()
}

fn count(lines: &[u8]) -> u64 {
    lines.iter().filter(|byte| **byte == b'\n').count() as u64
}

/// Writes all bytes, however long the stream takes.
///
/// # Errors
/// The error of the stream, and the number of bytes that it has taken.
fn write(stream: &mut impl Write, bytes: &[u8]) -> Result<(), (io::Error, usize)> {
    let mut written = 0;
    while let Some(rest) = bytes.get(written..).filter(|rest| !rest.is_empty()) {
        match stream.write(rest) {
            Ok(0) => return Err((ErrorKind::WriteZero.into(), written)),
            Ok(more) => written += more,
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            // Another process may have made the terminal non-blocking.
            Err(error) if error.kind() == ErrorKind::WouldBlock => std::thread::sleep(REST),
            Err(error) => return Err((error, written)),
        }
    }
    Ok(())
}

/// The standard output without the buffer of `std`, which is written at the end of the process and
/// then may block.
pub(super) fn unbuffered_stdout() -> Box<dyn Write + Send> {
    #[cfg(unix)]
    if let Ok(stdout) = std::os::fd::AsFd::as_fd(&io::stdout()).try_clone_to_owned() {
        return Box::new(File::from(stdout));
    }
    Box::new(io::stdout())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::mpsc::{Receiver, Sender, channel};

    use super::*;

    const SOON: Duration = Duration::from_secs(60);

    /// A stream whose writes have scripted outcomes, and succeed without one: the bytes that are
    /// taken, or an error.
    struct Scripted(Receiver<io::Result<usize>>, Arc<Mutex<Vec<u8>>>);

    impl Write for Scripted {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let taken = self
                .0
                .try_recv()
                .unwrap_or(Ok(bytes.len()))?
                .min(bytes.len());
            self.1.lock().unwrap().extend_from_slice(&bytes[..taken]);
            Ok(taken)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    struct Bench {
        queue: &'static Queue,
        outcomes: Sender<io::Result<usize>>,
        text: Arc<Mutex<Vec<u8>>>,
    }

    fn bench(log: Option<&'static Queue>) -> Bench {
        let (outcomes, script) = channel();
        let text = Arc::new(Mutex::new(Vec::new()));
        let name = if log.is_some() {
            "standard output"
        } else {
            "log"
        };
        Bench {
            queue: Queue::start(name, Scripted(script, Arc::clone(&text)), log).unwrap(),
            outcomes,
            text,
        }
    }

    impl Bench {
        fn say(&self, line: &str) {
            self.queue.push(format!("{line}\n").into_bytes());
            self.queue.finish(Instant::now() + SOON);
        }

        fn next(&self, outcome: io::Result<usize>) {
            self.outcomes.send(outcome).unwrap();
        }

        fn text(&self) -> String {
            String::from_utf8(self.text.lock().unwrap().clone()).unwrap()
        }
    }

    fn full() -> io::Result<usize> {
        Err(ErrorKind::StorageFull.into())
    }

    #[test]
    fn the_log_tells_what_it_lost_as_soon_as_it_can_be_written_again() {
        let log = bench(None);
        log.say("one");
        // Lines two and three; the retry may come at any time, and fails, too.
        (0..3).for_each(|_| log.next(full()));
        log.say("two");
        log.say("three");
        let told = "gantry-tau: 2 lines of the log lost: no storage space\n";
        // It needs no further line for that.
        let since = Instant::now();
        while log.queue.lock().failed.is_some() && since.elapsed() < SOON {
            std::thread::sleep(REST);
        }
        assert_eq!(log.text(), format!("one\n{told}"));
        log.say("four");
        assert_eq!(log.text(), format!("one\n{told}four\n"));
    }

    #[test]
    fn a_line_that_was_cut_is_ended_first() {
        let log = bench(None);
        log.next(Ok(2));
        log.next(full());
        log.say("one");
        log.say("two");
        assert_eq!(
            log.text(),
            "on\ngantry-tau: 1 line of the log lost: no storage space\ntwo\n"
        );
    }

    #[test]
    fn lines_of_the_standard_output_are_told_in_the_log_only() {
        let log = bench(None);
        let output = bench(Some(log.queue));
        output.next(full());
        output.next(full());
        output.say("{1}");
        output.say("{2}");
        output.say("{3}");
        log.say("end");
        assert_eq!(output.text(), "{3}\n");
        let told = "gantry-tau: lines of the standard output are lost: no storage space\n\
                    gantry-tau: 2 lines of the standard output lost: no storage space\nend\n";
        assert_eq!(log.text(), told);
        output.next(Err(ErrorKind::BrokenPipe.into()));
        output.say("{4}");
        assert!(output.queue.is_broken());
    }

    #[test]
    fn a_blocked_output_is_told_in_the_log_at_once_and_counted_later() {
        let log = bench(None);
        let (release, released) = channel();
        let output = Queue::start(
            "standard output",
            Blocked(released, Arc::default()),
            Some(log.queue),
        )
        .unwrap();
        // One is being written, the queue is full, and five more.
        output.push(line(0));
        while output.lock().waiting.len() == 1 {
            std::thread::yield_now();
        }
        (0..CAPACITY / 10_000 + 5).for_each(|_| output.push(line(0)));
        log.queue.finish(Instant::now() + SOON);
        assert_eq!(
            log.text(),
            "gantry-tau: lines of the standard output are lost: the reader does not take them\n"
        );
        drop(release);
        assert_eq!(output.finish(Instant::now() + SOON), None);
        log.queue.finish(Instant::now() + SOON);
        let told = log.text();
        let last = told.lines().last().unwrap();
        assert_eq!(
            last, "gantry-tau: 5 lines of the standard output lost: the reader did not take them",
            "{told}"
        );
    }

    /// A stream that fails once, and then takes nothing until it is released.
    struct Stalled(bool, Blocked);

    impl Write for Stalled {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            if std::mem::replace(&mut self.0, true) {
                self.1.write(bytes)
            } else {
                full()
            }
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn what_still_waits_at_the_end_is_lost_beside_what_failed() {
        let (release, released) = channel();
        let log = Queue::start(
            "log",
            Stalled(false, Blocked(released, Arc::default())),
            None,
        )
        .unwrap();
        log.push(b"one\n".to_vec());
        while log.lock().failed.is_none() {
            std::thread::yield_now();
        }
        log.push(b"two\n".to_vec());
        while !log.lock().waiting.is_empty() {
            std::thread::yield_now();
        }
        log.push(b"three\nfour\n".to_vec());
        // One failed, one is being written, two wait.
        let told = String::from_utf8(log.finish(Instant::now() + REST).unwrap()).unwrap();
        assert_eq!(
            told,
            "gantry-tau: 4 lines of the log lost: no storage space\n"
        );
        drop(release);
    }

    /// A line of 10 000 bytes.
    fn line(number: usize) -> Vec<u8> {
        format!("{number:>9999}\n").into_bytes()
    }

    /// A stream that takes nothing until it is released.
    struct Blocked(Receiver<()>, Arc<Mutex<Vec<u8>>>);

    impl Write for Blocked {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let _ = self.0.recv();
            self.1.lock().unwrap().extend_from_slice(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_blocked_stream_costs_lines_and_no_time() {
        let (release, released) = channel();
        let text = Arc::default();
        let log = Queue::start("log", Blocked(released, Arc::clone(&text)), None).unwrap();
        let fit = CAPACITY / 10_000;
        log.push(line(0));
        while log.lock().waiting.len() == 1 {
            std::thread::yield_now();
        }
        // One is being written.
        (1..fit + 8).for_each(|number| log.push(line(number)));
        assert!(!log.is_idle());
        let told = log.finish(Instant::now() + REST).unwrap();
        let lost = fit + 8;
        assert_eq!(
            String::from_utf8(told).unwrap(),
            format!("gantry-tau: {lost} lines of the log lost: the reader does not take them\n")
        );
        drop(release);
        assert_eq!(log.finish(Instant::now() + SOON), None);
        log.push(b"last\n".to_vec());
        assert_eq!(log.finish(Instant::now() + SOON), None);
        let text = String::from_utf8(text.lock().unwrap().clone()).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), fit + 3);
        assert_eq!(lines[fit].trim(), fit.to_string());
        let gap = "gantry-tau: 7 lines of the log lost: the reader did not take them";
        assert_eq!(lines[fit + 1..], [gap, "last"]);
    }
}
