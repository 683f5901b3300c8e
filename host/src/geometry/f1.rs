//! Calibration of an F1: 64 parameters from poses, 60 of which can be seen.
//!
//! A pose is predicted by the forward kinematics at the measured positions of the axes, from the measured pose on, and
//!
//!     W^T d(pose)/dtheta = s_ij . (dC_i + q_i dV_i + Q_i dP_ij + dQ_i P_ij - R db_ij) - dL_ij
//!
//! there, with `d(pose)` a translation and a rotation vector in the axes of the device. The axes of the plates move by rotation vectors:
//! `a <- exp(d) a` changes `Rot(a, q) p` by `d x (Rot(a, q) p) - Rot(a, q) (d x p)`.
//!
//! What cannot be seen: `C_1` against `P_11` (arm 1 has no plate), and `C_2` against `P_21`, `P_22` along the plates' axis. No step is taken
//! along either.

use gantry_tau_core::model::f1::{self, AXES};
use gantry_tau_core::model::kinematics::{COLD_ITERATIONS, KinematicsError, Pose};
use gantry_tau_core::model::robot::{ARM_OF_LINK, ARMS, LINKS, RobotError};
use nalgebra::{
    DMatrix, DVector, Isometry3, Matrix3, Matrix6, Rotation3, SMatrix, Translation3, Unit, UnitQuaternion, Vector3,
    Vector6,
};

use super::MeasuredPose;
use super::agreement::{Agreement, Model};
use super::frames::{Frames, apply, rotation_vector};
use crate::elastic::joints::joint;
use crate::fit::least_squares::Rows;
use crate::fit::statistics::float;
use crate::model::pose_at;

/// First parameters of the groups `C` (9), `V` (9), `P` (18), `b` (18), `L` (6), `ax` (2), `ax6` (2), and their number.
const C: usize = 0;
const V: usize = 9;
const P: usize = 18;
const B: usize = 36;
const L: usize = 54;
const AX: usize = 60;
const AX6: usize = 62;
/// All of them.
pub const PARAMETERS: usize = 64;
/// Those that can be seen.
pub const OBSERVABLE: usize = 60;
/// Changes that would matter: of a place or a length, m, and of a direction, rad. Ten times those of an L2: some combinations of joints move
/// the tool so little that sixty poses know them to centimetres only, and are estimated all the same.
const TOLERANCE_M: f64 = 1.0;
const TOLERANCE_RAD: f64 = 1.0;
/// Standard deviation of a combination that no step may be taken along, m.
const FIXED_M: f64 = 1e-9;

/// Reason why a machine predicts no pose.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PredictionError {
    /// Its parameters are refused.
    #[error(transparent)]
    Robot(#[from] RobotError),
    /// The frames of device and target do not follow from the poses.
    #[error("the poses turn too little: where device and target are cannot be told apart")]
    Frames,
    /// A pose cannot be reached.
    #[error("pose {index}: {error}")]
    Unreachable {
        /// Index of the pose.
        index: usize,
        /// What the kinematics say.
        error: KinematicsError,
    },
}

/// Measured poses, and what the device's noise is.
#[derive(Clone, Copy, Debug)]
pub struct Poses<'a> {
    /// The poses; one without an orientation is not used.
    pub poses: &'a [MeasuredPose<AXES>],
    /// Whitening matrix `W`: `W^T W` is the inverse of the covariance of place (m) and rotation vector (rad).
    pub whitening: Matrix6<f64>,
}

/// Returns the machine as the device sees it: world axes moved by `device`, platform axes and tool centre point replaced by the target's,
/// which is at `target` on the platform.
#[must_use]
pub fn seen_by(geometry: &f1::Geometry, device: &Isometry3<f64>, target: &Isometry3<f64>) -> f1::Geometry {
    let turn = device.rotation;
    let to_target = target.inverse();
    f1::Geometry {
        carts_m: geometry.carts_m.map(|cart| apply(device, &cart)),
        guideways: geometry.guideways.map(|guideway| turn * guideway),
        plate_joints_m: geometry.plate_joints_m.map(|joint| turn * joint),
        platform_joints_m: geometry.platform_joints_m.map(|joint| apply(&to_target, &joint)),
        turn_axis: turn * geometry.turn_axis,
        tilt_axis: turn * geometry.tilt_axis,
        ..*geometry
    }
}

/// Returns two unit vectors across a direction.
fn across(axis: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let axis = axis.normalize();
    let least = Vector3::ith(axis.iamin(), 1.0);
    let first = axis.cross(&least).normalize();
    [first, axis.cross(&first)]
}

/// Change of each parameter that would matter.
pub(crate) fn scales(geometry: &f1::Geometry) -> DVector<f64> {
    let mut scales = DVector::repeat(PARAMETERS, TOLERANCE_M);
    for (arm, guideway) in geometry.guideways.iter().enumerate() {
        scales.fixed_rows_mut::<3>(V + 3 * arm).fill(TOLERANCE_RAD * guideway.norm());
    }
    scales.rows_mut(AX, PARAMETERS - AX).fill(TOLERANCE_RAD);
    scales
}

/// Returns a machine changed by a step of its parameters.
fn stepped(geometry: &f1::Geometry, step: &DVector<f64>) -> f1::Geometry {
    let vector = |first: usize| step.fixed_rows::<3>(first).into_owned();
    let turned = |axis: &Vector3<f64>, first: usize| {
        let [one, other] = across(axis);
        UnitQuaternion::from_scaled_axis(one * step[first] + other * step[first + 1]) * axis
    };
    f1::Geometry {
        carts_m: std::array::from_fn(|arm| geometry.carts_m[arm] + vector(C + 3 * arm)),
        guideways: std::array::from_fn(|arm| geometry.guideways[arm] + vector(V + 3 * arm)),
        plate_joints_m: std::array::from_fn(|link| geometry.plate_joints_m[link] + vector(P + 3 * link)),
        platform_joints_m: std::array::from_fn(|link| geometry.platform_joints_m[link] + vector(B + 3 * link)),
        lengths_m: std::array::from_fn(|link| geometry.lengths_m[link] + step[L + link]),
        turn_axis: turned(&geometry.turn_axis, AX),
        tilt_axis: turned(&geometry.tilt_axis, AX6),
        ..*geometry
    }
}

/// Returns the pose with the axes at `q`, the one near `seed`. To rounding: core's tolerance of a billionth of a link is followed by one
/// more step, so that derivatives can be seen in differences.
///
/// # Errors
/// As [`f1::Kinematics::forward_from`].
pub fn forward(kinematics: &f1::Kinematics, q: &[f64; AXES], seed: &Pose) -> Result<Pose, KinematicsError> {
    let mut pose = kinematics.forward_from(q, seed, COLD_ITERATIONS)?.value;
    let geometry = kinematics.robot().geometry();
    let errors = Vector6::from_fn(|link, _| {
        let on_platform = pose.position_m + pose.rotation * geometry.platform_joints_m[link];
        (joint(geometry, link, q).place_m - on_platform).norm() - geometry.lengths_m[link]
    });
    // Moving the platform by a step shortens the links by `W^T step`.
    let step = lines(geometry, q, &pose).try_inverse().ok_or(KinematicsError::NotFinite)? * errors;
    pose.position_m += step.fixed_rows::<3>(0);
    pose.rotation = Rotation3::from_scaled_axis(step.fixed_rows::<3>(3).into_owned()).into_inner() * pose.rotation;
    Ok(pose)
}

/// `W^T`: row `s, l x s` per link.
fn lines(geometry: &f1::Geometry, q: &[f64; AXES], pose: &Pose) -> Matrix6<f64> {
    let mut lines = Matrix6::zeros();
    for link in 0..LINKS {
        let lever = pose.rotation * geometry.platform_joints_m[link];
        let s = (joint(geometry, link, q).place_m - pose.position_m - lever).normalize();
        lines.fixed_view_mut::<1, 3>(link, 0).copy_from(&s.transpose());
        lines.fixed_view_mut::<1, 3>(link, 3).copy_from(&lever.cross(&s).transpose());
    }
    lines
}

/// Derivative of a pose by the parameters.
pub(crate) fn derivative(geometry: &f1::Geometry, q: &[f64; AXES], pose: &Pose) -> SMatrix<f64, 6, PARAMETERS> {
    let lines = lines(geometry, q, pose);
    let mut lengths = SMatrix::<f64, 6, PARAMETERS>::zeros();
    let (turn_axis, tilt_axis) = (Unit::new_normalize(geometry.turn_axis), Unit::new_normalize(geometry.tilt_axis));
    for link in 0..LINKS {
        let arm = ARM_OF_LINK[link];
        let s = lines.fixed_view::<1, 3>(link, 0).transpose();
        let sign = |plate: usize| geometry.turn_signs[plate].sign();
        let (turn, tilt) = match arm {
            1 => (Rotation3::from_axis_angle(&turn_axis, sign(0) * q[3]), Rotation3::identity()),
            2 => (Rotation3::from_axis_angle(&turn_axis, sign(1) * q[4]), Rotation3::from_axis_angle(&tilt_axis, q[5])),
            _ => (Rotation3::identity(), Rotation3::identity()),
        };
        let mut set = |first: usize, row: Vector3<f64>| {
            lengths.fixed_view_mut::<1, 3>(link, first).copy_from(&row.transpose());
        };
        set(C + 3 * arm, s);
        set(V + 3 * arm, s * q[arm]);
        set(P + 3 * link, (turn * tilt).inverse() * s);
        set(B + 3 * link, -(pose.rotation.transpose() * s));
        lengths[(link, L + link)] = -1.0;
        let (plate, tilted) = (geometry.plate_joints_m[link], tilt * geometry.plate_joints_m[link]);
        for (index, d) in across(&geometry.turn_axis).iter().enumerate() {
            lengths[(link, AX + index)] = s.dot(&(d.cross(&(turn * tilted)) - turn * d.cross(&tilted)));
        }
        for (index, d) in across(&geometry.tilt_axis).iter().enumerate() {
            lengths[(link, AX6 + index)] = s.dot(&(turn * (d.cross(&tilted) - tilt * d.cross(&plate))));
        }
    }
    lines.try_inverse().unwrap_or_else(|| Matrix6::repeat(f64::NAN)) * lengths
}

/// Rows that keep what cannot be seen: `P_11`, and the mean of `P_21`, `P_22` along the plates' axis.
pub(crate) fn fixed(geometry: &f1::Geometry) -> SMatrix<f64, 4, PARAMETERS> {
    let mut rows = SMatrix::<f64, 4, PARAMETERS>::zeros();
    rows.fixed_view_mut::<3, 3>(0, P).copy_from(&Matrix3::from_diagonal_element(1.0 / FIXED_M));
    let along = geometry.turn_axis.normalize() / (2.0 * FIXED_M);
    for link in [1, 2] {
        rows.fixed_view_mut::<1, 3>(3, P + 3 * link).copy_from(&along.transpose());
    }
    rows
}

/// Residual and derivative of one pose.
type PoseRow = (Vector6<f64>, SMatrix<f64, 6, PARAMETERS>);

impl Poses<'_> {
    /// Residual and derivative of one pose, whitened; `None` for a pose without an orientation.
    fn row(&self, kinematics: &f1::Kinematics, index: usize) -> Result<Option<PoseRow>, PredictionError> {
        let measured = &self.poses[index];
        let Some(rotation) = measured.rotation else { return Ok(None) };
        let seed = Pose { position_m: measured.position_m, rotation: rotation.to_rotation_matrix().into_inner() };
        let pose =
            forward(kinematics, &measured.q, &seed).map_err(|error| PredictionError::Unreachable { index, error })?;
        let away = measured.position_m - pose.position_m;
        let turned = rotation_vector(&(seed.rotation * pose.rotation.transpose()));
        let residual = Vector6::new(away.x, away.y, away.z, turned.x, turned.y, turned.z);
        let derivative = derivative(kinematics.robot().geometry(), &measured.q, &pose);
        Ok(Some((self.whitening * residual, self.whitening * derivative)))
    }

    fn kinematics(geometry: &f1::Geometry) -> Result<f1::Kinematics, PredictionError> {
        Ok(f1::Kinematics::new(&f1::Robot::new(f1::Geometry { travel: None, ..*geometry })?))
    }
}

impl Poses<'_> {
    /// What a machine leaves of each place that was used: place and rest, m, in the frame of the device.
    #[must_use]
    pub fn residuals(&self, geometry: &f1::Geometry, outliers: &[usize]) -> Vec<[Vector3<f64>; 2]> {
        let Ok(kinematics) = Self::kinematics(geometry) else { return Vec::new() };
        let used = self.poses.iter().enumerate().filter(|(index, _)| !outliers.contains(index));
        let rest = |(_, pose): (usize, &MeasuredPose<AXES>)| {
            let rotation = pose.rotation?.to_rotation_matrix().into_inner();
            let seed = Pose { position_m: pose.position_m, rotation };
            let predicted = forward(&kinematics, &pose.q, &seed).ok()?;
            Some([pose.position_m, pose.position_m - predicted.position_m])
        };
        used.filter_map(rest).collect()
    }
}

impl Model for Poses<'_> {
    type State = f1::Geometry;
    type Error = PredictionError;
    const COMPONENTS: usize = 6;

    fn count(&self) -> usize {
        self.poses.len()
    }

    fn rows(&self, geometry: &f1::Geometry, used: &[usize]) -> Result<Rows, PredictionError> {
        let kinematics = Self::kinematics(geometry)?;
        let rows = used.iter().map(|index| self.row(&kinematics, *index)).collect::<Result<Vec<_>, _>>()?;
        let rows: Vec<_> = rows.into_iter().flatten().collect();
        let size = 6 * rows.len();
        // Four rows more fix the combinations that no pose shows: they are no readings, and take away none.
        let mut residuals = DVector::zeros(size + 4);
        let mut derivatives = DMatrix::zeros(size + 4, PARAMETERS);
        for (place, (residual, derivative)) in rows.into_iter().enumerate() {
            residuals.fixed_rows_mut::<6>(6 * place).copy_from(&residual);
            derivatives.fixed_view_mut::<6, PARAMETERS>(6 * place, 0).copy_from(&derivative);
        }
        derivatives.fixed_view_mut::<4, PARAMETERS>(size, 0).copy_from(&fixed(geometry));
        Ok(Rows::new(residuals, derivatives))
    }

    fn away_m(&self, geometry: &f1::Geometry, index: usize) -> Option<f64> {
        let kinematics = Self::kinematics(geometry).ok()?;
        let measured = &self.poses[index];
        let rotation = measured.rotation?.to_rotation_matrix().into_inner();
        let seed = Pose { position_m: measured.position_m, rotation };
        Some((measured.position_m - forward(&kinematics, &measured.q, &seed).ok()?.position_m).norm())
    }

    fn length_sd(&self, geometry: &f1::Geometry, index: usize) -> f64 {
        let row = Self::kinematics(geometry).and_then(|kinematics| self.row(&kinematics, index));
        row.map_or(f64::INFINITY, |row| row.map_or(0.0, |(residual, _)| residual.norm()))
    }

    fn scales(&self, geometry: &f1::Geometry) -> DVector<f64> {
        scales(geometry)
    }

    fn stepped(geometry: &f1::Geometry, step: &DVector<f64>) -> f1::Geometry {
        stepped(geometry, step)
    }
}

/// A calibrated machine, as the device sees it.
pub type Calibrated = Agreement<f1::Geometry>;

/// A calibrated machine in the robot's frame, its tool centre point where the robot file has it.
#[derive(Clone, Debug, PartialEq)]
pub struct InRobotFrame {
    /// How the frames lie.
    pub frames: Frames,
    /// The machine.
    pub geometry: f1::Geometry,
    /// Covariance of its parameters, in the order of this module; of rank 48: four combinations are the file's, twelve are the frames'.
    pub covariance: DMatrix<f64>,
}

impl Poses<'_> {
    /// Poses of the robot file's machine, whose home is at `home_m`.
    fn of_file(
        &self,
        file: &f1::Geometry,
        home_m: &Vector3<f64>,
        used: &[usize],
    ) -> Result<Vec<Pose>, PredictionError> {
        let kinematics = Self::kinematics(file)?;
        let mut poses: Vec<Pose> = Vec::new();
        for &index in used {
            let q = &self.poses[index].q;
            let found = pose_at(&kinematics, home_m, q)
                .or_else(|error| poses.last().map_or(Err(error), |last| forward(&kinematics, q, last)));
            poses.push(found.map_err(|error| PredictionError::Unreachable { index, error })?);
        }
        Ok(poses)
    }

    /// Moves a machine that the device sees into the frames of the robot file: those in which the poses of both agree best.
    fn moved_to(
        &self,
        file: &f1::Geometry,
        of_file: &[Pose],
        seen: &f1::Geometry,
        used: &[usize],
    ) -> Result<(Frames, f1::Geometry), PredictionError> {
        let of_seen = Self::kinematics(seen)?;
        let mut pairs = Vec::new();
        for (&index, of_file) in used.iter().zip(of_file) {
            let unreachable = |error| PredictionError::Unreachable { index, error };
            let measured = &self.poses[index];
            let Some(rotation) = measured.rotation else { continue };
            let seed = Pose { position_m: measured.position_m, rotation: rotation.to_rotation_matrix().into_inner() };
            let seen = forward(&of_seen, &measured.q, &seed).map_err(unreachable)?;
            pairs.push((isometry(of_file), isometry(&seen)));
        }
        let frames = Frames::fitted(&pairs).ok_or(PredictionError::Frames)?;
        let mut geometry = seen_by(seen, &frames.device.inverse(), &frames.target.inverse());
        // What cannot be seen is the file's.
        let lever = geometry.plate_joints_m[0] - file.plate_joints_m[0];
        geometry.plate_joints_m[0] -= lever;
        geometry.carts_m[0] += lever;
        let along = geometry.turn_axis.normalize();
        let off = |link: usize| (geometry.plate_joints_m[link] - file.plate_joints_m[link]).dot(&along);
        let shift = along * f64::midpoint(off(1), off(2));
        geometry.plate_joints_m[1] -= shift;
        geometry.plate_joints_m[2] -= shift;
        geometry.carts_m[1] += shift;
        Ok((frames, geometry))
    }

    /// Moves a calibrated machine to where the robot's file says it is; the home of the file's machine is at `home_m`. The covariance
    /// follows by differences of that motion.
    ///
    /// # Errors
    /// [`PredictionError`].
    pub fn in_frame_of(
        &self,
        calibrated: &Calibrated,
        file: &f1::Geometry,
        home_m: &Vector3<f64>,
    ) -> Result<InRobotFrame, PredictionError> {
        let used: Vec<usize> = (0..self.poses.len()).filter(|index| !calibrated.outliers.contains(index)).collect();
        let state = &calibrated.fit.state;
        let of_file = self.of_file(file, home_m, &used)?;
        let (frames, geometry) = self.moved_to(file, &of_file, state, &used)?;
        let mut by_parameter = DMatrix::zeros(PARAMETERS, PARAMETERS);
        for parameter in 0..PARAMETERS {
            let mut step = DVector::zeros(PARAMETERS);
            step[parameter] = DIFFERENCE;
            let ahead = self.moved_to(file, &of_file, &stepped(state, &step), &used)?.1;
            let behind = self.moved_to(file, &of_file, &stepped(state, &-step), &used)?.1;
            let column = (parameters(&ahead, &geometry) - parameters(&behind, &geometry)) / (2.0 * DIFFERENCE);
            by_parameter.set_column(parameter, &column);
        }
        let covariance = &by_parameter * calibrated.fit.seen.covariance() * by_parameter.transpose();
        Ok(InRobotFrame { frames, geometry, covariance })
    }
}

/// Expected error of a place, root mean square over positions, m, each with a pose near by; NaN where there are none. Positions that the
/// machine cannot stand in are left out.
#[must_use]
pub fn predicted_rms_m(
    moved: &InRobotFrame,
    seen: &f1::Geometry,
    covariance: &DMatrix<f64>,
    stands: &[([f64; AXES], Pose)],
) -> f64 {
    let [Ok(in_robot_frame), Ok(as_seen)] = [&moved.geometry, seen].map(Poses::kinematics) else { return f64::NAN };
    let variance = |(q, near): &([f64; AXES], Pose)| {
        let pose = moved.frames.device * isometry(&forward(&in_robot_frame, q, near).ok()?) * moved.frames.target;
        let seed =
            Pose { position_m: pose.translation.vector, rotation: pose.rotation.to_rotation_matrix().into_inner() };
        let pose = forward(&as_seen, q, &seed).ok()?;
        let places = derivative(seen, q, &pose).fixed_rows::<3>(0).into_owned();
        Some((places * covariance * places.transpose()).trace())
    };
    let variances: Vec<f64> = stands.iter().filter_map(variance).collect();
    (variances.iter().sum::<f64>() / float(variances.len())).sqrt()
}

/// Step of the differences by which the covariance follows the frames, m and rad.
const DIFFERENCE: f64 = 1e-5;

fn isometry(pose: &Pose) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(pose.rotation));
    Isometry3::from_parts(Translation3::from(pose.position_m), rotation)
}

/// Parameters of a machine near `origin`, whose axes' own are zero.
#[must_use]
pub fn parameters(geometry: &f1::Geometry, origin: &f1::Geometry) -> DVector<f64> {
    let mut parameters = DVector::zeros(PARAMETERS);
    let mut set = |first: usize, vectors: &[Vector3<f64>]| {
        for (index, vector) in vectors.iter().enumerate() {
            parameters.fixed_rows_mut::<3>(first + 3 * index).copy_from(vector);
        }
    };
    set(C, &geometry.carts_m);
    set(V, &geometry.guideways);
    set(P, &geometry.plate_joints_m);
    set(B, &geometry.platform_joints_m);
    parameters.fixed_rows_mut::<LINKS>(L).copy_from_slice(&geometry.lengths_m);
    let axes = [(AX, geometry.turn_axis, origin.turn_axis), (AX6, geometry.tilt_axis, origin.tilt_axis)];
    for (first, axis, from) in axes {
        // The rotation vector from one unit vector to one near it.
        let turn = from.normalize().cross(&axis.normalize());
        for (index, direction) in across(&from).iter().enumerate() {
            parameters[first + index] = turn.dot(direction);
        }
    }
    parameters
}

const _: () =
    assert!(V == 3 * ARMS && P == V + 3 * ARMS && B == P + 3 * LINKS && L == B + 3 * LINKS && AX == L + LINKS);

#[cfg(test)]
mod tests;
