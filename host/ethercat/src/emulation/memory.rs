//! Address space of a SubDevice's controller: registers, then RAM.

/// Length of the address space, bytes.
const LENGTH: usize = 0x3000;
/// First address of the RAM.
pub(super) const RAM: u16 = 0x1000;

/// Registers that this emulation names; ETG1000.4.
pub(super) mod register {
    pub(in super::super) const STATION_ADDRESS: u16 = 0x0010;
    pub(in super::super) const STATION_ALIAS: u16 = 0x0012;
    pub(in super::super) const DL_CONTROL_ALIAS: u16 = 0x0103;
    pub(in super::super) const DL_STATUS: u16 = 0x0110;
    pub(in super::super) const AL_CONTROL: u16 = 0x0120;
    pub(in super::super) const AL_STATUS: u16 = 0x0130;
    pub(in super::super) const AL_STATUS_CODE: u16 = 0x0134;
    pub(in super::super) const WATCHDOG_DIVIDER: u16 = 0x0400;
    pub(in super::super) const WATCHDOG_PROCESS_DATA: u16 = 0x0420;
    pub(in super::super) const WATCHDOG_STATUS: u16 = 0x0440;
    pub(in super::super) const WATCHDOG_COUNTER: u16 = 0x0442;
    pub(in super::super) const SII_OWNER: u16 = 0x0500;
    pub(in super::super) const SII_CONTROL: u16 = 0x0502;
    pub(in super::super) const SII_ADDRESS: u16 = 0x0504;
    pub(in super::super) const SII_DATA: u16 = 0x0508;
    pub(in super::super) const FMMU: u16 = 0x0600;
    pub(in super::super) const SYNC_MANAGER: u16 = 0x0800;
}

/// Ranges that a MainDevice cannot write.
const READ_ONLY: [std::ops::Range<u16>; 6] = [
    0x0000..0x0010,
    0x0012..0x0014,
    0x0110..0x0112,
    0x0130..0x0140,
    0x0440..0x0444,
    0x0F00..0x1000,
];

/// Bytes of a SubDevice, little-endian.
#[derive(Clone, Debug)]
pub(super) struct Memory(Box<[u8]>);

impl Memory {
    pub(super) fn new() -> Self {
        Self(vec![0; LENGTH].into())
    }

    /// Returns `length` bytes, `None` beyond the end.
    pub(super) fn bytes(&self, address: u16, length: usize) -> Option<&[u8]> {
        let start = usize::from(address);
        self.0.get(start..start.checked_add(length)?)
    }

    /// Writes bytes, whoever may; false beyond the end.
    pub(super) fn set(&mut self, address: u16, bytes: &[u8]) -> bool {
        let start = usize::from(address);
        match self.0.get_mut(start..start + bytes.len()) {
            Some(place) => {
                place.copy_from_slice(bytes);
                true
            }
            None => false,
        }
    }

    /// Writes bytes as a MainDevice: read-only registers keep theirs. False if no byte was written.
    pub(super) fn write(&mut self, address: u16, bytes: &[u8]) -> bool {
        let mut written = false;
        for (offset, byte) in (0_u16..).zip(bytes) {
            let at = address.saturating_add(offset);
            if !READ_ONLY.iter().any(|range| range.contains(&at)) {
                written |= self.set(at, &[*byte]);
            }
        }
        written
    }

    pub(super) fn u8(&self, address: u16) -> u8 {
        self.bytes(address, 1)
            .and_then(|bytes| bytes.first().copied())
            .unwrap_or(0)
    }

    pub(super) fn u16(&self, address: u16) -> u16 {
        u16::from_le_bytes([self.u8(address), self.u8(address.saturating_add(1))])
    }

    pub(super) fn u32(&self, address: u16) -> u32 {
        u32::from(self.u16(address)) | u32::from(self.u16(address.saturating_add(2))) << 16
    }

    pub(super) fn u64(&self, address: u16) -> u64 {
        u64::from(self.u32(address)) | u64::from(self.u32(address.saturating_add(4))) << 32
    }

    pub(super) fn set_u16(&mut self, address: u16, value: u16) {
        self.set(address, &value.to_le_bytes());
    }
}

/// Status bytes of the sync managers, which no MainDevice writes.
pub(super) type Statuses = [u8; 4];

impl Memory {
    const STATUS_AT: [u16; 4] = [0x0805, 0x080D, 0x0815, 0x081D];

    pub(super) fn clone_statuses(&self) -> Statuses {
        Self::STATUS_AT.map(|at| self.u8(at))
    }

    pub(super) fn restore_statuses(&mut self, statuses: Statuses) {
        for (at, status) in Self::STATUS_AT.into_iter().zip(statuses) {
            self.set(at, &[status]);
        }
    }
}
