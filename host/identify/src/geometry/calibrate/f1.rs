//! Calibration of an F1.

mod start;

use gantry_tau_core::model::f1::{AXES, Geometry};
use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::robot::{ARMS, LINKS};
use gantry_tau_machine::model::{F1, pose_at};
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_machine::robot_file::edit::RobotText;
use nalgebra::{DMatrix, Isometry3, Matrix6, UnitQuaternion, Vector3};

use super::columns::ColumnMistake;
use super::expected::Expected;
use super::robot_file_frame::move_frame;
use super::shape::Shape;
use super::{
    CalibrateError, CalibrateOptions, Calibration, FittedMachine, FrameOption, GuidewaysOption,
    check_shape, moved, rows,
};
use crate::fit::frames::LEVER_M;
use crate::geometry::answer::{F1Machine, InRobotFrame, TargetOnPlatform};
use crate::geometry::f1::{
    Diagnostic, KEPT, OBSERVABLE, PARAMETERS, Poses, parameters, seen_by, unseen,
};
use crate::geometry::robust_fit::{left_out_rms_m, rms_m};
use crate::measurements::poses::{self, MeasuredPose, PoseNoise};
use start::{best_start, pairs};

/// Poses that a calibration needs: 72 numbers for 60.
const MIN_POSES: usize = 12;

/// Calibrates an F1, the machine of `options.robot`, with the poses of `options.poses`.
///
/// # Errors
/// [`CalibrateError`].
pub fn calibrate_f1(
    robot: &RobotFile<F1, AXES>,
    options: &CalibrateOptions,
) -> Result<Calibration, CalibrateError> {
    check_guideways(options)?;
    fit_poses(robot, &poses::read(&options.poses, "f1")?, options)
}

/// As [`calibrate_f1`], with poses in memory; `options.poses` is not read.
///
/// # Errors
/// [`CalibrateError`].
pub fn calibrate_f1_with(
    robot: &RobotFile<F1, AXES>,
    measured: &poses::Poses<AXES>,
    options: &CalibrateOptions,
) -> Result<Calibration, CalibrateError> {
    check_guideways(options)?;
    fit_poses(robot, measured, options)
}

fn check_guideways(options: &CalibrateOptions) -> Result<(), CalibrateError> {
    if options.guideways == GuidewaysOption::Free {
        return Ok(());
    }
    Err(CalibrateError::Option(
        "--guideways: those of an F1 are always free",
    ))
}

fn fit_poses(
    robot: &RobotFile<F1, AXES>,
    measured: &poses::Poses<AXES>,
    options: &CalibrateOptions,
) -> Result<Calibration, CalibrateError> {
    check_poses(measured)?;
    let base = options.frame.points()?;
    let target_m = options.target_m.map(Vector3::from);
    let table = &measured.table;
    let file = Geometry {
        travel: None,
        ..*robot.model.robot().geometry()
    };
    let model = Poses {
        poses: &measured.poses,
        whitening: whitening(&measured.noise),
    };
    if let Some(mistake) = column_mistake(robot, &measured.poses, target_m) {
        return Err(CalibrateError::Columns {
            table: measured.table.clone(),
            mistake,
        });
    }
    let (frames, robust_fit) = best_start(&pairs(robot, &measured.poses), target_m, &model, &file)
        .map_err(|error| CalibrateError::NoStart {
            table: table.clone(),
            reason: error.to_string(),
        })?;
    let in_frame = model
        .in_frame_of(&robust_fit, &file, &robot.home_m(), target_m)
        .map_err(|reason| CalibrateError::Prediction {
            table: table.clone(),
            reason: reason.to_string(),
        })?;
    options
        .frame
        .check(base.as_ref(), &in_frame.frames.device)?;
    let placed = match (&options.frame, base) {
        (FrameOption::Measured, _) => in_frame.in_device_frame(&robust_fit, &file),
        (_, Some(device)) => in_frame.in_known_frame(&robust_fit, &file, device),
        (_, None) => in_frame.clone(),
    };
    let state = &robust_fit.fit.state;
    let used = robust_fit.used(measured.poses.len());
    let shape = Shape::of_poses(&measured.poses, &used);
    check_shape(
        table,
        &shape,
        robust_fit.fit.seen.kept() - (PARAMETERS - OBSERVABLE),
        OBSERVABLE,
    )?;
    let (rotation, translation_m) = rows(&placed.frames.device);
    let (rotation_target, translation_target_m) = rows(&placed.frames.target);
    let target = Some(TargetOnPlatform {
        rotation_target,
        translation_target_m,
    });
    let diagnostics = model.diagnostics(&robust_fit);
    let device = moved::doubt(&measured.poses, &used, &robust_fit.fit.rows, |motion| {
        DMatrix::from_column_slice(6, 6, (model.whitening * motion).as_slice())
    });
    let found = FittedMachine {
        model: "f1",
        robust_fit: &robust_fit,
        names: names(),
        values: parameters(state, state),
        unseen: unseen(state),
        kept: KEPT,
        measured_frame: machine(state),
        robot_frame: InRobotFrame {
            machine: machine(&placed.geometry),
            rotation,
            translation_m,
            target,
        },
        covariance: placed.covariance,
        before_rms_m: rms_m(
            &model,
            &seen_by(&file, &frames.device, &frames.target),
            used.iter().copied(),
        ),
        left_out_rms_m: left_out_rms_m(&model, &robust_fit),
        expected: Expected::over(robot, |stands| {
            let stands: Vec<_> = stands
                .iter()
                .map(|(q, tool_m)| (*q, Pose::at(*tool_m)))
                .collect();
            in_frame.predicted_rms_m(&robust_fit, &stands)
        }),
        residuals: model.residuals(state, &robust_fit.outliers),
        remarks: remarks(&diagnostics),
        diagnostics,
        doubts: device.into_iter().collect(),
    };
    found.calibration(measured, options, |text| {
        write_geometry(text, &machine(&placed.geometry));
        if options.frame == FrameOption::Measured {
            move_frame(text, robot, &in_frame.frames.device);
        }
    })
}

/// Finds a mistake in the columns by the robot file's machine.
fn column_mistake(
    robot: &RobotFile<F1, AXES>,
    measured: &[MeasuredPose<AXES>],
    target_m: Option<Vector3<f64>>,
) -> Option<ColumnMistake> {
    ColumnMistake::find(measured, |q| {
        Some(pose_at(&robot.model, &robot.home_m(), q).ok()?.position_m)
    })
    .or_else(|| {
        ColumnMistake::find_turned(measured, ARMS, target_m, |q| {
            let pose = pose_at(&robot.model, &robot.home_m(), q).ok()?;
            let rotation = UnitQuaternion::from_matrix(&pose.rotation);
            Some(Isometry3::from_parts(pose.position_m.into(), rotation))
        })
    })
}

/// Checks that there are enough poses, all of them with orientations.
fn check_poses(measured: &poses::Poses<AXES>) -> Result<(), CalibrateError> {
    if measured.poses.len() < MIN_POSES {
        return Err(CalibrateError::TooFew {
            table: measured.table.clone(),
            poses: measured.poses.len(),
            least: MIN_POSES,
        });
    }
    if measured.poses.iter().any(|pose| pose.rotation.is_none()) {
        return Err(CalibrateError::NoOrientations {
            table: measured.table.clone(),
        });
    }
    Ok(())
}

/// Puts a machine into its robot file.
fn write_geometry(text: &mut RobotText, machine: &F1Machine) {
    text.set_rows("C", &machine.carts_m);
    text.set_rows("V", &machine.guideways);
    text.set_rows("P", &machine.plate_joints_m);
    text.set_rows("b", &machine.platform_joints_m);
    text.set_numbers("L", &machine.lengths_m);
    text.set_numbers("ax", &machine.turn_axis);
    text.set_numbers("ax6", &machine.tilt_axis);
}

/// Says which departures from the model the poses show.
fn remarks(diagnostics: &[Diagnostic]) -> Vec<String> {
    let found = diagnostics
        .iter()
        .filter(|diagnostic| diagnostic.is_found(diagnostics.len()));
    let named: Vec<String> = found
        .map(|found| {
            format!(
                "{}: {} (p = {:.1e}); the model has no such number, and nothing of it is written",
                found.departure,
                found.magnitude(),
                found.p
            )
        })
        .collect();
    if !named.is_empty() || diagnostics.is_empty() {
        return named;
    }
    let least = diagnostics
        .iter()
        .map(|diagnostic| diagnostic.p)
        .fold(1.0, f64::min);
    vec![format!(
        "axes and screws of the plates are as the model has them (the smallest p of {} is {least:.2})",
        diagnostics.len()
    )]
}

/// Whitening matrix of place and rotation vector, `W^T W = covariance^-1`. It is lower triangular:
/// its first three rows whiten a place alone.
pub(crate) fn whitening(noise: &PoseNoise) -> Matrix6<f64> {
    let covariance = noise.covariance(&(noise.position_m2 / (LEVER_M * LEVER_M)));
    let factor = covariance
        .cholesky()
        .and_then(|factor| factor.l().try_inverse());
    factor.unwrap_or_else(Matrix6::identity)
}

/// Names of the parameters, and their units.
pub(crate) fn names() -> Vec<(String, &'static str)> {
    let lengths = (0..LINKS).map(|link| (format!("L[{link}]"), "m"));
    vector_names("C", ARMS)
        .chain(vector_names("V", ARMS))
        .chain(vector_names("P", LINKS))
        .chain(vector_names("b", LINKS))
        .chain(lengths)
        .chain(turn_names("ax"))
        .chain(turn_names("ax6"))
        .collect()
}

fn vector_names(name: &'static str, count: usize) -> impl Iterator<Item = (String, &'static str)> {
    (0..count)
        .flat_map(move |index| ["x", "y", "z"].map(|axis| (format!("{name}[{index}].{axis}"), "m")))
}

fn turn_names(name: &'static str) -> impl Iterator<Item = (String, &'static str)> {
    (0..2).map(move |index| (format!("{name}.turn[{index}]"), "rad"))
}

fn machine(geometry: &Geometry) -> F1Machine {
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    use nalgebra::Vector6;

    /// Place and turn that depend on each other, as a tracker's whose lever is long.
    #[test]
    fn a_full_covariance_is_whitened_as_such() {
        let place = 2.5e-9;
        let turn = 1e-8;
        let cross = 4.5e-9;
        let covariance = covariance_text(place, turn, cross);
        let setup = format!(
            "format = \"gantry-tau poses 1\"\nmodel = \"f1\"\nmeasurements = \"p.csv\"\n[noise]\ncovariance = [{covariance}]\n"
        );
        let table = "pose,q_1,q_2,q_3,q_4,q_5,q_6,x_m,y_m,z_m,rot_w,rot_x,rot_y,rot_z\na,0,0,0,0,0,0,0,0,0,1,0,0,0\n";
        let measured =
            poses::parse::<AXES>(Path::new("p.toml"), &setup, "f1", table.as_bytes()).unwrap();
        let whitening = whitening(&measured.noise);
        let whole = measured.noise.covariance(&nalgebra::Matrix3::zeros());
        assert!(
            (whole[(1, 4)] - cross).abs() < 1e-24 && whole[(1, 3)].abs() < 1e-24,
            "{whole}"
        );
        assert!((whitening * whole * whitening.transpose() - Matrix6::identity()).amax() < 1e-12);
        // Of a place alone: its own standard deviation.
        assert!(
            (whitening[(0, 0)] - 1.0 / place.sqrt()).abs() < 1e-6
                && whitening.view((0, 3), (3, 3)).amax() < 1e-9
        );
        // Residuals on the line of the correlation are likely, those across it are not.
        let [along, across] = [90e-6, -90e-6]
            .map(|turned| (whitening * Vector6::new(50e-6, 0.0, 0.0, turned, 0.0, 0.0)).norm());
        assert!(along < 1.1 && across > 4.0);
    }

    /// Rows of a covariance of place and turn, where each axis' place and turn have the variance
    /// `cross` in common.
    fn covariance_text(place: f64, turn: f64, cross: f64) -> String {
        let rows = (0..6_usize).map(|row| {
            let entries = (0..6_usize).map(|column| {
                let entry = match row.abs_diff(column) {
                    0 if row < 3 => place,
                    0 => turn,
                    3 => cross,
                    _ => 0.0,
                };
                format!("{entry:?}")
            });
            format!("[{}]", entries.collect::<Vec<_>>().join(", "))
        });
        rows.collect::<Vec<_>>().join(", ")
    }
}
