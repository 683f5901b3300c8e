//! Windows from a table of ticks whose levels are named.

use std::collections::HashMap;

use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_server::links::gauges::MAX_GAUGES;
use gantry_tau_system::output::Name;
use nalgebra::Vector6;

use super::window_builder::{SeriesLevel, WindowBuilder};
use super::{GuardedFile, Source, TARE, header};
use crate::experiment::windows::{InstrumentSample, Means, Progress, WindowCollector};
use crate::measurements::FileError;
use crate::measurements::springs::{MAX_VALUES, stroke};
use crate::measurements::table::{CsvTable, MAX_ROWS, TableRow};

/// Places of the columns, in the order of the header.
struct TickColumns {
    places: Vec<usize>,
    axes: usize,
}

/// Columns before those of the axes, by their place in the header.
const SERIES: usize = 0;
const MOUNTING: usize = 1;
const POSE: usize = 2;
const WINDOW: usize = 3;
const TIME: usize = 5;
const TICK: usize = 6;
const AXES: usize = 7;

impl TickColumns {
    fn load(&self) -> &[usize] {
        &self.places[AXES + self.axes..][..6]
    }

    fn gauges(&self) -> &[usize] {
        &self.places[AXES + self.axes + 6..]
    }
}

/// Error of a series that is in two places.
const ONE_PLACE: &str = "a series has one mounting and one pose";

/// Rows of one series that stand together.
#[derive(Default)]
struct OpenSeries {
    /// Of the series and of its mounting; `None` before the first row.
    names: Option<(Name, Name)>,
    pose: usize,
    /// Gauges that have had a reading.
    is_read: Vec<bool>,
    /// Zero of the force sensor.
    tare: Option<Vector6<f64>>,
}

/// A level that is being read.
struct OpenLevel {
    level: SeriesLevel,
    is_taken: bool,
    last_tick: u64,
}

struct LevelReader<'a, const N: usize> {
    source: &'a Source<'a, N>,
    builder: WindowBuilder<N>,
    collector: WindowCollector<N>,
    series: OpenSeries,
    /// Mounting and pose of each series.
    places: HashMap<Name, (Name, usize)>,
    open: Option<OpenLevel>,
    /// Number of levels.
    count: usize,
    /// Levels that gave no window.
    without: Vec<SeriesLevel>,
}

pub(super) fn read<const N: usize>(
    source: &Source<'_, N>,
    ticks: GuardedFile<'_>,
) -> Result<WindowBuilder<N>, FileError> {
    let watch = ticks.watch;
    let header = header::<N>(&source.setup.gauges);
    let table = CsvTable::begin(source.path, ticks, &header, |_| false)?;
    let columns = TickColumns {
        places: header
            .iter()
            .filter_map(|column| table.place(column))
            .collect(),
        axes: N,
    };
    let builder = WindowBuilder::new(source);
    let mut levels = LevelReader {
        source,
        collector: WindowCollector::new(builder.rules),
        builder,
        series: OpenSeries::default(),
        places: HashMap::new(),
        open: None,
        count: 0,
        without: Vec::new(),
    };
    table.each(|row| {
        watch.since_row.set(0);
        levels.feed(&columns, row)
    })?;
    levels.close();
    levels.builder.end(source, &levels.without)
}

impl<const N: usize> LevelReader<'_, N> {
    /// Takes the next row.
    fn feed(&mut self, columns: &TickColumns, row: &TableRow<'_>) -> Result<(), FileError> {
        self.follow_series(columns, row)?;
        let (sample, time_s) = self.sample(columns, row)?;
        let window = row.text_at(columns.places[WINDOW]);
        if window.is_empty() {
            self.close();
            return Ok(());
        }
        let stroke = stroke(row)?;
        let is_same = self
            .open
            .as_ref()
            .is_some_and(|open| open.level.window == *window && open.level.stroke == stroke);
        if !is_same {
            self.close();
            self.begin(
                row,
                row.name_at(columns.places[WINDOW])?,
                stroke,
                sample.tick,
            )?;
        }
        let Some(open) = &mut self.open else {
            return Ok(());
        };
        // Another session counts from elsewhere.
        if sample.tick < open.last_tick {
            self.collector.restart();
        }
        open.last_tick = sample.tick;
        if open.is_taken {
            return Ok(());
        }
        match self.collector.feed(&sample) {
            Progress::Taken(means) => self.accept_window(&means, time_s),
            Progress::Settling | Progress::Averaging | Progress::Refused { .. } => Ok(()),
        }
    }

    /// Begins another series where the row is of another one.
    fn follow_series(
        &mut self,
        columns: &TickColumns,
        row: &TableRow<'_>,
    ) -> Result<(), FileError> {
        let [series_text, mounting_text, pose_text] =
            [SERIES, MOUNTING, POSE].map(|column| row.text_at(columns.places[column]));
        let poses: &[(Name, Pose)] = &self.source.setup.poses;
        if let Some((_, mounting)) = self
            .series
            .names
            .as_ref()
            .filter(|(name, _)| name == series_text)
        {
            if *mounting != *mounting_text || poses[self.series.pose].0 != *pose_text {
                return Err(row.error("series", ONE_PLACE));
            }
            return Ok(());
        }
        let name = row.name_at(columns.places[SERIES])?;
        let mounting = row.name_at(columns.places[MOUNTING])?;
        let Some(pose) = poses.iter().position(|(name, _)| name == pose_text) else {
            return Err(row.error("pose", format_args!("{pose_text:?} is not in the set-up")));
        };
        if let Err(reason) = &self.source.places[pose] {
            return Err(row.error(
                "pose",
                format_args!("the robot file's machine does not take it: {reason}"),
            ));
        }
        let place = (mounting.clone(), pose);
        if *self
            .places
            .entry(name.clone())
            .or_insert_with(|| place.clone())
            != place
        {
            return Err(row.error("series", ONE_PLACE));
        }
        self.close();
        let is_read = vec![false; self.source.setup.gauges.len()];
        self.series = OpenSeries {
            names: Some((name, mounting)),
            pose,
            is_read,
            tare: None,
        };
        Ok(())
    }

    /// Reads the instruments of a row, and its time.
    fn sample(
        &mut self,
        columns: &TickColumns,
        row: &TableRow<'_>,
    ) -> Result<(InstrumentSample<N>, f64), FileError> {
        let [max_q, max_um, max_n, max_nm, max_s] = MAX_VALUES;
        let tick = row.text_at(columns.places[TICK]);
        let Ok(tick) = tick.parse() else {
            return Err(row.error(
                "tick",
                format_args!("{tick:?} is not a whole number from 0"),
            ));
        };
        let mut sample = InstrumentSample {
            tick,
            q: [0.0; N],
            wrench: [0.0; 6],
            lengths_m: [0.0; MAX_GAUGES],
            gauges: self.source.setup.gauges.len(),
        };
        for (q, place) in sample.q.iter_mut().zip(&columns.places[AXES..]) {
            *q = row.number_at(*place, max_q)?;
        }
        for (component, place) in columns.load().iter().enumerate() {
            sample.wrench[component] =
                row.number_at(*place, if component < 3 { max_n } else { max_nm })?;
        }
        for (gauge, place) in columns.gauges().iter().enumerate() {
            let is_read = &mut self.series.is_read[gauge];
            if row.text_at(*place).is_empty() {
                // Away, if the series reads it: then the level begins again.
                sample.lengths_m[gauge] = if *is_read { f64::NAN } else { 0.0 };
                continue;
            }
            sample.lengths_m[gauge] = row.number_at(*place, max_um)? * 1e-6;
            if !*is_read {
                *is_read = true;
                self.collector.restart();
            }
        }
        Ok((sample, row.number_at(columns.places[TIME], max_s)?))
    }

    fn begin(
        &mut self,
        row: &TableRow<'_>,
        window: Name,
        stroke: i8,
        tick: u64,
    ) -> Result<(), FileError> {
        if self.series.tare.is_none() && stroke != 0 {
            let reason = "the series does not begin with its slack level, stroke 0, where the sensor is tared, or that does not settle; remove its rows";
            return Err(row.error("stroke", reason));
        }
        self.count += 1;
        if self.count > MAX_ROWS {
            return Err(row.error("window", format_args!("has more than {MAX_ROWS} levels")));
        }
        let Some((series, mounting)) = self.series.names.clone() else {
            return Ok(());
        };
        let level = SeriesLevel {
            line: row.line(),
            series,
            mounting,
            pose: self.series.pose,
            window,
            stroke,
        };
        self.open = Some(OpenLevel {
            level,
            is_taken: false,
            last_tick: tick,
        });
        self.collector.restart();
        Ok(())
    }

    /// Ends the level.
    fn close(&mut self) {
        if let Some(open) = self
            .open
            .take()
            .filter(|open| !open.is_taken && open.level.window != *TARE)
        {
            self.without.push(open.level);
        }
    }

    /// Accepts the window of the level, or the tare.
    fn accept_window(&mut self, means: &Means<N>, time_s: f64) -> Result<(), FileError> {
        let Some(OpenLevel {
            level, is_taken, ..
        }) = &mut self.open
        else {
            return Ok(());
        };
        let Ok(place) = &self.source.places[level.pose] else {
            return Ok(());
        };
        *is_taken = true;
        let prediction = self.source.prediction;
        let shown = Vector6::from(means.wrench);
        let is_tare = level.window == *TARE;
        if is_tare || self.series.tare.is_none() {
            self.series.tare = Some(shown - prediction.weight_seen(&place.unloaded.pose.rotation));
        }
        if !is_tare {
            let seen = shown - self.series.tare.unwrap_or_default();
            let load = prediction
                .load(&seen, &means.q, &place.unloaded)
                .map_err(|error| {
                    FileError::at(
                        &self.source.path.display().to_string(),
                        level.line,
                        "window",
                        error,
                    )
                })?;
            self.builder
                .add(level, means, load, time_s, &self.series.is_read);
        }
        Ok(())
    }
}
