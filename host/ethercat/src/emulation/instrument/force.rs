//! A force sensor with the objects of the ATI EtherCAT F/T.

use super::terminal_objects::TerminalObjects;
use crate::emulation::device::{Device, MAX_PROCESS_DATA};
use crate::emulation::mailbox;
use crate::emulation::mapping::Mapped;
use crate::emulation::objects::Mappable;
use crate::emulation::sii::{COE, Identity, Sii};

/// Units of a sensor, as object 2040h tells them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ForceUnits {
    /// Code of the unit of force, sub-index 29h: 1 lbf, 2 N, 3 klbf, 4 kN, 5 kg.
    pub force: u8,
    /// Code of the unit of torque, sub-index 2Ah: 3 N m, 4 N mm.
    pub torque: u8,
    /// Counts per unit of force, sub-index 31h.
    pub counts_per_force: i32,
    /// Counts per unit of torque, sub-index 32h.
    pub counts_per_torque: i32,
}

const NAME: &str = "EtherCAT F/T Sensor";

/// Entry of 32 bits.
const fn whole((index, sub): (u16, u8)) -> Mapped {
    Mapped {
        index,
        sub,
        bits: 32,
    }
}

/// A force sensor.
#[derive(Clone, Debug)]
pub struct ForceTerminal {
    identity: Identity,
    objects: TerminalObjects,
    counts: [i32; 6],
    status: u32,
    samples: u32,
    /// Samples from one reading to the next: 0 for a sensor whose program stands.
    samples_per_reading: u32,
    /// Outputs that came last: the two control words.
    control: [u32; 2],
}

impl ForceTerminal {
    /// Identity of the ATI EtherCAT F/T; its product code is the default of a widespread stack.
    pub const IDENTITY: Identity = Identity {
        vendor: 0x0000_0732,
        product: 0x2648_3052,
        revision: 1,
        serial: 0,
    };

    /// Creates a sensor that has just been powered.
    #[must_use]
    pub fn new(identity: Identity, units: ForceUnits) -> Self {
        let no = Mappable::No;
        let settings = [
            (0x2040, 0x29, 8, false, no, units.force.into()),
            (0x2040, 0x2A, 8, false, no, units.torque.into()),
            (0x2040, 0x31, 32, false, no, units.counts_per_force.into()),
            (0x2040, 0x32, 32, false, no, units.counts_per_torque.into()),
        ];
        let inputs = (1..=6).map(|sub| (0x6000, sub));
        let inputs = inputs.chain([(0x6010, 0), (0x6020, 0)]);
        let outputs = [(0x7010, 1), (0x7010, 2)].into_iter();
        Self {
            identity,
            objects: TerminalObjects::new(
                NAME,
                0,
                &identity,
                &settings,
                [
                    vec![(0x1601, outputs.map(whole).collect())],
                    vec![(0x1A00, inputs.map(whole).collect())],
                ],
            ),
            counts: [0; 6],
            status: 0,
            samples: 0,
            samples_per_reading: 1,
            control: [0; 2],
        }
    }

    /// Loads the sensor: force, then torque, counts.
    pub const fn set_counts(&mut self, counts: [i32; 6]) {
        self.counts = counts;
    }

    /// Sets the status.
    pub const fn set_status(&mut self, status: u32) {
        self.status = status;
    }

    /// Sets the number of samples from one reading to the next.
    pub const fn set_samples_per_reading(&mut self, samples: u32) {
        self.samples_per_reading = samples;
    }

    /// Returns the two control words that came last.
    #[must_use]
    pub const fn control(&self) -> [u32; 2] {
        self.control
    }
}

impl Device for ForceTerminal {
    fn sii(&self) -> Sii {
        Sii {
            identity: self.identity,
            alias: 0,
            name: NAME,
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

    fn set_operational(&mut self, _: bool) {}

    fn take_outputs(&mut self, data: &[u8]) {
        for (word, bytes) in self.control.iter_mut().zip(data.chunks_exact(4)) {
            *word = bytes.try_into().map_or(0, u32::from_le_bytes);
        }
    }

    fn inputs(&mut self, data: &mut [u8; MAX_PROCESS_DATA]) -> usize {
        self.samples = self.samples.wrapping_add(self.samples_per_reading);
        let words = self.counts.map(|count| count as u32);
        let words = words.into_iter().chain([self.status, self.samples]);
        let [_, length] = self.objects.lengths();
        let places = data.chunks_exact_mut(4).take(length / 4);
        for (place, word) in places.zip(words) {
            place.copy_from_slice(&word.to_le_bytes());
        }
        length
    }

    fn power_cycle(&mut self) {
        self.objects.assign_first();
        self.control = [0; 2];
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::indexing_slicing, reason = "tests fail by panicking")]

    use super::*;

    /// Six counts, status, sample counter; two control words back.
    #[test]
    fn the_process_data_are_ten_words() {
        let units = ForceUnits {
            force: 2,
            torque: 3,
            counts_per_force: 1_000_000,
            counts_per_torque: 1_000_000,
        };
        let mut sensor = ForceTerminal::new(ForceTerminal::IDENTITY, units);
        assert_eq!(sensor.lengths(), [8, 32]);
        sensor.set_counts([1, -2, 3, 4, 5, 6]);
        sensor.set_status(1 << 31);
        let mut data = [0; MAX_PROCESS_DATA];
        assert_eq!(sensor.inputs(&mut data), 32);
        let word = |place: usize| i32::from_le_bytes(data[4 * place..][..4].try_into().unwrap());
        assert_eq!([0, 1, 2, 6, 7].map(word), [1, -2, 3, i32::MIN, 1]);
        sensor.set_samples_per_reading(0);
        sensor.inputs(&mut data);
        assert_eq!(data[28..32], [1, 0, 0, 0]);
        sensor.take_outputs(&[0, 3, 0, 0, 1, 0, 0, 0]);
        assert_eq!(sensor.control(), [0x300, 1]);
    }
}
