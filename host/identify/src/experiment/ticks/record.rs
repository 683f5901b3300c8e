//! Windows from a recording of `serve --record`, whose levels are those of the plan.
//!
//! A recording knows no series: the plan is followed in its order. A level is pulled where the
//! machine stands in the pose of the series and the load of the last tenth of a second is that of
//! the level, to the tolerance of a live campaign. Of the slack level the last window before the
//! pull counts, as strap and gauges may be mounted meanwhile. A strap that is let go in the middle
//! begins its series again.

use std::path::Path;

use gantry_tau_core::units::PositionNm;
use gantry_tau_record::recording::CsvRecord;
use gantry_tau_server::links::gauges::MAX_GAUGES;
use gantry_tau_server::record::TickRecord;
use nalgebra::Vector6;

use super::window_builder::{SeriesLevel, WindowBuilder};
use super::{GuardedFile, Source};
use crate::experiment::pull::{Pull, tolerance_n};
use crate::experiment::table::window_name;
use crate::experiment::windows::{InstrumentSample, Means, Progress, TICK_S, WindowCollector};
use crate::measurements::FileError;
use crate::measurements::plan::{self, Plan, PlannedSeries};
use crate::measurements::springs::{LOAD, MAX_VALUES};
use crate::measurements::table::{CsvTable, TableRow};

/// Places of the columns.
struct RecordingColumns {
    tick: usize,
    nominal: Vec<usize>,
    actual: Vec<usize>,
    load: Vec<usize>,
    /// Of each gauge of the set-up; `None` for one that is not recorded.
    gauges: Vec<Option<usize>>,
}

impl RecordingColumns {
    fn of<const N: usize>(plan: &Plan<N>, place: impl Fn(&str) -> Option<usize>) -> Self {
        let [nominal, actual] = ["nominal", "actual"].map(|name| {
            let columns = (1..=N).map(|axis| format!("{name}_{axis}_nm"));
            columns.filter_map(|column| place(&column)).collect()
        });
        Self {
            tick: place("tick").unwrap_or_default(),
            nominal,
            actual,
            load: LOAD.iter().filter_map(|column| place(column)).collect(),
            gauges: plan
                .gauges
                .iter()
                .map(|gauge| place(&format!("{}_um", gauge.name)))
                .collect(),
        }
    }
}

/// A window, and where it belongs.
struct LevelWindow<const N: usize> {
    level: SeriesLevel,
    means: Means<N>,
    end_s: f64,
}

/// Follows a plan through a recording.
struct PlanFollower<'a, const N: usize> {
    source: &'a Source<'a, N>,
    plan: &'a Plan<N>,
    /// Gauges of the set-up that the recording has.
    is_recorded: Vec<bool>,
    collector: WindowCollector<N>,
    series: usize,
    /// Windows of the series.
    found: Vec<LevelWindow<N>>,
    /// Most windows that the series has had.
    most_found: usize,
    /// Window of the slack level, until the pull begins.
    slack: Option<LevelWindow<N>>,
    pull: Pull,
    /// Line in which the level began.
    line: u64,
    builder: WindowBuilder<N>,
}

pub(super) fn read<const N: usize>(
    setup: &Path,
    source: &Source<'_, N>,
    ticks: GuardedFile<'_>,
) -> Result<WindowBuilder<N>, FileError> {
    let plan = plan::of(setup, source.setup.clone(), &source.metres_per_q)?;
    for series in &plan.series {
        if let Err(reason) = &source.places[series.pose] {
            let key = format!("pose.{}", plan.poses[series.pose].0);
            return Err(FileError::key(
                setup,
                key,
                format_args!("the robot file's machine does not take it: {reason}"),
            ));
        }
    }
    let watch = ticks.watch;
    // Recordings of version 0.1 have ticks alone.
    let (time, required): (Vec<_>, Vec<_>) = TickRecord::<N>::header()
        .into_iter()
        .partition(|column| column == "time_s");
    let table = CsvTable::begin(source.path, ticks, &required, |column| {
        time.iter().any(|time| time == column)
    })?;
    let columns = RecordingColumns::of(&plan, |column| table.place(column));
    if columns.gauges.iter().all(Option::is_none) {
        let reason = "a recording has the gauges gauge_x, gauge_y and gauge_z, and the set-up names none of them";
        return Err(FileError::key(setup, "gauge", reason));
    }
    let builder = WindowBuilder::new(source);
    let mut follower = PlanFollower {
        source,
        plan: &plan,
        is_recorded: columns.gauges.iter().map(Option::is_some).collect(),
        collector: WindowCollector::new(builder.rules),
        series: 0,
        found: Vec::new(),
        most_found: 0,
        slack: None,
        pull: Pull::default(),
        line: 0,
        builder,
    };
    table.each(|row| {
        watch.since_row.set(0);
        follower.feed(&columns, row)
    })?;
    follower.end()
}

impl<const N: usize> PlanFollower<'_, N> {
    fn feed(&mut self, columns: &RecordingColumns, row: &TableRow<'_>) -> Result<(), FileError> {
        let Some(series) = self.plan.series.get(self.series) else {
            return Ok(());
        };
        let (sample, nominal) = sample(columns, row, series, self.source)?;
        let is_in_place = self.source.places[series.pose]
            .as_ref()
            .is_ok_and(|place| place.has(&nominal));
        if let Some(load) = self.pull.add(&Vector6::from(sample.wrench)) {
            self.judge(series, is_in_place, &load, row.line());
        }
        if !self.pull.is_at_level || !is_in_place {
            return Ok(());
        }
        if let Progress::Taken(means) = self.collector.feed(&sample) {
            self.accept_window(series, means, sample.tick as f64 * TICK_S);
        }
        Ok(())
    }

    /// Index of the level that is waited for.
    fn level(&self) -> usize {
        self.found.len()
    }

    /// Judges the pull of the last tenth of a second.
    fn judge(&mut self, series: &PlannedSeries, is_in_place: bool, load: &Vector6<f64>, line: u64) {
        if self.slack.is_some() && is_in_place && is_pulled(series, 1, load) {
            self.found.extend(self.slack.take());
            self.most_found = self.most_found.max(1);
            self.pull.is_at_level = false;
        }
        let was_pulled = self.level() > 0
            && level_n(series, self.level() - 1) > 0.0
            && level_n(series, self.level()) > 0.0;
        if was_pulled && is_in_place && is_pulled(series, 0, load) {
            self.found.clear();
        }
        let is_at_level = is_in_place && is_pulled(series, self.level(), load);
        if is_at_level && !self.pull.is_at_level {
            self.collector.restart();
            self.line = line;
        }
        self.pull.is_at_level = is_at_level;
    }

    fn accept_window(&mut self, series: &PlannedSeries, means: Means<N>, end_s: f64) {
        let index = self.level();
        let level = SeriesLevel {
            line: self.line,
            series: series.name.clone(),
            mounting: self.plan.mountings[series.mounting].clone(),
            pose: series.pose,
            window: window_name(index),
            stroke: series.strokes()[index],
        };
        let found = LevelWindow {
            level,
            means,
            end_s,
        };
        self.pull.is_at_level = false;
        if index == 0 && series.levels_n[1] > 0.0 {
            self.slack = Some(found);
            return;
        }
        self.found.push(found);
        self.most_found = self.most_found.max(self.level());
        if self.level() == series.levels_n.len() {
            self.finish(series);
        }
    }

    /// Adds the windows of a series, and goes on to the next.
    fn finish(&mut self, series: &PlannedSeries) {
        let recorded = self.is_recorded.iter().enumerate();
        let read: Vec<bool> = recorded
            .map(|(gauge, is)| *is && series.gauges.contains(&gauge))
            .collect();
        for LevelWindow {
            level,
            means,
            end_s,
        } in self.found.drain(..)
        {
            self.builder
                .add(&level, &means, Vector6::from(means.wrench), end_s, &read);
        }
        self.series += 1;
        self.most_found = 0;
    }

    fn end(self) -> Result<WindowBuilder<N>, FileError> {
        let Some(series) = self.plan.series.get(self.series) else {
            return self.builder.end(self.source, &[]);
        };
        let level = self.most_found;
        let reason = format!(
            "series {}, window {} ({} N) of the plan is not in it: a recording shows the whole plan in its order, each level calm for 6 s",
            series.name,
            window_name(level),
            level_n(series, level)
        );
        Err(FileError::whole(
            &self.source.path.display().to_string(),
            reason,
        ))
    }
}

/// Force of a level, N; 0 beyond the last.
fn level_n(series: &PlannedSeries, level: usize) -> f64 {
    series.levels_n.get(level).copied().unwrap_or_default()
}

/// True if a load is that of a level.
fn is_pulled(series: &PlannedSeries, level: usize, load: &Vector6<f64>) -> bool {
    series.levels_n.get(level).is_some_and(|&level_n| {
        let off_n = load.fixed_rows::<3>(0) - series.direction * level_n;
        off_n.norm() <= tolerance_n(&series.levels_n, level_n)
    })
}

/// Returns the instruments of a row, and the nominal positions. Gauges that are not read, or not
/// recorded, show 0.
fn sample<const N: usize>(
    columns: &RecordingColumns,
    row: &TableRow<'_>,
    series: &PlannedSeries,
    source: &Source<'_, N>,
) -> Result<(InstrumentSample<N>, [PositionNm; N]), FileError> {
    let [_, max_um, max_n, max_nm, _] = MAX_VALUES;
    let tick =
        u64::try_from(whole(row, columns.tick)?).map_err(|_| row.error("tick", "is below 0"))?;
    let mut nominal = [PositionNm(0); N];
    let mut q = [0.0; N];
    for axis in 0..N {
        nominal[axis] = PositionNm(whole(row, columns.nominal[axis])?);
        let actual = PositionNm(whole(row, columns.actual[axis])?);
        q[axis] = actual.to_metres().0 / source.metres_per_q[axis];
    }
    let mut wrench = [0.0; 6];
    for (component, place) in columns.load.iter().enumerate() {
        if row.text_at(*place).is_empty() {
            return Err(row.error_at(*place, "is empty: this machine records no load"));
        }
        wrench[component] = row.number_at(*place, if component < 3 { max_n } else { max_nm })?;
    }
    let mut lengths_m = [0.0; MAX_GAUGES];
    for gauge in &series.gauges {
        if let Some(place) = columns.gauges[*gauge] {
            lengths_m[*gauge] = row.number_at(place, max_um)? * 1e-6;
        }
    }
    Ok((
        InstrumentSample {
            tick,
            q,
            wrench,
            lengths_m,
            gauges: columns.gauges.len(),
        },
        nominal,
    ))
}

fn whole(row: &TableRow<'_>, place: usize) -> Result<i64, FileError> {
    let text = row.text_at(place);
    text.parse()
        .map_err(|_| row.error_at(place, format_args!("{text:?} is not a whole number")))
}
