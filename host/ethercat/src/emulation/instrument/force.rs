//! A force sensor with the objects of the ATI EtherCAT F/T.

use super::pdo_choice::PdoChoice;
use crate::emulation::device::{Device, MAX_PROCESS_DATA};
use crate::emulation::mailbox::{self, Dictionary};
use crate::emulation::mapping::Mapped;
use crate::emulation::objects::{Mappable, Objects, abort, entries};
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

/// A force sensor.
#[derive(Clone, Debug)]
pub struct ForceSensor {
    identity: Identity,
    objects: Objects,
    outputs: PdoChoice,
    inputs: PdoChoice,
    counts: [i32; 6],
    status: u32,
    samples: u32,
    /// Samples from one reading to the next: 0 for a sensor whose program stands.
    samples_per_reading: u32,
    /// Outputs that came last: the two control words.
    control: [u32; 2],
}

impl ForceSensor {
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
        let rows = [
            (0x1000, 0, 32, false, no, 0),
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
            (0x2040, 0x29, 8, false, no, units.force.into()),
            (0x2040, 0x2A, 8, false, no, units.torque.into()),
            (0x2040, 0x31, 32, false, no, units.counts_per_force.into()),
            (0x2040, 0x32, 32, false, no, units.counts_per_torque.into()),
        ];
        let whole = |index, sub| Mapped {
            index,
            sub,
            bits: 32,
        };
        let mut back: Vec<Mapped> = (1..=6).map(|sub| whole(0x6000, sub)).collect();
        back.extend([whole(0x6010, 0), whole(0x6020, 0)]);
        let out = vec![whole(0x7010, 1), whole(0x7010, 2)];
        Self {
            identity,
            objects: Objects::new(entries(&rows)),
            outputs: PdoChoice::new(0x1C12, vec![(0x1601, out)]),
            inputs: PdoChoice::new(0x1C13, vec![(0x1A00, back)]),
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

impl Device for ForceSensor {
    fn sii(&self) -> Sii {
        Sii {
            identity: self.identity,
            alias: 0,
            name: self.name(),
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
        let length = self.inputs.length();
        let places = data.chunks_exact_mut(4).take(length / 4);
        for (place, word) in places.zip(words) {
            place.copy_from_slice(&word.to_le_bytes());
        }
        length
    }

    fn power_cycle(&mut self) {
        self.outputs.reset();
        self.inputs.reset();
        self.control = [0; 2];
    }
}

impl Dictionary for ForceSensor {
    fn name(&self) -> &'static str {
        "EtherCAT F/T Sensor"
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
