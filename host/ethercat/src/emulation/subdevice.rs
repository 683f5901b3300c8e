//! One SubDevice: its controller's registers, its state machine, its mailbox, and the device behind
//! them.

mod registers;
mod states;
mod sync0;

use super::device::Device;
use super::distributed_clock::{ClockSetup, DistributedClock};
use super::drive::{Drive, DriveSetup};
use super::mailbox;
use super::memory::{Memory, register};
use super::sii;
use super::sync_manager::{FMMUS, SYNC_MANAGERS, SyncManager};
use states::{al, code};
use sync0::Sync0Interval;
pub use sync0::{ClockHandle, Sync0Intervals};

/// Time of a read of the EEPROM, µs.
const EEPROM_US: u64 = 40;
/// Time from a request in the mailbox to its answer, µs.
const MAILBOX_US: u64 = 120;

/// A SubDevice: a controller with a device behind it.
#[derive(Clone, Debug)]
pub struct SubDevice<D = Drive> {
    memory: Memory,
    eeprom: Vec<u8>,
    device: D,
    /// State that its application refuses, and the code.
    refuses: Option<(u8, u16)>,
    clock: Option<DistributedClock>,
    sync0: Sync0Interval,
    /// Error code of an emergency message that leaves before the next answer.
    emergency: Option<u16>,
    /// Requests are taken from the mailbox and never answered.
    is_mute: bool,
    now_us: u64,
    /// Time of the wire at which the present frame passes, and of its way back.
    passing_ns: (u64, u64),
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
    /// Highest state since power-on.
    highest_state: u8,
}

impl SubDevice {
    /// Creates a drive that has just been powered.
    #[must_use]
    pub fn new(setup: &DriveSetup) -> Self {
        Self::of(Drive::new(setup))
    }

    /// Returns the drive.
    #[must_use]
    pub const fn drive(&self) -> &Drive {
        &self.device
    }

    /// Returns the drive, to be handled at its panel or by the process.
    pub const fn drive_mut(&mut self) -> &mut Drive {
        &mut self.device
    }

    /// Says whether writes to the watchdog's time are taken, and whether the outputs trigger it.
    pub fn set_watchdog(&mut self, is_writable: bool, has_watchdog: bool) {
        self.device.set_watchdog(is_writable, has_watchdog);
        self.eeprom = sii::eeprom(&self.device.sii());
    }
}

impl<D: Device> SubDevice<D> {
    /// Creates a SubDevice that has just been powered.
    #[must_use]
    pub fn of(device: D) -> Self {
        let sii = device.sii();
        let mut this = Self {
            memory: Memory::new(),
            eeprom: sii::eeprom(&sii),
            device,
            refuses: None,
            clock: None,
            sync0: Sync0Interval::default(),
            passing_ns: (0, 0),
            emergency: None,
            is_mute: false,
            now_us: 0,
            state: al::INIT,
            error: false,
            request: None,
            eeprom_read: None,
            mailbox_due_us: None,
            mailbox_counter: 0,
            outputs_us: None,
            highest_state: al::INIT,
        };
        this.power_on(sii.alias);
        this
    }

    /// Gives the controller a distributed clock of 64 bits.
    #[must_use]
    pub fn with_clock(mut self, setup: ClockSetup) -> Self {
        self.clock = Some(DistributedClock::new(setup, 0));
        self.power_on(self.device.sii().alias);
        self
    }

    /// Sets the registers to what a controller has at power-on.
    fn power_on(&mut self, alias: u16) {
        let features = if self.clock.is_some() { 0x0C } else { 0 };
        // Type, revision, build; FMMUs, sync managers, 8 KiB of RAM, two ports of MII; features.
        self.memory.set(
            0x0000,
            &[0x11, 0, 1, 0, FMMUS, SYNC_MANAGERS, 8, 0x0F, features, 0],
        );
        self.memory.set_u16(register::STATION_ALIAS, alias);
        // 100 µs by 2500 times 40 ns, and EtherCAT's 100 ms.
        self.memory.set_u16(register::WATCHDOG_DIVIDER, 2_498);
        self.memory.set_u16(register::WATCHDOG_PROCESS_DATA, 1_000);
        self.memory.set_u16(register::WATCHDOG_STATUS, 1);
        self.publish_state(0);
    }

    /// Returns the device behind the controller.
    #[must_use]
    pub const fn device(&self) -> &D {
        &self.device
    }

    /// Returns the device behind the controller, to be handled.
    pub const fn device_mut(&mut self) -> &mut D {
        &mut self.device
    }

    /// True in OP, without an error.
    #[must_use]
    pub const fn is_operational(&self) -> bool {
        self.state == al::OP && !self.error
    }

    /// Returns the highest state of the application layer since power-on: 1 INIT, 2 PRE-OP, 4
    /// SAFE-OP, 8 OP.
    #[must_use]
    pub const fn highest_state(&self) -> u8 {
        self.highest_state
    }

    /// Returns the state of the application layer, without the bit of an error.
    #[must_use]
    pub const fn state(&self) -> u8 {
        self.state
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

    /// Sends an emergency message before the next answer of the mailbox.
    pub const fn send_emergency(&mut self, code: u16) {
        self.emergency = Some(code);
    }

    /// Says whether requests in the mailbox stay without an answer.
    pub const fn mute(&mut self, is_mute: bool) {
        self.is_mute = is_mute;
    }

    /// Takes the power away and gives it again: the machine behind the device stays as it is, and
    /// everything that was configured is lost.
    pub fn power_cycle(&mut self) {
        let has_next = self.memory.u16(register::DL_STATUS) & 0x0020 != 0;
        self.device.power_cycle();
        let sii = self.device.sii();
        self.memory = Memory::new();
        self.eeprom = sii::eeprom(&sii);
        (self.refuses, self.emergency, self.is_mute) = (None, None, false);
        (self.state, self.error, self.highest_state) = (al::INIT, false, al::INIT);
        (self.request, self.eeprom_read) = (None, None);
        (self.mailbox_due_us, self.mailbox_counter) = (None, 0);
        self.outputs_us = None;
        self.sync0 = Sync0Interval::default();
        let now_ns = self.now_us * 1_000;
        self.clock = self
            .clock
            .as_ref()
            .map(|clock| DistributedClock::new(clock.setup(), now_ns));
        self.power_on(sii.alias);
        self.set_ports(has_next);
    }

    /// Returns the distributed clock, to be disturbed; `None` without one.
    pub fn clock_mut(&mut self) -> Option<ClockHandle<'_>> {
        let now_ns = self.now_us * 1_000;
        let memory = &self.memory;
        let clock = self.clock.as_mut()?;
        Some(ClockHandle {
            clock,
            memory,
            now_ns,
        })
    }

    /// Returns the intervals of SYNC0 in OP since the last call.
    pub const fn take_sync0_intervals(&mut self) -> Sync0Intervals {
        self.sync0.take()
    }

    /// Tells the time of the wire at which the coming datagram passes, and that of its way back.
    pub(super) const fn set_passing(&mut self, here_ns: u64, back_ns: u64) {
        self.passing_ns = (here_ns, back_ns);
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

    /// Runs what is due by `now_ns`: pulses of SYNC0, transitions, EEPROM, mailbox, watchdog.
    pub(super) fn advance_to(&mut self, now_ns: u64) {
        let now_us = now_ns / 1_000;
        self.now_us = self.now_us.max(now_us);
        self.run_sync0(now_ns);
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
        if let Some(code) = self.emergency.take() {
            self.memory.set(answer.start, &mailbox::emergency(code));
            answer.set_full(&mut self.memory, true);
            self.mailbox_due_us = Some(self.now_us + MAILBOX_US);
            return;
        }
        request.set_full(&mut self.memory, false);
        let is_pre_op = self.state == al::PRE_OP;
        let reply = self
            .device
            .answer(&bytes, &mut self.mailbox_counter, is_pre_op);
        if let Some(reply) = reply.filter(|_| !self.is_mute) {
            self.memory.set(answer.start, &reply);
            answer.set_full(&mut self.memory, true);
        }
    }
}
