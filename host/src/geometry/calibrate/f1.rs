//! Calibration of an F1.

use gantry_tau_core::model::f1::{self, AXES};
use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::robot::{ARMS, LINKS};
use nalgebra::{Isometry3, Matrix3, Matrix6, Translation3, UnitQuaternion, Vector3};

use super::along::turn_along;
use super::{CalibrateError, CalibrateOptions, Calibration, Found, FrameOption, GRID_CELLS, GuidewaysOption, rows};
use crate::geometry::agreement::{fit_agreeing, left_out_rms_m, rms_m};
use crate::geometry::answer::{F1Machine, InRobotFrame, Target};
use crate::geometry::f1::{OBSERVABLE, Poses, parameters, seen_by};
use crate::geometry::frames::Frames;
use crate::measurements::frame;
use crate::measurements::poses::{self, Noise};
use crate::model::{F1, pose_at};
use crate::robot_file::RobotFile;
use crate::workspace::{Grid, survey};

/// Poses that a calibration needs: 72 numbers for 60.
const LEAST_POSES: usize = 12;
/// Noise of a rotation where none is stated, rad: that of the places, as if seen on a lever of half a metre.
pub(crate) const LEVER_M: f64 = 0.5;

/// Calibrates an F1, the machine of `options.robot`.
///
/// # Errors
/// [`CalibrateError`].
pub fn calibrate_f1(robot: &RobotFile<F1, AXES>, options: &CalibrateOptions) -> Result<Calibration, CalibrateError> {
    if options.guideways != GuidewaysOption::Free {
        return Err(CalibrateError::Option("--guideways: those of an F1 are always free"));
    }
    let measured = poses::read::<AXES>(&options.poses, "f1")?;
    if measured.poses.len() < LEAST_POSES {
        let poses = measured.poses.len();
        return Err(CalibrateError::TooFew { table: measured.table, poses, least: LEAST_POSES });
    }
    if measured.poses.iter().any(|pose| pose.rotation.is_none()) {
        return Err(CalibrateError::NoOrientations { table: measured.table });
    }
    let base = match &options.frame {
        FrameOption::Points(path) => Some(frame::read(path)?),
        FrameOption::Nominal | FrameOption::Measured => None,
    };
    let target_m = options.target_m.map(Vector3::from);
    let table = measured.table.clone();
    let no_start = |reason: String| CalibrateError::NoStart { table: table.clone(), reason };
    let file = f1::Geometry { travel: None, ..*robot.model.robot().geometry() };
    let model = Poses { poses: &measured.poses, whitening: whitening(&measured.noise) };
    let frames = start(robot, &measured, target_m).ok_or_else(|| {
        no_start("the robot file's machine cannot stand as measured, or the poses turn too little to tell device and target apart".to_owned())
    })?;
    let agreement = fit_agreeing(&model, seen_by(&file, &frames.device, &frames.target))
        .map_err(|error| no_start(error.to_string()))?;
    let moved = model
        .in_frame_of(&agreement, &file, &robot.home_m(), target_m)
        .map_err(|reason| CalibrateError::Prediction { table: table.clone(), reason: reason.to_string() })?;
    let placed = match (&options.frame, base) {
        (FrameOption::Measured, _) => moved.in_device_frame(&agreement, &file),
        (_, Some(device)) => moved.in_known_frame(&agreement, &file, device),
        (_, None) => moved.clone(),
    };
    let state = &agreement.fit.state;
    let used: Vec<usize> = (0..measured.poses.len()).filter(|index| !agreement.outliers.contains(index)).collect();
    let grid = Grid::of(robot, GRID_CELLS);
    let reached = survey(robot, grid, |_| ()).places.into_iter();
    let stands: Vec<_> = reached.filter_map(|place| Some((place.reached.ok()?.q, Pose::at(place.tool_m)))).collect();
    let expected = |stand: &([f64; AXES], Pose)| {
        let error_m = moved.predicted_rms_m(&agreement, &[*stand]);
        error_m.is_finite().then_some((stand.1.position_m, error_m * 1e6))
    };
    let expected_um = stands.iter().filter_map(expected).collect();
    let predicted_rms_m = moved.predicted_rms_m(&agreement, &stands);
    let ((rotation, translation_m), (rotation_target, translation_target_m)) =
        (rows(&placed.frames.device), rows(&placed.frames.target));
    let target = Some(Target { rotation_target, translation_target_m });
    let found = Found {
        model: "f1",
        agreement: &agreement,
        names: names(),
        values: parameters(state, state),
        observable: OBSERVABLE,
        measured_frame: machine(state),
        robot_frame: InRobotFrame { machine: machine(&placed.geometry), rotation, translation_m, target },
        covariance: placed.covariance,
        predicted_rms_m,
        before_rms_m: rms_m(&model, &seen_by(&file, &frames.device, &frames.target), used.iter().copied()),
        left_out_rms_m: left_out_rms_m(&model, &agreement),
        expected_um,
        grid,
        residuals: model.residuals(state, &agreement.outliers),
        remarks: Vec::new(),
        doubts: Vec::new(),
    };
    found.calibration(&measured, options, |text| {
        let geometry = machine(&placed.geometry);
        text.set_rows("C", &geometry.carts_m);
        text.set_rows("V", &geometry.guideways);
        text.set_rows("P", &geometry.plate_joints_m);
        text.set_rows("b", &geometry.platform_joints_m);
        text.set_numbers("L", &geometry.lengths_m);
        text.set_numbers("ax", &geometry.turn_axis);
        text.set_numbers("ax6", &geometry.tilt_axis);
        if options.frame == FrameOption::Measured {
            turn_along(text, robot, &moved.frames.device);
        }
    })
}

/// Where device and target are, by the robot file.
fn start(robot: &RobotFile<F1, AXES>, measured: &poses::Poses<AXES>, target_m: Option<Vector3<f64>>) -> Option<Frames> {
    let pairs: Vec<_> = (measured.poses.iter())
        .filter_map(|pose| {
            let of_file = pose_at(&robot.model, &robot.home_m(), &pose.q).ok()?;
            let rotation = UnitQuaternion::from_matrix(&of_file.rotation);
            let of_file = Isometry3::from_parts(Translation3::from(of_file.position_m), rotation);
            Some((of_file, Isometry3::from_parts(Translation3::from(pose.position_m), pose.rotation?)))
        })
        .collect();
    Frames::fitted(&pairs, target_m)
}

/// `covariance^-1 = L L^T`, so `W = L^T`.
pub(crate) fn whitening(noise: &Noise) -> Matrix6<f64> {
    let rotation = noise.rotation_rad2.unwrap_or(noise.position_m2 / (LEVER_M * LEVER_M));
    let mut whitening = Matrix6::identity();
    for (first, covariance) in [(0, noise.position_m2), (3, rotation)] {
        let factor = covariance.try_inverse().and_then(Matrix3::cholesky);
        let block = factor.map_or_else(Matrix3::identity, |factor| factor.l().transpose());
        whitening.fixed_view_mut::<3, 3>(first, first).copy_from(&block);
    }
    whitening
}

/// Names of the parameters, and their units.
pub(crate) fn names() -> Vec<(String, &'static str)> {
    let vectors = |name: &'static str, count: usize| {
        (0..count).flat_map(move |index| ["x", "y", "z"].map(|axis| (format!("{name}[{index}].{axis}"), "m")))
    };
    let turns = |name: &'static str| (0..2).map(move |index| (format!("{name}.turn[{index}]"), "rad"));
    let lengths = (0..LINKS).map(|link| (format!("L[{link}]"), "m"));
    vectors("C", ARMS)
        .chain(vectors("V", ARMS))
        .chain(vectors("P", LINKS))
        .chain(vectors("b", LINKS))
        .chain(lengths)
        .chain(turns("ax"))
        .chain(turns("ax6"))
        .collect()
}

fn machine(geometry: &f1::Geometry) -> F1Machine {
    F1Machine {
        carts_m: geometry.carts_m.map(Into::into),
        guideways: geometry.guideways.map(Into::into),
        plate_joints_m: geometry.plate_joints_m.map(Into::into),
        platform_joints_m: geometry.platform_joints_m.map(Into::into),
        lengths_m: geometry.lengths_m,
        turn_axis: geometry.turn_axis.into(),
        tilt_axis: geometry.tilt_axis.into(),
    }
}
