//! A force sensor with the objects of the ATI EtherCAT F/T. Its map is known from public programs,
//! not from its handbook.

use super::{Identity, Instrument, InstrumentRefusal, MailboxSetup, NoReading};
use crate::discovery::DevicePlace;

/// PDO assignments of outputs and inputs, and the PDOs of the sensor.
const OUTPUTS: (u16, u16) = (0x1C12, 0x1601);
const INPUTS: (u16, u16) = (0x1C13, 0x1A00);
/// Bits of the inputs: six counts, status, counter of samples; of the outputs: two control words.
const INPUT_BITS: u32 = 256;
const OUTPUT_BITS: u32 = 64;
/// Object of the calibration: codes of the units, and counts per unit, of force and torque.
const CALIBRATION: u16 = 0x2040;
const UNITS: [u8; 2] = [0x29, 0x2A];
const COUNTS_PER_UNIT: [u8; 2] = [0x31, 0x32];
/// Bits of the status: a fault, a saturated gauge, a wrong checksum of the calibration.
const FAULTS: u32 = 0xE000_0000;
/// Cycles with the same counter of samples after which a sensor counts as frozen.
const FROZEN_CYCLES: u32 = 3;

/// Expectations of a force sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ForceSensorConfig {
    /// Place.
    pub place: DevicePlace,
    /// Vendor: the product code is the default of a widespread stack.
    pub vendor: u32,
    /// Product code.
    pub product: u32,
    /// Calibration that the sensor uses, 0 to 15.
    pub calibration: u8,
}

impl ForceSensorConfig {
    pub(crate) const fn identity(&self) -> Identity {
        Identity {
            place: self.place,
            vendor: self.vendor,
            product: self.product,
        }
    }

    /// Control words, constant: the number of the calibration, and no bias, which is the client's.
    const fn control(&self) -> [u8; 8] {
        [0, self.calibration & 0x0F, 0, 0, 0, 0, 0, 0]
    }
}

/// A force sensor that was set up.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ForceSensor {
    control: [u8; 8],
    /// Newtons, and newton metres, of a count.
    per_count: [f64; 2],
    samples: Option<u32>,
    frozen_for: u32,
    reading: Result<[f64; 6], NoReading>,
}

impl ForceSensor {
    /// Prepares a sensor in PRE-OP: assigns its PDOs, and asks for its units.
    pub(crate) async fn prepare(
        config: &ForceSensorConfig,
        sensor: &MailboxSetup<'_>,
    ) -> Result<Self, InstrumentRefusal> {
        for (direction, pdo) in [OUTPUTS, INPUTS] {
            sensor.assign(direction, pdo).await?;
        }
        for ((direction, _), wanted, expected) in [
            (
                OUTPUTS,
                OUTPUT_BITS,
                "expected 64 of outputs: two control words",
            ),
            (
                INPUTS,
                INPUT_BITS,
                "a force sensor's are of 256: six counts, status, counter of samples",
            ),
        ] {
            let (_, bits) = sensor.assigned(direction).await?;
            if bits != wanted {
                return Err(InstrumentRefusal::Map { bits, expected });
            }
        }
        let [force, torque] = UNITS;
        let newtons = match unit(sensor, force, "the unit of force").await? {
            1 => Ok(4.448_221_615_260_5),
            2 => Ok(1.0),
            3 => Ok(4_448.221_615_260_5),
            4 => Ok(1_000.0),
            5 => Ok(9.806_65),
            value => Err((
                force,
                "the unit of force",
                value,
                "1 lbf, 2 N, 3 klbf, 4 kN or 5 kg",
            )),
        };
        let newton_metres = match unit(sensor, torque, "the unit of torque").await? {
            3 => Ok(1.0),
            4 => Ok(1e-3),
            value => Err((torque, "the unit of torque", value, "3 N m or 4 N mm")),
        };
        let refused = |(sub, purpose, value, expected): (u8, _, u8, _)| InstrumentRefusal::Value {
            object: CALIBRATION,
            sub,
            purpose,
            value: value.into(),
            expected,
        };
        let units = [newtons.map_err(refused)?, newton_metres.map_err(refused)?];
        let mut per_count = [0.0; 2];
        for ((place, unit), sub) in per_count.iter_mut().zip(units).zip(COUNTS_PER_UNIT) {
            *place = unit / f64::from(counts(sensor, sub).await?);
        }
        Ok(Self {
            control: config.control(),
            per_count,
            samples: None,
            frozen_for: 0,
            reading: Err(NoReading::NoAnswer),
        })
    }

    /// Returns force, N, and torque, N m, of the last cycle, about the sensor's origin, its axes.
    pub(crate) const fn reading(&self) -> Result<[f64; 6], NoReading> {
        self.reading
    }
}

/// Reads the code of a unit.
async fn unit(
    sensor: &MailboxSetup<'_>,
    sub: u8,
    purpose: &'static str,
) -> Result<u8, InstrumentRefusal> {
    let object = CALIBRATION;
    let lacks = InstrumentRefusal::Lacks {
        object,
        sub,
        purpose,
    };
    sensor.object::<u8>(object, sub).await?.ok_or(lacks)
}

/// Reads a number of counts per unit.
async fn counts(sensor: &MailboxSetup<'_>, sub: u8) -> Result<i32, InstrumentRefusal> {
    let (object, purpose) = (CALIBRATION, "the counts per unit");
    match sensor.object::<i32>(object, sub).await? {
        Some(counts) if counts > 0 => Ok(counts),
        Some(value) => Err(InstrumentRefusal::Value {
            object,
            sub,
            purpose,
            value,
            expected: "more than 0",
        }),
        None => Err(InstrumentRefusal::Lacks {
            object,
            sub,
            purpose,
        }),
    }
}

impl Instrument for ForceSensor {
    fn outputs(&self) -> &[u8] {
        &self.control
    }

    fn take(&mut self, inputs: &[u8]) {
        let mut words = inputs.chunks_exact(4);
        let mut next = || words.next().and_then(|word| <[u8; 4]>::try_from(word).ok());
        let mut reading = [0.0; 6];
        let [force, torque] = self.per_count;
        let per_count = [force, force, force, torque, torque, torque];
        for (place, per_count) in reading.iter_mut().zip(per_count) {
            let Some(count) = next().map(i32::from_le_bytes) else {
                return self.miss(NoReading::WorkingCounter);
            };
            *place = f64::from(count) * per_count;
        }
        let words = [next(), next()].map(|word| word.map(u32::from_le_bytes));
        let [Some(status), Some(samples)] = words else {
            return self.miss(NoReading::WorkingCounter);
        };
        let stands = self.samples.replace(samples) == Some(samples);
        self.frozen_for = if stands {
            self.frozen_for.saturating_add(1)
        } else {
            0
        };
        self.reading = if status & FAULTS != 0 {
            Err(NoReading::SensorFault { status })
        } else if self.frozen_for >= FROZEN_CYCLES {
            Err(NoReading::Frozen)
        } else {
            Ok(reading)
        };
    }

    fn miss(&mut self, reason: NoReading) {
        self.reading = Err(reason);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sensor() -> ForceSensor {
        ForceSensor {
            control: [0; 8],
            per_count: [1e-6, 1e-3],
            samples: None,
            frozen_for: 0,
            reading: Err(NoReading::NoAnswer),
        }
    }

    fn inputs(status: u32, samples: u32) -> Vec<u8> {
        let counts = [1_000_000, -2_000_000, 3, 4, -5, i32::MIN];
        let words = counts.map(i32::to_le_bytes).into_iter();
        let words = words.chain([status, samples].map(u32::to_le_bytes));
        words.flatten().collect()
    }

    #[test]
    fn a_reading_is_six_counts_in_units() {
        let mut sensor = sensor();
        sensor.take(&inputs(0, 7));
        let expected = [1.0, -2.0, 3e-6, 4e-3, -5e-3, -2_147_483.648];
        let reading = sensor.reading().unwrap();
        for (found, expected) in reading.iter().zip(expected) {
            assert!(
                (found - expected).abs() <= 1e-12 * expected.abs(),
                "{reading:?}"
            );
        }
        // Two samples in a cycle are as good as one.
        sensor.take(&inputs(0, 9));
        assert!(sensor.reading().is_ok());
    }

    #[test]
    fn faults_and_a_counter_that_stands_are_no_reading() {
        let mut sensor = sensor();
        for bit in 0..32 {
            let status = 1 << bit;
            sensor.take(&inputs(status, bit));
            let expected = (bit >= 29).then_some(NoReading::SensorFault { status });
            assert_eq!(sensor.reading().err(), expected, "bit {bit}");
        }
        for (cycle, is_frozen) in [false, false, false, true, true].into_iter().enumerate() {
            sensor.take(&inputs(0, 99));
            assert_eq!(sensor.reading().is_err(), is_frozen, "{cycle}");
        }
        sensor.take(&inputs(0, 98));
        assert!(sensor.reading().is_ok());
        for length in 0..32 {
            sensor.take(&vec![0; length]);
            assert_eq!(sensor.reading(), Err(NoReading::WorkingCounter));
        }
    }
}
