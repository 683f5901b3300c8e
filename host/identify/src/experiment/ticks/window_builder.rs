//! Builder of the windows that ticks give.

use gantry_tau_system::output::Name;
use nalgebra::{SVector, Vector6};

use super::Source;
use crate::experiment::windows::{Mean, Means, TICK_S, WindowRules};
use crate::measurements::FileError;
use crate::measurements::springs::{Noise, Window};

/// Most sentences about levels without a window.
const LISTED: usize = 5;

/// Windows, and the names in them.
pub(super) struct WindowBuilder<const N: usize> {
    pub(super) rules: WindowRules,
    pub(super) series: Vec<Name>,
    pub(super) mountings: Vec<Name>,
    pub(super) windows: Vec<Window<N>>,
    pub(super) missed: Vec<String>,
}

/// A level of a series.
#[derive(Clone, Debug)]
pub(super) struct SeriesLevel {
    /// First line of its ticks.
    pub(super) line: u64,
    pub(super) series: Name,
    pub(super) mounting: Name,
    /// Pose, by index.
    pub(super) pose: usize,
    pub(super) window: Name,
    pub(super) stroke: i8,
}

impl<const N: usize> WindowBuilder<N> {
    pub(super) fn new(source: &Source<'_, N>) -> Self {
        let rules = WindowRules::new(source.setup.noise.unwrap_or(Noise::USUAL));
        Self {
            rules,
            series: Vec::new(),
            mountings: Vec::new(),
            windows: Vec::new(),
            missed: Vec::new(),
        }
    }

    /// Adds the window of a level under a load; `end_s` is the time of its last tick, and gauges
    /// that are not `read` have no reading.
    pub(super) fn add(
        &mut self,
        level: &SeriesLevel,
        means: &Means<N>,
        load: Vector6<f64>,
        end_s: f64,
        read: &[bool],
    ) {
        // One window does not show how well a gauge repeats: its noise is the stated one at least,
        // as of a live campaign.
        let min_sd_m = self.rules.noise.gauge_um * 1e-6;
        self.windows.push(Window {
            line: level.line,
            series: index_of(&mut self.series, &level.series),
            mounting: index_of(&mut self.mountings, &level.mounting),
            pose: level.pose,
            window: level.window.clone(),
            stroke: level.stroke,
            q: means.q,
            load,
            pushes_n: SVector::zeros(),
            readings_m: of_read(read, &means.gauges, |mean| mean.length_m),
            sds_m: of_read(read, &means.gauges, |mean| mean.sd_m.max(min_sd_m)),
            // The middle of the window.
            time_s: Some(end_s - 0.5 * means.samples as f64 * TICK_S),
        });
    }

    /// Ends with the levels that gave no window at their first try; those of the table that another
    /// try gave are not missed.
    pub(super) fn end(
        mut self,
        source: &Source<'_, N>,
        without: &[SeriesLevel],
    ) -> Result<Self, FileError> {
        let path = source.path.display().to_string();
        if self.windows.is_empty() {
            let reason = "no level settles, and stays calm for a window of 2 s";
            return Err(FileError::whole(&path, reason));
        }
        if self
            .windows
            .iter()
            .all(|window| window.readings_m.iter().all(Option::is_none))
        {
            let reason =
                "no gauge has a reading: with --ask-gauges they are in the table of windows only";
            return Err(FileError::whole(&path, reason));
        }
        let missed: Vec<&SeriesLevel> = without.iter().filter(|level| !self.has(level)).collect();
        let (listed, others) = missed.split_at(missed.len().min(LISTED));
        self.missed = listed
            .iter()
            .map(|level| {
                format!(
                    "series {}, window {} (line {}) does not settle: left out",
                    level.series, level.window, level.line
                )
            })
            .collect();
        if !others.is_empty() {
            self.missed.push(format!(
                "{} more levels do not settle: left out",
                others.len()
            ));
        }
        Ok(self)
    }

    /// True if a level has a window.
    fn has(&self, level: &SeriesLevel) -> bool {
        self.windows.iter().any(|window| {
            window.window == level.window
                && self
                    .series
                    .get(window.series)
                    .is_some_and(|name| *name == level.series)
        })
    }
}

/// Values of the gauges that are `read`.
fn of_read(read: &[bool], gauges: &[Mean], value: impl Fn(&Mean) -> f64) -> Vec<Option<f64>> {
    read.iter()
        .zip(gauges)
        .map(|(is_read, mean)| is_read.then(|| value(mean)))
        .collect()
}

/// Index of a name, which is added where it is new. The last one is the likeliest.
fn index_of(names: &mut Vec<Name>, name: &Name) -> usize {
    names
        .iter()
        .rposition(|other| other == name)
        .unwrap_or_else(|| {
            names.push(name.clone());
            names.len() - 1
        })
}
