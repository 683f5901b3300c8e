//! The loop of `monitor`: read, show, wait.

use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use gantry_tau_record::recording::Recorded;
use gantry_tau_system::dial::Addresses;

use super::screen::{Size, screen};
use super::snapshot::NO_SERVER;
use super::web::Web;
use super::{ServerMonitor, Tap};
use crate::terminal::{self, complain, say};

/// Pause between two visits to the server's connection: long against a tick, so that one read takes
/// many.
const REST: Duration = Duration::from_millis(20);
/// Pause between two pictures of the page, which are 30 a second.
const PICTURE: Duration = Duration::from_millis(33);
/// Pause between two screens of a terminal.
const SCREEN: Duration = Duration::from_millis(100);
/// Pause between two screens of a file or pipe.
const PRINTED: Duration = Duration::from_secs(1);

/// Options of `monitor`.
#[derive(Clone, Debug)]
pub struct MonitorOptions {
    /// Addresses of the server's LabComm port.
    pub server: Addresses,
    /// Form of what is shown.
    pub view: MonitorView,
    /// Time after which it ends by itself.
    pub quit_after: Option<Duration>,
}

/// Form of what is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MonitorView {
    /// A screen on the terminal.
    Screen,
    /// One line of JSON; again after each pause.
    Status {
        /// The pause; `None` for one line.
        every: Option<Duration>,
    },
}

/// Shows a server until `quit`. Returns the exit code, with a screen 0, else that of the last line;
/// and the recording of the tap.
pub fn run(
    options: &MonitorOptions,
    tap: Option<Box<dyn Tap>>,
    quit: &AtomicBool,
) -> (ExitCode, Option<Recorded>) {
    let mut monitor = ServerMonitor::of(options.server.clone()).with_tap(tap);
    let code = match options.view {
        MonitorView::Screen => {
            show_screen(&mut monitor, options.quit_after, quit);
            ExitCode::SUCCESS
        }
        MonitorView::Status { every } => {
            ExitCode::from(show_status(&mut monitor, every, options.quit_after, quit))
        }
    };
    (code, monitor.finish())
}

/// Updates the monitor and calls `show`, with pauses of `rest`, until it is time to end, or `show`
/// returns false.
fn each_visit(
    monitor: &mut ServerMonitor,
    rest: Duration,
    quit_after: Option<Duration>,
    quit: &AtomicBool,
    mut show: impl FnMut(&ServerMonitor) -> bool,
) {
    let began = Instant::now();
    while !quit.load(Ordering::Relaxed) && quit_after.is_none_or(|after| began.elapsed() < after) {
        monitor.update();
        if !show(monitor) {
            return;
        }
        std::thread::sleep(rest);
    }
}

/// Serves the page until `quit`. Returns the recording of the tap.
pub fn run_page(
    server: Addresses,
    page: &mut Web,
    tap: Option<Box<dyn Tap>>,
    quit_after: Option<Duration>,
    quit: &AtomicBool,
) -> Option<Recorded> {
    let mut monitor = ServerMonitor::of(server).with_tap(tap);
    each_visit(&mut monitor, PICTURE, quit_after, quit, |monitor| {
        page.visit(monitor);
        true
    });
    monitor.finish()
}

fn show_screen(monitor: &mut ServerMonitor, quit_after: Option<Duration>, quit: &AtomicBool) {
    let is_terminal = terminal::is_terminal();
    let pause = if is_terminal { SCREEN } else { PRINTED };
    let mut next = Instant::now();
    if is_terminal {
        terminal::show("\x1b[2J".to_owned());
    }
    each_visit(monitor, REST, quit_after, quit, |monitor| {
        if Instant::now() < next {
            return true;
        }
        next = Instant::now() + pause;
        terminal::show(if is_terminal {
            let size = terminal_size();
            frame(&screen(monitor, size), size.rows)
        } else {
            screen(monitor, Size::PRINTED) + "\n\n"
        });
        is_wanted(monitor)
    });
    if is_terminal {
        say("");
    }
}

/// Size of the terminal.
fn terminal_size() -> Size {
    terminal::size().map_or(Size::USUAL, |(columns, rows)| Size { columns, rows })
}

/// Returns what shows a screen on a terminal, from its upper left corner. Each line is erased before
/// its text, and what is below the last is erased; meanwhile nothing wraps, so that a letter of
/// double width costs the end of its line only.
fn frame(screen: &str, rows: usize) -> String {
    let lines = screen.replace('\n', "\r\n\x1b[K");
    let rest = if screen.lines().count() < rows {
        "\r\n\x1b[J"
    } else {
        ""
    };
    format!("\x1b[H\x1b[?7l\x1b[K{lines}{rest}\x1b[?7h")
}

/// True while there is a reader of the standard output, or a recording.
fn is_wanted(monitor: &ServerMonitor) -> bool {
    monitor.has_tap() || !terminal::reader_has_ended()
}

/// Logs the events after number `logged`, in their order. Returns the number of the last.
fn log_events(monitor: &ServerMonitor, logged: u64) -> u64 {
    let mut last = logged;
    for entry in monitor.events().rev().filter(|entry| entry.number > logged) {
        let lost = entry.number - last - 1;
        if lost > 0 {
            tracing::warn!("{lost} events before this one came at once with it and were not kept");
        }
        tracing::info!("{}", entry.text);
        last = entry.number;
    }
    last
}

/// Returns the exit status of the last line.
fn show_status(
    monitor: &mut ServerMonitor,
    every: Option<Duration>,
    quit_after: Option<Duration>,
    quit: &AtomicBool,
) -> u8 {
    let mut status = NO_SERVER;
    let mut next = Instant::now();
    let mut logged = 0;
    each_visit(monitor, REST, quit_after, quit, |monitor| {
        if every.is_some() {
            logged = log_events(monitor, logged);
        }
        if Instant::now() < next {
            return true;
        }
        match (monitor.live(), every) {
            (Some(snapshot), _) => {
                say(snapshot.json());
                status = snapshot.exit_status();
                next = Instant::now() + every.unwrap_or_default();
                every.is_some() && is_wanted(monitor)
            }
            (None, Some(_)) => {
                status = NO_SERVER;
                true
            }
            (None, None) => !monitor.has_failed(),
        }
    });
    if let (NO_SERVER, Some(trouble)) = (status, monitor.trouble()) {
        complain(trouble);
    }
    status
}
