//! Candidates of a plan of springs: straps at poses around home, within the limits.

use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_machine::elastic;
use gantry_tau_machine::elastic::gauge::Gauge;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use nalgebra::Vector3;

use super::{HOOKS_M, LEVELS, no_candidate};
use crate::geometry::deviation::Deviating;
use crate::measurements::springs::NamedGauge;
use crate::plan::PlanError;
use crate::plan::exchange::Candidate;
use crate::plan::information::{SeriesInformation, SpringInformation, Stand, Strap};
use crate::plan::limits::{Allowed, GAUGE_RANGE_M, MAX_SOFT, is_regular};
use crate::springs::preload::Preload;

/// Places of the grid, from home, m, in x, y, z.
const FROM_HOME_M: [[f64; 3]; 3] = [[-0.4, 0.0, 0.4], [-0.2, -0.05, 0.08], [-0.15, 0.0, 0.15]];
/// Series around the jump: forces in shares of the one at the jump, rising; the same falling.
const AROUND_JUMP: [f64; 12] = [
    0.0, 0.3, 0.6, 0.8, 0.88, 0.92, 0.96, 1.0, 1.04, 1.08, 1.12, 1.2,
];

/// Home, then the places of the grid that the machine stands in well. Home is always the first.
pub(in crate::plan) fn stands<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
) -> Vec<Stand<N>> {
    let [xs, ys, zs] = FROM_HOME_M;
    let columns = xs.into_iter().flat_map(|x| ys.map(|y| (x, y)));
    let places = columns.flat_map(|(x, y)| zs.map(|z| Vector3::new(x, y, z)));
    let all = std::iter::once(Vector3::zeros()).chain(places);
    all.filter_map(|from_home| stand_at(robot, &(robot.home_m() + from_home)))
        .collect()
}

/// The machine at a place, if it stands there well.
pub(in crate::plan) fn stand_at<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    tool_m: &Vector3<f64>,
) -> Option<Stand<N>> {
    let q = robot.model.axes_at(tool_m).ok()?;
    let pose = elastic::Pose {
        translation_m: *tool_m,
        rotation: nalgebra::UnitQuaternion::identity(),
    };
    is_regular(&robot.model.geometry(), &pose, &q).then_some(Stand { tool_m: *tool_m, q })
}

/// Candidates within the limits, and their straps.
pub(super) struct Grid {
    pub(super) candidates: Vec<Candidate>,
    pub(super) straps: Vec<Strap>,
}

impl Grid {
    pub(super) fn new<K: Deviating<N>, const N: usize>(
        robot: &RobotFile<K, N>,
        information: &SpringInformation<N>,
        stands: &[Stand<N>],
        gauges: &[NamedGauge],
        force_max_n: f64,
    ) -> Result<Self, PlanError> {
        if stands.len() < 2 {
            let reason = "no pose around home is in travel and away from singular ones";
            return Err(no_candidate(&robot.name, reason.to_owned()));
        }
        let preload = Preload::of(robot, information.machine());
        let gauges: Vec<Gauge> = gauges.iter().map(|gauge| gauge.gauge).collect();
        let levels_n = LEVELS.map(|share| share * force_max_n);
        let mut grid = Self {
            candidates: Vec::new(),
            straps: Vec::new(),
        };
        let mut over_m = 0.0_f64;
        let mut off = 0_usize;
        let allowed = Allowed::of(robot);
        for (place, stand) in stands.iter().enumerate() {
            if !allowed.can_stand(&Pose::at(stand.tool_m), &stand.q) {
                continue;
            }
            for (strap, (hook, axis)) in HOOKS_M
                .iter()
                .flat_map(|hook| (0..3).map(move |axis| (hook, axis)))
                .enumerate()
            {
                // A pull along an axis shows what one against it does.
                let pulls = [1.0, -1.0].map(|sign| Strap {
                    hook_m: (*hook).into(),
                    direction: Vector3::ith(axis, sign),
                });
                let found = pulls.into_iter().find_map(|pull| {
                    let series = information
                        .series(stand, &pull, &levels_n, &gauges, &[])
                        .ok()?;
                    preload
                        .is_none_or(|preload| preload.holds(series.cluster_n))
                        .then_some((pull, series))
                });
                match found {
                    None => off += 1,
                    Some((_, SeriesInformation { largest_m, .. }))
                        if largest_m * MAX_SOFT > GAUGE_RANGE_M =>
                    {
                        over_m = over_m.max(largest_m)
                    }
                    Some((pull, SeriesInformation { rows, .. })) => {
                        grid.candidates.push(Candidate { rows, place, strap });
                        grid.straps.push(pull);
                    }
                }
            }
        }
        if grid.candidates.is_empty() {
            let over = if over_m > 0.0 {
                format!(
                    "gauges would move by {:.1} mm if springs are twice as soft as the file's, their range is {:.0} mm",
                    over_m * MAX_SOFT * 1e3,
                    GAUGE_RANGE_M * 1e3
                )
            } else {
                format!("{off} straps would take the platform off cart 3, or the machine apart")
            };
            let reason = format!(
                "no strap stays within the limits at {force_max_n} N: {over}; lower --force-max"
            );
            return Err(no_candidate(&robot.name, reason));
        }
        Ok(grid)
    }

    /// Largest number of straps at a pose.
    pub(super) fn max_straps(&self) -> usize {
        let counts = self.candidates.iter().map(|candidate| {
            let at_pose = self.candidates.iter();
            at_pose
                .filter(|other| other.place == candidate.place)
                .count()
        });
        counts.max().unwrap_or(0)
    }
}

/// The places of a plan in an order of short ways, from the first stand on.
pub(super) fn nearest_first<const N: usize>(
    stands: &[Stand<N>],
    used: impl Iterator<Item = usize>,
) -> Vec<usize> {
    let mut left: Vec<usize> = used.collect();
    left.sort_unstable();
    left.dedup();
    let mut here = 0;
    let mut order = Vec::with_capacity(left.len());
    while let Some(next) = left.iter().copied().min_by(|one, other| {
        let [one_m, other_m] =
            [*one, *other].map(|to| (stands[here].tool_m - stands[to].tool_m).norm());
        one_m.total_cmp(&other_m)
    }) {
        left.retain(|place| *place != next);
        order.push(next);
        here = next;
    }
    order
}

/// The strap that takes the platform off cart 3 with the least force, and small steps around that
/// force.
pub(super) fn around_jump<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    information: &SpringInformation<N>,
    stand: &Stand<N>,
    force_max_n: f64,
) -> Result<(Strap, Vec<f64>), PlanError> {
    let Some(preload) = Preload::of(robot, information.machine()) else {
        let reason =
            "the robot file knows no jump; [play] or simulation.jump_gap_m says where it is";
        return Err(no_jump(reason));
    };
    let pulls = (0..3).flat_map(|axis| [1.0, -1.0].map(|sign| Vector3::ith(axis, sign)));
    let at_jump = pulls.filter_map(|direction| {
        let strap = Strap {
            hook_m: HOOKS_M[0].into(),
            direction,
        };
        let series = information
            .series(stand, &strap, &[0.0, force_max_n], &[], &[])
            .ok()?;
        Some((
            preload.share_at_jump(series.cluster_n)? * force_max_n,
            strap,
        ))
    });
    let (force_n, strap) = at_jump
        .min_by(|one, other| one.0.total_cmp(&other.0))
        .ok_or_else(|| no_jump("no strap at the first pose reaches it"))?;
    let last = AROUND_JUMP[AROUND_JUMP.len() - 1] * force_n;
    if last > force_max_n {
        return Err(no_jump(&format!(
            "forces to {last:.0} N are needed, and --force-max is {force_max_n}"
        )));
    }
    let rising = AROUND_JUMP.map(|share| (share * force_n).round());
    Ok((
        strap,
        rising
            .iter()
            .chain(rising.iter().rev().skip(1))
            .copied()
            .collect(),
    ))
}

fn no_jump(reason: &str) -> PlanError {
    PlanError::Option(format!("--around-jump: {reason}"))
}

/// Order of straps in which hooks change seldom.
pub(super) fn strap_order(strap: &Strap) -> (usize, usize) {
    let hook = HOOKS_M
        .iter()
        .position(|hook| Vector3::from(*hook) == strap.hook_m)
        .unwrap_or(HOOKS_M.len());
    (hook, strap.direction.iamax())
}
