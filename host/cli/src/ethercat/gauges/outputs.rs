//! Readers of gauges: the link of `experiment`, LabComm, and a table.

use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use gantry_tau_ethercat::NoReading;
use gantry_tau_labcomm::Version;
use gantry_tau_server::links::Allowed;
use gantry_tau_server::links::gauges::{GaugePublisher, Lengths};
use gantry_tau_server::publication::{Publication, SampleName};
use gantry_tau_server::server::ServerError;
use gantry_tau_system::last_wait;
use gantry_tau_system::output::GrowingFile;

use super::GaugesFile;

/// Rows that may wait for the disk: ten seconds.
const ROWS: usize = 10_000;
/// Pause of the writing thread when no row waits.
const REST: Duration = Duration::from_millis(5);
/// Gauges of the LabComm sample.
const OF_SAMPLE: usize = 3;

/// Readers and files that get the lengths of each cycle.
#[derive(Debug)]
pub(crate) struct GaugeOutputs {
    link: GaugePublisher,
    labcomm: Option<Publication>,
    table: Option<LengthTable>,
}

impl GaugeOutputs {
    /// Listens on both addresses, and opens the recording.
    ///
    /// # Errors
    /// An address is taken, the file cannot be made, or it has fewer than three gauges for LabComm.
    pub(crate) fn open(
        file: &GaugesFile,
        publish: SocketAddr,
        labcomm: Option<SocketAddr>,
        allowed: &Allowed,
        record: Option<&Path>,
    ) -> Result<Self, Box<dyn std::error::Error>> {
        if labcomm.is_some() && file.gauges.len() < OF_SAMPLE {
            let reason = format!(
                "{}: --labcomm publishes three gauges; here are {}",
                file.path,
                file.gauges.len()
            );
            return Err(reason.into());
        }
        let refused = |address| move |error| ServerError::listen(address, &error);
        let link = GaugePublisher::bind(publish).map_err(refused(publish))?;
        let labcomm = labcomm.map(|address| {
            // Lengths are counts: one count means one.
            Publication::bind::<1>(address, Version::V2006, &[SampleName::Data], 1.0)
                .map(|publication| publication.for_peers(allowed.clone()))
                .map_err(refused(address))
        });
        Ok(Self {
            link: link.for_peers(allowed.clone()),
            labcomm: labcomm.transpose()?,
            table: record
                .map(|path| LengthTable::begin(path, file))
                .transpose()?,
        })
    }

    /// Says what is published where.
    pub(super) fn description(&self, file: &GaugesFile) -> String {
        let names: Vec<&str> = file.gauges.iter().map(|gauge| &*gauge.name).collect();
        let mut text = format!("{} ({})", file.path, names.join(", "));
        if let Ok(address) = self.link.address() {
            let _infallible = write!(text, " on {address}");
        }
        if let Some(Ok(address)) = self.labcomm.as_ref().map(Publication::address) {
            let _infallible = write!(text, ", LabComm on {address}");
        }
        text
    }

    /// Hands the lengths of a cycle on; allocates nothing and never blocks. LabComm's sample has no
    /// place for a gauge without a count, and is left out then.
    pub(super) fn put(
        &mut self,
        lengths: &Lengths,
        counts: impl Iterator<Item = Result<i64, NoReading>>,
    ) {
        self.link.publish(lengths);
        if let Some(labcomm) = &mut self.labcomm {
            let mut data = [None; OF_SAMPLE];
            for (place, count) in data.iter_mut().zip(counts) {
                *place = count.ok().and_then(|count| i32::try_from(count).ok());
            }
            let data = match data {
                [Some(first), Some(second), Some(third)] => Some([first, second, third]),
                _ => None,
            };
            labcomm.publish_data(data);
        }
        if let Some(table) = &mut self.table {
            table.put(*lengths);
        }
    }

    /// Ends the recording.
    ///
    /// # Errors
    /// The reason for which it is not whole.
    pub(super) fn finish(self) -> Result<(), String> {
        self.table.map_or(Ok(()), LengthTable::finish)
    }
}

/// A table of all cycles, written by a thread of its own: a disk that waits delays no cycle. The file
/// is made with its first row.
#[derive(Debug)]
struct LengthTable {
    path: PathBuf,
    rows: rtrb::Producer<Lengths>,
    lost: u64,
    written: Arc<AtomicU64>,
    thread: JoinHandle<io::Result<()>>,
}

impl LengthTable {
    fn begin(path: &Path, file: &GaugesFile) -> Result<Self, Box<dyn std::error::Error>> {
        let target = GrowingFile::fresh(path, None)?.that_waits()?;
        let names = file
            .gauges
            .iter()
            .map(|gauge| format!(",{}_um", gauge.name));
        let header = format!("tick{}\n", names.collect::<String>());
        let (rows, waiting) = rtrb::RingBuffer::new(ROWS);
        let (path, written) = (path.to_owned(), Arc::new(AtomicU64::new(0)));
        let (of_thread, here) = (Arc::clone(&written), path.clone());
        let thread = std::thread::Builder::new()
            .name("gauges table".to_owned())
            .spawn(move || {
                let _ = gantry_tau_system::privileges::give_up(&[here]);
                write_rows(target, &header, waiting, &of_thread)
            })?;
        Ok(Self {
            path,
            rows,
            lost: 0,
            written,
            thread,
        })
    }

    fn put(&mut self, lengths: Lengths) {
        if self.rows.push(lengths).is_err() {
            if self.lost == 0 {
                tracing::warn!("{}: rows are lost", self.path.display());
            }
            self.lost += 1;
        }
    }

    /// Waits for the last rows, but not for a disk that hangs.
    fn finish(self) -> Result<(), String> {
        let path = self.path.display();
        drop(self.rows);
        match last_wait::join(self.thread, || self.written.load(Ordering::Relaxed)) {
            Some(Ok(Ok(()))) if self.lost == 0 => Ok(()),
            Some(Ok(Ok(()))) => Err(format!("{path}: {} rows were lost", self.lost)),
            Some(Ok(Err(error))) => Err(format!("{path}: {error}")),
            Some(Err(_)) => Err(format!("{path}: its thread ended")),
            None => Err(format!("{path}: its disk takes nothing")),
        }
    }
}

fn write_rows(
    mut file: GrowingFile,
    header: &str,
    mut rows: rtrb::Consumer<Lengths>,
    written: &AtomicU64,
) -> io::Result<()> {
    let mut text = header.to_owned();
    loop {
        // Before the last look: what came until then is written.
        let is_last = rows.is_abandoned();
        let mut count = 0;
        while let Ok(lengths) = rows.pop() {
            row(&mut text, &lengths);
            count += 1;
        }
        if count > 0 {
            file.write_all(text.as_bytes())?;
            text.clear();
            written.fetch_add(count, Ordering::Relaxed);
        } else if is_last {
            return Ok(());
        } else {
            std::thread::sleep(REST);
        }
    }
}

/// Writes a row: the tick, then lengths in µm; nothing for a gauge without a count.
fn row(text: &mut String, lengths: &Lengths) {
    let _infallible = write!(text, "{}", lengths.tick);
    for length_m in lengths.lengths_m() {
        text.push(',');
        if length_m.is_finite() {
            let _infallible = write!(text, "{:.3}", length_m * 1e6);
        }
    }
    text.push('\n');
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_has_micrometres_and_gaps() {
        let mut text = String::new();
        row(&mut text, &Lengths::new(7, [1.5e-6, f64::NAN, -0.25]));
        assert_eq!(text, "7,1.500,,-250000.000\n");
    }
}
