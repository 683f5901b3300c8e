//! The server: a cycle thread around the core's endpoint `[T 5.1.1]`.

mod connections;
pub mod cycle;
pub mod observe;
pub mod pace;

use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;

use crate::plant::{Plant, PlantError};
use cycle::{Cycle, Row};
use pace::Pace;

/// Half the black box, in ticks: at least so many remain before and after a cause.
pub const HALF: usize = 64;
/// Rows that may wait for a slow observer, about four seconds.
const ROWS: usize = 4_096;

/// Why a server cannot run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ServerError {
    /// An address cannot be listened on.
    Listen {
        /// The address.
        address: SocketAddr,
        /// What the system said.
        reason: String,
    },
    /// The machine does not answer.
    Plant(PlantError),
    /// The session refuses to start.
    Start(String),
    /// The system gave no thread.
    Thread(String),
}

impl ServerError {
    /// An address that cannot be listened on.
    #[must_use]
    pub fn listen(address: SocketAddr, error: &io::Error) -> Self {
        Self::Listen {
            address,
            reason: match error.kind() {
                io::ErrorKind::AddrInUse => "the port is in use".to_owned(),
                io::ErrorKind::PermissionDenied => "no permission for this port".to_owned(),
                io::ErrorKind::AddrNotAvailable => "this machine has no such address".to_owned(),
                _ => error.to_string(),
            },
        }
    }
}

impl fmt::Display for ServerError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Listen { address, reason } => write!(f, "cannot listen on {address}: {reason}"),
            Self::Plant(error) => error.fmt(f),
            Self::Start(reason) => write!(f, "the session cannot start: {reason}"),
            Self::Thread(reason) => write!(f, "the cycle thread cannot start: {reason}"),
        }
    }
}

impl std::error::Error for ServerError {}

/// Switches that other threads throw; the cycle looks at them once per tick.
#[derive(Debug, Default)]
pub struct Controls {
    /// End: ramp to zero, then return.
    pub quit: AtomicBool,
    /// The stop at the machine.
    pub stop: AtomicBool,
    /// Re-arm after a stop; taken back once the server listens.
    pub rearm: AtomicBool,
    /// Lock-step only: the link is known to be silent, so waiting for an answer has no use.
    pub link_silent: AtomicBool,
    /// Rows that found the observer's queue full.
    pub dropped_rows: AtomicU64,
}

/// A running server.
#[derive(Debug)]
pub struct Server<const N: usize> {
    /// Where clients connect.
    pub address: SocketAddr,
    /// Its switches.
    pub controls: Arc<Controls>,
    thread: JoinHandle<()>,
}

impl<const N: usize> Server<N> {
    /// Runs `cycle` in a thread of its own. The other half of the result are the rows, one per tick, for one observer.
    ///
    /// # Errors
    /// [`ServerError`] when the system gives no address or no thread.
    pub fn spawn<const M: usize, P: Plant<N, M> + 'static>(
        cycle: Cycle<N, M, P>,
        pace: Pace,
    ) -> Result<(Self, rtrb::Consumer<Row<N>>), ServerError> {
        let thread_error = |error: io::Error| ServerError::Thread(error.to_string());
        let address = cycle.address().map_err(thread_error)?;
        let controls = Arc::new(Controls::default());
        let (rows, observer) = rtrb::RingBuffer::new(ROWS);
        let switches = Arc::clone(&controls);
        let thread = std::thread::Builder::new()
            .name("cycle".to_owned())
            .spawn(move || pace::run(cycle, pace, &switches, rows))
            .map_err(thread_error)?;
        let server = Self {
            address,
            controls,
            thread,
        };
        Ok((server, observer))
    }

    /// Whether the cycle thread has returned.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.thread.is_finished()
    }

    /// Ramps to zero, ends the thread, and returns how many rows its observer missed.
    #[must_use]
    pub fn quit(self) -> u64 {
        self.controls.quit.store(true, Ordering::Relaxed);
        // A panicking cycle has already said so on stderr.
        let _ = self.thread.join();
        self.controls.dropped_rows.load(Ordering::Relaxed)
    }
}
