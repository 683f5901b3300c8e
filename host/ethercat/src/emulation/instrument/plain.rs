//! A device of which nothing but the EEPROM is emulated.

use crate::emulation::device::{Device, MAX_PROCESS_DATA};
use crate::emulation::sii::{Identity, SOE, Sii};

/// A device without process data, and without an answer in its mailbox.
#[derive(Clone, Copy, Debug)]
pub struct Plain(Sii);

impl Plain {
    /// Returns a coupler EK1100.
    #[must_use]
    pub const fn coupler() -> Self {
        Self(Sii {
            identity: Identity {
                vendor: 0x0000_0002,
                product: 0x044C_2C52,
                revision: 0x0011_0000,
                serial: 0,
            },
            alias: 0,
            name: "EK1100",
            protocols: 0,
            has_process_data: false,
            has_watchdog: false,
        })
    }

    /// Returns a drive that speaks SoE: the identity of an AX5203.
    #[must_use]
    pub const fn soe_drive() -> Self {
        Self(Sii {
            identity: Identity {
                vendor: 0x0000_0002,
                product: 0x1453_6012,
                revision: 0x00D5_0000,
                serial: 0,
            },
            alias: 0,
            name: "AX5203",
            protocols: SOE,
            has_process_data: false,
            has_watchdog: false,
        })
    }
}

impl Device for Plain {
    fn sii(&self) -> Sii {
        self.0
    }

    fn lengths(&self) -> [usize; 2] {
        [0, 0]
    }

    fn answer(&mut self, _: &[u8], _: &mut u8, _: bool) -> Option<Vec<u8>> {
        None
    }

    fn set_operational(&mut self, _: bool) {}

    fn take_outputs(&mut self, _: &[u8]) {}

    fn inputs(&mut self, _: &mut [u8; MAX_PROCESS_DATA]) -> usize {
        0
    }

    fn power_cycle(&mut self) {}
}
