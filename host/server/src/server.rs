//! The server: a cycle thread around core's endpoint `[T 5.1.1]`.

pub mod connections;
pub mod cycle;
pub mod event_log;
pub mod keyboard;
mod port_owner;
pub mod tick_source;
pub mod velocity_interface;

use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;

use gantry_tau_core::control::axis::{InForce, Offsets};
use gantry_tau_core::control::message::Phase;
use gantry_tau_core::control::session::StartError;

use crate::plant::Plant;
use crate::record::TickRecord;
pub use cycle::Cycle;
use port_owner::port_owner;
pub use tick_source::TickSource;
use velocity_interface::VelocityInterfaceError;

/// Rows that may wait for a slow observer, about four seconds.
const ROWS: usize = 4_096;

/// Reason why a session cannot start.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ServerStartError {
    /// The machine is where a session must not begin.
    #[error(transparent)]
    Session(#[from] StartError),
    /// The machine must not be moved by velocities.
    #[error(transparent)]
    Velocity(#[from] VelocityInterfaceError),
}

/// Error of a server.
#[derive(Clone, Debug, PartialEq)]
pub enum ServerError {
    /// An address cannot be listened on.
    Listen {
        /// The address.
        address: SocketAddr,
        /// The reason, with what to do about it.
        reason: String,
    },
    /// The machine does not answer.
    Plant(String),
    /// The session cannot start.
    Start(ServerStartError),
    /// The cycle thread cannot be started.
    Thread(String),
    /// The cycle thread panicked.
    Panicked,
    /// The server has ended with all offsets at zero, and the stop latch could not be written: the
    /// next start does not know of the stop.
    StopNotStored,
    /// The server has ended, and the machine did not take the references that bring its offsets to
    /// zero.
    StillInForce {
        /// Offsets that the machine had in force when it was heard of last, axis order.
        offsets: Vec<Offsets>,
    },
}

impl ServerError {
    fn of_plant(error: impl fmt::Display) -> Self {
        Self::Plant(error.to_string())
    }

    fn still_in_force<const N: usize>(in_force: &[InForce; N]) -> Self {
        Self::StillInForce {
            offsets: in_force.iter().map(|axis| axis.offsets).collect(),
        }
    }

    fn thread(error: io::Error) -> Self {
        Self::Thread(error.to_string())
    }

    /// Returns the error of an address, with what to do about it.
    #[must_use]
    pub fn listen(address: SocketAddr, error: &io::Error) -> Self {
        let reason = match error.kind() {
            io::ErrorKind::AddrInUse => {
                let owner = port_owner(address.port())
                    .map_or_else(|| "another process".to_owned(), |id| format!("pid {id}"));
                format!(
                    "the port is in use by {owner}; is another server running? (--listen, --accelerometer, --gauges, --labcomm)"
                )
            }
            io::ErrorKind::PermissionDenied => {
                "permission denied; choose a port above 1023".to_owned()
            }
            io::ErrorKind::AddrNotAvailable => {
                "this computer does not have that address".to_owned()
            }
            _ => error.to_string(),
        };
        Self::Listen { address, reason }
    }
}

impl fmt::Display for ServerError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Listen { address, reason } => write!(f, "cannot listen on {address}: {reason}"),
            Self::Plant(error) => f.write_str(error),
            Self::Start(reason) => write!(f, "the session cannot start: {reason}"),
            Self::Panicked => f.write_str(
                "the cycle thread panicked; the offsets in force are unknown and the drives' watchdog must act",
            ),
            Self::StillInForce { offsets } => {
                f.write_str(
                    "the machine takes no references; when it was heard of last, it had these offsets in force:",
                )?;
                for (axis, Offsets { position, velocity, torque }) in offsets.iter().enumerate() {
                    let (position, velocity, torque) = (position.0, velocity.0, torque.0);
                    write!(f, "\n  axis {}: {position} nm, {velocity} um/s, {torque} per mille", axis + 1)?;
                }
                f.write_str("\nStop it at the machine; a server that is started again ramps what it then finds")
            }
            Self::StopNotStored => f.write_str(
                "all offsets are zero; the stop latch cannot be written, and the next start would not know of a stop or re-arm: \
                 make room on the disk, and check the machine before the server is started again",
            ),
            Self::Thread(reason) => write!(f, "the threads of the cycle and of its stop latch cannot start: {reason}"),
        }
    }
}

impl std::error::Error for ServerError {}

/// Switches for other threads; the cycle reads them once per tick.
#[derive(Debug, Default)]
pub struct Controls {
    /// Ramp to zero, then end.
    pub quit: AtomicBool,
    /// The stop at the machine is held.
    stop: AtomicBool,
    /// The stop was pressed; kept until the cycle has seen it, however shortly it was held.
    stop_pressed: AtomicBool,
    /// Re-arm was pressed.
    rearm: AtomicBool,
    /// The last tick began in Fault.
    was_in_fault: AtomicBool,
    /// Lock-step only: the client is known to be silent, so the server does not wait for an answer.
    pub link_silent: AtomicBool,
    /// Rows that found the observer's queue full.
    pub dropped_rows: AtomicU64,
}

impl Controls {
    /// Presses the stop, and holds it.
    pub fn press_stop(&self) {
        self.rearm.store(false, Ordering::Relaxed);
        self.stop.store(true, Ordering::Relaxed);
        self.stop_pressed.store(true, Ordering::Relaxed);
    }

    /// Releases the stop and re-arms.
    pub fn release_and_rearm(&self) {
        self.stop.store(false, Ordering::Relaxed);
        self.rearm.store(true, Ordering::Relaxed);
    }

    /// True if the next tick must not wait for the client.
    fn is_urgent(&self) -> bool {
        [&self.quit, &self.stop, &self.stop_pressed]
            .iter()
            .any(|switch| switch.load(Ordering::Relaxed))
    }

    /// True if the stop is held, or was pressed since the last tick.
    fn take_stop(&self) -> bool {
        self.stop_pressed.swap(false, Ordering::Relaxed) | self.stop.load(Ordering::Relaxed)
    }

    /// True if the re-arm was pressed in Fault. Pressed elsewhere it is forgotten: it must not
    /// answer a later stop.
    ///
    /// The first tick in Fault sees it released: core takes one that is pressed from the beginning
    /// for stuck. So a re-arm that is typed before the first tick of a server that starts in Fault
    /// counts.
    fn take_rearm(&self, phase: Phase) -> bool {
        let is_in_fault = phase == Phase::Fault;
        let was_in_fault = self.was_in_fault.swap(is_in_fault, Ordering::Relaxed);
        if !is_in_fault {
            self.rearm.store(false, Ordering::Relaxed);
        }
        is_in_fault && was_in_fault && self.rearm.load(Ordering::Relaxed)
    }
}

/// A running server.
#[derive(Debug)]
pub struct Server<const N: usize> {
    /// Address on which clients connect.
    pub address: SocketAddr,
    /// Switches.
    pub controls: Arc<Controls>,
    thread: JoinHandle<Result<(), ServerError>>,
}

impl<const N: usize> Server<N> {
    /// Runs `cycle` in a thread of its own, which has its priority, no privileges and its drives
    /// enabled when this returns. Also returns the rows, one per tick, for one observer.
    ///
    /// # Errors
    /// [`ServerError::Thread`]: the system does not tell the address, or does not start a thread.
    /// [`ServerError::Plant`]: the drives cannot be enabled.
    pub fn spawn<const M: usize, P: Plant<N, M> + 'static>(
        cycle: Cycle<N, M, P>,
        ticks: TickSource,
    ) -> Result<(Self, rtrb::Consumer<TickRecord<N>>), ServerError> {
        Self::spawn_controlled(cycle, ticks, Arc::default())
    }

    /// As [`Server::spawn`], with switches that are there before the first tick.
    ///
    /// # Errors
    /// As [`Server::spawn`].
    pub fn spawn_controlled<const M: usize, P: Plant<N, M> + 'static>(
        mut cycle: Cycle<N, M, P>,
        ticks: TickSource,
        controls: Arc<Controls>,
    ) -> Result<(Self, rtrb::Consumer<TickRecord<N>>), ServerError> {
        let address = cycle.address().map_err(ServerError::thread)?;
        let (mut rows, mut observer) = rtrb::RingBuffer::new(ROWS);
        // Memory that is not locked would else cost the first cycles a page fault each.
        while rows.push(TickRecord::listening()).is_ok() {}
        while observer.pop().is_ok() {}
        let switches = Arc::clone(&controls);
        let (starting, until_started) = mpsc::channel();
        let thread = std::thread::Builder::new()
            .name("cycle".to_owned())
            .spawn(move || {
                tick_source::set_up_thread(ticks);
                let started = cycle.start();
                let has_started = started.is_ok();
                // Somebody waits for it below.
                let _sent = starting.send(started);
                if has_started {
                    tick_source::run(cycle, ticks, &switches, rows)
                } else {
                    Ok(())
                }
            })
            .map_err(ServerError::thread)?;
        until_started.recv().map_err(|_| ServerError::Panicked)??;
        let server = Self {
            address,
            controls,
            thread,
        };
        Ok((server, observer))
    }

    /// Ramps to zero, ends the thread, and returns the number of rows that its observer missed.
    ///
    /// # Errors
    /// [`ServerError::StillInForce`]: the machine took no references for two seconds, and may have
    /// offsets in force. [`ServerError::Panicked`]: the offsets in force are unknown, and the
    /// drives' watchdog must act.
    pub fn quit(self) -> Result<u64, ServerError> {
        self.controls.quit.store(true, Ordering::Relaxed);
        self.thread.join().map_err(|_| ServerError::Panicked)??;
        Ok(self.controls.dropped_rows.load(Ordering::Relaxed))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Found by review: `stop` and `rearm` typed within one cycle left no trace of the stop.
    #[test]
    fn a_stop_is_seen_however_shortly_it_is_held() {
        let controls = Controls::default();
        controls.press_stop();
        controls.release_and_rearm();
        assert!(controls.is_urgent());
        assert!(controls.take_stop(), "pressed since the last tick");
        assert!(!controls.take_stop(), "and released");
        controls.press_stop();
        assert!(controls.take_stop() && controls.take_stop(), "held");
    }

    /// Found by review: a re-arm typed in Obtain answered a stop that came later.
    #[test]
    fn a_rearm_counts_in_fault_only() {
        let controls = Controls::default();
        for phase in [Phase::Listening, Phase::Obtain, Phase::SafeDisconnect] {
            controls.release_and_rearm();
            assert!(!controls.take_rearm(phase));
            assert!(
                !controls.take_rearm(Phase::Fault) && !controls.take_rearm(Phase::Fault),
                "forgotten in {phase:?}"
            );
        }
        controls.release_and_rearm();
        // It stands until the ramp is done and the server listens.
        assert!(controls.take_rearm(Phase::Fault) && controls.take_rearm(Phase::Fault));
        controls.press_stop();
        assert!(
            !controls.take_rearm(Phase::Fault),
            "a new stop takes it back"
        );
    }

    /// Found by a user: `echo rearm | gantry-tau serve` after a stop left the server in Fault, and
    /// every further re-arm was stuck.
    #[test]
    fn a_rearm_before_the_first_tick_counts_from_the_second_on() {
        let controls = Controls::default();
        controls.release_and_rearm();
        assert!(
            !controls.take_rearm(Phase::Fault),
            "core must see it released"
        );
        assert!(controls.take_rearm(Phase::Fault) && controls.take_rearm(Phase::Fault));
        assert!(!controls.take_rearm(Phase::Listening) && !controls.take_rearm(Phase::Fault));
    }
}
