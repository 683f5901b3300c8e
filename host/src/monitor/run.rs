//! The loop of `monitor`: read, show, wait.

use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::snapshot::NO_SERVER;
use super::web::Web;
use super::{Monitor, Tap, screen};
use crate::dial::Addresses;
use crate::record::Recorded;
use crate::terminal::{self, complain, say};

/// Pause between two visits to the server's connection: long against a tick, so that one read takes many.
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
    pub view: View,
    /// Time after which it ends by itself.
    pub quit_after: Option<Duration>,
}

/// Form of what is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum View {
    /// A screen on the terminal.
    Screen,
    /// One line of JSON; again after each pause.
    Status {
        /// The pause; `None` for one line.
        every: Option<Duration>,
    },
}

/// Shows a server until `quit`. Returns the exit code, with a screen 0, else that of the last line; and the recording of the tap.
pub fn run(options: &MonitorOptions, tap: Option<Box<dyn Tap>>, quit: &AtomicBool) -> (ExitCode, Option<Recorded>) {
    let mut monitor = Monitor::of(options.server.clone()).with_tap(tap);
    let code = match options.view {
        View::Screen => {
            show_screen(&mut monitor, options.quit_after, quit);
            ExitCode::SUCCESS
        }
        View::Status { every } => ExitCode::from(show_status(&mut monitor, every, options.quit_after, quit)),
    };
    (code, monitor.finish())
}

/// Updates the monitor and calls `show`, with pauses of `rest`, until it is time to end, or `show` returns false.
fn each_visit(
    monitor: &mut Monitor,
    rest: Duration,
    quit_after: Option<Duration>,
    quit: &AtomicBool,
    mut show: impl FnMut(&Monitor) -> bool,
) {
    let began = Instant::now();
    let is_over = || quit.load(Ordering::Relaxed) || quit_after.is_some_and(|after| began.elapsed() >= after);
    while !is_over() {
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
    let mut monitor = Monitor::of(server).with_tap(tap);
    each_visit(&mut monitor, PICTURE, quit_after, quit, |monitor| {
        page.visit(monitor);
        true
    });
    monitor.finish()
}

fn show_screen(monitor: &mut Monitor, quit_after: Option<Duration>, quit: &AtomicBool) {
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
        let text = screen::screen(monitor);
        // From the upper left corner; each line and the rest of the screen are erased behind the text.
        terminal::show(if is_terminal {
            format!("\x1b[H{}\x1b[J", text.replace('\n', "\x1b[K\r\n"))
        } else {
            text + "\n"
        });
        is_wanted(monitor)
    });
}

/// True while there is a reader of the standard output, or a recording.
fn is_wanted(monitor: &Monitor) -> bool {
    monitor.has_tap() || !terminal::reader_has_ended()
}

/// Logs the events after number `told`, the first first. Returns the number of the last.
fn tell_events(monitor: &Monitor, told: u64) -> u64 {
    let mut last = told;
    for entry in monitor.events().rev().filter(|entry| entry.number > told) {
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
fn show_status(monitor: &mut Monitor, every: Option<Duration>, quit_after: Option<Duration>, quit: &AtomicBool) -> u8 {
    let mut status = NO_SERVER;
    let mut next = Instant::now();
    let mut told = 0;
    each_visit(monitor, REST, quit_after, quit, |monitor| {
        if every.is_some() {
            told = tell_events(monitor, told);
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
