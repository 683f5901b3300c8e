//! Poses of a plan as a simulated camera or tracker sees them: a machine that is a little off its
//! file, in the frame of the device.

use gantry_tau_core::model::{f1, l2};
use gantry_tau_machine::model::{F1, L2};
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_system::output::Name;
use nalgebra::{Isometry3, Matrix3, Matrix6, Translation3, UnitQuaternion, Vector3, Vector6};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::noise::normal;
use super::{ExperimentError, PoseError};
use crate::geometry::deviation::Deviating;
use crate::measurements::poses::{PlannedPose, PoseNoise, PosesPlan};
use crate::measurements::table;

/// Stream of the seeded generator, apart from those of springs, sensor and gauges.
const TRACKER_STREAM: u64 = 8;
/// Standard deviations of where the device stands, m, and how it is turned, rad, each component.
const DEVICE_M: f64 = 2.0;
const DEVICE_RAD: f64 = 1.0;
/// Target on an F1, from the tool centre point, platform axes, m, and its turn, rad. On an L2 it is
/// the tool centre point.
const TARGET_M: [f64; 3] = [0.03, -0.02, 0.08];
const TARGET_RAD: [f64; 3] = [0.1, -0.3, 1.2];

/// Kind of machine that a tracker can be simulated for.
pub trait TrackedMachine<const N: usize>: Deviating<N> {
    /// Target on the platform.
    fn target() -> Isometry3<f64>;
}

impl TrackedMachine<{ l2::AXES }> for L2 {
    fn target() -> Isometry3<f64> {
        Isometry3::identity()
    }
}

impl TrackedMachine<{ f1::AXES }> for F1 {
    fn target() -> Isometry3<f64> {
        Isometry3::from_parts(
            Translation3::from(Vector3::from(TARGET_M)),
            UnitQuaternion::from_scaled_axis(Vector3::from(TARGET_RAD)),
        )
    }
}

/// Table of measured poses, and the planned ones that the machine cannot stand in, by name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tracked {
    /// The table.
    pub table: String,
    /// Poses without a row.
    pub skipped: Vec<Name>,
}

/// Returns what a device with the plan's noise sees in the poses of a plan, of a machine that is
/// off its file by `[simulation] geometry_mm`; its seed decides every error.
///
/// # Errors
/// [`ExperimentError`].
pub fn track<K: TrackedMachine<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    plan: &PosesPlan,
    noise: &PoseNoise,
) -> Result<Tracked, ExperimentError> {
    let mut generator = ChaCha8Rng::seed_from_u64(robot.simulation.seed);
    generator.set_stream(TRACKER_STREAM);
    let off_m = robot.simulation.geometry_mm * 1e-3;
    let [shift, turn] = [DEVICE_M, DEVICE_RAD]
        .map(|size| Vector3::from_fn(|_, _| normal(&mut generator, 1.0)) * size);
    let device = Isometry3::from_parts(
        Translation3::from(shift),
        UnitQuaternion::from_scaled_axis(turn),
    );
    let machine = robot
        .model
        .off(off_m, &mut || normal(&mut generator, 1.0))
        .map_err(|error| ExperimentError::Pose {
            pose: Name::made("of the machine"),
            reason: error.into(),
        })?;
    // Lower triangular: without a stated noise of rotations, places have their own.
    let root = noise
        .covariance(&Matrix3::identity())
        .cholesky()
        .map_or_else(Matrix6::zeros, |factor| factor.l());
    let mut table = plan.header::<N>();
    let mut skipped = Vec::new();
    for planned in &plan.poses {
        let q = axes(planned).ok_or_else(|| ExperimentError::Pose {
            pose: planned.name.clone(),
            reason: PoseError::Axes { axes: N },
        })?;
        let Some(pose) = machine.stand(&q, &planned.pose()) else {
            skipped.push(planned.name.clone());
            continue;
        };
        let rotation = UnitQuaternion::from_matrix(&pose.rotation);
        let seen = device
            * Isometry3::from_parts(Translation3::from(pose.position_m), rotation)
            * K::target();
        let mut drawn = Vector6::zeros();
        drawn
            .iter_mut()
            .take(if noise.rotation_rad2.is_some() { 6 } else { 3 })
            .for_each(|value| *value = normal(&mut generator, 1.0));
        let off = root * drawn;
        let place = seen.translation.vector + off.fixed_rows::<3>(0);
        let mut row = vec![planned.name.to_string()];
        row.extend(
            q.iter()
                .chain(place.iter())
                .map(|number| format!("{number:?}")),
        );
        if noise.rotation_rad2.is_some() {
            let turn = UnitQuaternion::from_scaled_axis(off.fixed_rows::<3>(3).into_owned())
                * seen.rotation;
            row.extend([turn.w, turn.i, turn.j, turn.k].map(|part| format!("{part:?}")));
        }
        table += &table::row(&row);
    }
    Ok(Tracked { table, skipped })
}

fn axes<const N: usize>(planned: &PlannedPose) -> Option<[f64; N]> {
    planned.q.as_slice().try_into().ok()
}
