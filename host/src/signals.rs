//! Signals: those that end a command in good order, and those that must not end or suspend it.
//!
//! On Unix they are blocked in every thread, and one thread waits for those that end. SIGXFSZ (a file at its limit), SIGTTOU and SIGTTIN
//! (a terminal that belongs to another job) stay blocked: writes and reads succeed or return an error instead. SIGPIPE is ignored by Rust's
//! runtime.

use std::io;
use std::sync::{Mutex, PoisonError};

/// Action of a signal; `None` until the command has begun.
static ON_QUIT: Mutex<Option<Box<dyn FnMut() + Send>>> = Mutex::new(None);

/// Reaction to Ctrl-Z.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Suspension {
    /// The process is suspended.
    Allowed,
    /// Nothing: a suspended server would keep its offsets in force.
    Ignored,
}

/// Takes the signals over that end a command (Ctrl-C and, on Unix, SIGTERM, SIGHUP and SIGQUIT), for this thread and those that it starts from
/// now on. Call it before the first of them. Until [`on_quit`] they end the process at once, with exit code 128 + their number.
///
/// # Errors
/// There is no further thread, or the system does not let signals be blocked.
pub fn take(suspension: Suspension) -> io::Result<()> {
    system::take(suspension)
}

/// Calls `quit` with every signal from now on.
pub fn on_quit(quit: impl FnMut() + Send + 'static) {
    *ON_QUIT.lock().unwrap_or_else(PoisonError::into_inner) = Some(Box::new(quit));
}

fn signalled(number: i32) {
    match &mut *ON_QUIT.lock().unwrap_or_else(PoisonError::into_inner) {
        Some(quit) => quit(),
        None => std::process::exit(128_i32.saturating_add(number)),
    }
}

#[cfg(unix)]
mod system {
    use std::io;

    use nix::sys::signal::{SigSet, Signal};

    use super::{Suspension, signalled};

    const ENDING: [Signal; 4] = [Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP, Signal::SIGQUIT];
    const BLOCKED: [Signal; 3] = [Signal::SIGXFSZ, Signal::SIGTTOU, Signal::SIGTTIN];

    pub(super) fn take(suspension: Suspension) -> io::Result<()> {
        let ending: SigSet =
            ENDING.into_iter().filter(|signal| *signal != Signal::SIGHUP || !hangup_is_ignored()).collect();
        let mut blocked: SigSet = BLOCKED.into_iter().collect();
        blocked.extend(&ending);
        if suspension == Suspension::Ignored {
            blocked.add(Signal::SIGTSTP);
        }
        blocked.thread_block()?;
        let wait = move || {
            // It needs none; without the right to give them up it has none.
            let _ = crate::privileges::give_up(&[]);
            loop {
                if let Ok(signal) = ending.wait() {
                    signalled(signal as i32);
                }
            }
        };
        std::thread::Builder::new().name("signals".to_owned()).spawn(wait)?;
        Ok(())
    }

    /// True if the process was started by `nohup`, which means that it outlives its terminal.
    fn hangup_is_ignored() -> bool {
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
        let mask = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
        mask & 1 << (Signal::SIGHUP as i32 - 1) != 0
    }
}

#[cfg(not(unix))]
mod system {
    use std::io;

    use super::{Suspension, signalled};

    /// Number of SIGINT.
    const INTERRUPT: i32 = 2;

    pub(super) fn take(_: Suspension) -> io::Result<()> {
        ctrlc::set_handler(move || signalled(INTERRUPT)).map_err(io::Error::other)
    }
}
