//! Devices beside the drives: couplers, encoder terminals, force sensors.

mod encoder;
mod force;
mod pdo_choice;
mod plain;
mod terminal_objects;

use super::device::{Device, MAX_PROCESS_DATA};
use super::sii::Sii;
pub use encoder::{EncoderModel, EncoderTerminal};
pub use force::{ForceTerminal, ForceUnits};
pub use plain::Plain;

/// A device that moves nothing.
#[derive(Clone, Debug)]
pub enum Instrument {
    /// A coupler, or a device of which nothing but its EEPROM is emulated.
    Plain(Plain),
    /// A terminal that counts the edges of a length gauge.
    Encoder(EncoderTerminal),
    /// A force sensor.
    Force(ForceTerminal),
}

impl Instrument {
    fn inner(&self) -> &dyn Device {
        match self {
            Self::Plain(device) => device,
            Self::Encoder(device) => device,
            Self::Force(device) => device,
        }
    }

    fn inner_mut(&mut self) -> &mut dyn Device {
        match self {
            Self::Plain(device) => device,
            Self::Encoder(device) => device,
            Self::Force(device) => device,
        }
    }
}

impl Device for Instrument {
    fn sii(&self) -> Sii {
        self.inner().sii()
    }

    fn lengths(&self) -> [usize; 2] {
        self.inner().lengths()
    }

    fn answer(
        &mut self,
        request: &[u8],
        last_counter: &mut u8,
        is_pre_op: bool,
    ) -> Option<Vec<u8>> {
        self.inner_mut().answer(request, last_counter, is_pre_op)
    }

    fn set_operational(&mut self, is_operational: bool) {
        self.inner_mut().set_operational(is_operational);
    }

    fn take_outputs(&mut self, data: &[u8]) {
        self.inner_mut().take_outputs(data);
    }

    fn inputs(&mut self, data: &mut [u8; MAX_PROCESS_DATA]) -> usize {
        self.inner_mut().inputs(data)
    }

    fn power_cycle(&mut self) {
        self.inner_mut().power_cycle();
    }
}
