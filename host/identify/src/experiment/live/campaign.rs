//! Progress of a campaign: pose, mounting, tare, levels.

mod clock;
mod keys;
mod prompts;

use std::collections::HashSet;
use std::path::Path;

use gantry_tau_core::units::PositionNm;
use gantry_tau_machine::elastic::Equilibrium;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use nalgebra::Vector6;

use super::LiveReport;
use super::probe::ProbeTick;
use crate::experiment::ExperimentError;
use crate::experiment::plan_pose::PlanPose;
use crate::experiment::prediction::{NotBorne, Prediction};
use crate::experiment::pull::{Pull, tolerance_n};
use crate::experiment::table::{WindowRow, WindowTable};
use crate::experiment::ticks::table::{SeriesPart, TickTable};
use crate::experiment::windows::{
    InstrumentSample, Means, Progress, TICK_S, WindowCollector, WindowRules,
};
use crate::measurements::plan::Plan;
use clock::Clock;

/// Ticks that the nominal positions must stand still.
const STILL_TICKS: u32 = 500;
/// Ticks that gauges must be away to count as mounted again; and, in the middle of a series, to end
/// it where no operator is asked.
const REMOUNT_TICKS: u32 = 200;
const LOST_TICKS: u32 = 1_000;
/// State of a campaign: the event that it waits for.
#[derive(Clone, Debug, PartialEq)]
enum CampaignStage<const N: usize> {
    /// The machine is to stand in the pose.
    Pose { still: u32 },
    /// Strap and gauges are to be mounted, and the strap slack.
    Mounting,
    /// The sensor is tared; the window is that of the first level.
    Tare,
    /// The strap is to pull with the force of the level.
    Level,
    /// The readings are to be typed in.
    Typing { means: Means<N>, load: Vector6<f64> },
    /// All windows are taken.
    Done,
}

/// A campaign that is being measured.
pub(super) struct LiveCampaign<const N: usize> {
    plan: Plan<N>,
    table: WindowTable,
    raw: Option<TickTable>,
    prediction: Prediction<N>,
    places: Vec<PlanPose<N>>,
    has_gauges: bool,
    is_unattended: bool,
    series: usize,
    level: usize,
    stage: CampaignStage<N>,
    /// Series and levels that were skipped.
    skipped: HashSet<(usize, usize)>,
    last_taken: Option<(usize, usize)>,
    tare: Option<Vector6<f64>>,
    collector: WindowCollector<N>,
    pull: Pull,
    /// Ticks that the gauges have been away.
    away: u32,
    was_remounted: bool,
    is_confirmed: bool,
    last_nominal: Option<[PositionNm; N]>,
    clock: Clock,
    reminded: u64,
    taken: usize,
}

impl<const N: usize> LiveCampaign<N> {
    pub(super) fn new<K: MachineKind<N>>(
        robot: &RobotFile<K, N>,
        mut plan: Plan<N>,
        table: WindowTable,
        prediction: Prediction<N>,
        raw: Option<&Path>,
    ) -> Result<Self, ExperimentError> {
        let places = plan.poses.iter().map(|(name, pose)| {
            PlanPose::of(robot, &prediction, pose).map_err(|reason| ExperimentError::Pose {
                pose: name.clone(),
                reason,
            })
        });
        let places = places.collect::<Result<Vec<PlanPose<N>>, ExperimentError>>()?;
        let skipped = table.remounted(&mut plan);
        let raw = raw
            .map(|path| TickTable::open(path, &plan, !table.is_empty()))
            .transpose()?;
        let rules = WindowRules::new(plan.noise);
        let clock = Clock::from(table.last_s());
        let mut campaign = Self {
            plan,
            table,
            raw,
            prediction,
            places,
            has_gauges: true,
            is_unattended: false,
            series: 0,
            level: 0,
            stage: CampaignStage::Pose { still: 0 },
            skipped,
            last_taken: None,
            tare: None,
            collector: WindowCollector::new(rules),
            pull: Pull::default(),
            away: 0,
            was_remounted: false,
            is_confirmed: false,
            last_nominal: None,
            clock,
            reminded: 0,
            taken: 0,
        };
        campaign.seek();
        Ok(campaign)
    }

    pub(super) const fn set_instruments(&mut self, has_gauges: bool, is_unattended: bool) {
        self.has_gauges = has_gauges;
        self.is_unattended = is_unattended;
    }

    /// True if the series is to be measured with compensation.
    pub(super) fn is_compensated(&self) -> bool {
        self.plan
            .series
            .get(self.series)
            .is_some_and(|series| series.compensated)
    }

    pub(super) fn is_done(&self) -> bool {
        self.stage == CampaignStage::Done
    }

    pub(super) fn report(&self) -> LiveReport {
        let planned = self.plan.series.iter().enumerate();
        let missing = planned
            .flat_map(|(index, series)| (0..series.levels_n.len()).map(move |level| (index, level)))
            .filter(|(series, level)| !self.table.has(&self.plan, *series, *level))
            .count();
        LiveReport {
            taken: self.taken,
            missing,
        }
    }

    /// The session is lost: pose and tare must be found again.
    pub(super) fn pause(&mut self) {
        self.clock.pause();
        if !self.is_done() {
            self.begin();
        }
    }

    /// Begins with the pose of the series.
    fn begin(&mut self) {
        self.stage = CampaignStage::Pose { still: 0 };
        self.tare = None;
        self.is_confirmed = false;
        self.last_nominal = None;
        self.pull = Pull::default();
        self.collector.restart();
    }

    /// True if a window is to be taken.
    fn is_wanted(&self, series: usize, level: usize) -> bool {
        !self.table.has(&self.plan, series, level) && !self.skipped.contains(&(series, level))
    }

    /// Goes to the next window that is to be taken.
    fn seek(&mut self) {
        let from = self.series;
        while let Some(series) = self.plan.series.get(self.series) {
            let levels = series.levels_n.len();
            if let Some(level) =
                (self.level..levels).find(|level| self.is_wanted(self.series, *level))
            {
                self.level = level;
                self.pull.is_at_level = false;
                if from != self.series || self.tare.is_none() {
                    self.was_remounted &= from == self.series;
                    self.begin();
                } else {
                    self.stage = CampaignStage::Level;
                    tracing::info!("pull to {} N", self.level_n());
                }
                return;
            }
            self.series += 1;
            self.level = 0;
        }
        self.stage = CampaignStage::Done;
    }

    fn level_n(&self) -> f64 {
        self.plan.series[self.series].levels_n[self.level]
    }

    /// Leaves the rest of a series out.
    fn give_up(&mut self) {
        let levels = self.plan.series[self.series].levels_n.len();
        self.skipped
            .extend((0..levels).map(|level| (self.series, level)));
        self.tare = None;
        self.seek();
    }

    /// Takes what the instruments show in a tick.
    pub(super) fn feed(&mut self, tick: &ProbeTick<N>) -> Result<(), ExperimentError> {
        let time_s = self.clock.at(tick.sample.tick);
        if self.is_done() {
            return Ok(());
        }
        let sample = self.of_series(&tick.sample);
        if !self.note_gauges(&sample) {
            return Ok(());
        }
        let is_in_place = self.is_in_place(&tick.nominal);
        match &mut self.stage {
            CampaignStage::Pose { still } => {
                *still = if is_in_place && self.last_nominal == Some(tick.nominal) {
                    *still + 1
                } else {
                    0
                };
                if *still >= STILL_TICKS {
                    self.stage = CampaignStage::Mounting;
                    tracing::info!("{}", self.mounting_text());
                } else {
                    self.remind_at(tick.sample.tick, &|campaign| {
                        campaign.pose_text(&tick.nominal)
                    });
                }
            }
            CampaignStage::Done | CampaignStage::Typing { .. } => {}
            _ if !is_in_place => {
                tracing::warn!("the machine has left the pose");
                self.begin();
            }
            CampaignStage::Mounting => self.mount(&sample),
            CampaignStage::Tare => self.tare(&sample, time_s)?,
            CampaignStage::Level => self.pull(&sample, time_s)?,
        }
        self.last_nominal = Some(tick.nominal);
        Ok(())
    }

    /// Returns the sample without the gauges that the series does not read.
    fn of_series(&self, sample: &InstrumentSample<N>) -> InstrumentSample<N> {
        let mut sample = *sample;
        let read = &self.plan.series[self.series].gauges;
        for (gauge, length_m) in sample.lengths_m.iter_mut().enumerate() {
            if !read.contains(&gauge) {
                *length_m = 0.0;
            }
        }
        sample
    }

    /// Takes note of gauges that are away. False if that has ended the series: with no operator to
    /// ask, they may have been mounted again.
    fn note_gauges(&mut self, sample: &InstrumentSample<N>) -> bool {
        let is_away = sample
            .lengths_m
            .iter()
            .take(sample.gauges)
            .any(|length_m| length_m.is_nan());
        self.away = if is_away { self.away + 1 } else { 0 };
        self.was_remounted |= self.away >= REMOUNT_TICKS;
        if self.away != LOST_TICKS || self.stage != CampaignStage::Level {
            return true;
        }
        tracing::warn!(
            "series {}: the gauges are away",
            self.plan.series[self.series].name
        );
        if self.is_unattended {
            self.give_up();
            self.was_remounted = true;
        }
        !self.is_unattended
    }

    fn is_in_place(&self, nominal: &[PositionNm; N]) -> bool {
        self.places[self.plan.series[self.series].pose].has(nominal)
    }

    fn mount(&mut self, sample: &InstrumentSample<N>) {
        let is_new = !(0..self.plan.series[self.series].levels_n.len())
            .any(|level| self.table.has(&self.plan, self.series, level));
        let is_ready = if self.is_unattended {
            !is_new || self.was_remounted
        } else {
            self.is_confirmed
        };
        if is_ready && self.away == 0 {
            self.collector.restart();
            self.stage = CampaignStage::Tare;
            tracing::info!("the sensor is tared; keep the strap slack");
        } else {
            self.remind_at(sample.tick, &|campaign| campaign.mounting_text());
        }
    }

    /// Takes the window of the first level: what the sensor shows there is its zero.
    fn tare(&mut self, sample: &InstrumentSample<N>, time_s: f64) -> Result<(), ExperimentError> {
        self.write_tick(
            if self.level == 0 {
                SeriesPart::Level(0)
            } else {
                SeriesPart::Tare
            },
            sample,
            time_s,
        )?;
        if let Progress::Taken(means) = self.collector.feed(sample) {
            let rotation = self.unloaded().pose.rotation;
            self.tare = Some(Vector6::from(means.wrench) - self.prediction.weight_seen(&rotation));
            self.pull.rotation = rotation;
            if self.level == 0 {
                return self.accept_window(means, time_s);
            }
            self.seek();
        }
        Ok(())
    }

    /// Waits for the pull of the level, and takes its window.
    fn pull(&mut self, sample: &InstrumentSample<N>, time_s: f64) -> Result<(), ExperimentError> {
        let Some(tare) = self.tare else { return Ok(()) };
        let raw = Vector6::from(sample.wrench) - tare;
        if let Some(seen) = self.pull.add(&raw) {
            self.note_pull(&seen, sample)?;
        }
        self.write_tick(
            if self.pull.is_at_level {
                SeriesPart::Level(self.level)
            } else {
                SeriesPart::Way
            },
            sample,
            time_s,
        )?;
        if !self.pull.is_at_level {
            return Ok(());
        }
        match self.collector.feed(sample) {
            Progress::Settling | Progress::Averaging => {}
            Progress::Refused { drift_n } => {
                tracing::info!(
                    "the force has drifted by {drift_n:.1} N; the window is taken again"
                );
            }
            Progress::Taken(means) => return self.accept_window(means, time_s),
        }
        Ok(())
    }

    fn write_tick(
        &mut self,
        part: SeriesPart,
        sample: &InstrumentSample<N>,
        time_s: f64,
    ) -> Result<(), ExperimentError> {
        match &mut self.raw {
            Some(raw) => raw.write(&self.plan, (self.series, part), time_s, sample),
            None => Ok(()),
        }
    }

    /// Judges the pull of the last tenth of a second.
    fn note_pull(
        &mut self,
        seen: &Vector6<f64>,
        sample: &InstrumentSample<N>,
    ) -> Result<(), ExperimentError> {
        let load = self.load(seen, &sample.q)?;
        let series = &self.plan.series[self.series];
        let force_n = load.fixed_rows::<3>(0).dot(&series.direction);
        let is_at_level =
            (force_n - self.level_n()).abs() <= tolerance_n(&series.levels_n, self.level_n());
        if is_at_level && !self.pull.is_at_level {
            self.collector.restart();
            tracing::info!("{}: {force_n:.0} N; settling", self.window_text());
        }
        self.pull.force_n = force_n;
        self.pull.is_at_level = is_at_level;
        if !is_at_level {
            self.remind_at(sample.tick, &|campaign| campaign.pull_text());
        }
        Ok(())
    }

    fn unloaded(&self) -> &Equilibrium<N> {
        &self.places[self.plan.series[self.series].pose].unloaded
    }

    fn load(&mut self, seen: &Vector6<f64>, q: &[f64; N]) -> Result<Vector6<f64>, ExperimentError> {
        let start = *self.unloaded();
        let (load, rotation) = self
            .prediction
            .load_and_turn(seen, q, &start)
            .map_err(|error| self.failed(error))?;
        self.pull.rotation = rotation;
        Ok(load)
    }

    fn failed(&self, error: NotBorne) -> ExperimentError {
        let series = self.plan.series[self.series].name.clone();
        ExperimentError::Sensor {
            series,
            level_n: self.level_n(),
            error,
        }
    }

    /// Accepts a window; with gauges that are typed in, asks for them first.
    fn accept_window(&mut self, means: Means<N>, time_s: f64) -> Result<(), ExperimentError> {
        let tare = self.tare.unwrap_or_default();
        let load = self.load(&(Vector6::from(means.wrench) - tare), &means.q)?;
        if self.has_gauges {
            let gauges = &means.gauges;
            let min_sd_m = self.plan.noise.gauge_um * 1e-6;
            let lengths: Vec<f64> = gauges.iter().map(|mean| mean.length_m).collect();
            // One window does not show how well a gauge repeats: its noise is the stated one at
            // least.
            let sds: Vec<Option<f64>> = gauges
                .iter()
                .map(|mean| Some(mean.sd_m.max(min_sd_m)))
                .collect();
            return self.write(&means, load, &lengths, &sds, time_s);
        }
        tracing::info!(
            "type the readings of the gauges, um: {}",
            self.names_of_gauges().join(" ")
        );
        self.stage = CampaignStage::Typing { means, load };
        Ok(())
    }

    fn write(
        &mut self,
        means: &Means<N>,
        load: Vector6<f64>,
        lengths: &[f64],
        sds: &[Option<f64>],
        time_s: f64,
    ) -> Result<(), ExperimentError> {
        let read = &self.plan.series[self.series].gauges;

        let row = WindowRow {
            series: self.series,
            level: self.level,
            q: means.q,
            load,
            readings_m: lengths
                .iter()
                .enumerate()
                .map(|(gauge, length)| read.contains(&gauge).then_some(*length))
                .collect(),
            sds_m: sds
                .iter()
                .enumerate()
                .map(|(gauge, sd)| sd.filter(|_| read.contains(&gauge)))
                .collect(),
            // The middle of the window, which has just ended.
            time_s: time_s - 0.5 * means.samples as f64 * TICK_S,
            samples: means.samples,
        };
        self.table.write(&self.plan, &row)?;
        if let Some(raw) = &mut self.raw {
            raw.flush()?;
        }
        self.taken += 1;
        self.last_taken = Some((self.series, self.level));
        tracing::info!("{}: taken", self.window_text());
        self.level += 1;
        self.collector.restart();
        self.seek();
        Ok(())
    }
}

#[cfg(test)]
mod tests;
