//! A terminal that counts the edges of a length gauge, as EL5101, EL5101-0010 and EL5151.

use super::terminal_objects::TerminalObjects;
use crate::emulation::device::{Device, MAX_PROCESS_DATA};
use crate::emulation::mailbox;
use crate::emulation::mapping::Mapped;
use crate::emulation::objects::Mappable;
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
    const fn name(self) -> &'static str {
        match self {
            Self::El5101 | Self::El5101Old => "EL5101",
            Self::El5101Fast => "EL5101-0010",
            Self::El5151 => "EL5151",
        }
    }

    const fn identity(self) -> Identity {
        let (product, revision) = match self {
            Self::El5101 => (0x13ED_3052, 0x0400_0000),
            Self::El5101Old => (0x13ED_3052, 0x03F9_0000),
            Self::El5101Fast => (0x13ED_3052, 0x0400_000A),
            Self::El5151 => (0x141F_3052, 0x0400_0000),
        };
        Identity {
            vendor: 0x0000_0002,
            product,
            revision,
            serial: 0,
        }
    }
}

/// An encoder terminal.
#[derive(Clone, Debug)]
pub struct EncoderTerminal {
    model: EncoderModel,
    objects: TerminalObjects,
    /// Counts of the gauge since it was made, and of the moment of power-on.
    counts: i64,
    zero: i64,
    is_broken: bool,
    has_sync_error: bool,
    is_invalid: bool,
    is_frozen: bool,
    toggle: bool,
    /// Status and counter of the last cycle in which its program ran.
    shown: (u16, u32),
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

impl EncoderTerminal {
    /// Creates a terminal that has just been powered.
    #[must_use]
    pub fn new(model: EncoderModel) -> Self {
        // Wire checks of channels A and B.
        let checks = [0x0B, 0x0C].map(|sub| (0x8010, sub, 8, true, Mappable::No, 0));
        let settings = match model {
            EncoderModel::El5101Old => &[],
            _ => checks.as_slice(),
        };
        let pdos = match model {
            EncoderModel::El5101 => [
                vec![(0x1602, outputs(16)), (0x1603, outputs(32))],
                vec![(0x1A03, inputs(16)), (0x1A04, inputs(32))],
            ],
            EncoderModel::El5101Old => [
                vec![(0x1600, old(0x7000, 1))],
                vec![(0x1A00, old(0x6000, 2))],
            ],
            EncoderModel::El5101Fast | EncoderModel::El5151 => {
                [vec![(0x1600, outputs(32))], vec![(0x1A00, inputs(32))]]
            }
        };
        Self {
            model,
            objects: TerminalObjects::new(model.name(), 0x1389, &model.identity(), settings, pdos),
            counts: 0,
            zero: 0,
            is_broken: false,
            has_sync_error: false,
            is_invalid: false,
            is_frozen: false,
            toggle: false,
            shown: (0, 0),
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
        let bits = [
            (self.is_broken && checks_wire, OPEN_CIRCUIT),
            (self.has_sync_error, SYNC_ERROR),
            (self.is_invalid, INVALID),
            (self.toggle, TOGGLE),
        ];
        let set = bits.into_iter().filter(|(is_set, _)| *is_set);
        set.fold(0, |status, (_, bit)| status | bit)
    }
}

impl Device for EncoderTerminal {
    fn sii(&self) -> Sii {
        Sii {
            identity: self.model.identity(),
            alias: 0,
            name: self.model.name(),
            protocols: COE,
            has_process_data: true,
            has_watchdog: true,
        }
    }

    fn lengths(&self) -> [usize; 2] {
        self.objects.lengths()
    }

    fn answer(
        &mut self,
        request: &[u8],
        last_counter: &mut u8,
        is_pre_op: bool,
    ) -> Option<Vec<u8>> {
        mailbox::answer(&mut self.objects, request, last_counter, is_pre_op)
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
            self.shown = (self.status(), (self.counts - self.zero) as u32);
        }
        let (status, counter) = self.shown;
        let (status, counter) = (status.to_le_bytes(), counter.to_le_bytes());
        let old = [if self.is_broken { 0x20 } else { 0 }];
        let status = if self.is_enhanced() {
            &status[..]
        } else {
            &old
        };
        let [_, length] = self.objects.lengths();
        let width = if length == 10 { 4 } else { 2 };
        let bytes = status.iter().chain(counter.iter().take(width));
        // The latch is never used.
        let bytes = bytes.copied().chain(std::iter::repeat(0));
        for (place, byte) in data.iter_mut().take(length).zip(bytes) {
            *place = byte;
        }
        length
    }

    fn power_cycle(&mut self) {
        self.zero = self.counts;
        self.objects.assign_first();
        self.objects.set(0x8010, 0x0B, 0);
        self.objects.set(0x8010, 0x0C, 0);
        self.is_operational = false;
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::indexing_slicing, reason = "tests fail by panicking")]

    use super::*;

    fn shown(encoder: &mut EncoderTerminal) -> Vec<u8> {
        let mut data = [0xEE; MAX_PROCESS_DATA];
        let length = encoder.inputs(&mut data);
        data[..length].to_vec()
    }

    /// Status, counter, latch, as of section 1.7 of the specification of the bus.
    #[test]
    fn maps_of_16_and_32_bits_begin_with_the_status() {
        let mut old = EncoderTerminal::new(EncoderModel::El5101Old);
        old.set_counts(-2);
        assert_eq!(shown(&mut old), [0, 0xFE, 0xFF, 0, 0]);
        let mut narrow = EncoderTerminal::new(EncoderModel::El5101);
        narrow.set_counts(-2);
        assert_eq!(shown(&mut narrow), [0, 0x80, 0xFE, 0xFF, 0, 0]);
        let mut wide = EncoderTerminal::new(EncoderModel::El5151);
        wide.set_counts(70_000);
        assert_eq!(shown(&mut wide), [0, 0x80, 0x70, 0x11, 1, 0, 0, 0, 0, 0]);
        // The toggle bit changes in each cycle.
        assert_eq!(shown(&mut wide)[1], 0);
    }

    #[test]
    fn a_broken_wire_is_seen_where_it_is_looked_for() {
        let mut encoder = EncoderTerminal::new(EncoderModel::El5151);
        encoder.break_wire(true);
        assert_eq!(shown(&mut encoder)[0], 0);
        encoder.objects.set(0x8010, 0x0B, 1);
        assert_eq!(shown(&mut encoder)[0], 0x40);
        encoder.set_sync_error(true);
        encoder.invalidate(true);
        assert_eq!(shown(&mut encoder)[..2], [0x40, 0xE0]);
        encoder.power_cycle();
        assert_eq!(shown(&mut encoder)[0], 0);
    }

    #[test]
    fn a_program_that_stands_shows_the_same() {
        let mut encoder = EncoderTerminal::new(EncoderModel::El5151);
        encoder.set_counts(5);
        let before = shown(&mut encoder);
        encoder.freeze(true);
        encoder.set_counts(9);
        encoder.set_sync_error(true);
        assert_eq!(shown(&mut encoder), before);
        encoder.freeze(false);
        assert_ne!(shown(&mut encoder)[2..], before[2..]);
    }

    #[test]
    fn a_loss_of_power_is_a_new_zero() {
        let mut encoder = EncoderTerminal::new(EncoderModel::El5151);
        encoder.set_counts(5);
        encoder.power_cycle();
        assert_eq!(shown(&mut encoder)[2..6], [0; 4]);
        encoder.set_counts(3);
        assert_eq!(shown(&mut encoder)[2..6], (-2_i32).to_le_bytes());
    }
}
