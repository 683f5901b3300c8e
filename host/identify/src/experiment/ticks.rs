//! Tables of every tick: written beside the windows of a live campaign, and made into windows
//! again.
//!
//! | module | contents |
//! |---|---|
//! | `table` | the table, as a live campaign writes it |
//! | `levels` | windows from such a table, whose levels are named |
//! | `record` | windows from a recording of `serve --record`, whose levels are those of the plan |
//! | `window_builder` | builder of the windows |
//!
//! A tick is one row: series, mounting and pose; window and stroke, empty on the way between two
//! levels; time and tick; positions of the axes, q-units; the force sensor as it indicates, in its
//! own axes, its zero error and the weight of its tool included; and the gauges that the series
//! reads. A series begins with its slack level, stroke 0, at which the sensor is tared; a window
//! `tare` tares it again and is not a window of the campaign.

mod levels;
mod record;
pub(crate) mod table;
mod window_builder;

use std::cell::{Cell, RefCell};
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;

use super::PoseError;
use super::plan_pose::PlanPose;
use super::prediction::Prediction;
use crate::measurements::FileError;
use crate::measurements::springs::{
    Campaign, LOAD, NamedGauge, Setup, WINDOW, axis_columns, read_setup,
};
use crate::measurements::wrench_columns::WrenchColumns;
use window_builder::WindowBuilder;

/// Columns of the force sensor.
const SENSOR: [&str; 6] = [
    "sensor_force_x_n",
    "sensor_force_y_n",
    "sensor_force_z_n",
    "sensor_moment_x_n_m",
    "sensor_moment_y_n_m",
    "sensor_moment_z_n_m",
];
/// Window in which the sensor is tared in the middle of a series.
const TARE: &str = "tare";
/// First column of a recording of `serve --record`, which a table of ticks does not begin with.
const OF_RECORD: &[u8] = b"tick,";
/// Longest row, bytes.
const MAX_ROW_LEN: usize = 1 << 20;

/// Names of the columns, for these gauges.
fn header<const N: usize>(gauges: &[NamedGauge]) -> Vec<String> {
    let first = WINDOW
        .into_iter()
        .chain(["time_s", "tick"])
        .map(str::to_owned);
    let gauges = gauges.iter().map(|gauge| format!("{}_um", gauge.name));
    first
        .chain(axis_columns::<N>())
        .chain(SENSOR.map(str::to_owned))
        .chain(gauges)
        .collect()
}

/// A campaign whose windows were made of ticks.
#[derive(Clone, Debug, PartialEq)]
pub struct TickCampaign<const N: usize> {
    /// The campaign.
    pub campaign: Campaign<N>,
    /// Levels that give no window: series, window and line in a sentence each.
    pub missed: Vec<String>,
}

/// Set-up and machine of a table of ticks.
struct Source<'a, const N: usize> {
    path: &'a Path,
    setup: &'a Setup,
    metres_per_q: [f64; N],
    /// Poses of the set-up, or the reason why the machine does not take them.
    places: Vec<Result<PlanPose<N>, PoseError>>,
    prediction: &'a Prediction<N>,
}

/// Makes the windows of a table of ticks of any length, for the set-up at `setup`: a table of
/// `experiment --raw`, or a recording of `serve --record`, which `[[series]]` of the set-up divide.
/// Memory does not grow with the table.
///
/// # Errors
/// [`FileError`].
pub fn read<K: MachineKind<N>, const N: usize>(
    path: &Path,
    setup: &Path,
    robot: &RobotFile<K, N>,
    prediction: &Prediction<N>,
) -> Result<TickCampaign<N>, FileError> {
    let of_setup = read_setup(setup, K::MODEL, &robot.metres_per_q)?;
    let places = of_setup
        .poses
        .iter()
        .map(|(_, pose)| PlanPose::of(robot, prediction, pose))
        .collect();
    let source = Source {
        path,
        setup: &of_setup,
        metres_per_q: robot.metres_per_q,
        places,
        prediction,
    };
    let (file, is_record) =
        open(path).map_err(|error| FileError::whole(&path.display().to_string(), error))?;
    let watch = ReadGuard::default();
    let ticks = GuardedFile {
        file,
        watch: &watch,
    };
    let builder = if is_record {
        record::read(setup, &source, ticks)?
    } else {
        levels::read(&source, ticks)?
    };
    let WindowBuilder {
        series,
        mountings,
        windows,
        missed,
        ..
    } = builder;
    let crc = watch.checksum.into_inner().finalize();
    let campaign = Campaign::of(
        of_setup,
        path,
        crc,
        &robot.metres_per_q,
        [series, mountings],
        windows,
    );
    let names = if is_record { LOAD } else { SENSOR };
    let maps = campaign
        .poses
        .iter()
        .map(|(_, pose)| prediction.wrench_map(pose))
        .collect();
    let campaign = Campaign {
        wrench: WrenchColumns { names, maps },
        ..campaign
    };
    Ok(TickCampaign { campaign, missed })
}

/// Opens a table; true if it is a recording.
fn open(path: &Path) -> io::Result<(BufReader<File>, bool)> {
    let mut file = BufReader::new(File::open(path)?);
    let is_record = file.fill_buf()?.starts_with(OF_RECORD);
    Ok((file, is_record))
}

/// Guard of a table of any length.
#[derive(Default)]
struct ReadGuard {
    /// CRC-32 of what was read.
    checksum: RefCell<crc32fast::Hasher>,
    /// Bytes since the last row.
    since_row: Cell<usize>,
}

/// File under a guard: its rows may not be longer than [`MAX_ROW_LEN`].
struct GuardedFile<'a> {
    file: BufReader<File>,
    watch: &'a ReadGuard,
}

impl Read for GuardedFile<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.file.read(buffer)?;
        self.watch.checksum.borrow_mut().update(&buffer[..count]);
        let since_row = self.watch.since_row.get() + count;
        self.watch.since_row.set(since_row);
        if since_row > MAX_ROW_LEN {
            return Err(io::Error::other(
                "a row is longer than 1 MiB; look for a quotation mark that is not closed",
            ));
        }
        Ok(count)
    }
}

#[cfg(test)]
mod tests;
