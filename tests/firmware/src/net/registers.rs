//! The registers of the LAN9118, by name; the only volatile accesses of the driver.

use core::ptr::{
    read_volatile, with_exposed_provenance, with_exposed_provenance_mut, write_volatile,
};

/// The processor's identity; the same place in every Cortex-M.
const CPUID: usize = 0xe000_ed00;

/// One register: its offset from the base, in bytes. Names are those of the data sheet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Register(usize);

impl Register {
    /// Received frames, word by word.
    pub(super) const RX_DATA_FIFO: Self = Self(0x00);
    /// Frames to send: two command words, then the frame, word by word.
    pub(super) const TX_DATA_FIFO: Self = Self(0x20);
    /// One word per received frame: its length and its errors. Reading takes it.
    pub(super) const RX_STATUS_FIFO: Self = Self(0x40);
    /// One word per sent frame. Reading takes it.
    pub(super) const TX_STATUS_FIFO: Self = Self(0x48);
    /// Chip and revision.
    pub(super) const ID_REV: Self = Self(0x50);
    /// Interrupt enables.
    pub(super) const INT_EN: Self = Self(0x5c);
    /// Always [`super::lan9118::BYTE_ORDER`] once the chip is awake.
    pub(super) const BYTE_TEST: Self = Self(0x64);
    /// Transmitter control.
    pub(super) const TX_CFG: Self = Self(0x70);
    /// Reset and the sizes of the FIFOs.
    pub(super) const HW_CFG: Self = Self(0x74);
    /// Frames waiting in the receive FIFOs.
    pub(super) const RX_FIFO_INF: Self = Self(0x7c);
    /// Room in the transmit FIFO, and waiting statuses.
    pub(super) const TX_FIFO_INF: Self = Self(0x80);
    /// Access to the registers of the MAC: which, and which way.
    pub(super) const MAC_CSR_CMD: Self = Self(0xa4);
    /// Access to the registers of the MAC: the value.
    pub(super) const MAC_CSR_DATA: Self = Self(0xa8);
}

/// The block of registers. There is one controller, and [`super::lan9118::Lan9118`] is its one
/// user.
#[derive(Debug)]
pub(super) struct Registers {
    base: usize,
}

impl Registers {
    /// The controller's registers: the MPS2 board with a Cortex-M7 (AN500) has them elsewhere than
    /// the one with a Cortex-M4F (AN386).
    pub(super) fn of_board() -> Self {
        // The part number.
        let is_m7 = read(CPUID) >> 4 & 0xfff == 0xc27;
        let base = if is_m7 { 0xa000_0000 } else { 0x4020_0000 };
        Self { base }
    }

    /// Reads a register.
    pub(super) fn read(&self, register: Register) -> u32 {
        read(self.base.wrapping_add(register.0))
    }

    /// Writes a register.
    pub(super) fn write(&mut self, register: Register, value: u32) {
        write(self.base.wrapping_add(register.0), value);
    }
}

/// Reads the word at an address of this module: [`CPUID`], or a [`Register`] from a base.
#[expect(unsafe_code, reason = "registers are read by address")]
fn read(address: usize) -> u32 {
    // SAFETY: those words are devices, which the board has for ever: aligned, every bit pattern is
    // a `u32`, no Rust object lies there.
    unsafe { read_volatile(with_exposed_provenance(address)) }
}

/// Writes the word at an address of this module.
#[expect(unsafe_code, reason = "registers are written by address")]
fn write(address: usize, value: u32) {
    // SAFETY: as for `read`; and the controller masters no bus, so no value written to it can
    // change memory.
    unsafe { write_volatile(with_exposed_provenance_mut(address), value) }
}
