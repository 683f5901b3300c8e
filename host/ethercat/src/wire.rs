//! Carrier of frames: a network interface, or an emulated chain.

/// Carrier of EtherCAT frames, with the clock that its user's timers follow. No call blocks, except
/// [`wait_until`](Self::wait_until).
pub trait Wire: Send {
    /// Returns the time, µs; it never goes back.
    fn now_us(&self) -> u64;

    /// Returns the time, ns; the same clock as [`now_us`](Self::now_us).
    fn now_ns(&self) -> u64 {
        self.now_us().saturating_mul(1_000)
    }

    /// Sends a frame.
    ///
    /// # Errors
    /// [`WireError`] when the interface does not take it.
    fn send(&mut self, frame: &[u8]) -> Result<(), WireError>;

    /// Takes a frame that has arrived; returns its length.
    fn receive(&mut self, buffer: &mut [u8]) -> Option<usize>;

    /// Waits until a frame has arrived, at most until `us`.
    fn wait_until(&mut self, us: u64);

    /// Takes note that `cycles` cycles of `cycle_us` have begun since the last call. Interfaces
    /// have the clock of the system and need none.
    fn begin_cycles(&mut self, cycles: u64, cycle_us: u64) {
        let _ = (cycles, cycle_us);
    }

    /// True if [`begin_cycles`](Self::begin_cycles) makes the cycles: the time goes on to the
    /// beginning of the next.
    fn makes_cycles(&self) -> bool {
        false
    }

    /// Moves the cycles to come by so much, ns, where [`begin_cycles`](Self::begin_cycles) makes
    /// them.
    fn shift_cycles(&mut self, ns: i64) {
        let _ = ns;
    }
}

/// The interface does not take a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the network interface takes no frame")]
pub struct WireError;
