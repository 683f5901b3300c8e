//! Recordings: one CSV row per tick, units in the header, written by a separate thread `[T 5.1.2]`.

use std::fmt;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;
use std::time::Duration;

use gantry_tau_core::control::message::{AxisState, State};
use gantry_tau_core::units::OffsetNm;

use crate::plant::ToolReading;
use crate::server::cycle::Row;

/// Pause of the writing thread when the queue is empty.
const REST: Duration = Duration::from_millis(5);
/// Rows that may wait for a slow disk, about eight seconds.
const QUEUE: usize = 8_192;

/// One row of a recording.
pub trait Record: Copy + Send + 'static {
    /// Names of the columns, with units.
    fn header() -> Vec<String>;
    /// The values, in the order of the header.
    fn fields(&self) -> Vec<String>;
}

/// Reason why a recording failed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("recording {path}: {reason}")]
pub struct RecordError {
    path: PathBuf,
    reason: String,
}

/// CSV file. After its first failure (for instance a full disk) it only counts lost rows.
#[derive(Debug)]
pub struct CsvFile {
    path: PathBuf,
    writer: csv::Writer<File>,
    failure: Option<RecordError>,
    written: u64,
    lost: u64,
}

/// Outcome of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recorded {
    /// Path of the file.
    pub path: PathBuf,
    /// Rows written; if the file failed, some of the last ones may be lost.
    pub written: u64,
    /// Rows known to be lost, because the queue was full or the file failed.
    pub lost: u64,
    /// The first failure of the file.
    pub failure: Option<RecordError>,
}

impl fmt::Display for Recorded {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let path = self.path.display();
        let (written, lost) = (self.written, self.lost);
        match &self.failure {
            None => write!(f, "recorded {written} rows to {path}, {lost} dropped"),
            // Some of the last rows were still buffered.
            Some(failure) => {
                write!(f, "recorded at most {written} rows to {path}, at least {lost} dropped ({})", failure.reason)
            }
        }
    }
}

impl CsvFile {
    /// Creates the file and writes the header of `T`.
    ///
    /// # Errors
    /// [`RecordError`] naming the path and the reason.
    pub fn create<T: Record>(path: &Path) -> Result<Self, RecordError> {
        let fail = |reason: String| RecordError { path: path.to_owned(), reason };
        let file = File::create(path).map_err(|error| fail(error.to_string()))?;
        let mut writer = csv::Writer::from_writer(file);
        writer.write_record(T::header()).map_err(|error| fail(error.to_string()))?;
        Ok(Self { path: path.to_owned(), writer, failure: None, written: 0, lost: 0 })
    }

    /// Writes a row.
    pub fn write<T: Record>(&mut self, row: &T) {
        if self.failure.is_none() {
            match self.writer.write_record(row.fields()) {
                Ok(()) => {
                    self.written += 1;
                    return;
                }
                Err(error) => self.fail(error.to_string()),
            }
        }
        self.lost += 1;
    }

    /// Flushes, and adds the rows that the queue dropped.
    #[must_use]
    pub fn finish(mut self, dropped: u64) -> Recorded {
        if let Err(error) = self.writer.flush() {
            self.fail(error.to_string());
        }
        Recorded { path: self.path, written: self.written, lost: self.lost + dropped, failure: self.failure }
    }

    fn fail(&mut self, reason: String) {
        let path = self.path.clone();
        self.failure.get_or_insert(RecordError { path, reason });
    }
}

/// Producer side of a recording: pushing never blocks and never allocates.
#[derive(Debug)]
pub struct Recorder<T> {
    queue: rtrb::Producer<T>,
    thread: JoinHandle<CsvFile>,
    dropped: u64,
}

impl<T: Record> Recorder<T> {
    /// Creates the file and starts the thread that writes it.
    ///
    /// # Errors
    /// [`RecordError`].
    pub fn start(path: &Path) -> Result<Self, RecordError> {
        let mut file = CsvFile::create::<T>(path)?;
        let (queue, mut rows) = rtrb::RingBuffer::new(QUEUE);
        let thread = std::thread::Builder::new()
            .name("recorder".to_owned())
            .spawn(move || {
                drain(&mut rows, |row| file.write::<T>(row));
                file
            })
            .map_err(|error| RecordError { path: path.to_owned(), reason: error.to_string() })?;
        Ok(Self { queue, thread, dropped: 0 })
    }

    /// Adds a row, or counts it as dropped.
    pub fn push(&mut self, row: T) {
        self.dropped += u64::from(self.queue.push(row).is_err());
    }

    /// Ends the recording. `None` if the writing thread panicked, which was reported on stderr.
    #[must_use]
    pub fn finish(self) -> Option<Recorded> {
        let Self { queue, thread, dropped } = self;
        drop(queue);
        thread.join().ok().map(|file| file.finish(dropped))
    }
}

/// Calls `each` with every row until the producer is gone and the queue is empty.
pub fn drain<T: Copy>(rows: &mut rtrb::Consumer<T>, mut each: impl FnMut(&T)) {
    loop {
        let gone = rows.is_abandoned();
        while let Ok(row) = rows.pop() {
            each(&row);
        }
        if gone {
            return;
        }
        std::thread::sleep(REST);
    }
}

const LOAD: [&str; 6] = ["force_x_n", "force_y_n", "force_z_n", "moment_x_nm", "moment_y_nm", "moment_z_nm"];

/// Name and value of a column.
type Column = (&'static str, fn(&AxisState) -> i64);

/// Columns of an axis, whose number stands for `{}`.
const AXIS: [Column; 9] = [
    ("nominal_{}_nm", |axis| axis.nominal.0),
    ("offset_{}_nm", |axis| axis.offsets.position.0.into()),
    ("velocity_offset_{}_um_s", |axis| axis.offsets.velocity.0.into()),
    ("torque_offset_{}_permille", |axis| axis.offsets.torque.0.into()),
    ("shadow_{}_nm", |axis| axis.shadow.position.0.into()),
    ("actual_{}_nm", |axis| axis.actual.position.0),
    ("actual_velocity_{}_um_s", |axis| axis.actual.velocity.0.into()),
    ("actual_torque_{}_permille", |axis| axis.actual.torque.0.into()),
    ("flags_{}", |axis| axis.flags.bits().into()),
];

/// Columns common to all recordings, from the State.
fn state_header(axes: usize) -> Vec<String> {
    let mut header: Vec<String> = ["tick", "state", "cause", "missed", "ramp_ticks_left"].map(str::to_owned).into();
    for axis in 1..=axes {
        header.extend(AXIS.map(|(name, _)| name.replace("{}", &axis.to_string())));
    }
    header
}

fn state_fields<const N: usize>(state: &State<N>) -> Vec<String> {
    let mut fields = vec![
        state.tick.0.to_string(),
        state.phase.name().to_owned(),
        state.cause.name().to_owned(),
        state.counters.missed.to_string(),
        state.ramp_ticks_left.to_string(),
    ];
    for axis in &state.axes {
        fields.extend(AXIS.map(|(_, value)| value(axis).to_string()));
    }
    fields
}

/// Names of a vector's three columns; the axis stands for `{}`.
fn vector(name: &str) -> [String; 3] {
    ["x", "y", "z"].map(|axis| name.replace("{}", axis))
}

/// The server's recording.
impl<const N: usize> Record for Row<N> {
    fn header() -> Vec<String> {
        let mut header = state_header(N);
        header.extend((1..=N).map(|axis| format!("reference_{axis}_nm")));
        header.extend(LOAD.map(str::to_owned));
        header.extend(vector("displacement_{}_um"));
        header.extend(vector("gauge_{}_um"));
        header.extend(["elapsed_ticks", "round_trip_us"].map(str::to_owned));
        header.extend(vector("turn_{}_urad"));
        header
    }

    fn fields(&self) -> Vec<String> {
        // Without instruments at the tool their columns are empty.
        let millionths = |values: fn(&ToolReading) -> [f64; 3]| match &self.tool {
            Some(tool) => values(tool).map(|value| (value * 1e6).to_string()),
            None => Default::default(),
        };
        let mut fields = state_fields(&self.state);
        fields.extend(self.references.iter().map(|r| r.position.0.to_string()));
        fields.extend(self.tool.map_or_else(Default::default, |tool| tool.load.map(|value| value.to_string())));
        fields.extend(millionths(|tool| tool.displacement_m));
        fields.extend(millionths(|tool| tool.gauges_m));
        fields.push(self.elapsed.to_string());
        fields.push(self.round_trip_us.map_or_else(String::new, |time| time.to_string()));
        fields.extend(millionths(|tool| tool.turn_rad));
        fields
    }
}

/// One tick of the client.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClientRow<const N: usize> {
    /// State that was answered.
    pub state: State<N>,
    /// Position offsets that were requested.
    pub targets: [OffsetNm; N],
    /// Axes whose correction was cut at the limit of its offset.
    pub saturated: [bool; N],
    /// Load on the tool as it computed with, tared and filtered: force (N) and moment (N m), world axes.
    pub load: [f64; 6],
}

/// The client's recording: references and actual values as reported by the server `[T 5.1.2]`, and the requested offsets.
impl<const N: usize> Record for ClientRow<N> {
    fn header() -> Vec<String> {
        let mut header = state_header(N);
        header.extend((1..=N).map(|axis| format!("reference_{axis}_nm")));
        header.extend((1..=N).map(|axis| format!("target_{axis}_nm")));
        header.extend(LOAD.map(str::to_owned));
        header.push("saturated_axes".to_owned());
        header
    }

    fn fields(&self) -> Vec<String> {
        let mut fields = state_fields(&self.state);
        let reference = |axis: &AxisState| {
            let offset = i64::from(axis.offsets.position.0);
            axis.nominal.0.saturating_add(offset).to_string()
        };
        fields.extend(self.state.axes.iter().map(reference));
        fields.extend(self.targets.iter().map(|target| target.0.to_string()));
        fields.extend(self.load.map(|value| value.to_string()));
        // One bit per axis, the first axis lowest.
        let bits = self.saturated.iter().rev();
        fields.push(bits.fold(0_u32, |bits, cut| 2 * bits + u32::from(*cut)).to_string());
        fields
    }
}

#[cfg(test)]
mod tests {
    use gantry_tau_core::control::message::{Cause, Counters, Phase};
    use gantry_tau_core::units::{Epoch, Sequence, Tick};

    use super::*;

    #[test]
    fn every_saturated_axis_has_its_bit() {
        let state = State {
            tick: Tick(7),
            epoch: Epoch(1),
            accepted: Sequence(1),
            phase: Phase::Obtain,
            cause: Cause::None,
            on_time_of_100: 100,
            arrival_us: 0,
            ramp_ticks_left: 0,
            counters: Counters::default(),
            axes: [AxisState::default(); 3],
        };
        let header = ClientRow::<3>::header();
        for (saturated, bits) in [([false; 3], "0"), ([true, false, false], "1"), ([true, false, true], "5")] {
            let row = ClientRow { state, targets: [OffsetNm(0); 3], saturated, load: [0.0; 6] };
            let fields = row.fields();
            assert_eq!(fields.len(), header.len());
            assert_eq!((header.last(), fields.last()), (Some(&"saturated_axes".to_owned()), Some(&bits.to_owned())));
        }
    }
}
