//! Plan of straps that show how well compensation works where identification did not look.

use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_machine::elastic::ElasticError;
use gantry_tau_machine::elastic::gauge::Gauge;
use gantry_tau_machine::elastic::springs::Springs;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_machine::workspace::{Grid, survey};
use gantry_tau_system::output::Name;
use nalgebra::{DMatrix, Vector3, Vector6};

use super::information::{SpringInformation, Stand, Strap};
use super::limits::{Allowed, GAUGE_RANGE_M, MAX_SOFT};
use super::springs::{SpringsOptions, default_gauges, pose_entry, springs, stand_at, written};
use super::{PlanError, Written};
use crate::geometry::deviation::Deviating;
use crate::measurements::springs::Setup;
use crate::springs::preload::Preload;

/// Hooks that plans of springs do not have, from the tool centre point, m.
const HOOKS_M: [[f64; 3]; 3] = [
    [0.08, 0.08, -0.08],
    [-0.1, 0.05, -0.08],
    [0.05, -0.1, -0.08],
];
/// Directions that plans of springs do not have, before they are made unit vectors.
const DIRECTIONS: [[f64; 3]; 6] = [
    [1.0, 1.0, 1.0],
    [-1.0, 1.0, 1.0],
    [1.0, -1.0, 1.0],
    [-1.0, -1.0, 1.0],
    [1.0, -1.0, 0.0],
    [1.0, 1.0, 0.0],
];
/// Largest displacement, in those at home: beyond it the machine is near a singular pose.
const MAX_DISPLACEMENT: f64 = 3.0;
/// Levels, in shares of the largest force: the first again at the end.
const LEVELS: [f64; 5] = [0.0, 0.5, 1.0, 0.5, 0.0];
/// Steps along the longest side of the workspace.
const CELLS: u32 = 16;

/// Plans straps at poses spread over the reach, each with compensation off and on. `measurements`
/// is the name of their table.
///
/// # Errors
/// [`PlanError`].
pub fn plan_verify<K: Deviating<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    options: &SpringsOptions,
    measurements: &str,
) -> Result<Written, PlanError> {
    options.check()?;
    if options.around_jump {
        return Err(PlanError::Option(
            "--around-jump is an option of plan springs".to_owned(),
        ));
    }
    let information = SpringInformation::new(robot, springs(robot)?, options.noise, false);
    let gauges = options
        .gauges
        .clone()
        .unwrap_or_else(|| default_gauges(robot));
    let mut setup = Setup {
        measurements: measurements.to_owned(),
        noise: Some(options.noise),
        setup: None,
        poses: Vec::new(),
        gauges,
        plan: Vec::new(),
    };
    let faces = setup
        .gauges
        .iter()
        .filter(|named| matches!(named.gauge, Gauge::Face { .. }));
    let faces: Vec<Name> = faces.map(|named| named.name.clone()).collect();
    let straps = spread_straps(robot, &information, &setup.gauges, options)?;
    for (stand, strap) in &straps {
        let entry = pose_entry(setup.poses.len(), stand);
        let pose = setup
            .poses
            .iter()
            .position(|(_, pose)| *pose == entry.1)
            .unwrap_or_else(|| {
                setup.poses.push(entry);
                setup.poses.len() - 1
            });
        let number = setup.plan.len() / 2 + 1;
        let levels_n = LEVELS.map(|share| share * options.force_max_n).to_vec();
        for compensated in [false, true] {
            let state = if compensated { "on" } else { "off" };
            setup.push_named(
                Name::made(format_args!("v{number} {state}")),
                pose,
                strap,
                levels_n.clone(),
            );
            let Some(entry) = setup.plan.last_mut() else {
                continue;
            };
            entry.compensated = compensated;
            // A gauge on a cart would show the offset on top of the displacement by its spring.
            if compensated && !faces.is_empty() {
                entry.gauges.clone_from(&faces);
            }
        }
    }
    let mut written = written(robot, &setup, "verify")?;
    // What the springs would be known to from these windows is not what they are for.
    written.doubts.retain(|doubt| doubt.starts_with("series"));
    written.summary = summary(robot, &information, &straps, options)?;
    Ok(written)
}

/// One strap after the other at poses far from each other; each within the limits.
fn spread_straps<K: Deviating<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    information: &SpringInformation<N>,
    gauges: &[crate::measurements::springs::NamedGauge],
    options: &SpringsOptions,
) -> Result<Vec<(Stand<N>, Strap)>, PlanError> {
    let limits = StrapLimits {
        information,
        home: Stand {
            tool_m: robot.home_m(),
            q: robot.home_q()?,
        },
        gauges: gauges.iter().map(|gauge| gauge.gauge).collect(),
        preload: Preload::of(robot, information.machine()),
        force_max_n: options.force_max_n,
    };
    let allowed = Allowed::of(robot);
    let poses = far_apart(robot, options.poses.min(options.series), |stand| {
        allowed.can_stand(&Pose::at(stand.tool_m), &stand.q)
            && (0..DIRECTIONS.len()).all(|number| limits.strap_at(stand, number).is_some())
    });
    let numbered = poses
        .iter()
        .cycle()
        .take(if poses.is_empty() { 0 } else { options.series })
        .enumerate();
    let straps: Vec<(Stand<N>, Strap)> = numbered
        .filter_map(|(number, stand)| Some((*stand, limits.strap_at(stand, number)?)))
        .collect();
    if straps.is_empty() {
        let reason = format!(
            "no strap stays within the limits at {} N; lower --force-max",
            options.force_max_n
        );
        return Err(PlanError::NoCandidate {
            robot: robot.name.clone(),
            reason,
        });
    }
    // Straps of one pose in a row.
    let mut ordered = straps.clone();
    ordered.sort_by_key(|(stand, _)| straps.iter().position(|(other, _)| other == stand));
    Ok(ordered)
}

/// Limits of the straps of a plan.
struct StrapLimits<'a, const N: usize> {
    information: &'a SpringInformation<N>,
    home: Stand<N>,
    gauges: Vec<Gauge>,
    preload: Option<Preload>,
    force_max_n: f64,
}

impl<const N: usize> StrapLimits<'_, N> {
    /// The strap in the first direction within the limits, from the one with this number on.
    fn strap_at(&self, stand: &Stand<N>, number: usize) -> Option<Strap> {
        let hook_m = HOOKS_M[number % HOOKS_M.len()].into();
        let from_here =
            (0..DIRECTIONS.len()).map(|step| DIRECTIONS[(number + step) % DIRECTIONS.len()]);
        let ways =
            from_here.flat_map(|way| [1.0, -1.0].map(|sign| Vector3::from(way).normalize() * sign));
        ways.map(|direction| Strap { hook_m, direction })
            .find(|strap| self.holds(stand, strap))
    }

    fn holds(&self, stand: &Stand<N>, strap: &Strap) -> bool {
        let [Some(here), Some(home)] = [stand, &self.home].map(|stand| {
            let levels_n = [0.0, self.force_max_n];
            let series = self
                .information
                .series(stand, strap, &levels_n, &self.gauges, &[]);
            series.ok()
        }) else {
            return false;
        };
        here.largest_m * MAX_SOFT <= GAUGE_RANGE_M
            && here.displacement_m <= MAX_DISPLACEMENT * home.displacement_m
            && self
                .preload
                .is_none_or(|preload| preload.holds(here.cluster_n))
    }
}

/// Places of the workspace where something can be measured, each as far as possible from home and
/// from those before it.
fn far_apart<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    count: usize,
    can_measure: impl Fn(&Stand<N>) -> bool,
) -> Vec<Stand<N>> {
    let places = survey(robot, Grid::of(robot, CELLS), |_| ()).places;
    let reached = places.into_iter().filter(|place| place.reached.is_ok());
    let mut left: Vec<Stand<N>> = reached
        .filter_map(|place| stand_at(robot, &place.tool_m))
        .collect();
    let mut found: Vec<Stand<N>> = Vec::new();
    while found.len() < count {
        let distances: Vec<f64> = left
            .iter()
            .map(|stand| {
                let from_home_m = (robot.home_m() - stand.tool_m).norm();
                found
                    .iter()
                    .map(|other| (other.tool_m - stand.tool_m).norm())
                    .fold(from_home_m, f64::min)
            })
            .collect();
        let farthest =
            (0..left.len()).max_by(|one, other| distances[*one].total_cmp(&distances[*other]));
        let Some(stand) = farthest.map(|index| left.swap_remove(index)) else {
            break;
        };
        if can_measure(&stand) {
            found.push(stand);
        }
    }
    found
}

/// Displacement to expect per strap, and what compensation leaves of it by the covariance of
/// identified springs.
fn summary<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    information: &SpringInformation<N>,
    straps: &[(Stand<N>, Strap)],
    options: &SpringsOptions,
) -> Result<String, PlanError> {
    let covariance = relative_covariance(robot);
    let mut lines = vec![format!(
        "{:<8} {:>30} {:>16} {:>16}",
        "strap", "tool centre point, m", "displacement", "expected rest"
    )];
    for (index, (stand, strap)) in straps.iter().enumerate() {
        let load = strap.load(options.force_max_n);
        let name = Name::made(format_args!("v{}", index + 1));
        let (moved_um, rest) = expected_rest(information, stand, &load, covariance.as_ref())
            .map_err(|error| PlanError::Series {
                plan: robot.name.clone(),
                series: name.clone(),
                error,
            })?;
        let place = format!(
            "({:.3}, {:.3}, {:.3})",
            stand.tool_m.x, stand.tool_m.y, stand.tool_m.z
        );
        lines.push(format!(
            "{name:<8} {place:>30} {:>16} {rest:>16}",
            format!("{moved_um:.0} um")
        ));
    }
    Ok(lines.join("\n"))
}

/// Displacement by a load, um, and what compensation leaves of it.
fn expected_rest<const N: usize>(
    information: &SpringInformation<N>,
    stand: &Stand<N>,
    load: &Vector6<f64>,
    covariance: Option<&DMatrix<f64>>,
) -> Result<(f64, String), ElasticError> {
    let moved_um = 1e6 * information.moved_m(stand, load)?;
    let Some(covariance) = covariance else {
        return Ok((moved_um, "not identified".to_owned()));
    };
    let by_springs = information.displacement(stand, load)?;
    let variance = (&by_springs * covariance * by_springs.transpose()).trace();
    Ok((moved_um, format!("{:.2} um", 1e6 * variance.sqrt())))
}

/// Covariance of identified compliances, in shares of the file's.
fn relative_covariance<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
) -> Option<DMatrix<f64>> {
    let identified = robot.identified.as_ref()?;
    let values = Springs::of(robot)?.vector();
    let size = values.len();
    Some(DMatrix::from_fn(size, size, |row, column| {
        identified.covariance[row][column] / (values[row] * values[column])
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Six poses, two series each, apart from each other and from home; no load takes the platform
    /// off cart 3.
    #[test]
    fn straps_are_spread_over_the_reach() {
        let robot = RobotFile::builtin_l2().unwrap();
        let options = SpringsOptions {
            series: 6,
            poses: 6,
            ..SpringsOptions::default()
        };
        let plan = plan_verify(&robot, &options, "v.csv").unwrap();
        assert_eq!(
            (plan.doubts.len(), plan.plan.matches("[[pose]]").count()),
            (0, 6),
            "{:?}",
            plan.doubts
        );
        assert_eq!(plan.plan.matches("[[series]]").count(), 12);
        assert_eq!(plan.plan.matches("compensated = true").count(), 6);
        assert_eq!(
            plan.plan.matches("compensated").count(),
            6,
            "false is not written"
        );
        let stands = far_apart(&robot, 6, |_| true);
        for (index, one) in stands.iter().enumerate() {
            assert!((one.tool_m - robot.home_m()).norm() > 0.3);
            assert!(
                stands
                    .iter()
                    .skip(index + 1)
                    .all(|other| (one.tool_m - other.tool_m).norm() > 0.3)
            );
        }
        assert!(plan.summary.contains("not identified"));
    }
}
