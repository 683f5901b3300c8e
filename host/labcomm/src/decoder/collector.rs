//! Bytes of a stream that are not decoded yet, in a buffer of fixed size.

use core::cell::Cell;

/// Up to `C` bytes: chunks behind, events in front.
#[derive(Clone, Debug)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct Collector<const C: usize> {
    bytes: [u8; C],
    /// Number of bytes in use.
    held: usize,
}

impl<const C: usize> Default for Collector<C> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const C: usize> Collector<C> {
    /// An empty collector.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            bytes: [0; C],
            held: 0,
        }
    }

    /// Builds a collector with the first `held` of these bytes, if they satisfy the invariant.
    #[must_use]
    pub fn from_parts(bytes: [u8; C], held: usize) -> Option<Self> {
        let collector = Self { bytes, held };
        collector.is_valid().then_some(collector)
    }

    /// The invariant: no more bytes than there is room for.
    #[must_use]
    pub const fn is_valid(&self) -> bool {
        self.held <= C
    }

    /// Returns the bytes in use.
    #[must_use]
    pub fn held(&self) -> &[u8] {
        self.bytes.get(..self.held).unwrap_or(&self.bytes)
    }

    /// Appends the front of a chunk, as much as there is room for; returns the number of bytes
    /// taken.
    pub fn append(&mut self, chunk: &[u8]) -> usize {
        let room = self.bytes.get_mut(self.held..).unwrap_or_default();
        for (place, byte) in room.iter_mut().zip(chunk) {
            *place = *byte;
        }
        let taken = room.len().min(chunk.len());
        self.held = self.held.saturating_add(taken);
        taken
    }

    /// Drops bytes from the front, at most those that are held.
    pub fn drop_front(&mut self, count: usize) {
        let count = count.min(self.held);
        let held = self.held;
        let cells = Cell::from_mut(self.bytes.as_mut_slice()).as_slice_of_cells();
        for (place, byte) in cells.iter().take(held).zip(cells.iter().skip(count)) {
            place.set(byte.get());
        }
        self.held = held.saturating_sub(count);
    }
}
