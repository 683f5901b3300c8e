//! Frames of one tick, kept until the references are with the drives, which come first.

use gantry_tau_core::control::endpoint::FRAMES;
use gantry_tau_core::control::session::fsm::Connection;
use gantry_tau_core::control::wire::MAX_FRAME;

/// Frames, in the order in which they are to be sent. Allocated once.
#[derive(Debug)]
pub(super) struct Outbox {
    bytes: Vec<u8>,
    /// To whom, and where it ends.
    frames: Vec<(Connection, usize)>,
}

impl Outbox {
    pub(super) fn new() -> Self {
        Self {
            bytes: Vec::with_capacity(FRAMES * MAX_FRAME),
            frames: Vec::with_capacity(FRAMES),
        }
    }

    pub(super) fn push(&mut self, to: Connection, frame: &[u8]) {
        self.bytes.extend_from_slice(frame);
        self.frames.push((to, self.bytes.len()));
    }

    /// Hands out every frame, and forgets it.
    pub(super) fn empty(&mut self, mut send: impl FnMut(Connection, &[u8])) {
        let mut start = 0;
        for (to, end) in self.frames.drain(..) {
            send(to, self.bytes.get(start..end).unwrap_or_default());
            start = end;
        }
        self.bytes.clear();
    }
}
