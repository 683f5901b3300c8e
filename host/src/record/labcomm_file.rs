//! A recording as a stream of LabComm.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use gantry_tau_labcomm::Version;

use crate::publication::{SampleName, Samples, Ticks};
use crate::server::event_log::Event;

/// Samples of a recording.
pub(super) const NAMES: [SampleName; 5] =
    [SampleName::Axes, SampleName::State, SampleName::Tool, SampleName::SessionEvent, SampleName::Drives];

/// File of one stream.
#[derive(Debug)]
pub(super) struct LabcommFile {
    file: BufWriter<File>,
    ticks: Ticks,
}

impl LabcommFile {
    /// Creates the file, with version and definitions for `N` axes.
    pub(super) fn create<const N: usize>(path: &Path, version: Version) -> io::Result<Self> {
        let ticks = Ticks::of::<N>(version, &NAMES)?;
        let mut file = BufWriter::new(File::create(path)?);
        file.write_all(ticks.preamble())?;
        Ok(Self { file, ticks })
    }

    pub(super) fn write<const N: usize>(&mut self, samples: &Samples<N>, events: &[Event]) -> io::Result<()> {
        self.file.write_all(self.ticks.encode(samples, events, None))
    }

    pub(super) fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}
