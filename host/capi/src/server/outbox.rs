//! Frames of one tick that wait to be fetched: C is never called, it asks.

use gantry_tau_core::control::endpoint::{FRAMES, REFUSALS};
use gantry_tau_core::control::session::fsm::Connection;
use gantry_tau_core::control::wire::{HEADER_LEN, MAX_FRAME, TRAILER_LEN};

/// Longest frame, bytes.
pub const GT_MAX_FRAME: usize = 394;
const _: () = assert!(GT_MAX_FRAME == MAX_FRAME, "a frame fits");

/// A Refusal: 8 bytes of body (`wire.md`).
const REFUSAL: usize = HEADER_LEN + 8 + TRAILER_LEN;
/// The frames of a tick: Refusals, a Welcome and a State.
const BYTES: usize = REFUSALS * REFUSAL + 2 * MAX_FRAME;

/// A frame to be written to a connection.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct gt_frame {
    /// To whom.
    pub connection: u64,
    /// How many bytes.
    pub length: u32,
    /// The bytes; those from `length` on are 0.
    pub bytes: [u8; GT_MAX_FRAME],
}

/// The frames, in the order in which they are to be written.
#[derive(Debug)]
pub(super) struct Outbox {
    frames: [(Connection, usize, usize); FRAMES],
    count: usize,
    bytes: [u8; BYTES],
    used: usize,
}

impl Outbox {
    pub(super) const fn new() -> Self {
        Self {
            frames: [(Connection(0), 0, 0); FRAMES],
            count: 0,
            bytes: [0; BYTES],
            used: 0,
        }
    }

    pub(super) const fn clear(&mut self) {
        self.count = 0;
        self.used = 0;
    }

    /// There is room: [`FRAMES`], [`BYTES`].
    pub(super) fn push(&mut self, connection: Connection, bytes: &[u8]) {
        let end = self.used.saturating_add(bytes.len());
        let (Some(frame), Some(room)) = (
            self.frames.get_mut(self.count),
            self.bytes.get_mut(self.used..end),
        ) else {
            return;
        };
        *frame = (connection, self.used, end);
        for (to, from) in room.iter_mut().zip(bytes) {
            *to = *from;
        }
        self.count = self.count.saturating_add(1);
        self.used = end;
    }

    pub(super) const fn count(&self) -> usize {
        self.count
    }

    pub(super) fn frame(&self, index: usize) -> Option<gt_frame> {
        let written = self.frames.get(..self.count)?;
        let (connection, start, end) = *written.get(index)?;
        Some(gt_frame::new(connection, self.bytes.get(start..end)?))
    }
}

impl gt_frame {
    pub(super) fn new(connection: Connection, frame: &[u8]) -> Self {
        let mut bytes = [0; GT_MAX_FRAME];
        for (to, from) in bytes.iter_mut().zip(frame) {
            *to = *from;
        }
        Self {
            connection: connection.0,
            length: u32::try_from(frame.len()).unwrap_or(0),
            bytes,
        }
    }
}
