//! A calibrated F1 in the frame that its robot file is written in `[T 3.11]`.

use gantry_tau_core::model::f1::{self, AXES};
use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_machine::model::pose_at;
use nalgebra::{DMatrix, DVector, Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::derivative::{derivative, forward};
use super::parameters::{PARAMETERS, parameters, stepped};
use super::{Calibrated, Poses, PredictionError, seen_by};
use crate::fit::frames::Frames;
use crate::fit::statistics::float;

/// Step of the differences by which the covariance follows the frames, m and rad.
const DIFFERENCE: f64 = 1e-5;

/// A calibrated machine in the frame of a robot file.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    /// Positions of device and target, in the frame of the machine.
    pub frames: Frames,
    /// The machine.
    pub geometry: f1::Geometry,
    /// Covariance of its parameters, in their order. Four combinations are the file's; what was
    /// fitted of the frames moves along and is not known apart: twelve combinations more in the
    /// frame of the file, nine with a known target, none where the frames are given.
    pub covariance: DMatrix<f64>,
}

impl Placed {
    /// Moves a calibrated machine into given frames; what no pose shows is taken from `like`, a
    /// machine in them.
    fn given(calibrated: &Calibrated, frames: Frames, like: &f1::Geometry) -> Self {
        let state = &calibrated.fit.state;
        let geometry = framed(state, &frames, like);
        let by_parameter = by_parameter(
            |step| Some(framed(&stepped(state, step), &frames, like)),
            &geometry,
        );
        Self {
            frames,
            geometry,
            covariance: follow(&by_parameter, calibrated),
        }
    }

    /// The same machine in the frame of the device. The platform's axes turn along with the
    /// world's, so that a platform that is unturned in the file still is; the target stays where it
    /// is on the platform.
    #[must_use]
    pub fn in_device_frame(&self, calibrated: &Calibrated, file: &f1::Geometry) -> Self {
        let Frames { device, target } = self.frames;
        let turn = Isometry3::from_parts(Translation3::identity(), device.rotation);
        let frames = Frames {
            device: Isometry3::identity(),
            target: turn * target,
        };
        Self::given(calibrated, frames, &seen_by(file, &device, &turn.inverse()))
    }

    /// The same machine in a frame that `device` takes to the device's: that of known points.
    #[must_use]
    pub fn in_known_frame(
        &self,
        calibrated: &Calibrated,
        file: &f1::Geometry,
        device: Isometry3<f64>,
    ) -> Self {
        Self::given(
            calibrated,
            Frames {
                device,
                ..self.frames
            },
            file,
        )
    }

    /// Expected error of a place, root mean square over positions, m, each with a pose near by; NaN
    /// where there are none. `calibrated` is the same machine as the device sees it. Positions that
    /// the machine cannot stand in are left out.
    #[must_use]
    pub fn predicted_rms_m(&self, calibrated: &Calibrated, stands: &[([f64; AXES], Pose)]) -> f64 {
        let seen = &calibrated.fit.state;
        let [Ok(here), Ok(there)] = [&self.geometry, seen].map(Poses::kinematics) else {
            return f64::NAN;
        };
        let covariance = calibrated.fit.seen.covariance();
        let variances: Vec<f64> = stands
            .iter()
            .filter_map(|(q, near)| {
                let pose = forward(&here, q, near).ok()?;
                let pose = self.frames.device * isometry(&pose) * self.frames.target;
                let pose = forward(&there, q, &pose_of(&pose)).ok()?;
                let places = derivative(seen, q, &pose).fixed_rows::<3>(0).into_owned();
                Some((places * &covariance * places.transpose()).trace())
            })
            .collect();
        (variances.iter().sum::<f64>() / float(variances.len())).sqrt()
    }
}

impl Poses<'_> {
    /// Moves a calibrated machine to where the robot's file says it is: where the poses of both
    /// agree best. The home of the file's machine is at `home_m`; `target_m` is the target's centre
    /// from the tool centre point, platform axes, and is fitted along where absent.
    ///
    /// # Errors
    /// [`PredictionError`].
    pub fn in_frame_of(
        &self,
        calibrated: &Calibrated,
        file: &f1::Geometry,
        home_m: &Vector3<f64>,
        target_m: Option<Vector3<f64>>,
    ) -> Result<Placed, PredictionError> {
        let used = calibrated.used(self.poses.len());
        let state = &calibrated.fit.state;
        let of_file = self.of_file(file, home_m, &used)?;
        let frames = self.frames(&of_file, state, target_m)?;
        let geometry = framed(state, &frames, file);
        let by_parameter = by_parameter(
            |step| {
                let seen = stepped(state, step);
                let frames = self.frames(&of_file, &seen, target_m).ok()?;
                Some(framed(&seen, &frames, file))
            },
            &geometry,
        );
        Ok(Placed {
            frames,
            geometry,
            covariance: follow(&by_parameter, calibrated),
        })
    }

    /// Poses of the robot file's machine, whose home is at `home_m`, by their indices. Where the
    /// file is off, its machine may not reach each of them.
    fn of_file(
        &self,
        file: &f1::Geometry,
        home_m: &Vector3<f64>,
        used: &[usize],
    ) -> Result<Vec<(usize, Pose)>, PredictionError> {
        let kinematics = Self::kinematics(file)?;
        let mut poses: Vec<(usize, Pose)> = Vec::new();
        for &index in used {
            let q = &self.poses[index].q;
            let found = pose_at(&kinematics, home_m, q).or_else(|error| {
                poses
                    .last()
                    .map_or(Err(error), |(_, last)| forward(&kinematics, q, last))
            });
            poses.extend(found.ok().map(|pose| (index, pose)));
        }
        Ok(poses)
    }

    /// Frames in which the poses of a machine that the device sees agree best with those of the
    /// file.
    fn frames(
        &self,
        of_file: &[(usize, Pose)],
        seen: &f1::Geometry,
        target_m: Option<Vector3<f64>>,
    ) -> Result<Frames, PredictionError> {
        let of_seen = Self::kinematics(seen)?;
        let mut pairs = Vec::new();
        for (index, of_file) in of_file {
            let measured = &self.poses[*index];
            let Some(seed) = measured.pose() else {
                continue;
            };
            let seen = forward(&of_seen, &measured.q, &seed).map_err(|error| {
                PredictionError::Unreachable {
                    index: *index,
                    error,
                }
            })?;
            pairs.push((isometry(of_file), isometry(&seen)));
        }
        Frames::fitted(&pairs, target_m).ok_or(PredictionError::Frames)
    }
}

/// Returns a machine that the device sees in these frames; what no pose shows is taken from `like`,
/// a machine in them.
pub(super) fn framed(seen: &f1::Geometry, frames: &Frames, like: &f1::Geometry) -> f1::Geometry {
    let mut geometry = seen_by(seen, &frames.device.inverse(), &frames.target.inverse());
    let lever = geometry.plate_joints_m[0] - like.plate_joints_m[0];
    geometry.plate_joints_m[0] -= lever;
    geometry.carts_m[0] += lever;
    let along = geometry.turn_axis.normalize();
    let [one, other] =
        [1, 2].map(|link| (geometry.plate_joints_m[link] - like.plate_joints_m[link]).dot(&along));
    let shift = along * f64::midpoint(one, other);
    geometry.plate_joints_m[1] -= shift;
    geometry.plate_joints_m[2] -= shift;
    geometry.carts_m[1] += shift;
    geometry
}

/// Derivatives of the parameters near `geometry` by those before a motion, by central differences;
/// NaN where there is none.
fn by_parameter(
    moved: impl Fn(&DVector<f64>) -> Option<f1::Geometry>,
    geometry: &f1::Geometry,
) -> DMatrix<f64> {
    let mut by_parameter = DMatrix::repeat(PARAMETERS, PARAMETERS, f64::NAN);
    for parameter in 0..PARAMETERS {
        let mut step = DVector::zeros(PARAMETERS);
        step[parameter] = DIFFERENCE;
        let (Some(ahead), Some(behind)) = (moved(&step), moved(&-&step)) else {
            continue;
        };
        let column =
            (parameters(&ahead, geometry) - parameters(&behind, geometry)) / (2.0 * DIFFERENCE);
        by_parameter.set_column(parameter, &column);
    }
    by_parameter
}

fn follow(by_parameter: &DMatrix<f64>, calibrated: &Calibrated) -> DMatrix<f64> {
    by_parameter * calibrated.fit.seen.covariance() * by_parameter.transpose()
}

fn isometry(pose: &Pose) -> Isometry3<f64> {
    let rotation =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(pose.rotation));
    Isometry3::from_parts(Translation3::from(pose.position_m), rotation)
}

fn pose_of(pose: &Isometry3<f64>) -> Pose {
    Pose {
        position_m: pose.translation.vector,
        rotation: pose.rotation.to_rotation_matrix().into_inner(),
    }
}
