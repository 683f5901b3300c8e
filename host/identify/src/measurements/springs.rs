//! Campaigns of forces and gauges: windows of a load, and what the gauges showed.

use std::collections::{BTreeSet, HashMap};
use std::path::Path;

use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_system::output::Name;
use nalgebra::{SVector, Vector6};

use super::plan::before_remount;
use super::repeated::{self, Column};
use super::wrench_columns::WrenchColumns;
use super::{FileError, setup, table};
use crate::fit::statistics::float;

mod plan;
mod setup_file;
mod windows;

pub use plan::{parse_gauges, read_gauges};
pub use setup_file::{NamedGauge, Noise, SeriesEntry, Setup, SetupNoise, parse_setup, read_setup};
pub(super) use setup_file::{Refused, check_wrist};
pub(crate) use windows::{LOAD, WINDOW, axis_columns, stroke, windows_of};

/// First line of a set-up.
pub const FORMAT: &str = "gantry-tau springs 1";
/// Largest number of gauges.
pub const MAX_GAUGES: usize = 16;
/// Largest position of an axis, q-units; reading, µm; force, N; moment, N m; time, s.
pub(crate) const MAX_VALUES: [f64; 5] = [1e3, 1e5, 1e5, 1e5, 1e9];
/// Largest angle of a wrist's joint, rad: a turn.
pub const MAX_TURN_RAD: f64 = std::f64::consts::TAU;
/// Load that is zero but for rounding, in standard deviations of its noise.
const ZERO_SD: f64 = 1e-9;
/// Range of a standard deviation, in the unit of its key.
pub(super) const NOISE: (f64, f64) = (1e-6, 1e6);

/// One window.
#[derive(Clone, Debug, PartialEq)]
pub struct Window<const N: usize> {
    /// Line of the table.
    pub line: u64,
    /// Series, by index: one mounting of strap and gauges, whose zeros are its own.
    pub series: usize,
    /// Mounting, by index.
    pub mounting: usize,
    /// Pose, by index.
    pub pose: usize,
    /// Name or number of the window in its series.
    pub window: Name,
    /// 1 rising, -1 falling, 0 start.
    pub stroke: i8,
    /// Positions of the axes, q-units.
    pub q: [f64; N],
    /// Load on the platform, about the tool centre point where it is, world axes, tared; N, N m.
    pub load: Vector6<f64>,
    /// Loads on the axes, newtons along `+q`.
    pub pushes_n: SVector<f64, N>,
    /// Readings, m, gauge by gauge.
    pub readings_m: Vec<Option<f64>>,
    /// Standard deviations of the readings, m, where the table has its own.
    pub sds_m: Vec<Option<f64>>,
    /// Time, s.
    pub time_s: Option<f64>,
}

/// A campaign.
#[derive(Clone, Debug, PartialEq)]
pub struct Campaign<const N: usize> {
    /// Path of the table, as messages name it.
    pub table: String,
    /// CRC-32 of the table.
    pub crc: u32,
    /// Length of each axis per unit of `q`, m.
    pub metres_per_q: [f64; N],
    /// Noise of a window.
    pub noise: Noise,
    /// False if the set-up states none: then [`Noise::USUAL`], which is good for ratios only.
    pub is_noise_stated: bool,
    /// Uncertainty of the set-up.
    pub setup: SetupNoise,
    /// Poses, with their names.
    pub poses: Vec<(Name, Pose)>,
    /// Columns of the table that the loads were read from.
    pub wrench: WrenchColumns,
    /// Gauges.
    pub gauges: Vec<NamedGauge>,
    /// Names of the series.
    pub series: Vec<Name>,
    /// Names of the mountings.
    pub mountings: Vec<Name>,
    /// The windows.
    pub windows: Vec<Window<N>>,
    /// The plan, if the set-up is one.
    pub plan: Vec<SeriesEntry>,
}

impl<const N: usize> Campaign<N> {
    /// Puts a campaign together from a set-up, the path and CRC-32 of its table, and names of
    /// series and mountings.
    pub(crate) fn of(
        setup: Setup,
        table: &Path,
        crc: u32,
        metres_per_q: &[f64; N],
        [series, mountings]: [Vec<Name>; 2],
        windows: Vec<Window<N>>,
    ) -> Self {
        let Setup {
            noise,
            setup,
            poses,
            gauges,
            plan,
            ..
        } = setup;
        Self {
            table: table.display().to_string(),
            crc,
            metres_per_q: *metres_per_q,
            noise: noise.unwrap_or(Noise::USUAL),
            is_noise_stated: noise.is_some(),
            setup: setup.unwrap_or_default(),
            wrench: WrenchColumns::of_load(poses.len()),
            poses,
            gauges,
            series,
            mountings,
            windows,
            plan,
        }
    }

    /// Angles of the wrist in a series, rad; empty: at zero.
    #[must_use]
    pub fn wrist_rad(&self, series: &str) -> &[f64] {
        self.planned(series).map_or(&[], |entry| &entry.wrist_rad)
    }

    /// Entry of the plan for a series, by its name or by that before it was mounted again.
    fn planned(&self, series: &str) -> Option<&SeriesEntry> {
        [series, before_remount(series)]
            .into_iter()
            .find_map(|name| self.plan.iter().find(|entry| entry.name == *name))
    }

    /// Checks that the angles of the wrist are those of a wrist with `joints` joints; `path` names
    /// the set-up.
    ///
    /// # Errors
    /// [`FileError`], naming the series.
    pub fn check_wrist(&self, path: &Path, joints: usize) -> Result<(), FileError> {
        let is_turned = self.plan.iter().any(|entry| !entry.wrist_rad.is_empty());
        let unknown = self.windows.iter().find(|window| {
            let name = self.series.get(window.series).map_or("", |name| name);
            self.planned(name).is_none()
        });
        if let Some(window) = unknown.filter(|_| is_turned) {
            let reason = "is not in the set-up, whose series have angles of the wrist (wrist_rad)";
            return Err(self.error(window, "series", reason));
        }
        check_wrist(
            path,
            self.plan
                .iter()
                .map(|entry| (&*entry.name, &*entry.wrist_rad)),
            joints,
        )
    }

    /// Checks that no row is a copy of another one, which would count twice. A window that
    /// `experiment` has taken again has its own readings.
    fn check_copies(&self) -> Result<(), FileError> {
        let mut lines: HashMap<(usize, &str), Vec<&Window<N>>> = HashMap::new();
        for window in &self.windows {
            let earlier = lines.entry((window.series, &window.window)).or_default();
            if let Some(first) = earlier
                .iter()
                .find(|other| other.load == window.load && other.readings_m == window.readings_m)
            {
                let reason = format!(
                    "{:?} is a copy of line {}, loads and readings too; remove one",
                    window.window, first.line
                );
                return Err(self.error(window, "window", reason));
            }
            earlier.push(window);
        }
        Ok(())
    }

    /// Checks that no row is a copy of one under another name, and that no column stands still or
    /// is cut at an end.
    ///
    /// # Errors
    /// [`FileError`], naming line and column.
    pub fn check_repeated(&self) -> Result<(), FileError> {
        let lines: Vec<u64> = self.windows.iter().map(|window| window.line).collect();
        let columns = self.columns();
        repeated::check(&self.table, &lines, "window", &columns)?;
        // A component without a load is typed as zero.
        let shown = columns
            .iter()
            .filter(|column| LOAD.contains(&&*column.name) && !column.is_zero());
        repeated::check_still(&self.table, &lines, repeated::OTHERS, shown)
    }

    /// Columns of poses, gauges and loads.
    fn columns(&self) -> Vec<Column> {
        let mut columns =
            vec![self.column("pose".to_owned(), None, |window| Some(float(window.pose)))];
        for (index, gauge) in self.gauges.iter().enumerate() {
            let sd = self.noise.gauge_um * 1e-6;
            columns.push(
                self.column(format!("{}_um", gauge.name), Some(sd), |window| {
                    window.readings_m.get(index).copied().flatten()
                }),
            );
        }
        let tared = self.tared();
        for (index, (name, variance)) in LOAD.iter().zip(&self.noise.load_variances()).enumerate() {
            columns.push(
                self.column((*name).to_owned(), Some(variance.sqrt()), |window| {
                    let load = window.load.get(index).copied();
                    load.filter(|_| !tared.contains(&window.line))
                }),
            );
        }
        columns
    }

    fn column(
        &self,
        name: String,
        sd: Option<f64>,
        value: impl Fn(&Window<N>) -> Option<f64>,
    ) -> Column {
        Column {
            name,
            sd,
            values: self.windows.iter().map(value).collect(),
        }
    }

    /// Lines of the windows at the ends of a series whose load is zero: the tare defines it, or it
    /// was typed, and no instrument read it.
    fn tared(&self) -> BTreeSet<u64> {
        let limits = self
            .noise
            .load_variances()
            .map(|variance| ZERO_SD * variance.sqrt());
        (0..self.series.len())
            .flat_map(|series| {
                let mut windows = self
                    .windows
                    .iter()
                    .filter(move |window| window.series == series);
                let first = windows.next();
                [first, windows.next_back()].into_iter().flatten()
            })
            .filter(|window| {
                let mut loads = window.load.iter().zip(&limits);
                loads.all(|(load, limit)| load.abs() <= *limit)
            })
            .map(|window| window.line)
            .collect()
    }

    /// Returns an error about a column of a window.
    #[must_use]
    pub fn error(
        &self,
        window: &Window<N>,
        column: &str,
        reason: impl std::fmt::Display,
    ) -> FileError {
        FileError::at(&self.table, window.line, column, reason)
    }
}

/// Reads a set-up and its table, for a machine of `model` whose axes are `metres_per_q` long.
///
/// # Errors
/// [`FileError`].
pub fn read<const N: usize>(
    path: &Path,
    model: &str,
    metres_per_q: &[f64; N],
) -> Result<Campaign<N>, FileError> {
    let setup = read_setup(path, model, metres_per_q)?;
    let table = setup::beside(path, &setup.measurements);
    campaign(setup, &table, &table::bytes(&table)?, metres_per_q)
}

/// Reads a set-up, and another table than it names.
///
/// # Errors
/// [`FileError`].
pub fn read_table<const N: usize>(
    path: &Path,
    table: &Path,
    model: &str,
    metres_per_q: &[f64; N],
) -> Result<Campaign<N>, FileError> {
    campaign(
        read_setup(path, model, metres_per_q)?,
        table,
        &table::bytes(table)?,
        metres_per_q,
    )
}

/// Reads the bytes of the table of a set-up, for a machine whose axes are `metres_per_q` long;
/// `table` names it.
///
/// # Errors
/// [`FileError`].
pub fn campaign<const N: usize>(
    setup: Setup,
    table: &Path,
    bytes: &[u8],
    metres_per_q: &[f64; N],
) -> Result<Campaign<N>, FileError> {
    let windows::Read {
        windows,
        series,
        mountings,
    } = windows::read(table, bytes, &setup.poses, &setup.gauges)?;
    let names = [series, mountings];
    let campaign = Campaign::of(
        setup,
        table,
        crc32fast::hash(bytes),
        metres_per_q,
        names,
        windows,
    );
    campaign.check_copies()?;
    Ok(campaign)
}
