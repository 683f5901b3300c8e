//! Plan of straps and gauges for the springs `[T 4.2.9]`, and judgement of any such plan.

mod candidates;

use std::fmt;

use gantry_tau_core::model::kinematics::Pose;

use gantry_tau_machine::elastic::gauge::{Body, Gauge};
use gantry_tau_machine::elastic::springs::Springs;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_system::output::Name;
use nalgebra::{DMatrix, Vector3};

use super::exchange::{Criterion, Search};
use super::expected::Expected;
use super::information::{SpringInformation, Stand, Strap};
use super::limits::GAUGE_RANGE_M;
use super::time::Minutes;
use super::{PlanError, Written, check_range, model_name, sheet};
use crate::fit::statistics::float;
use crate::geometry::deviation::Deviating;
use crate::measurements::springs::{NamedGauge, Noise, SeriesEntry, Setup};
use crate::springs::preload::Preload;
pub(super) use candidates::stand_at;
use candidates::{Grid, around_jump, nearest_first, stands, strap_order};

/// Hooks, from the tool centre point, m.
pub(super) const HOOKS_M: [[f64; 3]; 3] =
    [[0.0, 0.0, -0.08], [0.15, 0.0, -0.08], [0.0, 0.15, -0.08]];
/// Gauges on a body, 3-2-1: names, where they touch from the tool centre point, m, and their
/// directions.
const FACE_GAUGES: [(&str, [f64; 3], [f64; 3]); 6] = [
    ("pz1", [0.12, -0.06, 0.10], [0.0, 0.0, 1.0]),
    ("pz2", [-0.12, -0.06, 0.10], [0.0, 0.0, 1.0]),
    ("pz3", [0.0, 0.12, 0.10], [0.0, 0.0, 1.0]),
    ("py1", [0.12, 0.12, 0.05], [0.0, 1.0, 0.0]),
    ("py2", [-0.12, 0.12, 0.05], [0.0, 1.0, 0.0]),
    ("px1", [0.14, 0.12, 0.05], [1.0, 0.0, 0.0]),
];
/// Levels of a series, in shares of the largest force; the first comes again at the end, for the
/// drift.
const LEVELS: [f64; 11] = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 0.8, 0.6, 0.4, 0.2, 0.0];
/// Name of that series.
pub(super) const JUMP: &str = "jump";
/// Starts of the search.
const STARTS: u64 = 8;

/// Options of a plan.
#[derive(Clone, Debug, PartialEq)]
pub struct SpringsOptions {
    /// Number of series.
    pub series: usize,
    /// Largest number of poses.
    pub poses: usize,
    /// Quantity that the plan makes small.
    pub criterion: Criterion,
    /// Largest force, N.
    pub force_max_n: f64,
    /// Adds a series of small steps around the jump.
    pub around_jump: bool,
    /// Noise of a window.
    pub noise: Noise,
    /// Gauges; absent: those of [`default_gauges`].
    pub gauges: Option<Vec<NamedGauge>>,
}

impl Default for SpringsOptions {
    fn default() -> Self {
        Self {
            series: 9,
            poses: 3,
            criterion: Criterion::I,
            force_max_n: 300.0,
            around_jump: false,
            noise: Noise::USUAL,
            gauges: None,
        }
    }
}

impl SpringsOptions {
    pub(super) fn check(&self) -> Result<(), PlanError> {
        check_range("--series", float(self.series), 1.0, 200.0)?;
        check_range("--poses", float(self.poses), 1.0, 100.0)?;
        check_range("--force-max", self.force_max_n, 10.0, 10_000.0)?;
        check_range("--noise-um", self.noise.gauge_um, 1e-3, 1e3)?;
        check_range("--noise-n", self.noise.force_n, 1e-3, 1e3)
    }
}

/// Six gauges on the tool if the file has a wrist, else on the platform, and one per axis.
#[must_use]
pub fn default_gauges<K, const N: usize>(robot: &RobotFile<K, N>) -> Vec<NamedGauge> {
    let body = if robot.wrist.is_empty() {
        Body::Platform
    } else {
        Body::Tool
    };
    let faces = FACE_GAUGES.map(|(name, point_m, axis)| NamedGauge {
        name: Name::made(name),
        gauge: Gauge::Face {
            body,
            point_m: point_m.into(),
            axis: axis.into(),
        },
    });
    let axes = robot
        .metres_per_q
        .iter()
        .enumerate()
        .map(|(axis, metres_per_q)| NamedGauge {
            name: Name::made(format_args!("axis{}", axis + 1)),
            gauge: Gauge::Axis {
                axis,
                metres_per_q: *metres_per_q,
            },
        });
    faces.into_iter().chain(axes).collect()
}

/// Expected result of a plan of straps and gauges, and its cost.
#[derive(Clone, Debug, PartialEq)]
pub struct Judgement {
    /// Standard deviations, directions, indices.
    pub expected: Expected,
    /// Largest force of the plan, which the predicted error is for, N.
    force_n: f64,
    minutes: Minutes,
    pub(super) series: Vec<Predicted>,
    /// Limits that the plan breaks.
    pub doubts: Vec<String>,
}

/// Prediction of one series.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Predicted {
    /// Displacement of the tool centre point at the largest force, m.
    pub(super) displacement_m: f64,
    /// Largest reading, m.
    pub(super) largest_m: f64,
}

/// Plans a campaign and judges it. `measurements` is the name of its table.
///
/// # Errors
/// [`PlanError`].
pub fn plan_springs<K: Deviating<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    options: &SpringsOptions,
    measurements: &str,
) -> Result<Written, PlanError> {
    let setup = planned(robot, options, measurements)?;
    written(robot, &setup, "springs")
}

/// Judges a plan, and writes it.
pub(super) fn written<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    setup: &Setup,
    kind: &str,
) -> Result<Written, PlanError> {
    let judgement = judge(robot, setup, false, &robot.name)?;
    let mut doubts = judgement.doubts.clone();
    doubts.extend(lost(&judgement.expected));
    Ok(Written {
        plan: setup
            .text(model_name::<N>())
            .map_err(|error| PlanError::Text(error.to_string()))?,
        header: setup.header::<N>(),
        sheet: sheet::straps(robot, setup, &judgement, kind)?,
        summary: judgement.to_string(),
        doubts,
    })
}

/// A doubt, if directions are lost.
pub(super) fn lost(expected: &Expected) -> Option<String> {
    let (seen, all) = expected.seen;
    (!expected.is_complete()).then(|| {
        let lost: Vec<String> = expected
            .lost
            .iter()
            .map(|direction| format!("({direction})"))
            .collect();
        format!(
            "{} of {all} directions cannot be seen: {}",
            all - seen,
            lost.join(", ")
        )
    })
}

pub(super) fn springs<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
) -> Result<Springs<N>, PlanError> {
    Springs::of(robot).ok_or_else(|| PlanError::NoCompliances {
        robot: robot.name.clone(),
    })
}

/// Chooses the series.
fn planned<K: Deviating<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    options: &SpringsOptions,
    measurements: &str,
) -> Result<Setup, PlanError> {
    options.check()?;
    let information = SpringInformation::new(robot, springs(robot)?, options.noise, false);
    let gauges = options
        .gauges
        .clone()
        .unwrap_or_else(|| default_gauges(robot));
    let stands = stands(robot);
    let grid = Grid::new(robot, &information, &stands, &gauges, options.force_max_n)?;
    // What is asked for everywhere, but for home itself, which is not a place of the grid.
    let goal = goal(&information, &stands[1..], options.force_max_n, &robot.name)?;
    let search = Search::new(
        &grid.candidates,
        &goal,
        options.criterion,
        options.series,
        options.poses,
    );
    let chosen = search.best(STARTS).ok_or_else(|| {
        PlanError::Option(format!(
            "--series is {}, and a pose has {} straps within the limits; --poses {} allows too few",
            options.series,
            grid.max_straps(),
            options.poses
        ))
    })?;
    let mut entries: Vec<(usize, Strap)> = chosen
        .iter()
        .map(|index| (grid.candidates[*index].place, grid.straps[*index]))
        .collect();
    let order = nearest_first(&stands, entries.iter().map(|(place, _)| *place));
    entries.sort_by_key(|(place, strap)| (rank(&order, *place), strap_order(strap)));
    let mut setup = Setup {
        measurements: measurements.to_owned(),
        noise: Some(options.noise),
        setup: None,
        poses: order
            .iter()
            .enumerate()
            .map(|(index, place)| pose_entry(index, &stands[*place]))
            .collect(),
        gauges,
        plan: Vec::new(),
    };
    for (place, strap) in &entries {
        let levels_n = LEVELS
            .map(|share| round_n(share * options.force_max_n))
            .to_vec();
        let pose = rank(&order, *place).unwrap_or_default();
        setup.push(pose, strap, levels_n);
    }
    if options.around_jump {
        let (strap, levels_n) =
            around_jump(robot, &information, &stands[order[0]], options.force_max_n)?;
        setup.push_named(Name::made(JUMP), 0, &strap, levels_n);
    }
    Ok(setup)
}

fn rank(order: &[usize], place: usize) -> Option<usize> {
    order.iter().position(|other| *other == place)
}

fn round_n(force_n: f64) -> f64 {
    (force_n * 10.0).round() / 10.0
}

pub(super) fn pose_entry<const N: usize>(index: usize, stand: &Stand<N>) -> (Name, Pose) {
    let rounded = stand
        .tool_m
        .map(|coordinate| (coordinate * 1e6).round() / 1e6);
    (
        Name::made(format_args!("p{}", index + 1)),
        Pose::at(rounded),
    )
}

impl Setup {
    /// Adds a series at a pose, with all gauges.
    pub(super) fn push(&mut self, pose: usize, strap: &Strap, levels_n: Vec<f64>) {
        let name = Name::made(format_args!("s{}", self.plan.len() + 1));
        self.push_named(name, pose, strap, levels_n);
    }

    pub(super) fn push_named(
        &mut self,
        name: Name,
        pose: usize,
        strap: &Strap,
        levels_n: Vec<f64>,
    ) {
        self.plan.push(SeriesEntry {
            name,
            pose: self.poses[pose].0.clone(),
            mounting: Name::made(format_args!("gauges at {}", self.poses[pose].0)),
            hook_m: strap.hook_m.into(),
            direction: strap.direction.into(),
            levels_n,
            gauges: self.gauges.iter().map(|gauge| gauge.name.clone()).collect(),
            compensated: false,
            wrist_rad: Vec::new(),
        });
    }
}

/// `M`: mean of `G^T G` over stands and loads at the first hook; `plan` is what an error names.
pub(super) fn goal<const N: usize>(
    information: &SpringInformation<N>,
    stands: &[Stand<N>],
    force_n: f64,
    plan: &str,
) -> Result<DMatrix<f64>, PlanError> {
    let size = information.parameters().basis.ncols();
    let mut goal = DMatrix::zeros(size, size);
    let count = float(stands.len() * 3);
    for stand in stands {
        for direction in [Vector3::x(), Vector3::y(), Vector3::z()] {
            let load = Strap {
                hook_m: HOOKS_M[0].into(),
                direction,
            }
            .load(force_n);
            let rows = information.displacement(stand, &load).map_err(|error| {
                let reason =
                    format!("{error} at {force_n} N; lower --force-max, or the levels of the plan");
                no_candidate(plan, reason)
            })?;
            goal += rows.tr_mul(&rows) / count;
        }
    }
    Ok(goal)
}

/// Judges a plan of a machine; `plan` names it in errors. With `is_links_only` the axes' springs
/// are taken as known: their carts are held.
///
/// # Errors
/// [`PlanError`].
pub fn judge<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    setup: &Setup,
    is_links_only: bool,
    plan: &str,
) -> Result<Judgement, PlanError> {
    let information = SpringInformation::new(
        robot,
        springs(robot)?,
        setup.noise.unwrap_or(Noise::USUAL),
        is_links_only,
    );
    let preload = Preload::of(robot, information.machine());
    let parameters = information.parameters();
    let mut rows = DMatrix::zeros(0, parameters.basis.ncols());
    let mut readings = 0;
    let mut series = Vec::new();
    let mut doubts = Vec::new();
    let mut force_n = 0.0_f64;
    for entry in &setup.plan {
        let stand = stand_of(robot, setup, entry, plan)?;
        let strap = Strap {
            hook_m: entry.hook_m.into(),
            direction: entry.direction.into(),
        };
        let read = setup
            .gauges
            .iter()
            .filter(|gauge| entry.gauges.contains(&gauge.name));
        let gauges: Vec<Gauge> = read.map(|gauge| gauge.gauge).collect();
        let found = information
            .series(&stand, &strap, &entry.levels_n, &gauges, &entry.wrist_rad)
            .map_err(|error| PlanError::Series {
                plan: plan.to_owned(),
                series: entry.name.clone(),
                error,
            })?;
        series.push(Predicted {
            displacement_m: found.displacement_m,
            largest_m: found.largest_m,
        });
        // What it shows of the springs, the play takes.
        if entry.name == *JUMP {
            continue;
        }
        let first = rows.nrows();
        rows = rows.resize_vertically(first + found.rows.nrows(), 0.0);
        rows.rows_mut(first, found.rows.nrows())
            .copy_from(&found.rows);
        readings += found.readings;
        force_n = entry.levels_n.iter().copied().fold(force_n, f64::max);
        if found.largest_m > GAUGE_RANGE_M {
            doubts.push(format!(
                "series {}: a gauge moves by {:.1} mm; its range is {:.0} mm",
                entry.name,
                found.largest_m * 1e3,
                GAUGE_RANGE_M * 1e3
            ));
        }
        if preload.is_some_and(|preload| !preload.holds(found.cluster_n)) {
            doubts.push(format!(
                "series {}: the platform comes near leaving cart 3, or leaves it; pull the other way",
                entry.name
            ));
        }
    }
    let stands = stands(robot);
    let goal = goal(
        &information,
        stands.get(1..).unwrap_or_default(),
        force_n,
        plan,
    )?;
    let expected = Expected::new(&parameters, rows, readings, &goal);
    Ok(Judgement {
        expected,
        force_n,
        minutes: minutes(setup),
        series,
        doubts,
    })
}

/// The stand of a series.
fn stand_of<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    setup: &Setup,
    entry: &SeriesEntry,
    plan: &str,
) -> Result<Stand<N>, PlanError> {
    let mut poses = setup.poses.iter();
    let Some((_, pose)) = poses.find(|(name, _)| *name == entry.pose) else {
        let reason = format!("series {}: pose {:?} is missing", entry.name, entry.pose);
        return Err(no_candidate(plan, reason));
    };
    if pose.rotation != nalgebra::Matrix3::identity() {
        let reason = format!(
            "pose {:?} is turned; plans of springs have an unturned platform",
            entry.pose
        );
        return Err(no_candidate(plan, reason));
    }
    let tool_m = pose.position_m;
    let q = robot
        .model
        .axes_at(&tool_m)
        .map_err(|error| no_candidate(plan, format!("pose {:?}: {error}", entry.pose)))?;
    Ok(Stand { tool_m, q })
}

fn no_candidate(plan: &str, reason: String) -> PlanError {
    PlanError::NoCandidate {
        robot: plan.to_owned(),
        reason,
    }
}

fn minutes(setup: &Setup) -> Minutes {
    let mut poses: Vec<&Name> = setup.plan.iter().map(|series| &series.pose).collect();
    poses.dedup();
    let mut straps: Vec<_> = setup
        .plan
        .iter()
        .map(|series| (&series.pose, series.hook_m, series.direction))
        .collect();
    straps.dedup();
    Minutes::of_straps(
        poses.len(),
        straps.len(),
        setup.plan.iter().map(|series| series.levels_n.len()).sum(),
    )
}

impl fmt::Display for Judgement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.expected)?;
        let but = if self.expected.is_complete() {
            ""
        } else {
            ", lost directions not counted"
        };
        writeln!(
            f,
            "predicted error  {:.3} um rms of the tool's displacement under {} N over the grid of poses{but}",
            self.expected.rms_m * 1e6,
            self.force_n
        )?;
        write!(f, "time             {}", self.minutes)
    }
}

#[cfg(test)]
mod tests;
