//! Registers, RAM and EEPROM of a controller as a MainDevice reads and writes them.

use super::states::al;
use super::{EEPROM_US, MAILBOX_US, SubDevice};
use crate::emulation::device::{Device, MAX_PROCESS_DATA};
use crate::emulation::distributed_clock::REGISTERS;
use crate::emulation::memory::{RAM, register};
use crate::emulation::sii;
use crate::emulation::sync_manager::{FMMUS, Fmmu, SyncManager};

impl<D: Device> SubDevice<D> {
    /// True if a datagram with a configured address is for this SubDevice.
    pub(in crate::emulation) fn answers_to(&self, address: u16) -> bool {
        let uses_alias = self.memory.u8(register::DL_CONTROL_ALIAS) & 1 != 0;
        address == self.memory.u16(register::STATION_ADDRESS)
            || uses_alias && address == self.memory.u16(register::STATION_ALIAS)
    }

    /// Reads as a MainDevice. False if the access is refused.
    pub(in crate::emulation) fn read(&mut self, address: u16, data: &mut [u8]) -> bool {
        if (sii::INPUTS..sii::INPUTS + 0x100).contains(&address) {
            self.publish_inputs();
        }
        if REGISTERS.contains(&address) {
            let Some(clock) = &self.clock else {
                return false;
            };
            clock.refresh(&mut self.memory, self.passing_ns.0);
        }
        let owner = if address < RAM {
            None
        } else {
            SyncManager::owner_of(&self.memory, address, data.len())
        };
        if let Some(sm) = owner {
            let is_whole = address == sm.start && data.len() == usize::from(sm.length);
            if sm.is_written() || !is_whole || sm.is_mailbox() && !sm.is_full(&self.memory) {
                return false;
            }
        }
        let Some(bytes) = self.memory.bytes(address, data.len()) else {
            return false;
        };
        data.copy_from_slice(bytes);
        if let Some(sm) = owner.filter(SyncManager::is_mailbox) {
            sm.set_full(&mut self.memory, false);
        }
        true
    }

    fn publish_inputs(&mut self) {
        let mut packed = [0; MAX_PROCESS_DATA];
        let length = self.device.inputs(&mut packed);
        self.memory
            .set(sii::INPUTS, packed.get(..length).unwrap_or(&[]));
    }

    /// Writes as a MainDevice. False if the access is refused.
    pub(in crate::emulation) fn write(&mut self, address: u16, data: &[u8]) -> bool {
        if address < RAM {
            return self.write_registers(address, data);
        }
        let Some(sm) = SyncManager::owner_of(&self.memory, address, data.len()) else {
            return self.memory.set(address, data);
        };
        let is_whole = address == sm.start && data.len() == usize::from(sm.length);
        if !sm.is_written() || !is_whole || sm.is_mailbox() && sm.is_full(&self.memory) {
            return false;
        }
        self.memory.set(address, data);
        if sm.is_mailbox() {
            sm.set_full(&mut self.memory, true);
            // In INIT it is not read.
            self.mailbox_due_us = (self.state != al::INIT).then_some(self.now_us + MAILBOX_US);
        } else if self.state >= al::SAFE_OP {
            self.outputs_us = Some(self.now_us);
            self.memory.set_u16(register::WATCHDOG_STATUS, 1);
            self.note_outputs(data);
        }
        true
    }

    fn write_registers(&mut self, address: u16, data: &[u8]) -> bool {
        if REGISTERS.contains(&address) {
            let passing_ns = self.passing_ns;
            let Some(clock) = &mut self.clock else {
                return false;
            };
            return clock.write(&mut self.memory, address, data, passing_ns);
        }
        let watchdog = register::WATCHDOG_DIVIDER..register::WATCHDOG_STATUS;
        let is_watchdog = watchdog.contains(&address);
        let status = self.memory.clone_statuses();
        if is_watchdog && !self.device.watchdog_is_writable() {
            // The value stays, as in controllers whose application owns it.
            return true;
        }
        if !self.memory.write(address, data) {
            return false;
        }
        self.memory.restore_statuses(status);
        let written = u32::from(address)..u32::from(address) + data.len() as u32;
        if written.contains(&register::AL_CONTROL.into()) {
            self.request_state(self.memory.u8(register::AL_CONTROL));
        }
        if written.contains(&register::SII_CONTROL.into()) {
            self.command_eeprom();
        }
        true
    }

    fn command_eeprom(&mut self) {
        let control = self.memory.u16(register::SII_CONTROL);
        let belongs_to_application = self.memory.u8(register::SII_OWNER) & 1 != 0;
        match control & 0x0700 {
            // Clears errors.
            0 => self.memory.set_u16(register::SII_CONTROL, 0),
            0x0100 if !belongs_to_application => {
                let address = self.memory.u32(register::SII_ADDRESS);
                self.eeprom_read = Some((address, self.now_us + EEPROM_US));
                self.memory.set_u16(register::SII_CONTROL, 0x8000);
            }
            // Writing and reloading are not offered: command error.
            _ => self.memory.set_u16(register::SII_CONTROL, 0x2000),
        }
    }

    /// Reads and writes by logical address. Returns what its working counter grows by: 1 for a
    /// read, `write_counts` for a write.
    pub(in crate::emulation) fn logical(
        &mut self,
        address: u32,
        data: &mut [u8],
        reads: bool,
        write_counts: u16,
    ) -> u16 {
        let (mut was_read, mut was_written) = (false, false);
        for index in 0..FMMUS {
            let Some(fmmu) = Fmmu::read(&self.memory, index) else {
                continue;
            };
            let Some((range, physical)) = fmmu.within(address, data.len()) else {
                continue;
            };
            let Some(part) = data.get_mut(range) else {
                continue;
            };
            was_written |= fmmu.writes && write_counts > 0 && self.write(physical, part);
            was_read |= fmmu.reads && reads && self.read(physical, part);
        }
        u16::from(was_read) + if was_written { write_counts } else { 0 }
    }
}
