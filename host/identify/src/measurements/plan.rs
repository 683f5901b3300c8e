//! Plans: a set-up with the series that are to be measured. Its table may be empty or absent.

use std::path::{Path, PathBuf};

use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_system::output::{MAX_NAME, Name};
use nalgebra::Vector3;

use super::springs::{
    MAX_VALUES, NamedGauge, Noise, Refused, SeriesEntry, Setup, SetupNoise, check_wrist, read_setup,
};
use super::{FileError, MAX_ROWS};

/// Farthest hook from the tool centre point, m.
const MAX_HOOK_M: f64 = 10.0;

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
pub fn read<const N: usize>(
    path: &Path,
    model: &str,
    metres_per_q: &[f64; N],
) -> Result<Plan<N>, FileError> {
    of(path, read_setup(path, model, metres_per_q)?, metres_per_q)
}

/// Checks the plan of a set-up; `path` is that of the set-up.
///
/// # Errors
/// [`FileError`], naming the series and the key.
pub fn of<const N: usize>(
    path: &Path,
    setup: Setup,
    metres_per_q: &[f64; N],
) -> Result<Plan<N>, FileError> {
    let Setup {
        measurements,
        noise,
        setup,
        poses,
        gauges,
        plan: entries,
    } = setup;
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
        plan.add(entry).map_err(|(key, reason)| {
            FileError::key(path, format!("series.{}.{key}", entry.name), reason)
        })?;
    }
    let windows: usize = plan.series.iter().map(|series| series.levels_n.len()).sum();
    match windows {
        0 => Err(FileError::key(
            path,
            "series",
            "is missing: a plan has [[series]]",
        )),
        1..=MAX_ROWS => Ok(plan),
        _ => Err(FileError::key(
            path,
            "series",
            format!("has more than {MAX_ROWS} windows"),
        )),
    }
}

impl<const N: usize> Plan<N> {
    /// Adds a series after another, the same with a mounting of its own: `x` is followed by `x.2`,
    /// that by `x.3`.
    pub fn remount(&mut self, series: usize) {
        let name = self.name_again(series);
        if let Some(planned) = self.series.get(series) {
            let again = PlannedSeries {
                name,
                ..planned.clone()
            };
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

    /// Checks that the angles of the wrist are those of a wrist with `joints` joints; `path` names
    /// the set-up.
    ///
    /// # Errors
    /// [`FileError`], naming the series.
    pub fn check_wrist(&self, path: &Path, joints: usize) -> Result<(), FileError> {
        check_wrist(
            path,
            self.series
                .iter()
                .map(|series| (&*series.name, &*series.wrist_rad)),
            joints,
        )
    }

    fn add(&mut self, entry: &SeriesEntry) -> Result<(), Refused> {
        self.check_name(&entry.name)?;
        let Some(pose) = self.poses.iter().position(|(name, _)| *name == entry.pose) else {
            let reason = format!("{:?} is not in the set-up", entry.pose);
            return Err(refused("pose", reason));
        };
        let direction = Vector3::from(entry.direction);
        // `contains` refuses NaN.
        if !(1.0 - 1e-6..=1.0 + 1e-6).contains(&direction.norm()) {
            let reason = format!("has length {}, not 1", direction.norm());
            return Err(refused("direction", reason));
        }
        if !entry
            .hook_m
            .iter()
            .all(|coordinate| coordinate.abs() <= MAX_HOOK_M)
        {
            let reason = format!("is more than {MAX_HOOK_M} m away; it is in metres");
            return Err(refused("hook_m", reason));
        }
        check_levels(&entry.levels_n)?;
        let gauges = self.gauges_of(entry)?;
        let mounting = self
            .mountings
            .iter()
            .position(|name| *name == entry.mounting)
            .unwrap_or_else(|| {
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

    fn check_name(&self, name: &Name) -> Result<(), Refused> {
        if self.series.iter().any(|series| series.name == *name) {
            return Err(refused("name", "duplicate name"));
        }
        let length = name.chars().count();
        if length > MAX_SERIES_NAME {
            let reason = format!(
                "has {length} characters; expected at most {MAX_SERIES_NAME}: a number is added when the series is mounted again"
            );
            return Err(refused("name", reason));
        }
        Ok(())
    }

    /// Gauges of a series, by index.
    fn gauges_of(&self, entry: &SeriesEntry) -> Result<Vec<usize>, Refused> {
        if entry.gauges.is_empty() {
            let reason = "is empty; name the gauges that are read";
            return Err(refused("gauges", reason));
        }
        let mut gauges = Vec::with_capacity(entry.gauges.len());
        for (place, name) in entry.gauges.iter().enumerate() {
            if entry.gauges.iter().take(place).any(|other| other == name) {
                let reason = format!("{name:?} is a duplicate name");
                return Err(refused("gauges", reason));
            }
        }
        for name in &entry.gauges {
            let Some(index) = self.gauges.iter().position(|gauge| gauge.name == *name) else {
                let reason = format!("{name:?} is not in the set-up");
                return Err(refused("gauges", reason));
            };
            gauges.push(index);
        }
        Ok(gauges)
    }
}

fn refused(key: &str, reason: impl Into<String>) -> Refused {
    (key.to_owned(), reason.into())
}

fn check_levels(levels_n: &[f64]) -> Result<(), Refused> {
    let [_, _, max_n, ..] = MAX_VALUES;
    if let Some(level) = levels_n
        .iter()
        .find(|level| !(0.0..=max_n).contains(*level))
    {
        let reason = format!("{level} is not from 0 to {max_n:e}");
        return Err(refused("levels_n", reason));
    }
    if levels_n.first().is_none_or(|first| *first > 0.0) {
        let reason = "must begin with 0: the sensor is tared there";
        return Err(refused("levels_n", reason));
    }
    if levels_n.len() < 2 {
        let reason = "has fewer than two levels; the zero of a gauge takes one";
        return Err(refused("levels_n", reason));
    }
    Ok(())
}

/// Name and number of a series that was mounted again.
fn remounted(name: &str) -> Option<(&str, u32)> {
    let (base, count) = name.rsplit_once('.')?;
    Some((base, count.parse().ok()?))
}

/// Name of a series before it was mounted again.
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
        let path = folder.path("plan.toml");
        for length in MAX_SERIES_NAME..=MAX_SERIES_NAME + 2 {
            let name = format!("name = {:?}", "s".repeat(length));
            let text = first_series(&campaign_a("", &[0, 60]), 1).replace("name = \"x1\"", &name);
            std::fs::write(&path, text).unwrap();
            let read = read::<3>(&path, "l2", &[1.0; 3]);
            if length == MAX_SERIES_NAME {
                read.unwrap();
                continue;
            }
            let said = read.unwrap_err().to_string();
            assert!(
                said.contains(&format!(
                    "has {length} characters; expected at most {MAX_SERIES_NAME}"
                )),
                "{said}"
            );
        }
    }
}
