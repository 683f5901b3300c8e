//! Plans: a set-up with the series that are to be measured. Its table may be empty or absent.

use std::path::{Path, PathBuf};

use gantry_tau_core::model::kinematics::Pose;
use nalgebra::Vector3;

use super::springs::{MOST, NamedGauge, Noise, Refused, SeriesEntry, Setup, SetupNoise, check_wrist, read_setup};
use super::{FileError, MAX_ROWS};
use crate::output::{MAX_NAME, Name};

/// Farthest hook from the tool centre point, m.
const FARTHEST_M: f64 = 10.0;

/// Longest name of a series of a plan, characters: room for the number that [`Plan::remount`] adds.
const MAX_SERIES_NAME: usize = MAX_NAME - 11;

/// A plan.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan<const N: usize> {
    /// Path of the table that the set-up names.
    pub table: PathBuf,
    /// Length of each axis per unit of `q`, m.
    pub metres_per_q: [f64; N],
    /// Noise of a window.
    pub noise: Noise,
    /// Uncertainty of the set-up.
    pub setup: SetupNoise,
    /// Poses, with their names.
    pub poses: Vec<(Name, Pose)>,
    /// Gauges.
    pub gauges: Vec<NamedGauge>,
    /// Names of the mountings.
    pub mountings: Vec<Name>,
    /// Series, in order.
    pub series: Vec<PlannedSeries>,
}

/// A series that is to be measured.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedSeries {
    /// Its name.
    pub name: Name,
    /// Pose, by index.
    pub pose: usize,
    /// Mounting, by index.
    pub mounting: usize,
    /// Hook of the strap, from the tool centre point of the unloaded machine, world axes, m.
    pub hook_m: Vector3<f64>,
    /// Direction of its pull, world axes; unit vector.
    pub direction: Vector3<f64>,
    /// Forces, in order, N: the first is 0, at which the sensor is tared.
    pub levels_n: Vec<f64>,
    /// Gauges that are read, by index.
    pub gauges: Vec<usize>,
    /// True if compensation runs meanwhile: the axes then contain its offsets.
    pub compensated: bool,
    /// Angles of the wrist's joints, rad; empty: at zero.
    pub wrist_rad: Vec<f64>,
}

impl PlannedSeries {
    /// Direction of the force at each level: 1 rising, -1 falling, 0 start.
    #[must_use]
    pub fn strokes(&self) -> Vec<i8> {
        let mut strokes = Vec::with_capacity(self.levels_n.len());
        let mut last = None;
        for &level in &self.levels_n {
            let stroke = match last {
                None => 0,
                Some(last) if level > last => 1,
                Some(last) if level < last => -1,
                Some(_) => strokes.last().copied().unwrap_or(0),
            };
            strokes.push(stroke);
            last = Some(level);
        }
        strokes
    }
}

/// Reads the plan of a set-up, for a machine of `model` whose axes are `metres_per_q` long.
///
/// # Errors
/// [`FileError`].
pub fn read<const N: usize>(path: &Path, model: &str, metres_per_q: &[f64; N]) -> Result<Plan<N>, FileError> {
    of(path, read_setup(path, model, metres_per_q)?, metres_per_q)
}

/// Checks the plan of a set-up; `path` is that of the set-up.
///
/// # Errors
/// [`FileError`], naming the series and the key.
pub fn of<const N: usize>(path: &Path, setup: Setup, metres_per_q: &[f64; N]) -> Result<Plan<N>, FileError> {
    let Setup { measurements, noise, setup, poses, gauges, plan: entries } = setup;
    let mut plan = Plan {
        table: super::setup::beside(path, &measurements),
        metres_per_q: *metres_per_q,
        noise: noise.unwrap_or(Noise::USUAL),
        setup: setup.unwrap_or_default(),
        poses,
        gauges,
        mountings: Vec::new(),
        series: Vec::new(),
    };
    for entry in &entries {
        plan.add(entry)
            .map_err(|(key, reason)| FileError::key(path, format!("series.{}.{key}", entry.name), reason))?;
    }
    let windows: usize = plan.series.iter().map(|series| series.levels_n.len()).sum();
    match windows {
        0 => Err(FileError::key(path, "series", "is missing: a plan has [[series]]")),
        1..=MAX_ROWS => Ok(plan),
        _ => Err(FileError::key(path, "series", format!("has more than {MAX_ROWS} windows"))),
    }
}

impl<const N: usize> Plan<N> {
    /// Adds a series after another, the same with a mounting of its own: `x` is followed by `x.2`, that by `x.3`.
    pub fn remount(&mut self, series: usize) {
        let name = self.name_again(series);
        if let Some(planned) = self.series.get(series) {
            let again = PlannedSeries { name, ..planned.clone() };
            self.series.insert(series + 1, again);
        }
    }

    /// Name of the series that [`remount`](Self::remount) adds.
    #[must_use]
    pub fn name_again(&self, series: usize) -> Name {
        let name = self.series.get(series).map_or("", |planned| &planned.name);
        let (base, count) = remounted(name).unwrap_or((name, 1));
        Name::made(format_args!("{base}.{}", count.saturating_add(1)))
    }

    /// Checks that the angles of the wrist are those of a wrist with `joints` joints; `path` names the set-up.
    ///
    /// # Errors
    /// [`FileError`], naming the series.
    pub fn check_wrist(&self, path: &Path, joints: usize) -> Result<(), FileError> {
        check_wrist(path, self.series.iter().map(|series| (&*series.name, &*series.wrist_rad)), joints)
    }

    fn add(&mut self, entry: &SeriesEntry) -> Result<(), Refused> {
        let refused = |key: &str, reason: String| (key.to_owned(), reason);
        if self.series.iter().any(|series| series.name == entry.name) {
            return Err(refused("name", "stands twice".to_owned()));
        }
        let length = entry.name.chars().count();
        if length > MAX_SERIES_NAME {
            let reason = format!(
                "has {length} characters; expected at most {MAX_SERIES_NAME}: a number is added when the series is mounted again"
            );
            return Err(refused("name", reason));
        }
        let Some(pose) = self.poses.iter().position(|(name, _)| *name == entry.pose) else {
            return Err(refused("pose", format!("{:?} is not in the set-up", entry.pose)));
        };
        let direction = Vector3::from(entry.direction);
        // `contains` refuses NaN.
        if !(1.0 - 1e-6..=1.0 + 1e-6).contains(&direction.norm()) {
            return Err(refused("direction", format!("has length {}, not 1", direction.norm())));
        }
        if !entry.hook_m.iter().all(|coordinate| coordinate.abs() <= FARTHEST_M) {
            return Err(refused("hook_m", format!("is more than {FARTHEST_M} m away; it is in metres")));
        }
        let [_, _, most_n, ..] = MOST;
        if let Some(level) = entry.levels_n.iter().find(|level| !(0.0..=most_n).contains(*level)) {
            return Err(refused("levels_n", format!("{level} is not from 0 to {most_n:e}")));
        }
        if entry.levels_n.first().is_none_or(|first| *first > 0.0) {
            return Err(refused("levels_n", "must begin with 0: the sensor is tared there".to_owned()));
        }
        if entry.levels_n.len() < 2 {
            return Err(refused("levels_n", "has fewer than two levels; the zero of a gauge takes one".to_owned()));
        }
        if entry.gauges.is_empty() {
            return Err(refused("gauges", "is empty; name the gauges that are read".to_owned()));
        }
        if let Some(twice) =
            entry.gauges.iter().enumerate().find(|(at, name)| entry.gauges.iter().take(*at).any(|other| other == *name))
        {
            return Err(refused("gauges", format!("{:?} stands twice", twice.1)));
        }
        let gauges = entry.gauges.iter().map(|name| {
            let index = self.gauges.iter().position(|gauge| gauge.name == *name);
            index.ok_or_else(|| refused("gauges", format!("{name:?} is not in the set-up")))
        });
        let gauges = gauges.collect::<Result<Vec<usize>, Refused>>()?;
        let mounting = self.mountings.iter().position(|name| *name == entry.mounting).unwrap_or_else(|| {
            self.mountings.push(entry.mounting.clone());
            self.mountings.len() - 1
        });
        self.series.push(PlannedSeries {
            name: entry.name.clone(),
            pose,
            mounting,
            hook_m: entry.hook_m.into(),
            direction: direction.normalize(),
            levels_n: entry.levels_n.clone(),
            gauges,
            compensated: entry.compensated,
            wrist_rad: entry.wrist_rad.clone(),
        });
        Ok(())
    }
}

/// Name and number of a series that was mounted anew.
fn remounted(name: &str) -> Option<(&str, u32)> {
    let (base, count) = name.rsplit_once('.')?;
    Some((base, count.parse().ok()?))
}

/// Name of a series before it was mounted anew.
pub(crate) fn before_remount(name: &str) -> &str {
    remounted(name).map_or(name, |(base, _)| base)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::fixture::{Folder, campaign_a, first_series};

    #[test]
    fn the_name_of_a_series_leaves_room_for_the_number_of_a_mounting() {
        let folder = Folder::new("names");
        let refused = |length: usize| {
            let text = first_series(&campaign_a("", &[0, 60]), 1);
            let path = folder.path("plan.toml");
            let name = "s".repeat(length);
            std::fs::write(&path, text.replace("name = \"x1\"", &format!("name = {name:?}"))).unwrap();
            read::<3>(&path, "l2", &[1.0; 3]).err().map(|error| error.to_string())
        };
        assert_eq!(refused(MAX_SERIES_NAME), None);
        for length in [MAX_SERIES_NAME + 1, MAX_SERIES_NAME + 2] {
            let said = refused(length).unwrap();
            assert!(said.contains(&format!("has {length} characters; expected at most {MAX_SERIES_NAME}")), "{said}");
        }
    }
}
