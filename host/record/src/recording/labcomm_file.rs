//! A recording as a stream of LabComm.

use std::io::{self, Write};

use gantry_tau_labcomm::Version;
use gantry_tau_server::publication::{SampleName, Samples, Ticks};
use gantry_tau_server::record::Event;
use gantry_tau_system::output::GrowingFile;

/// Samples of a recording.
pub(super) const NAMES: [SampleName; 5] = [
    SampleName::Axes,
    SampleName::State,
    SampleName::Tool,
    SampleName::SessionEvent,
    SampleName::Drives,
];

/// File of one stream. Each tick is written whole, so that the stream ends between two events
/// whenever the process ends.
#[derive(Debug)]
pub(super) struct LabcommFile {
    file: GrowingFile,
    ticks: Ticks,
}

impl LabcommFile {
    /// Begins the file, with version and definitions for `N` axes.
    pub(super) fn create<const N: usize>(
        mut file: GrowingFile,
        version: Version,
    ) -> io::Result<Self> {
        let ticks = Ticks::of::<N>(version, &NAMES)?;
        file.write_all(ticks.preamble())?;
        Ok(Self { file, ticks })
    }

    pub(super) fn write<const N: usize>(
        &mut self,
        samples: &Samples<N>,
        events: &[Event],
    ) -> io::Result<()> {
        self.file
            .write_all(self.ticks.encode(samples, events, None))
    }

    pub(super) fn sync(&mut self) -> io::Result<()> {
        self.file.sync()
    }
}
