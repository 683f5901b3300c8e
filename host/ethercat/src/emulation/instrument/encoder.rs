//! A terminal that counts the edges of a length gauge, as EL5101, EL5101-0010 and EL5151.

use super::pdo_choice::PdoChoice;
use crate::emulation::device::{Device, MAX_PROCESS_DATA};
use crate::emulation::mailbox::{self, Dictionary};
use crate::emulation::mapping::Mapped;
use crate::emulation::objects::{Mappable, Objects, abort, entries};
use crate::emulation::sii::{COE, Identity, Sii};

/// Bits of the status of the enhanced map.
const OPEN_CIRCUIT: u16 = 1 << 6;
const SYNC_ERROR: u16 = 1 << 13;
const INVALID: u16 = 1 << 14;
const TOGGLE: u16 = 1 << 15;

/// Model of a terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EncoderModel {
    /// EL5101 with enhanced maps: 32 bits by 1A04h, 16 bits by default.
    El5101,
    /// EL5101 of old firmware: status of 8 bits, counter of 16, nothing to choose.
    El5101Old,
    /// EL5101-0010: 32 bits.
    El5101Fast,
    /// EL5151: 32 bits.
    El5151,
}

impl EncoderModel {
    const fn identity(self) -> (u32, &'static str) {
        match self {
            Self::El5101 | Self::El5101Old => (0x13ED_3052, "EL5101"),
            Self::El5101Fast => (0x13ED_3052, "EL5101-0010"),
            Self::El5151 => (0x141F_3052, "EL5151"),
        }
    }

    const fn revision(self) -> u32 {
        match self {
            Self::El5101Old => 0x03F9_0000,
            Self::El5101 | Self::El5151 => 0x0400_0000,
            Self::El5101Fast => 0x0400_000A,
        }
    }
}

/// An encoder terminal.
#[derive(Clone, Debug)]
pub struct Encoder {
    model: EncoderModel,
    objects: Objects,
    outputs: PdoChoice,
    inputs: PdoChoice,
    /// Counts of the gauge since it was made, and of the moment of power-on.
    counts: i64,
    zero: i64,
    is_broken: bool,
    has_sync_error: bool,
    is_invalid: bool,
    is_frozen: bool,
    toggle: bool,
    is_operational: bool,
}

/// Entries of a status of 16 bits, a counter and a latch.
fn inputs(bits: u8) -> Vec<Mapped> {
    let mut contents: Vec<Mapped> = (1..=16)
        .map(|sub| Mapped {
            index: 0x6010,
            sub,
            bits: 1,
        })
        .collect();
    contents.extend([0x11, 0x12].map(|sub| Mapped {
        index: 0x6010,
        sub,
        bits,
    }));
    contents
}

/// Entries of a control word of 16 bits and a value to set.
fn outputs(bits: u8) -> Vec<Mapped> {
    let mut contents: Vec<Mapped> = (1..=16)
        .map(|sub| Mapped {
            index: 0x7010,
            sub,
            bits: 1,
        })
        .collect();
    contents.push(Mapped {
        index: 0x7010,
        sub: 0x11,
        bits,
    });
    contents
}

/// Entries of the old map: 8 bits, then so many words.
fn old(index: u16, words: u8) -> Vec<Mapped> {
    let mut contents = vec![Mapped {
        index,
        sub: 1,
        bits: 8,
    }];
    contents.extend((0..words).map(|word| Mapped {
        index,
        sub: 2 + word,
        bits: 16,
    }));
    contents
}

impl Encoder {
    /// Creates a terminal that has just been powered.
    #[must_use]
    pub fn new(model: EncoderModel) -> Self {
        let no = Mappable::No;
        let (product, _) = model.identity();
        let mut rows = vec![
            (0x1000, 0, 32, false, no, 0x0000_1389),
            (0x1018, 0, 8, false, no, 4),
            (0x1018, 1, 32, false, no, 2),
            (0x1018, 2, 32, false, no, product.into()),
            (0x1018, 3, 32, false, no, model.revision().into()),
            (0x1018, 4, 32, false, no, 0),
            (0x1C00, 0, 8, false, no, 4),
            (0x1C00, 1, 8, false, no, 1),
            (0x1C00, 2, 8, false, no, 2),
            (0x1C00, 3, 8, false, no, 3),
            (0x1C00, 4, 8, false, no, 4),
        ];
        if model != EncoderModel::El5101Old {
            // Wire checks of channels A and B.
            rows.extend([
                (0x8010, 0x0B, 8, true, no, 0),
                (0x8010, 0x0C, 8, true, no, 0),
            ]);
        }
        let (out, back) = match model {
            EncoderModel::El5101 => (
                vec![(0x1602, outputs(16)), (0x1603, outputs(32))],
                vec![(0x1A03, inputs(16)), (0x1A04, inputs(32))],
            ),
            EncoderModel::El5101Old => (
                vec![(0x1600, old(0x7000, 1))],
                vec![(0x1A00, old(0x6000, 2))],
            ),
            EncoderModel::El5101Fast | EncoderModel::El5151 => {
                (vec![(0x1600, outputs(32))], vec![(0x1A00, inputs(32))])
            }
        };
        Self {
            model,
            objects: Objects::new(entries(&rows)),
            outputs: PdoChoice::new(0x1C12, out),
            inputs: PdoChoice::new(0x1C13, back),
            counts: 0,
            zero: 0,
            is_broken: false,
            has_sync_error: false,
            is_invalid: false,
            is_frozen: false,
            toggle: false,
            is_operational: false,
        }
    }

    /// Moves the gauge to so many counts. Its counter began at power-on.
    pub const fn set_counts(&mut self, counts: i64) {
        self.counts = counts;
    }

    /// Breaks a wire of the gauge, or mends it.
    pub const fn break_wire(&mut self, is_broken: bool) {
        self.is_broken = is_broken;
    }

    /// Sets the bit of a synchronisation error.
    pub const fn set_sync_error(&mut self, has_sync_error: bool) {
        self.has_sync_error = has_sync_error;
    }

    /// Sets the bit by which a terminal says that its inputs are invalid.
    pub const fn invalidate(&mut self, is_invalid: bool) {
        self.is_invalid = is_invalid;
    }

    /// Stops the terminal's program: its inputs and the toggle bit stay as they are.
    pub const fn freeze(&mut self, is_frozen: bool) {
        self.is_frozen = is_frozen;
    }

    fn is_enhanced(&self) -> bool {
        self.model != EncoderModel::El5101Old
    }

    fn status(&self) -> u16 {
        let checks_wire = self.objects.get(0x8010, 0x0B) != 0;
        let bit = |is_set: bool, bit: u16| if is_set { bit } else { 0 };
        bit(self.is_broken && checks_wire, OPEN_CIRCUIT)
            | bit(self.has_sync_error, SYNC_ERROR)
            | bit(self.is_invalid, INVALID)
            | bit(self.toggle, TOGGLE)
    }
}

impl Device for Encoder {
    fn sii(&self) -> Sii {
        let (product, name) = self.model.identity();
        Sii {
            identity: Identity {
                vendor: 0x0000_0002,
                product,
                revision: self.model.revision(),
                serial: 0,
            },
            alias: 0,
            name,
            protocols: COE,
            has_process_data: true,
            has_watchdog: true,
        }
    }

    fn lengths(&self) -> [usize; 2] {
        [self.outputs.length(), self.inputs.length()]
    }

    fn answer(
        &mut self,
        request: &[u8],
        last_counter: &mut u8,
        is_pre_op: bool,
    ) -> Option<Vec<u8>> {
        mailbox::answer(self, request, last_counter, is_pre_op)
    }

    fn set_operational(&mut self, is_operational: bool) {
        self.is_operational = is_operational;
    }

    fn take_outputs(&mut self, data: &[u8]) {
        // Any control bit would latch, set or reset the counter; the counter's set value is not
        // emulated beyond that.
        if self.is_operational && data.first().is_some_and(|control| *control != 0) {
            self.zero = self.counts;
        }
    }

    fn inputs(&mut self, data: &mut [u8; MAX_PROCESS_DATA]) -> usize {
        if !self.is_frozen {
            self.toggle = !self.toggle;
        }
        let counter = (self.counts - self.zero) as u32;
        let mut bytes = Vec::new();
        if self.is_enhanced() {
            bytes.extend(self.status().to_le_bytes());
        } else {
            bytes.push(if self.is_broken { 0x20 } else { 0 });
        }
        match self.inputs.length() {
            10 => bytes.extend(counter.to_le_bytes()),
            _ => bytes.extend((counter as u16).to_le_bytes()),
        }
        let length = self.inputs.length();
        // The latch is never used.
        bytes.resize(length, 0);
        if let Some(place) = data.get_mut(..length) {
            place.copy_from_slice(&bytes);
        }
        length
    }

    fn power_cycle(&mut self) {
        self.zero = self.counts;
        self.outputs.reset();
        self.inputs.reset();
        self.objects.set(0x8010, 0x0B, 0);
        self.objects.set(0x8010, 0x0C, 0);
        self.is_operational = false;
    }
}

impl Dictionary for Encoder {
    fn name(&self) -> &'static str {
        self.model.identity().1
    }

    fn upload(&self, index: u16, sub: u8) -> Result<([u8; 4], usize), u32> {
        for pdos in [&self.outputs, &self.inputs] {
            if pdos.owns(index) {
                return pdos.upload(index, sub);
            }
        }
        self.objects.upload(index, sub)
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
        self.objects.download(index, sub, bytes)
    }
}
