//! Objects of a terminal with CoE: its identity, its settings, and PDOs of which one per direction is
//! assigned.

use super::pdo_choice::PdoChoice;
use crate::emulation::mailbox::Dictionary;
use crate::emulation::mapping::Mapped;
use crate::emulation::objects::{Mappable, Objects, abort, entries};
use crate::emulation::sii::Identity;

/// Row of a dictionary, as of [`entries`].
pub(super) type Row = (u16, u8, u8, bool, Mappable, i64);
/// PDOs of one direction, by their objects.
pub(super) type Pdos = Vec<(u16, Vec<Mapped>)>;

/// Objects of a terminal.
#[derive(Clone, Debug)]
pub(super) struct TerminalObjects {
    name: &'static str,
    settings: Objects,
    outputs: PdoChoice,
    inputs: PdoChoice,
}

impl TerminalObjects {
    /// Creates the objects of a terminal that has just been powered: the first PDOs are assigned.
    pub(super) fn new(
        name: &'static str,
        device_type: i64,
        identity: &Identity,
        settings: &[Row],
        [outputs, inputs]: [Pdos; 2],
    ) -> Self {
        let no = Mappable::No;
        let mut rows = vec![
            (0x1000, 0, 32, false, no, device_type),
            (0x1018, 0, 8, false, no, 4),
            (0x1018, 1, 32, false, no, identity.vendor.into()),
            (0x1018, 2, 32, false, no, identity.product.into()),
            (0x1018, 3, 32, false, no, identity.revision.into()),
            (0x1018, 4, 32, false, no, identity.serial.into()),
            (0x1C00, 0, 8, false, no, 4),
            (0x1C00, 1, 8, false, no, 1),
            (0x1C00, 2, 8, false, no, 2),
            (0x1C00, 3, 8, false, no, 3),
            (0x1C00, 4, 8, false, no, 4),
        ];
        rows.extend_from_slice(settings);
        Self {
            name,
            settings: Objects::new(entries(&rows)),
            outputs: PdoChoice::new(0x1C12, outputs),
            inputs: PdoChoice::new(0x1C13, inputs),
        }
    }

    /// Returns a setting.
    pub(super) fn get(&self, index: u16, sub: u8) -> i32 {
        self.settings.get(index, sub)
    }

    /// Sets a setting.
    pub(super) fn set(&mut self, index: u16, sub: u8, value: i32) {
        self.settings.set(index, sub, value);
    }

    /// Returns the lengths of the assigned PDOs, outputs and inputs, bytes.
    pub(super) fn lengths(&self) -> [usize; 2] {
        [&self.outputs, &self.inputs].map(PdoChoice::length)
    }

    /// Assigns the first PDOs again, as after a loss of power.
    pub(super) fn assign_first(&mut self) {
        self.outputs.reset();
        self.inputs.reset();
    }
}

impl Dictionary for TerminalObjects {
    fn name(&self) -> &'static str {
        self.name
    }

    fn upload(&self, index: u16, sub: u8) -> Result<([u8; 4], usize), u32> {
        for pdos in [&self.outputs, &self.inputs] {
            if pdos.owns(index) {
                return pdos.upload(index, sub);
            }
        }
        self.settings.upload(index, sub)
    }

    fn download(&mut self, index: u16, sub: u8, bytes: &[u8], is_pre_op: bool) -> Result<(), u32> {
        for pdos in [&mut self.outputs, &mut self.inputs] {
            if pdos.owns(index) {
                return if is_pre_op {
                    pdos.download(index, sub, bytes)
                } else {
                    Err(abort::STATE)
                };
            }
        }
        self.settings.download(index, sub, bytes)
    }
}
