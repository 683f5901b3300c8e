//! Plan of poses for a calibration `[T 3.2]`, and judgement of any such plan.

mod f1;
mod l2;

use std::fmt;
use std::path::Path;

use gantry_tau_core::model::kinematics::{KinematicsError, Pose};
use gantry_tau_machine::elastic;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_system::output::Name;
use nalgebra::{DMatrix, Matrix3, Matrix6, UnitQuaternion, Vector3};

use super::exchange::{Candidate, Criterion, Search};
use super::expected::{Expected, Parameters};
use super::limits::{Allowed, doubtful, is_regular};
use super::springs::lost;
use super::time::Minutes;
use super::{PlanError, Written, check_range, model_name, sheet};
use crate::fit::frames::LEVER_M;
use crate::fit::statistics::float;
use crate::geometry::calibrate::expected::stands;
use crate::geometry::calibrate::f1::whitening;
use crate::geometry::deviation::Deviating;
use crate::measurements::poses::{PlannedPose, PoseNoise, PosesPlan};

/// Largest distance between the positions of a planned pose and those that the kinematics give,
/// q-units.
const SAME_Q: f64 = 1e-4;

/// Starts of the search with this many parameters or fewer, and with more: an F1's takes seconds
/// each, and they end within a few percent.
const STARTS: u64 = 4;
const FEW_PARAMETERS: usize = 30;

/// Options of a plan.
#[derive(Clone, Debug, PartialEq)]
pub struct GeometryOptions {
    /// Number of poses.
    pub poses: usize,
    /// Quantity that the plan makes small.
    pub criterion: Criterion,
    /// Standard deviation of each coordinate of a place, µm; of a rotation vector, where one is
    /// needed, that of a place half a metre away.
    pub noise_um: f64,
}

impl Default for GeometryOptions {
    fn default() -> Self {
        Self {
            poses: 30,
            criterion: Criterion::I,
            noise_um: 50.0,
        }
    }
}

/// A kind of machine whose geometry can be planned for.
pub trait PlannedMachine<const N: usize>: Deviating<N> {
    /// True if orientations are measured, not places alone.
    const IS_TURNED: bool;

    /// Poses that a plan may contain, before any limit.
    fn poses(robot: &RobotFile<Self, N>) -> Vec<Pose>;

    /// Positions of the axes in a pose, within travel.
    ///
    /// # Errors
    /// [`KinematicsError`].
    fn axes_in(&self, pose: &Pose) -> Result<[f64; N], KinematicsError>;

    /// Names of the parameters, and their units.
    fn names() -> Vec<(String, &'static str)>;

    /// Change of each parameter that would matter, and orthonormal columns of the combinations that
    /// can be determined.
    fn scales_and_basis(&self) -> (nalgebra::DVector<f64>, DMatrix<f64>);

    /// Derivative of the pose by the parameters: 3 rows, m, or 6, m and rad.
    fn derivative(&self, pose: &Pose, q: &[f64; N]) -> DMatrix<f64>;
}

/// Machine in a pose: what a measurement there shows.
struct Spot<const N: usize> {
    pose: Pose,
    q: [f64; N],
    /// Derivative in scaled parameters, in the coordinates of the basis.
    rows: DMatrix<f64>,
}

/// Parameters and what turns derivatives into scaled coordinates.
struct ScaledParameters {
    parameters: Parameters,
    /// `diag(scales) basis`.
    reduce: DMatrix<f64>,
}

impl ScaledParameters {
    fn of<K: PlannedMachine<N>, const N: usize>(machine: &K) -> Self {
        let (scales, basis) = machine.scales_and_basis();
        let shown = K::names();
        let reduce = DMatrix::from_diagonal(&scales) * &basis;

        let parameters = Parameters {
            shown: shown
                .iter()
                .zip(&scales)
                .map(|((name, unit), scale)| (scale * 1e6, shown_unit(name, unit)))
                .collect(),
            names: shown.into_iter().map(|(name, _)| name).collect(),
            basis,
            index_unit: if K::IS_TURNED {
                "1 m, 1 rad"
            } else {
                "10 mm, 10 mrad"
            },
        };
        Self { parameters, reduce }
    }

    /// The machine in a pose, if it stands there well.
    fn spot<K: PlannedMachine<N>, const N: usize>(
        &self,
        robot: &RobotFile<K, N>,
        pose: Pose,
    ) -> Option<Spot<N>> {
        let q = robot.model.axes_in(&pose).ok()?;
        let rotation = UnitQuaternion::from_matrix(&pose.rotation);
        let at = elastic::Pose {
            translation_m: pose.position_m,
            rotation,
        };
        is_regular(&robot.model.geometry(), &at, &q).then(|| self.at(robot, pose, q))
    }

    fn at<K: PlannedMachine<N>, const N: usize>(
        &self,
        robot: &RobotFile<K, N>,
        pose: Pose,
        q: [f64; N],
    ) -> Spot<N> {
        Spot {
            pose,
            q,
            rows: robot.model.derivative(&pose, &q) * &self.reduce,
        }
    }
}

/// Unit that a standard deviation of a parameter is shown in.
fn shown_unit(name: &str, unit: &str) -> &'static str {
    match (unit, name.starts_with('V')) {
        ("rad", _) => "urad",
        (_, true) => "um/m",
        _ => "um",
    }
}

/// Spots that a plan may contain, which are also those where the place is asked for.
fn spots<K: PlannedMachine<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    model: &ScaledParameters,
) -> Vec<Spot<N>> {
    K::poses(robot)
        .into_iter()
        .filter_map(|pose| model.spot(robot, pose))
        .collect()
}

/// The machine at the places of the workspace that a calibration judges itself by.
fn workspace<K: PlannedMachine<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    model: &ScaledParameters,
) -> Vec<Spot<N>> {
    let (_, stands) = stands(robot);
    stands
        .into_iter()
        .filter_map(|(q, tool_m)| {
            let pose = robot.model.stand(&q, &Pose::at(tool_m))?;
            Some(model.at(robot, pose, q))
        })
        .collect()
}

/// `M`: mean of `G^T G` of the places.
fn goal<const N: usize>(model: &ScaledParameters, spots: &[Spot<N>]) -> DMatrix<f64> {
    let size = model.parameters.basis.ncols();
    let mut goal = DMatrix::zeros(size, size);
    for spot in spots {
        let places = spot.rows.rows(0, 3);
        goal += places.tr_mul(&places) / float(spots.len());
    }
    goal
}

fn whitened<const N: usize>(spot: &Spot<N>, whitening: &Matrix6<f64>) -> DMatrix<f64> {
    let size = spot.rows.nrows();
    whitening.view((0, 0), (size, size)) * &spot.rows
}

/// Expected result of a plan of poses, and its cost.
#[derive(Clone, Debug, PartialEq)]
pub struct Judgement {
    /// Standard deviations, directions, indices.
    pub expected: Expected,
    /// Root mean square of the predicted error of a place over the workspace, as a calibration
    /// expects it, m; `None` where nothing is reached.
    pub workspace_rms_m: Option<f64>,
    minutes: Minutes,
}

impl fmt::Display for Judgement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.expected)?;
        let but = if self.expected.is_complete() {
            ""
        } else {
            ", lost directions not counted"
        };
        let rms_um = self.expected.rms_m * 1e6;
        writeln!(
            f,
            "predicted error  {rms_um:.1} um rms of a place over the grid of poses{but}"
        )?;
        if let Some(rms_um) = self.workspace_rms_m.map(|rms_m| rms_m * 1e6) {
            writeln!(
                f,
                "                 {rms_um:.1} um rms over the workspace, as calibrate expects it{but}"
            )?;
        }
        write!(f, "time             {}", self.minutes)
    }
}

/// Plans poses and judges them. `measurements` is the name of their table.
///
/// # Errors
/// [`PlanError`].
pub fn plan_geometry<K: PlannedMachine<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    options: &GeometryOptions,
    measurements: &str,
) -> Result<Written, PlanError> {
    check_range("--poses", float(options.poses), 1.0, 300.0)?;
    check_range("--noise-um", options.noise_um, 1e-2, 1e4)?;
    let rotation_urad = K::IS_TURNED.then_some(options.noise_um / LEVER_M);
    let noise = isotropic(
        options.noise_um * 1e-6,
        rotation_urad.map(|urad| urad * 1e-6),
    );
    let model = ScaledParameters::of(&robot.model);
    let spots = spots(robot, &model);
    if spots.is_empty() {
        let reason = "no pose of the grid is in travel and away from singular ones".to_owned();
        return Err(PlanError::NoCandidate {
            robot: robot.name.clone(),
            reason,
        });
    }
    let allowed = Allowed::of(robot);
    let safe: Vec<bool> = spots
        .iter()
        .map(|spot| allowed.can_stand(&spot.pose, &spot.q))
        .collect();
    let left_out = safe.iter().filter(|is_safe| !**is_safe).count();
    let off_mm = robot.simulation.geometry_mm;
    let found = chosen(&model, &spots, &safe, &noise, options).ok_or_else(|| {
        PlanError::Option(format!(
            "--poses is {}; the grid has {} where a machine {off_mm} mm off its file can stand",
            options.poses,
            spots.len() - left_out
        ))
    })?;
    let plan = PosesPlan {
        measurements: measurements.to_owned(),
        position_um: options.noise_um,
        rotation_urad,
        poses: in_order(robot, &spots, found),
    };
    let judgement = judge(robot, &noise, &plan.poses, &robot.name)?;
    let mut summary = judgement.to_string();
    let all = (left_out > 0)
        .then(|| chosen(&model, &spots, &vec![true; spots.len()], &noise, options))
        .flatten();
    if let Some(all) = all {
        let all = in_order(robot, &spots, all);
        let [with_um, without_um] = [
            judgement.expected.rms_m,
            judge(robot, &noise, &all, &robot.name)?.expected.rms_m,
        ]
        .map(|rms_m| rms_m * 1e6);
        summary += &format!(
            "\nmargin           {left_out} of {} poses are left out, where a machine {off_mm} mm off its file may not stand: {with_um:.1} instead of {without_um:.1} um rms",
            spots.len()
        );
    }
    Ok(Written {
        plan: plan
            .text(model_name::<N>())
            .map_err(|error| PlanError::Text(error.to_string()))?,
        header: plan.header::<N>(),
        sheet: sheet::poses(robot, &plan, &judgement)?,
        summary,
        doubts: lost(&judgement.expected).into_iter().collect(),
    })
}

fn isotropic(position_m: f64, rotation_rad: Option<f64>) -> PoseNoise {
    fn square(sd: f64) -> Matrix3<f64> {
        Matrix3::from_diagonal_element(sd * sd)
    }
    PoseNoise::independent(square(position_m), rotation_rad.map(square))
}

/// The best of the spots that are `safe`, by index.
fn chosen<const N: usize>(
    model: &ScaledParameters,
    spots: &[Spot<N>],
    safe: &[bool],
    noise: &PoseNoise,
    options: &GeometryOptions,
) -> Option<Vec<usize>> {
    let whitening = whitening(noise);
    let candidates: Vec<Candidate> = spots
        .iter()
        .enumerate()
        .filter(|(place, _)| safe[*place])
        .map(|(place, spot)| Candidate {
            rows: whitened(spot, &whitening),
            place,
            strap: 0,
        })
        .collect();
    let goal = goal(model, spots);
    let starts = if goal.ncols() > FEW_PARAMETERS {
        1
    } else {
        STARTS
    };
    let found = Search::new(
        &candidates,
        &goal,
        options.criterion,
        options.poses,
        options.poses,
    )
    .best(starts)?;
    Some(
        found
            .into_iter()
            .map(|index| candidates[index].place)
            .collect(),
    )
}

/// The chosen spots with names, in an order of short ways, from home on.
fn in_order<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    spots: &[Spot<N>],
    mut left: Vec<usize>,
) -> Vec<PlannedPose> {
    let mut here = robot.home_m();
    let mut order = Vec::with_capacity(left.len());
    while let Some(next) = left
        .iter()
        .copied()
        .min_by(|one, other| way_m(&here, &spots[*one]).total_cmp(&way_m(&here, &spots[*other])))
    {
        left.retain(|index| *index != next);
        let spot = &spots[next];
        here = spot.pose.position_m;
        let name = Name::made(format_args!("p{}", order.len() + 1));
        order.push(PlannedPose::new(name, &spot.pose, &spot.q));
    }
    order
}

fn way_m<const N: usize>(from: &Vector3<f64>, to: &Spot<N>) -> f64 {
    (from - to.pose.position_m).norm()
}

/// Judges the poses of a plan, which `plan` names in errors.
///
/// # Errors
/// [`PlanError`].
pub fn judge<K: PlannedMachine<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    noise: &PoseNoise,
    poses: &[PlannedPose],
    plan: &str,
) -> Result<Judgement, PlanError> {
    let model = ScaledParameters::of(&robot.model);
    let whitening = whitening(noise);
    let size = if K::IS_TURNED { 6 } else { 3 };
    let mut rows = DMatrix::zeros(size * poses.len(), model.parameters.basis.ncols());
    for (index, planned) in poses.iter().enumerate() {
        let pose = planned.pose();
        let q = robot
            .model
            .axes_in(&pose)
            .map_err(|error| refused(plan, planned, error))?;
        let is_same = planned.q.len() == N
            && q.iter()
                .zip(&planned.q)
                .all(|(one, other)| (one - other).abs() < SAME_Q);
        if !is_same {
            let reason = format!("q and T disagree; expected q = {q:.6?}");
            return Err(refused(plan, planned, reason));
        }
        let spot = model.at(robot, pose, q);
        rows.rows_mut(size * index, size)
            .copy_from(&whitened(&spot, &whitening));
    }
    let goal = goal(&model, &spots(robot, &model));
    let readings = rows.nrows();
    let expected = Expected::new(&model.parameters, rows, readings, &goal);
    let reached = workspace(robot, &model);
    let workspace_rms_m =
        (!reached.is_empty()).then(|| expected.rms_m_of(&self::goal(&model, &reached)));
    Ok(Judgement {
        expected,
        workspace_rms_m,
        minutes: Minutes::of_places(poses.len()),
    })
}

fn refused(plan: &str, planned: &PlannedPose, reason: impl fmt::Display) -> PlanError {
    PlanError::NoCandidate {
        robot: plan.to_owned(),
        reason: format!("pose.{}: {reason}", planned.name),
    }
}

/// Reads a plan of poses and judges it. Returns what to expect, and reasons not to measure it as it
/// is.
///
/// # Errors
/// [`PlanError`].
pub(super) fn check<K: PlannedMachine<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    path: &Path,
) -> Result<(String, Vec<String>), PlanError> {
    let (plan, noise) = PosesPlan::read(path, model_name::<N>())?;
    let judgement = judge(robot, &noise, &plan.poses, &path.display().to_string())?;
    let poses = plan.poses.iter();
    let doubtful = doubtful(
        robot,
        poses.filter_map(|planned| {
            Some((
                &planned.name,
                planned.pose(),
                planned.q.as_slice().try_into().ok()?,
            ))
        }),
    );
    Ok((
        judgement.to_string(),
        lost(&judgement.expected)
            .into_iter()
            .chain(doubtful)
            .collect(),
    ))
}

#[cfg(test)]
mod tests;
