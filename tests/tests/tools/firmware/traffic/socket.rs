//! Bytes that have arrived on a connection and are not read yet.

use std::collections::VecDeque;

use gantry_tau_core::control::endpoint::Transport;

/// Receive buffer of a connection.
pub(super) struct Socket {
    transport: Transport,
    /// Pieces of a stream, or datagrams.
    pub(super) waiting: VecDeque<Vec<u8>>,
}

impl Socket {
    pub(super) const fn new(transport: Transport) -> Self {
        Self {
            transport,
            waiting: VecDeque::new(),
        }
    }

    /// Takes at most `left` bytes. The rest of a datagram is lost.
    pub(super) fn receive(&mut self, left: usize) -> Option<Vec<u8>> {
        let next = self.waiting.front_mut().filter(|_| left > 0)?;
        let rest = next.split_off(next.len().min(left));
        let taken = std::mem::replace(next, rest);
        if next.is_empty() || self.transport == Transport::Datagram {
            self.waiting.pop_front();
        }
        Some(taken)
    }
}
