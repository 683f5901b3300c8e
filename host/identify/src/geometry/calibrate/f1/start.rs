//! Starts of a calibration of an F1: where device and target are, by the robot file.

use gantry_tau_core::model::f1::{AXES, Geometry};
use gantry_tau_machine::model::{F1, pose_at};
use gantry_tau_machine::robot_file::RobotFile;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::super::MAX_OUTLIER_SHARE;
use crate::fit::frames::{Frames, LEVER_M, near};
use crate::fit::goodness::MIN_P;
use crate::fit::least_squares::FitError;
use crate::fit::statistics::{chi_squared_above, float};
use crate::geometry::f1::{Calibrated, Poses, PredictionError, seen_by};
use crate::geometry::robust_fit::{cost, fit_agreeing, fit_agreeing_first};
use crate::measurements::poses::MeasuredPose;

/// Relative difference of chi-squared of two fits that have found the same machine.
const SAME: f64 = 1e-6;

/// Reason why no start fits.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(super) enum StartError {
    /// No start has frames of device and target.
    #[error(
        "the robot file's machine cannot stand as measured, or the poses turn too little to distinguish device and target"
    )]
    NoFrames,
    /// No fit from a start succeeds.
    #[error(transparent)]
    Fit(#[from] FitError<PredictionError>),
}

/// Fits from the robot file where the device sees it, begun with the poses whose places are near.
/// That may be far off with wrong poses among them, so unless a fit is to be believed it is made
/// again from frames of other poses. Returns the best, and its frames.
pub(super) fn best_start(
    pairs: &[(Isometry3<f64>, Isometry3<f64>)],
    target_m: Option<Vector3<f64>>,
    model: &Poses<'_>,
    file: &Geometry,
) -> Result<(Frames, Calibrated), StartError> {
    let mut best = Err(StartError::NoFrames);
    let places: Vec<_> = pairs
        .iter()
        .map(|(pose, seen)| (pose.translation.vector, seen.translation.vector))
        .collect();
    let near: Vec<_> = near(&places)
        .into_iter()
        .map(|index| pairs[index])
        .collect();
    for (attempt, frames) in starts(&near, target_m)
        .chain(starts(pairs, target_m))
        .enumerate()
    {
        let start = seen_by(file, &frames.device, &frames.target);
        let fitted = if attempt == 0 && near.len() == pairs.len() {
            fit_agreeing(model, start)
        } else {
            fit_agreeing_first(model, start)
        };
        match (fitted, &best) {
            (Ok(found), Ok((_, before)))
                if cost::<Poses<'_>>(&found) >= cost::<Poses<'_>>(before) =>
            {
                // The same again: no start leads elsewhere.
                if (found.fit.chi_squared() / before.fit.chi_squared() - 1.0).abs() < SAME {
                    break;
                }
            }
            (Ok(found), _) => {
                let many = float(found.outliers.len()) > MAX_OUTLIER_SHARE * float(pairs.len());
                let is_good = !many
                    && chi_squared_above(found.fit.chi_squared(), found.fit.degrees()) >= MIN_P;
                best = Ok((frames, found));
                if is_good {
                    break;
                }
            }
            (Err(error), Err(_)) => best = Err(error.into()),
            (Err(_), Ok(_)) => {}
        }
    }
    best
}

/// Frames by all poses, and by the half of them that agrees best, with the turn of the target begun
/// from one pose, then from others.
fn starts(
    pairs: &[(Isometry3<f64>, Isometry3<f64>)],
    target_m: Option<Vector3<f64>>,
) -> impl Iterator<Item = Frames> {
    let count = pairs.len();
    [0, count / 3, 2 * count / 3]
        .into_iter()
        .filter(move |_| count > 0)
        .flat_map(move |first| starts_from(first, pairs.to_vec(), target_m))
}

/// Frames by all poses and by the better half, with the turn of the target begun from the pose
/// `first`.
fn starts_from(
    first: usize,
    mut pairs: Vec<(Isometry3<f64>, Isometry3<f64>)>,
    target_m: Option<Vector3<f64>>,
) -> impl Iterator<Item = Frames> {
    pairs.rotate_left(first);
    let all = Frames::fitted(&pairs, target_m);
    let agreeing = all.and_then(|frames| {
        pairs.sort_by(|one, other| left_m(&frames, one).total_cmp(&left_m(&frames, other)));
        Frames::fitted(&pairs[..pairs.len().div_ceil(2)], target_m)
    });
    [all, agreeing].into_iter().flatten()
}

/// Distance that frames leave between a pose of the file and the measured one, m.
fn left_m(frames: &Frames, (pose, seen): &(Isometry3<f64>, Isometry3<f64>)) -> f64 {
    let off = (frames.device * pose * frames.target).inverse() * seen;
    off.translation.vector.norm() + LEVER_M * off.rotation.angle()
}

/// Poses of the robot file's machine, and the measured ones.
pub(super) fn pairs(
    robot: &RobotFile<F1, AXES>,
    poses: &[MeasuredPose<AXES>],
) -> Vec<(Isometry3<f64>, Isometry3<f64>)> {
    let pairs = poses.iter().filter_map(|pose| {
        let of_file = pose_at(&robot.model, &robot.home_m(), &pose.q).ok()?;
        let rotation = UnitQuaternion::from_matrix(&of_file.rotation);
        let of_file = Isometry3::from_parts(Translation3::from(of_file.position_m), rotation);
        Some((
            of_file,
            Isometry3::from_parts(Translation3::from(pose.position_m), pose.rotation?),
        ))
    });
    pairs.collect()
}

#[cfg(test)]
mod tests {
    use gantry_tau_core::model::kinematics::Pose;
    use nalgebra::Matrix3;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::super::whitening;
    use super::*;
    use crate::measurements::poses::PoseNoise;
    use gantry_tau_system::output::Name;

    /// Vector whose components are drawn up to `most` in size.
    fn vector(random: &mut ChaCha8Rng, most: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| most * random.random_range(-1.0..1.0_f64))
    }

    /// Motion with a shift of up to `shift_m` per axis, and a turn of up to `turn_rad`.
    fn motion(random: &mut ChaCha8Rng, shift_m: f64, turn_rad: f64) -> Isometry3<f64> {
        let shift = Translation3::from(vector(random, shift_m));
        Isometry3::from_parts(
            shift,
            UnitQuaternion::from_scaled_axis(vector(random, turn_rad)),
        )
    }

    fn is_right(found: &Calibrated) -> bool {
        found.outliers == [0, 1, 14] && found.fit.reduced_chi_squared() < 1.5
    }

    /// A tracker that took another target for this one, three times, metres away: the first fit
    /// goes astray.
    #[test]
    fn poses_that_are_far_off_are_left_out_from_another_start() {
        let robot = RobotFile::builtin_f1().unwrap();
        let file = Geometry {
            travel: None,
            ..*robot.model.robot().geometry()
        };
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let device = motion(&mut random, 3.0, 2.0);
        let target = motion(&mut random, 0.1, 1.0);
        let mut poses = Vec::new();
        while poses.len() < 40 {
            let mut pose = motion(&mut random, 0.25, 0.2);
            pose.translation.vector = robot.home_m() + pose.translation.vector;
            let of_robot = Pose {
                position_m: pose.translation.vector,
                rotation: pose.rotation.to_rotation_matrix().into_inner(),
            };
            let Ok(found) = robot.model.inverse_in_assembly(&of_robot, None) else {
                continue;
            };
            let is_wrong = [0, 1, 14].contains(&poses.len());
            let seen = device * pose * target;
            let seen = if is_wrong {
                motion(&mut random, 2.0, 2.0) * seen
            } else {
                seen
            };
            // Even noise of these deviations.
            let position_m = seen.translation.vector + vector(&mut random, 50e-6 * 3.0_f64.sqrt());
            let rotation = Some(
                UnitQuaternion::from_scaled_axis(vector(&mut random, 100e-6 * 3.0_f64.sqrt()))
                    * seen.rotation,
            );
            poses.push(MeasuredPose {
                name: Name::made(poses.len()),
                q: found.value,
                position_m,
                rotation,
            });
        }
        let noise = PoseNoise::independent(
            Matrix3::identity() * 2.5e-9,
            Some(Matrix3::identity() * 1e-8),
        );
        let pairs = pairs(&robot, &poses);
        let model = Poses {
            poses: &poses,
            whitening: whitening(&noise),
        };
        let first = starts(&pairs, None).next().unwrap();
        let alone = fit_agreeing(&model, seen_by(&file, &first.device, &first.target));

        assert!(
            !alone.is_ok_and(|found| is_right(&found)),
            "the first start is good enough"
        );
        let (_, found) = best_start(&pairs, None, &model, &file).unwrap();
        assert!(
            is_right(&found),
            "{:?} {}",
            found.outliers,
            found.fit.reduced_chi_squared()
        );
    }
}
