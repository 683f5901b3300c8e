//! Encoder of a stream with the same samples in every tick.

use std::io;

use gantry_tau_labcomm::samples::Data;
use gantry_tau_labcomm::{Encoder, ErrorKind, Version};

use super::machine::MAX_ROBOT_FILE;
use super::rows::{self, Samples, Sensors};
use super::{MachineIdentity, SampleName};
use crate::record::Event;

/// Room for the definitions of all samples, bytes.
const DEFINITIONS: usize = 1_024;
/// Room for all samples of a tick and as many events as one tick can have, bytes.
pub(super) const TICK: usize = 2_048;
/// Room for the sample of the machine, bytes.
const MACHINE: usize = MAX_ROBOT_FILE + 512;

/// Stream of samples, tick by tick. Encoding a tick allocates nothing.
#[derive(Debug)]
pub struct Ticks {
    version: Version,
    names: Vec<SampleName>,
    /// Version and definitions.
    preamble: Vec<u8>,
    buffer: Box<[u8; TICK]>,
}

impl Ticks {
    /// Stream of these samples of a machine with `N` axes.
    ///
    /// # Errors
    /// The definitions have no room.
    pub fn of<const N: usize>(version: Version, names: &[SampleName]) -> io::Result<Self> {
        let mut definitions = [0; DEFINITIONS];
        let mut encoder = Encoder::new(version, &mut definitions);
        rows::define::<N>(&mut encoder, rows::indexed(version, names))
            .map_err(|error| io::Error::other(error.to_string()))?;
        let preamble = encoder.bytes().to_vec();
        Ok(Self {
            version,
            names: names.to_vec(),
            preamble,
            buffer: Box::new([0; TICK]),
        })
    }

    /// Returns the names of the samples.
    #[must_use]
    pub fn names(&self) -> &[SampleName] {
        &self.names
    }

    /// Returns version and definitions, with which a stream begins.
    #[must_use]
    pub fn preamble(&self) -> &[u8] {
        &self.preamble
    }

    /// Returns the bytes of the machine; none if the stream does not carry them.
    pub(super) fn encode_machine(&self, machine: &MachineIdentity) -> Vec<u8> {
        let mut buffer = vec![0; MACHINE];
        let mut encoder = Encoder::new(self.version, &mut buffer);
        let names = rows::indexed(self.version, &self.names);
        let written = rows::write_machine(&mut encoder, names, machine);
        debug_assert_eq!(written, Ok(()), "a machine has room");
        encoder.bytes().to_vec()
    }

    /// Returns the bytes of gauges and force sensor.
    pub(super) fn encode_sensors(&mut self, sensors: Sensors<'_>) -> &[u8] {
        self.written(|encoder, names| rows::write_sensors(encoder, names, sensors))
    }

    /// Returns the bytes of counts of gauges.
    pub(super) fn encode_data(&mut self, counts: [i32; 3]) -> &[u8] {
        self.written(|encoder, names| rows::write_data(encoder, names, Data(counts)))
    }

    /// Returns the bytes of events alone.
    pub(super) fn encode_events<'e>(
        &mut self,
        events: impl IntoIterator<Item = &'e Event>,
    ) -> &[u8] {
        self.written(|encoder, names| rows::write_events(encoder, names, events))
    }

    /// Returns the bytes of a tick; gauges and force sensor only with `sensors`.
    pub fn encode<const N: usize>(
        &mut self,
        samples: &Samples<N>,
        events: &[Event],
        sensors: Option<Sensors<'_>>,
    ) -> &[u8] {
        self.written(|encoder, names| rows::write_tick(encoder, names, samples, events, sensors))
    }

    /// Returns the bytes that `write` encodes, given the samples with their indices.
    fn written(
        &mut self,
        write: impl FnOnce(
            &mut Encoder<'_>,
            &mut dyn Iterator<Item = (u32, SampleName)>,
        ) -> Result<(), ErrorKind>,
    ) -> &[u8] {
        let mut encoder = Encoder::new(self.version, self.buffer.as_mut_slice());
        let written = write(&mut encoder, &mut rows::indexed(self.version, &self.names));
        debug_assert_eq!(written, Ok(()), "a tick has room");
        let length = encoder.len();
        self.buffer.get(..length).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::ToolReading;

    /// A machine with a force sensor alone shows no gauges at zero.
    #[test]
    fn gauges_that_are_not_there_are_no_sample() {
        let lengths = |gauges_m: [f64; 3]| {
            let names = [SampleName::Data, SampleName::ForceSensor];
            let mut ticks = Ticks::of::<3>(Version::V2006, &names).unwrap();
            let tool = ToolReading {
                gauges_m,
                ..ToolReading::UNKNOWN
            };
            let sensors = Sensors {
                tool: &tool,
                gauge_resolution_m: 1e-6,
            };
            ticks.encode_sensors(sensors).len()
        };
        let [with, without, in_part] = [[0.0; 3], [f64::NAN; 3], [0.0, f64::NAN, 0.0]].map(lengths);
        // Index, length and three counts.
        assert!(with > without && without > 0, "{with}, {without}");
        assert_eq!(in_part, without);
    }
}
