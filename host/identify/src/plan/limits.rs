//! Limits of a plan: poses away from singular ones, that every machine can stand in which the robot
//! file allows.

use gantry_tau_core::model::f1;
use gantry_tau_core::model::kinematics;
use gantry_tau_core::model::robot::{ARM_OF_LINK, ARMS};
use gantry_tau_machine::elastic::Pose;
use gantry_tau_machine::elastic::joints::joint;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_system::output::Name;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::geometry::deviation::Deviating;

/// Smallest determinant of the directions of the clusters, and smallest cosine between a link and
/// its guideway.
const MIN_REGULARITY: f64 = 0.1;
/// The same of each machine that the robot file allows. Those that are tried are twice as far off,
/// so that of 5 000 that are as far off as the file says each one stands in every planned pose.
const MIN_REGULARITY_OFF_FILE: f64 = 0.03;
const FARTHER: f64 = 2.0;
const ALLOWED: usize = 200;
const SEED: u64 = 1;
/// Factor by which a machine may be softer than its file.
pub(super) const MAX_SOFT: f64 = 2.0;
/// Range of a gauge, m.
pub(super) const GAUGE_RANGE_M: f64 = 0.01;

/// Machines that a robot file allows: off it by `[simulation] geometry_mm` and farther, each number
/// by a normal variable.
pub(super) struct Allowed<K>(Vec<K>);

impl<K> Allowed<K> {
    pub(super) fn of<const N: usize>(robot: &RobotFile<K, N>) -> Self
    where
        K: Deviating<N>,
    {
        let mut generator = ChaCha8Rng::seed_from_u64(SEED);
        let off_m = FARTHER * robot.simulation.geometry_mm * 1e-3;
        let machines = (0..ALLOWED).filter_map(|_| {
            robot
                .model
                .off(off_m, &mut || StandardNormal.sample(&mut generator))
                .ok()
        });
        Self(machines.collect())
    }

    /// True if each of the machines stands well with the axes at `q`, where the file's has this
    /// pose.
    pub(super) fn can_stand<const N: usize>(&self, pose: &kinematics::Pose, q: &[f64; N]) -> bool
    where
        K: Deviating<N>,
    {
        // Without a machine that can be, no machine stands.
        !self.0.is_empty()
            && self.0.iter().all(|machine| {
                machine.stand(q, pose).is_some_and(|pose| {
                    let rotation = UnitQuaternion::from_matrix(&pose.rotation);
                    let pose = Pose {
                        translation_m: pose.position_m,
                        rotation,
                    };
                    regularity(&machine.geometry(), &pose, q) >= MIN_REGULARITY_OFF_FILE
                })
            })
    }
}

/// Says in which of the poses of a plan, with their positions of the axes, a machine that the robot
/// file allows may not stand.
pub(super) fn doubtful<'a, K: Deviating<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    poses: impl Iterator<Item = (&'a Name, kinematics::Pose, [f64; N])>,
) -> Option<String> {
    let allowed = Allowed::of(robot);
    let names: Vec<String> = poses
        .filter(|(_, pose, q)| !allowed.can_stand(pose, q))
        .map(|(name, ..)| name.to_string())
        .collect();
    let off_mm = robot.simulation.geometry_mm;
    (!names.is_empty()).then(|| {
        format!(
            "a machine {off_mm} mm off its file may not stand in {}; plan others",
            names.join(", ")
        )
    })
}

/// True if the pose is away from singular ones: `|det s|` of the clusters' directions and `|s.v|`
/// of every link are at least a tenth.
pub(super) fn is_regular<const N: usize>(
    geometry: &f1::Geometry,
    pose: &Pose,
    q: &[f64; N],
) -> bool {
    regularity(geometry, pose, q) >= MIN_REGULARITY
}

/// The smallest of `|det s|` of the clusters' directions and of `|s.v|` of every link.
fn regularity<const N: usize>(geometry: &f1::Geometry, pose: &Pose, q: &[f64; N]) -> f64 {
    let mut least = f64::INFINITY;
    let mut sums = [Vector3::zeros(); ARMS];
    for (link, arm) in ARM_OF_LINK.into_iter().enumerate() {
        let on_platform = pose.translation_m + pose.rotation * geometry.platform_joints_m[link];
        let direction = (joint(geometry, link, q).place_m - on_platform).normalize();
        least = least.min(direction.dot(&geometry.guideways[arm].normalize()).abs());
        sums[arm] += direction;
    }
    least.min(
        Matrix3::from_columns(&sums.map(|sum| sum.normalize()))
            .determinant()
            .abs(),
    )
}
