//! Sync managers and FMMUs, as their registers describe them.

use super::memory::{Memory, register};

/// Number of sync managers.
pub(super) const SYNC_MANAGERS: u8 = 4;
/// Number of FMMUs.
pub(super) const FMMUS: u8 = 4;
/// Bit of the status byte: the mailbox has a message.
const FULL: u8 = 0x08;

/// A sync manager's registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SyncManager {
    pub(super) index: u8,
    pub(super) start: u16,
    pub(super) length: u16,
    pub(super) control: u8,
    pub(super) enabled: bool,
}

impl SyncManager {
    pub(super) fn read(memory: &Memory, index: u8) -> Self {
        let at = register::SYNC_MANAGER + u16::from(index) * 8;
        Self {
            index,
            start: memory.u16(at),
            length: memory.u16(at + 2),
            control: memory.u8(at + 4),
            enabled: memory.u8(at + 6) & 1 != 0,
        }
    }

    /// Returns the enabled sync manager that owns any byte of a range.
    pub(super) fn owner_of(memory: &Memory, address: u16, length: usize) -> Option<Self> {
        let first = u32::from(address);
        let end = first + u32::try_from(length).unwrap_or(u32::MAX / 2);
        (0..SYNC_MANAGERS)
            .map(|index| Self::read(memory, index))
            .find(|sm| {
                let start = u32::from(sm.start);
                sm.enabled && sm.length > 0 && first < start + u32::from(sm.length) && end > start
            })
    }

    /// True if the MainDevice writes it.
    pub(super) const fn is_written(&self) -> bool {
        self.control & 0x0C == 0x04
    }

    /// True in mailbox mode.
    pub(super) const fn is_mailbox(&self) -> bool {
        self.control & 0x03 == 0x02
    }

    /// True if it triggers the watchdog.
    pub(super) const fn has_watchdog(&self) -> bool {
        self.control & 0x40 != 0
    }

    const fn status(self) -> u16 {
        register::SYNC_MANAGER + self.index as u16 * 8 + 5
    }

    pub(super) fn is_full(self, memory: &Memory) -> bool {
        memory.u8(self.status()) & FULL != 0
    }

    pub(super) fn set_full(self, memory: &mut Memory, full: bool) {
        let status = memory.u8(self.status());
        memory.set(
            self.status(),
            &[if full { status | FULL } else { status & !FULL }],
        );
    }
}

/// An FMMU's registers. Bits are not mapped here: all of them are whole bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Fmmu {
    pub(super) logical: u32,
    pub(super) length: u16,
    pub(super) physical: u16,
    pub(super) reads: bool,
    pub(super) writes: bool,
}

impl Fmmu {
    /// Returns an FMMU that is active and maps whole bytes.
    pub(super) fn read(memory: &Memory, index: u8) -> Option<Self> {
        let at = register::FMMU + u16::from(index) * 16;
        let bits = [memory.u8(at + 6), memory.u8(at + 7), memory.u8(at + 10)];
        let kind = memory.u8(at + 11);
        (memory.u8(at + 12) & 1 != 0 && bits == [0, 7, 0]).then(|| Self {
            logical: memory.u32(at),
            length: memory.u16(at + 4),
            physical: memory.u16(at + 8),
            reads: kind & 1 != 0,
            writes: kind & 2 != 0,
        })
    }

    /// Returns the part of a logical datagram that this FMMU maps: its range in the datagram, and
    /// its physical address.
    pub(super) fn within(
        &self,
        logical: u32,
        length: usize,
    ) -> Option<(std::ops::Range<usize>, u16)> {
        let datagram_end = u64::from(logical) + u64::try_from(length).ok()?;
        let first = u64::from(self.logical.max(logical));
        let end = datagram_end.min(u64::from(self.logical) + u64::from(self.length));
        (first < end).then_some(())?;
        let start = usize::try_from(first - u64::from(logical)).ok()?;
        let stop = usize::try_from(end - u64::from(logical)).ok()?;
        let offset = u16::try_from(first - u64::from(self.logical)).ok()?;
        Some((start..stop, self.physical.checked_add(offset)?))
    }
}
