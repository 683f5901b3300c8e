//! Output on the terminal that cannot fail, and in commands that run for long cannot block.
//!
//! Short commands write directly and wait for their reader. Commands that own or watch a machine
//! call [`queue_output`] first: from then on both streams have a bounded queue and a thread of
//! their own. Lines that cannot be written (closed, full or blocked stream) are counted, and the
//! log says how many were lost and why as soon as it can be written again.

mod progress;
mod queue;

use std::fmt::Display;
use std::io::{self, IsTerminal, Write};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use gantry_tau_system::output::escaped;
use tracing_subscriber::fmt::MakeWriter;

pub(crate) use progress::Progress;
use queue::Queue;

/// Longest wait at the end of a command for streams that are slow or blocked.
const LAST_WAIT: Duration = Duration::from_secs(1);

/// Queues of the standard output and of the log.
struct Queues {
    output: &'static Queue,
    log: &'static Queue,
    reader: OutputReader,
}

static QUEUES: OnceLock<Queues> = OnceLock::new();

/// Reader of the standard output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum OutputReader {
    /// A person: the output may also say that lines of the log were lost.
    Person,
    /// A program: the output has nothing but its format.
    Program,
}

/// Writes from now on through queues, and panics are logged through them. Returns a guard for the
/// end of `main`.
///
/// # Errors
/// There is no further thread.
pub(crate) fn queue_output(reader: OutputReader) -> io::Result<WritesRest> {
    let log = Queue::start("log", io::stderr(), None)?;
    let output = Queue::start("standard output", queue::unbuffered_stdout(), Some(log))?;
    let _ = QUEUES.set(Queues {
        output,
        log,
        reader,
    });
    std::panic::set_hook(Box::new(|panicked| {
        let backtrace = std::backtrace::Backtrace::capture();
        let thread = std::thread::current();
        let name = thread.name().unwrap_or("without a name");
        let trace = match backtrace.status() {
            std::backtrace::BacktraceStatus::Captured => format!("\n{backtrace}"),
            _ => String::new(),
        };
        write_log(format!("thread {name} {panicked}{trace}\n").into_bytes());
    }));
    Ok(WritesRest)
}

/// Writes what waits in the queues when it is dropped, for at most one second.
#[derive(Debug)]
#[must_use]
pub(crate) struct WritesRest;

impl Drop for WritesRest {
    fn drop(&mut self) {
        let Some(Queues {
            output,
            log,
            reader,
        }) = QUEUES.get()
        else {
            return;
        };
        let until = Instant::now() + LAST_WAIT;
        if let Some(lost) = output.finish(until - LAST_WAIT / 2) {
            write_log(lost);
        }
        if let (Some(lost), OutputReader::Person) = (log.finish(until), reader) {
            output.push(lost);
            output.finish(until);
        }
    }
}

/// First failure of the standard output of a short command.
static OUTPUT_FAILURE: OnceLock<String> = OnceLock::new();

/// Returns why the standard output of a short command is not whole; `None` if it is, or if its
/// reader has ended.
#[must_use]
pub(crate) fn output_failure() -> Option<&'static str> {
    OUTPUT_FAILURE.get().map(String::as_str)
}

/// Prints a line on the standard output.
pub(crate) fn say(line: impl Display) {
    let line = format!("{}\n", harmless(&line.to_string())).into_bytes();
    match QUEUES.get() {
        Some(queues) => queues.output.push(line),
        // Continues after the reader has ended (`gantry-tau plan | head`), where `println!` would
        // panic.
        None => match queue::unbuffered_stdout().write_all(&line) {
            Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
                OUTPUT_FAILURE.get_or_init(|| error.to_string());
            }
            _ => {}
        },
    }
}

/// Prints an error or a remark on stderr, with the name of the program.
pub(crate) fn complain(what: impl Display) {
    write_log(format!("gantry-tau: {}\n", harmless(&what.to_string())).into_bytes());
}

/// Returns a text in which what would command a terminal is escaped: texts of files and of the
/// network are among what is said.
fn harmless(text: &str) -> String {
    escaped(text, |letter| {
        !letter.is_control() || matches!(letter, '\n' | '\t')
    })
}

fn write_log(line: Vec<u8>) {
    match QUEUES.get() {
        Some(queues) => queues.log.push(line),
        None => drop(io::stderr().write_all(&line)),
    }
}

/// Writer of the log, for `tracing_subscriber`. It never fails.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct LogWriter;

impl Write for LogWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        write_log(bytes.to_vec());
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl MakeWriter<'_> for LogWriter {
    type Writer = Self;

    fn make_writer(&self) -> Self {
        Self
    }
}

/// Shows a picture on the standard output. One that the terminal has no time for is left out: the
/// next is newer.
pub(crate) fn show(picture: String) {
    match QUEUES.get() {
        Some(queues) if queues.output.is_idle() => queues.output.push(picture.into_bytes()),
        Some(_) => {}
        None => drop(queue::unbuffered_stdout().write_all(picture.as_bytes())),
    }
}

/// True once the reader of the standard output has ended.
pub(crate) fn reader_has_ended() -> bool {
    QUEUES.get().is_some_and(|queues| queues.output.is_broken())
}

/// Columns and lines of the terminal; `None` if there is none, or if it does not tell.
pub(crate) fn size() -> Option<(usize, usize)> {
    let (columns, rows) = terminal_size::terminal_size()?;
    Some((columns.0.into(), rows.0.into()))
}

/// True if the standard output is a terminal.
pub(crate) fn is_terminal() -> bool {
    io::stdout().is_terminal()
}
