//! States of the application layer: requests, grants and refusals; ETG1000.6.

use super::SubDevice;
use crate::emulation::device::Device;
use crate::emulation::memory::register;
use crate::emulation::sii;
use crate::emulation::sync_manager::SyncManager;

/// Time from a request of a state to its grant or refusal, µs.
const TRANSITION_US: u64 = 300;

/// States.
pub(super) mod al {
    pub(in crate::emulation::subdevice) const INIT: u8 = 1;
    pub(in crate::emulation::subdevice) const PRE_OP: u8 = 2;
    pub(in crate::emulation::subdevice) const BOOT: u8 = 3;
    pub(in crate::emulation::subdevice) const SAFE_OP: u8 = 4;
    pub(in crate::emulation::subdevice) const OP: u8 = 8;
    pub(in crate::emulation::subdevice) const ERROR: u8 = 0x10;
}

/// AL status codes; ETG1000.6 table 11.
pub(super) mod code {
    pub(in crate::emulation::subdevice) const INVALID_CHANGE: u16 = 0x0011;
    pub(in crate::emulation::subdevice) const UNKNOWN_STATE: u16 = 0x0012;
    pub(in crate::emulation::subdevice) const NO_BOOT: u16 = 0x0013;
    pub(in crate::emulation::subdevice) const MAILBOX: u16 = 0x0016;
    pub(in crate::emulation::subdevice) const NO_OUTPUTS: u16 = 0x0019;
    pub(in crate::emulation::subdevice) const WATCHDOG: u16 = 0x001B;
    pub(in crate::emulation::subdevice) const OUTPUTS: u16 = 0x001D;
    pub(in crate::emulation::subdevice) const INPUTS: u16 = 0x001E;
    pub(in crate::emulation::subdevice) const SYNC: u16 = 0x002C;
    pub(in crate::emulation::subdevice) const NO_SYNC: u16 = 0x002D;
}

impl<D: Device> SubDevice<D> {
    pub(super) fn publish_state(&mut self, code: u16) {
        let status = self.state | if self.error { al::ERROR } else { 0 };
        self.memory.set_u16(register::AL_STATUS, status.into());
        self.memory.set_u16(register::AL_STATUS_CODE, code);
        self.highest_state = self.highest_state.max(self.state);
        self.device.set_operational(self.is_operational());
    }

    pub(super) fn leave_op(&mut self, state: u8, code: u16) {
        (self.state, self.error) = (state, true);
        self.outputs_us = None;
        self.publish_state(code);
    }

    /// Grants or refuses a requested state.
    pub(super) fn decide(&mut self, requested: u8) {
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
        let sii = self.device.sii();
        let (has_mailbox, has_process_data) = (sii.protocols != 0, sii.has_process_data);
        match (self.state, requested) {
            (_, al::INIT) => None,
            (_, al::BOOT) => Some(code::NO_BOOT),
            (al::INIT, al::PRE_OP) if has_mailbox => {
                let has_mailboxes = self.is_configured(0, out.0, out.1, sii::CONTROL[0])
                    && self.is_configured(1, back.0, back.1, sii::CONTROL[1]);
                (!has_mailboxes).then_some(code::MAILBOX)
            }
            (al::INIT, al::PRE_OP) => None,
            (al::PRE_OP, al::SAFE_OP) if has_process_data => {
                let [outputs, inputs] = self.device.lengths().map(|length| length as u16);
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
            (al::PRE_OP, al::SAFE_OP) => None,
            (al::SAFE_OP, al::OP) if self.device.requires_sync0() && !self.has_sync0() => {
                Some(code::NO_SYNC)
            }
            (al::SAFE_OP, al::OP) if has_process_data => {
                self.outputs_us.is_none().then_some(code::NO_OUTPUTS)
            }
            (al::SAFE_OP, al::OP) => None,
            (state, requested) if state == requested => None,
            (al::SAFE_OP | al::OP, al::PRE_OP) | (al::OP, al::SAFE_OP) => None,
            (_, al::PRE_OP | al::SAFE_OP | al::OP) => Some(code::INVALID_CHANGE),
            _ => Some(code::UNKNOWN_STATE),
        }
    }

    /// Takes a request of a state. With an error standing, only one that acknowledges it, or goes
    /// down, is heard.
    pub(super) fn request_state(&mut self, control: u8) {
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
}
