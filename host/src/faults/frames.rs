//! Byte streams cut into the frames of `wire.md`, every byte kept.

use gantry_tau_core::control::wire::{Deframer, Feed};

/// Cuts a stream into its frames; once the boundary is lost, into the pieces that were read.
#[derive(Default)]
pub(super) struct Frames {
    deframer: Deframer,
    held: Vec<u8>,
}

impl Frames {
    /// Hands out every frame that is complete now, byte for byte.
    pub(super) fn feed(&mut self, bytes: &[u8], mut each: impl FnMut(&[u8])) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let (taken, whole) = match self.deframer.feed(rest) {
                Feed::Incomplete => (rest.len(), false),
                Feed::Frame { consumed, .. } => (consumed, true),
                Feed::Broken(_) => (rest.len(), true),
            };
            let (frame, behind) = rest.split_at_checked(taken).unwrap_or((rest, &[]));
            self.held.extend_from_slice(frame);
            rest = behind;
            if whole {
                each(&self.held);
                self.held.clear();
            }
        }
    }

    /// The beginning of a frame that will not be completed.
    pub(super) fn rest(&mut self) -> Option<Vec<u8>> {
        (!self.held.is_empty()).then(|| std::mem::take(&mut self.held))
    }
}
