//! SMSC LAN9118, polled, as a smoltcp device: one frame in and one frame out at a time, in buffers
//! of its own.

use smoltcp::phy::{self, Device, DeviceCapabilities, Medium};
use smoltcp::time::Instant;

use super::registers::{Register, Registers};

/// Content of `BYTE_TEST`.
pub(super) const BYTE_ORDER: u32 = 0x8765_4321;
/// Upper half of `ID_REV`.
const CHIP: u32 = 0x0118;
/// Looks at a bit that the chip clears by itself within microseconds.
const PATIENCE: u32 = 100_000;

/// Longest Ethernet frame without its checksum, which the chip makes and checks.
const MAX_FRAME: usize = 1_514;
/// The same in words of the FIFOs, checksum included.
const BUFFER: usize = 1_520;
/// Bytes in the transmit FIFO beside the frame and its last word's padding: two command words.
const TX_OVERHEAD: usize = 8 + 3;

/// `HW_CFG`: software reset; clears itself.
const SOFT_RESET: u32 = 1;
/// `HW_CFG`: a bit that must be one, and 5 KiB of the chip's memory for sending.
const MUST_BE_ONE_AND_TX_5K: u32 = 1 << 20 | 5 << 16;
/// `TX_CFG`: the transmitter is on, and goes on when its statuses are not read.
const TX_ON_AND_ALLOW_STATUS_OVERRUN: u32 = 1 << 1 | 1 << 2;
/// `MAC_CSR_CMD`: an access is on its way; clears itself.
const CSR_BUSY: u32 = 1 << 31;
/// `TX_DATA_FIFO`, command word A: this buffer is the first and the last of its frame.
const WHOLE_FRAME: u32 = 1 << 13 | 1 << 12;
/// `RX_STATUS_FIFO`: the frame has an error of any kind.
const RX_ERROR: u32 = 1 << 15;
/// Bytes of the checksum behind each received frame.
const FCS: usize = 4;

/// Registers of the MAC behind `MAC_CSR_CMD`.
mod mac {
    /// Control.
    pub(super) const CR: u32 = 1;
    /// Upper two bytes of the address.
    pub(super) const ADDRH: u32 = 2;
    /// Lower four bytes of the address.
    pub(super) const ADDRL: u32 = 3;
    /// `CR`: full duplex, transmitter and receiver on.
    pub(super) const RUN: u32 = 1 << 20 | 1 << 3 | 1 << 2;
}

/// Error of the start: the controller cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, defmt::Format)]
pub(crate) enum LanError {
    /// `BYTE_TEST` is not what it must be: the device is absent, or the bytes are swapped.
    Absent {
        /// Value read.
        byte_test: u32,
    },
    /// Another chip.
    Chip {
        /// Value of `ID_REV`.
        id_rev: u32,
    },
    /// The reset does not end.
    Reset,
    /// An access to a register of the MAC does not end.
    Mac {
        /// The register.
        register: u32,
    },
}

/// The controller.
#[derive(Debug)]
pub(crate) struct Lan9118 {
    registers: Registers,
    received: [u8; BUFFER],
    to_send: [u8; BUFFER],
}

impl Lan9118 {
    /// Wakes the controller, gives it an address, and lets it send and receive.
    ///
    /// # Errors
    /// [`LanError`].
    pub(crate) fn new(address: [u8; 6]) -> Result<Self, LanError> {
        let mut lan = Self {
            registers: Registers::of_board(),
            received: [0; BUFFER],
            to_send: [0; BUFFER],
        };
        lan.find()?;
        lan.reset()?;
        let [a, b, c, d, e, f] = address;
        lan.write_mac(mac::ADDRL, u32::from_le_bytes([a, b, c, d]))?;
        lan.write_mac(mac::ADDRH, u32::from_le_bytes([e, f, 0, 0]))?;
        lan.registers.write(Register::INT_EN, 0);
        lan.registers
            .write(Register::TX_CFG, TX_ON_AND_ALLOW_STATUS_OVERRUN);
        lan.write_mac(mac::CR, mac::RUN)?;
        Ok(lan)
    }

    fn find(&self) -> Result<(), LanError> {
        // The first reads may find the chip asleep.
        if !(0..PATIENCE).any(|_| self.registers.read(Register::BYTE_TEST) == BYTE_ORDER) {
            let byte_test = self.registers.read(Register::BYTE_TEST);
            return Err(LanError::Absent { byte_test });
        }
        let id_rev = self.registers.read(Register::ID_REV);
        if id_rev >> 16 != CHIP {
            return Err(LanError::Chip { id_rev });
        }
        Ok(())
    }

    fn reset(&mut self) -> Result<(), LanError> {
        self.registers.write(Register::HW_CFG, SOFT_RESET);
        self.await_clear(Register::HW_CFG, SOFT_RESET)
            .ok_or(LanError::Reset)?;
        self.registers
            .write(Register::HW_CFG, MUST_BE_ONE_AND_TX_5K);
        Ok(())
    }

    fn write_mac(&mut self, register: u32, value: u32) -> Result<(), LanError> {
        let stuck = LanError::Mac { register };
        self.await_clear(Register::MAC_CSR_CMD, CSR_BUSY)
            .ok_or(stuck)?;
        self.registers.write(Register::MAC_CSR_DATA, value);
        self.registers
            .write(Register::MAC_CSR_CMD, CSR_BUSY | register);
        self.await_clear(Register::MAC_CSR_CMD, CSR_BUSY)
            .ok_or(stuck)
    }

    /// Waits for a bit that clears itself.
    fn await_clear(&self, register: Register, bit: u32) -> Option<()> {
        (0..PATIENCE)
            .any(|_| self.registers.read(register) & bit == 0)
            .then_some(())
    }

    /// Receives the next frame from the FIFOs into the buffer; its length without checksum. A frame
    /// with errors is dropped.
    fn receive_frame(&mut self) -> Option<usize> {
        loop {
            let waiting = self.registers.read(Register::RX_FIFO_INF) >> 16 & 0xff;
            if waiting == 0 {
                return None;
            }
            let status = self.registers.read(Register::RX_STATUS_FIFO);
            let length = usize::try_from(status >> 16 & 0x3fff).unwrap_or(0);
            let mut words = self.received.chunks_exact_mut(4);
            for _ in 0..length.div_ceil(4) {
                let word = self.registers.read(Register::RX_DATA_FIFO);
                // What is longer than any frame may be is taken all the same.
                if let Some(place) = words.next() {
                    place.copy_from_slice(&word.to_le_bytes());
                }
            }
            let whole = length.checked_sub(FCS).filter(|frame| *frame <= MAX_FRAME);
            if status & RX_ERROR == 0 && whole.is_some() {
                return whole;
            }
        }
    }

    /// True if the longest frame has room.
    fn has_room(&self) -> bool {
        let free = self.registers.read(Register::TX_FIFO_INF) & 0xffff;
        usize::try_from(free).is_ok_and(|free| free >= MAX_FRAME.saturating_add(TX_OVERHEAD))
    }
}

/// Hands the beginning of `buffer` to the transmitter as one frame.
fn send(registers: &mut Registers, buffer: &[u8; BUFFER], length: usize) {
    let length = length.min(MAX_FRAME);
    let stated = u32::try_from(length).unwrap_or(0);
    registers.write(Register::TX_DATA_FIFO, WHOLE_FRAME | stated);
    registers.write(Register::TX_DATA_FIFO, stated);
    for word in buffer.chunks_exact(4).take(length.div_ceil(4)) {
        let word = <[u8; 4]>::try_from(word).unwrap_or_default();
        registers.write(Register::TX_DATA_FIFO, u32::from_le_bytes(word));
    }
    // What became of it is not asked for: TCP sends again what got lost.
    while registers.read(Register::TX_FIFO_INF) >> 16 & 0xff != 0 {
        let _ = registers.read(Register::TX_STATUS_FIFO);
    }
}

/// A received frame.
pub(crate) struct RxToken<'a>(&'a [u8]);

impl phy::RxToken for RxToken<'_> {
    fn consume<R, F: FnOnce(&[u8]) -> R>(self, read: F) -> R {
        read(self.0)
    }
}

/// Room for a frame to send.
pub(crate) struct TxToken<'a> {
    registers: &'a mut Registers,
    buffer: &'a mut [u8; BUFFER],
}

impl phy::TxToken for TxToken<'_> {
    fn consume<R, F: FnOnce(&mut [u8]) -> R>(self, length: usize, write: F) -> R {
        // smoltcp asks for no more than `MAX_FRAME`, which it was given.
        let place = self.buffer.get_mut(..length).unwrap_or_default();
        let result = write(place);
        send(self.registers, self.buffer, length);
        result
    }
}

impl Device for Lan9118 {
    type RxToken<'a> = RxToken<'a>;
    type TxToken<'a> = TxToken<'a>;

    fn receive(&mut self, _now: Instant) -> Option<(RxToken<'_>, TxToken<'_>)> {
        if !self.has_room() {
            return None;
        }
        let length = self.receive_frame()?;
        let sending = TxToken {
            registers: &mut self.registers,
            buffer: &mut self.to_send,
        };
        Some((RxToken(self.received.get(..length)?), sending))
    }

    fn transmit(&mut self, _now: Instant) -> Option<TxToken<'_>> {
        self.has_room().then_some(TxToken {
            registers: &mut self.registers,
            buffer: &mut self.to_send,
        })
    }

    fn capabilities(&self) -> DeviceCapabilities {
        let mut capabilities = DeviceCapabilities::default();
        capabilities.medium = Medium::Ethernet;
        capabilities.max_transmission_unit = MAX_FRAME;
        capabilities
    }
}
