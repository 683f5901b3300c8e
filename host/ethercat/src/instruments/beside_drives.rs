//! Instruments of different kinds on a bus of drives, in one group and one frame.

use super::encoder::Counter;
use super::force::ForceSensor;
use super::{Instrument, NoReading};

/// An instrument on a bus of drives.
#[derive(Clone, Copy, Debug)]
pub(crate) enum BesideDrives {
    Gauge(Counter),
    Force(ForceSensor),
}

impl BesideDrives {
    /// Returns the counter of a gauge.
    pub(crate) const fn gauge(&self) -> Option<&Counter> {
        match self {
            Self::Gauge(counter) => Some(counter),
            Self::Force(_) => None,
        }
    }

    /// Returns the force sensor.
    pub(crate) const fn force(&self) -> Option<&ForceSensor> {
        match self {
            Self::Force(sensor) => Some(sensor),
            Self::Gauge(_) => None,
        }
    }
}

impl Instrument for BesideDrives {
    fn outputs(&self) -> &[u8] {
        match self {
            Self::Gauge(counter) => counter.outputs(),
            Self::Force(sensor) => sensor.outputs(),
        }
    }

    fn take(&mut self, inputs: &[u8]) {
        match self {
            Self::Gauge(counter) => counter.take(inputs),
            Self::Force(sensor) => sensor.take(inputs),
        }
    }

    fn miss(&mut self, reason: NoReading) {
        match self {
            Self::Gauge(counter) => counter.miss(reason),
            Self::Force(sensor) => sensor.miss(reason),
        }
    }
}
