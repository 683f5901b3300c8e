//! Runs futures of ethercrab on the calling thread, and carries their frames.

use std::future::Future;
use std::pin::pin;
use std::task::{Context, Poll, Waker};

use ethercrab::error::Error;
use ethercrab::{PduRx, PduTx, ReceiveAction};

use crate::clock;
use crate::wire::Wire;

/// Longest frame, bytes.
const MAX_FRAME: usize = 1_536;
/// Longest wait for a frame between two looks at the timers, µs.
const WAIT_US: u64 = 50;

/// Carries frames between ethercrab and a wire.
pub(crate) struct Pump<W> {
    pub(crate) wire: W,
    tx: PduTx<'static>,
    rx: PduRx<'static>,
    buffer: [u8; MAX_FRAME],
}

impl<W: Wire> Pump<W> {
    pub(crate) const fn new(wire: W, tx: PduTx<'static>, rx: PduRx<'static>) -> Self {
        Self {
            wire,
            tx,
            rx,
            buffer: [0; MAX_FRAME],
        }
    }

    /// Runs a future until it ends, at most for `limit_us`. `None` then: what it waits for is given
    /// up.
    pub(crate) fn run<F: Future>(&mut self, future: F, limit_us: u64) -> Option<F::Output> {
        let mut future = pin!(future);
        let mut context = Context::from_waker(Waker::noop());
        let limit_us = self.wire.now_us().saturating_add(limit_us);
        loop {
            let now_ns = self.wire.now_ns();
            clock::set_ns(now_ns);
            let now_us = now_ns / 1_000;
            if let Poll::Ready(output) = future.as_mut().poll(&mut context) {
                return Some(output);
            }
            if now_us > limit_us {
                return None;
            }
            let sent = self.send();
            if !self.receive() && !sent {
                self.wire.wait_until(now_us.saturating_add(WAIT_US));
            }
        }
    }

    /// Drops what has arrived, outside an exchange: a wire with a frame waits no longer.
    fn drain(&mut self) {
        while self.wire.receive(&mut self.buffer).is_some() {}
    }

    /// Begins the next cycle, and waits for it, outside an exchange.
    pub(crate) fn rest_until(&mut self, next_us: u64, cycle_us: u64) {
        self.wire.begin_cycles(1, cycle_us);
        while self.wire.now_us() < next_us {
            self.wire.wait_until(next_us);
            self.drain();
        }
    }

    /// Sends what is to be sent; true if there was a frame, and the interface took it.
    fn send(&mut self) -> bool {
        let mut sent = false;
        while let Some(frame) = self.tx.next_sendable_frame() {
            let wire = &mut self.wire;
            let outcome = frame.send_blocking(|bytes| match wire.send(bytes) {
                Ok(()) => Ok(bytes.len()),
                Err(_) => Err(Error::SendFrame),
            });
            if outcome.is_err() {
                // It stays sendable until its time is over.
                return false;
            }
            sent = true;
        }
        sent
    }

    /// Takes what has arrived; true if there was an answer that somebody waits for.
    fn receive(&mut self) -> bool {
        let mut received = false;
        while let Some(length) = self.wire.receive(&mut self.buffer) {
            let frame = self.buffer.get(..length).unwrap_or(&[]);
            received |= self.rx.receive_frame(frame) == Ok(ReceiveAction::Processed);
        }
        received
    }
}

impl<W> std::fmt::Debug for Pump<W> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Pump").finish_non_exhaustive()
    }
}
