//! One SubDevice: its controller's registers, its state machine, its mailbox, and the drive behind
//! them.

use super::drive::{Drive, DriveSetup};
use super::mailbox;
use super::mapping;
use super::memory::{Memory, RAM, register};
use super::sii;
use super::sync_manager::{FMMUS, Fmmu, SYNC_MANAGERS, SyncManager};

/// Time from a request of a state to its grant or refusal, µs.
const TRANSITION_US: u64 = 300;
/// Time of a read of the EEPROM, µs.
const EEPROM_US: u64 = 40;
/// Time from a request in the mailbox to its answer, µs.
const MAILBOX_US: u64 = 120;

/// States of the application layer.
mod al {
    pub(super) const INIT: u8 = 1;
    pub(super) const PRE_OP: u8 = 2;
    pub(super) const BOOT: u8 = 3;
    pub(super) const SAFE_OP: u8 = 4;
    pub(super) const OP: u8 = 8;
    pub(super) const ERROR: u8 = 0x10;
}

/// AL status codes; ETG1000.6 table 11.
mod code {
    pub(super) const INVALID_CHANGE: u16 = 0x0011;
    pub(super) const UNKNOWN_STATE: u16 = 0x0012;
    pub(super) const NO_BOOT: u16 = 0x0013;
    pub(super) const MAILBOX: u16 = 0x0016;
    pub(super) const NO_OUTPUTS: u16 = 0x0019;
    pub(super) const WATCHDOG: u16 = 0x001B;
    pub(super) const OUTPUTS: u16 = 0x001D;
    pub(super) const INPUTS: u16 = 0x001E;
}

/// A SubDevice with a drive.
#[derive(Clone, Debug)]
pub struct SubDevice {
    memory: Memory,
    eeprom: Vec<u8>,
    drive: Drive,
    setup: DriveSetup,
    /// State that its application refuses, and the code.
    refuses: Option<(u8, u16)>,
    now_us: u64,
    state: u8,
    error: bool,
    /// Requested state, and when it is decided.
    request: Option<(u8, u64)>,
    /// Address in the EEPROM, and when its words are there.
    eeprom_read: Option<(u32, u64)>,
    /// Time at which the request in the mailbox is answered.
    mailbox_due_us: Option<u64>,
    mailbox_counter: u8,
    /// Time of the last outputs.
    outputs_us: Option<u64>,
}

impl SubDevice {
    pub(super) fn new(setup: &DriveSetup) -> Self {
        let drive = Drive::new(setup);
        let eeprom = sii::eeprom(
            &setup.identity,
            setup.alias,
            drive.name(),
            setup.has_watchdog,
        );
        let mut this = Self {
            memory: Memory::new(),
            eeprom,
            drive,
            setup: setup.clone(),
            refuses: None,
            now_us: 0,
            state: al::INIT,
            error: false,
            request: None,
            eeprom_read: None,
            mailbox_due_us: None,
            mailbox_counter: 0,
            outputs_us: None,
        };
        // Type, revision, build; FMMUs, sync managers, 8 KiB of RAM, two ports of MII; no
        // distributed clocks.
        this.memory.set(
            0x0000,
            &[0x11, 0, 1, 0, FMMUS, SYNC_MANAGERS, 8, 0x0F, 0, 0],
        );
        this.memory.set_u16(register::STATION_ALIAS, setup.alias);
        // 100 µs by 2500 times 40 ns, and EtherCAT's 100 ms.
        this.memory.set_u16(register::WATCHDOG_DIVIDER, 2_498);
        this.memory.set_u16(register::WATCHDOG_PROCESS_DATA, 1_000);
        this.memory.set_u16(register::WATCHDOG_STATUS, 1);
        this.publish_state(0);
        this
    }

    /// Returns the drive.
    #[must_use]
    pub const fn drive(&self) -> &Drive {
        &self.drive
    }

    /// Returns the drive, to be handled at its panel or by the process.
    pub const fn drive_mut(&mut self) -> &mut Drive {
        &mut self.drive
    }

    /// True in OP, without an error.
    #[must_use]
    pub const fn is_operational(&self) -> bool {
        self.state == al::OP && !self.error
    }

    /// Leaves its state by itself, with a code of its application: the next best state that needs
    /// no outputs.
    pub fn fail(&mut self, code: u16) {
        if self.state == al::OP {
            self.leave_op(al::SAFE_OP, code);
        }
    }

    /// Refuses a state with a code of its application from now on.
    pub const fn refuse(&mut self, state: u8, code: u16) {
        self.refuses = Some((state, code));
    }

    /// Says whether writes to the watchdog's time are taken, and whether the outputs trigger it.
    pub fn set_watchdog(&mut self, is_writable: bool, has_watchdog: bool) {
        (self.setup.watchdog_is_writable, self.setup.has_watchdog) = (is_writable, has_watchdog);
        self.eeprom = sii::eeprom(
            &self.setup.identity,
            self.setup.alias,
            self.drive.name(),
            has_watchdog,
        );
    }

    /// Takes the power away and gives it again: the motor stays where it is, and everything that
    /// was configured is lost.
    pub fn power_cycle(&mut self) {
        let position = self
            .drive
            .motor()
            .position
            .clamp(i32::MIN.into(), i32::MAX.into()) as i32;
        let has_next = self.memory.u16(register::DL_STATUS) & 0x0020 != 0;
        let mut again = Self::new(&DriveSetup {
            position,
            ..self.setup.clone()
        });
        again.now_us = self.now_us;
        again.set_ports(has_next);
        *self = again;
    }

    /// Tells which of the ports have a neighbour.
    pub(super) fn set_ports(&mut self, has_next: bool) {
        // Links of ports 0 and 1; port 0 open with a signal; port 1 the same, or closed; ports 2
        // and 3 closed.
        let status: u16 = if has_next {
            0x0030 | 0x5A00
        } else {
            0x0010 | 0x5600
        };
        self.memory.set_u16(register::DL_STATUS, status | 1);
    }

    /// Runs what is due by `now_us`: transitions, EEPROM, mailbox, watchdog.
    pub(super) fn advance_to(&mut self, now_us: u64) {
        self.now_us = self.now_us.max(now_us);
        if let Some((state, _)) = self.request.take_if(|(_, due)| *due <= now_us) {
            self.decide(state);
        }
        if let Some((address, _)) = self.eeprom_read.take_if(|(_, due)| *due <= now_us) {
            let start = usize::try_from(address)
                .unwrap_or(usize::MAX)
                .saturating_mul(2);
            let data = [0, 1, 2, 3].map(|at| {
                self.eeprom
                    .get(start.saturating_add(at))
                    .copied()
                    .unwrap_or(0xFF)
            });
            self.memory.set(register::SII_DATA, &data);
            self.memory.set_u16(register::SII_CONTROL, 0);
        }
        if self.mailbox_due_us.take_if(|due| *due <= now_us).is_some() {
            self.answer_mailbox();
        }
        let watchdog_us = self.watchdog_us();
        let is_late = self
            .outputs_us
            .is_some_and(|at| self.now_us.saturating_sub(at) > watchdog_us);
        if self.state == al::OP && watchdog_us > 0 && is_late {
            self.memory.set_u16(register::WATCHDOG_STATUS, 0);
            let count = self.memory.u8(register::WATCHDOG_COUNTER).saturating_add(1);
            self.memory.set(register::WATCHDOG_COUNTER, &[count]);
            self.leave_op(al::SAFE_OP, code::WATCHDOG);
        }
    }

    /// Time of the watchdog of the outputs, µs; 0 when it is off.
    fn watchdog_us(&self) -> u64 {
        if !SyncManager::read(&self.memory, 2).has_watchdog() {
            return 0;
        }
        let tick_ns = (u64::from(self.memory.u16(register::WATCHDOG_DIVIDER)) + 2) * 40;
        u64::from(self.memory.u16(register::WATCHDOG_PROCESS_DATA)) * tick_ns / 1_000
    }

    fn publish_state(&mut self, code: u16) {
        let status = self.state | if self.error { al::ERROR } else { 0 };
        self.memory.set_u16(register::AL_STATUS, status.into());
        self.memory.set_u16(register::AL_STATUS_CODE, code);
        self.drive.set_operational(self.is_operational());
    }

    fn leave_op(&mut self, state: u8, code: u16) {
        (self.state, self.error) = (state, true);
        self.outputs_us = None;
        self.publish_state(code);
    }

    /// Grants or refuses a requested state.
    fn decide(&mut self, requested: u8) {
        let refusal = self.refusal(requested);
        match refusal {
            None => {
                if requested < self.state || requested == al::INIT {
                    self.outputs_us = None;
                }
                if requested == al::INIT {
                    self.mailbox_counter = 0;
                    self.mailbox_due_us = None;
                }
                (self.state, self.error) = (requested, false);
                self.publish_state(0);
            }
            Some(code) => {
                self.error = true;
                self.publish_state(code);
            }
        }
    }

    /// True if a SyncManager has this start, length and control, the watchdog's bit aside.
    fn is_configured(&self, index: u8, start: u16, length: u16, control: u8) -> bool {
        let sm = SyncManager::read(&self.memory, index);
        sm.enabled == (length > 0)
            && (sm.start, sm.length, sm.control | 0x40) == (start, length, control | 0x40)
    }

    /// Returns the code by which a state is refused.
    fn refusal(&self, requested: u8) -> Option<u16> {
        let (out, back) = (sii::MAILBOX_OUT, sii::MAILBOX_IN);
        if let Some((_, code)) = self.refuses.filter(|(state, _)| *state == requested) {
            return Some(code);
        }
        match (self.state, requested) {
            (_, al::INIT) => None,
            (_, al::BOOT) => Some(code::NO_BOOT),
            (al::INIT, al::PRE_OP) => {
                let has_mailboxes = self.is_configured(0, out.0, out.1, sii::CONTROL[0])
                    && self.is_configured(1, back.0, back.1, sii::CONTROL[1]);
                (!has_mailboxes).then_some(code::MAILBOX)
            }
            (al::PRE_OP, al::SAFE_OP) => {
                let [outputs, inputs] =
                    [&self.drive.outputs, &self.drive.inputs].map(|pdo| pdo.length() as u16);
                if outputs == 0 || !self.is_configured(2, sii::OUTPUTS, outputs, sii::CONTROL[2]) {
                    Some(code::OUTPUTS)
                } else if inputs == 0
                    || !self.is_configured(3, sii::INPUTS, inputs, sii::CONTROL[3])
                {
                    Some(code::INPUTS)
                } else {
                    None
                }
            }
            (al::SAFE_OP, al::OP) => self.outputs_us.is_none().then_some(code::NO_OUTPUTS),
            (state, requested) if state == requested => None,
            (al::SAFE_OP | al::OP, al::PRE_OP) | (al::OP, al::SAFE_OP) => None,
            (_, al::PRE_OP | al::SAFE_OP | al::OP) => Some(code::INVALID_CHANGE),
            _ => Some(code::UNKNOWN_STATE),
        }
    }

    fn answer_mailbox(&mut self) {
        let request = SyncManager::read(&self.memory, 0);
        let answer = SyncManager::read(&self.memory, 1);
        if answer.is_full(&self.memory) {
            // The last answer was not fetched: this one waits.
            self.mailbox_due_us = Some(self.now_us + MAILBOX_US);
            return;
        }
        let bytes = self
            .memory
            .bytes(request.start, request.length.into())
            .unwrap_or(&[])
            .to_vec();
        request.set_full(&mut self.memory, false);
        let is_pre_op = self.state == al::PRE_OP;
        if let Some(reply) = mailbox::answer(
            &mut self.drive,
            &bytes,
            &mut self.mailbox_counter,
            is_pre_op,
        ) {
            self.memory.set(answer.start, &reply);
            answer.set_full(&mut self.memory, true);
        }
    }

    /// True if a datagram with a configured address is for this SubDevice.
    pub(super) fn answers_to(&self, address: u16) -> bool {
        let uses_alias = self.memory.u8(register::DL_CONTROL_ALIAS) & 1 != 0;
        address == self.memory.u16(register::STATION_ADDRESS)
            || uses_alias && address == self.memory.u16(register::STATION_ALIAS)
    }

    /// Reads as a MainDevice. False if the access is refused.
    pub(super) fn read(&mut self, address: u16, data: &mut [u8]) -> bool {
        if (sii::INPUTS..sii::INPUTS + 0x100).contains(&address) {
            self.publish_inputs();
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
        let mut packed = mapping::room();
        let status = self.drive.status();
        self.drive.objects.set(0x6041, 0, status.into());
        let length = self.drive.inputs.pack(&self.drive.objects, &mut packed);
        self.memory
            .set(sii::INPUTS, packed.get(..length).unwrap_or(&[]));
    }

    /// Writes as a MainDevice. False if the access is refused.
    pub(super) fn write(&mut self, address: u16, data: &[u8]) -> bool {
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
            self.drive.take_outputs(data);
        }
        true
    }

    fn write_registers(&mut self, address: u16, data: &[u8]) -> bool {
        let watchdog = register::WATCHDOG_DIVIDER..register::WATCHDOG_STATUS;
        let is_watchdog = watchdog.contains(&address);
        let status = self.memory.clone_statuses();
        if is_watchdog && !self.setup.watchdog_is_writable {
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

    /// Takes a request of a state. With an error standing, only one that acknowledges it, or goes
    /// down, is heard.
    fn request_state(&mut self, control: u8) {
        let (requested, acknowledges) = (control & 0x0F, control & al::ERROR != 0);
        if self.error && !acknowledges && requested >= self.state {
            return;
        }
        if acknowledges && self.error {
            self.error = false;
            self.publish_state(0);
        }
        self.request = Some((requested, self.now_us + TRANSITION_US));
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
    pub(super) fn logical(
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
