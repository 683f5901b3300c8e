//! A client for programs that are slower than the server: they say which offsets they want at which
//! time, one JSON object per line; core's pacer makes one target per tick of it.
//!
//! The server's rule does not change. This is a client of it, with the cycle's priority, and beside it
//! a port for one program at a time:
//!
//! ```text
//! program -> {"mode":"obtain","t":12.3,"offset_um":[5.0,0.0,0.0]}
//! program <- {"t":12.25,"phase":"obtain","nominal_mm":[..],"offset_um":[..],"actual_mm":[..],
//!             "force_n":[..],"moment_nm":[..],"late":0,"limited":0}
//! program <- {"error":"t: the time of the target has been played 12 ticks ago; ..."}
//! ```
//!
//! `t` is the server's time, its tick times its cycle, so that no clock is shared. A line that cannot
//! be used costs an error line and nothing else. A program that is gone, or silent for too long, ends
//! the session with a Goodbye; the next one begins another.

mod line;
mod program;
mod session;

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::keys::Key;
use gantry_tau_system::dial::{Addresses, LOOK};

pub use program::Programs;

use super::ClientError;
use session::Session;

/// Options of a pacing client.
#[derive(Clone, Debug)]
pub struct PaceOptions {
    /// Addresses of the server, of which the first that answers is taken.
    pub server: Addresses,
    /// TCP or UDP.
    pub transport: Transport,
    /// Key of the server; `None` for a server without keys.
    pub key: Option<Key>,
    /// Checksum of the machine's kinematic parameters.
    pub kinematics_checksum: u32,
    /// Time between that of a target and the tick in which it is asked for.
    pub latency: Duration,
    /// Silence after which the targets stay where they are.
    pub hold: Duration,
    /// Silence after which the session is ended.
    pub give_up: Duration,
    /// Time between two lines to the program.
    pub period: Duration,
    /// Answers a server in lock-step at once, in place of once per cycle of the clock: its time then
    /// runs ahead of a program's.
    pub is_hurried: bool,
}

/// Counts of a pacing client.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PaceReport {
    /// Programs that were served.
    pub programs: u64,
    /// Targets that were taken.
    pub targets: u64,
    /// Lines that were refused.
    pub refused: u64,
    /// Programs that were given up.
    pub silent: u64,
}

/// End of a program's session that is no error.
enum Left {
    /// The program has closed its connection.
    Gone,
    /// It was silent for too long.
    Silent,
    /// The switch was set.
    Quit,
}

/// Serves programs, one after the other, until the switch is set, or the [one](Programs::one) has been
/// served. An error of a session is told to the program, and logged.
pub fn run<const N: usize>(
    options: &PaceOptions,
    programs: &mut Programs,
    quit: &AtomicBool,
) -> PaceReport {
    let mut report = PaceReport::default();
    while !quit.load(Ordering::Relaxed) && !programs.is_over() {
        let Some(mut program) = programs.accept() else {
            std::thread::sleep(LOOK.min(options.period));
            continue;
        };
        report.programs = report.programs.saturating_add(1);
        tracing::info!("program {} connected", program.peer());
        let session = Session::<N>::open(options, &mut program, quit);
        match session.and_then(|session| session.hold(programs, &mut report)) {
            Ok(Left::Gone) => tracing::info!("the program has left; the offsets ramp to zero"),
            Ok(Left::Silent) => {
                report.silent = report.silent.saturating_add(1);
                let silence = options.give_up.as_millis();
                let error = format!("no target for {silence} ms: the session is ended");
                tracing::warn!("{error}");
                program.refuse(&error);
            }
            Ok(Left::Quit) | Err(ClientError::Quit) => program.refuse(&"the pacer was ended"),
            Err(error) => {
                tracing::warn!("{error}");
                program.refuse(&error);
            }
        }
        program.close();
    }
    report
}
