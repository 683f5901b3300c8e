//! Signals: those that end a command in good order, and those that must not end or suspend it.
//!
//! On Unix every signal is blocked in every thread but those of a fault of the program itself, and
//! one thread waits for those that end. So SIGXFSZ (a file at its limit), SIGTTOU and SIGTTIN (a
//! terminal that belongs to another job) end and suspend nothing: writes and reads succeed or
//! return an error instead. SIGPIPE is ignored by Rust's runtime.

use std::io;
use std::sync::{Mutex, PoisonError};

/// Action of a signal; `None` until the command has begun.
static ON_QUIT: Mutex<Option<Box<dyn FnMut() + Send>>> = Mutex::new(None);

/// Reaction to Ctrl-Z.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Suspension {
    /// The process is suspended.
    Allowed,
    /// Nothing: a suspended server would keep its offsets in force.
    Ignored,
}

/// Takes the signals over that end a command (Ctrl-C and, on Unix, SIGTERM, SIGHUP, SIGQUIT and
/// every other one whose default is the end of the process, but for SIGKILL and faults), for this
/// thread and those that it starts from now on. Call it before the first of them. Until [`on_quit`]
/// they end the process at once, with exit code 128 + their number. Signals for applications
/// (SIGRTMIN and up) do nothing.
///
/// # Errors
/// There is no further thread, or the system does not let signals be blocked.
pub(crate) fn install(suspension: Suspension) -> io::Result<()> {
    system::install(suspension)
}

/// Makes a write to a file at its limit return an error, where it would end the process.
///
/// # Errors
/// The system does not let signals be blocked.
pub(crate) fn survive_file_limits() -> io::Result<()> {
    system::survive_file_limits()
}

/// Calls `quit` with every signal from now on.
pub(crate) fn on_quit(quit: impl FnMut() + Send + 'static) {
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

    /// Those whose default is the end of the process.
    const ENDING: [Signal; 11] = [
        Signal::SIGINT,
        Signal::SIGTERM,
        Signal::SIGHUP,
        Signal::SIGQUIT,
        Signal::SIGUSR1,
        Signal::SIGUSR2,
        Signal::SIGALRM,
        Signal::SIGVTALRM,
        Signal::SIGPROF,
        Signal::SIGIO,
        Signal::SIGXCPU,
    ];
    /// Further ones of Linux.
    #[cfg(target_os = "linux")]
    const ENDING_ON_LINUX: [Signal; 2] = [Signal::SIGSTKFLT, Signal::SIGPWR];
    #[cfg(not(target_os = "linux"))]
    const ENDING_ON_LINUX: [Signal; 0] = [];
    /// Faults of the program itself, which cannot go on.
    const FAULTS: [Signal; 7] = [
        Signal::SIGSEGV,
        Signal::SIGBUS,
        Signal::SIGILL,
        Signal::SIGFPE,
        Signal::SIGABRT,
        Signal::SIGTRAP,
        Signal::SIGSYS,
    ];

    pub(super) fn survive_file_limits() -> io::Result<()> {
        Ok([Signal::SIGXFSZ]
            .into_iter()
            .collect::<SigSet>()
            .thread_block()?)
    }

    pub(super) fn install(suspension: Suspension) -> io::Result<()> {
        let all = ENDING.into_iter().chain(ENDING_ON_LINUX);
        let ending: SigSet = all
            .filter(|signal| *signal != Signal::SIGHUP || !hangup_is_ignored())
            .collect();
        let mut blocked = SigSet::all();
        FAULTS.into_iter().for_each(|fault| blocked.remove(fault));
        if suspension == Suspension::Allowed {
            blocked.remove(Signal::SIGTSTP);
        }
        blocked.thread_block()?;
        std::thread::Builder::new()
            .name("signals".to_owned())
            .spawn(move || wait_for(&ending))?;
        Ok(())
    }

    fn wait_for(ending: &SigSet) {
        // It needs none; without the right to give them up it has none.
        let _ = gantry_tau_system::privileges::give_up(&[]);
        loop {
            if let Ok(signal) = ending.wait() {
                signalled(signal as i32);
            }
        }
    }

    /// True if the process was started by `nohup`, which means that it outlives its terminal.
    fn hangup_is_ignored() -> bool {
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
        let mask = ignored
            .and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok())
            .unwrap_or(0);
        mask & 1 << (Signal::SIGHUP as i32 - 1) != 0
    }
}

#[cfg(not(unix))]
mod system {
    use std::io;

    use super::{Suspension, signalled};

    /// Number of SIGINT.
    const INTERRUPT: i32 = 2;

    pub(super) fn survive_file_limits() -> io::Result<()> {
        Ok(())
    }

    pub(super) fn install(_: Suspension) -> io::Result<()> {
        ctrlc::set_handler(move || signalled(INTERRUPT)).map_err(io::Error::other)
    }
}
