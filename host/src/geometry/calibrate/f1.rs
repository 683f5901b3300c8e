//! Calibration of an F1.

mod start;

use gantry_tau_core::model::f1::{AXES, Geometry};
use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::robot::{ARMS, LINKS};
use nalgebra::{DMatrix, Isometry3, Matrix6, UnitQuaternion, Vector3};

use super::along::turn_along;
use super::columns::Mistake;
use super::expected::Expected;
use super::shape::Shape;
use super::{
    CalibrateError, CalibrateOptions, Calibration, Found, FrameOption, GuidewaysOption, check_shape, moved, rows,
};
use crate::geometry::agreement::{left_out_rms_m, rms_m};
use crate::geometry::answer::{F1Machine, InRobotFrame, Target};
use crate::geometry::f1::{Diagnostic, KEPT, OBSERVABLE, PARAMETERS, Poses, parameters, seen_by, unseen};
use crate::geometry::frames::LEVER_M;
use crate::measurements::poses::{self, Noise};
use crate::model::{F1, pose_at};
use crate::robot_file::RobotFile;
use crate::robot_file::edit::RobotText;
use start::{best_start, pairs};

/// Poses that a calibration needs: 72 numbers for 60.
const LEAST_POSES: usize = 12;

/// Calibrates an F1, the machine of `options.robot`.
///
/// # Errors
/// [`CalibrateError`].
pub fn calibrate_f1(robot: &RobotFile<F1, AXES>, options: &CalibrateOptions) -> Result<Calibration, CalibrateError> {
    if options.guideways != GuidewaysOption::Free {
        return Err(CalibrateError::Option("--guideways: those of an F1 are always free"));
    }
    let measured = read(options)?;
    let base = options.frame.points()?;
    let target_m = options.target_m.map(Vector3::from);
    let table = &measured.table;
    let file = Geometry { travel: None, ..*robot.model.robot().geometry() };
    let model = Poses { poses: &measured.poses, whitening: whitening(&measured.noise) };
    let of_file = |q: &[f64; AXES]| Some(pose_at(&robot.model, &robot.home_m(), q).ok()?.position_m);
    let pose_of_file = |q: &[f64; AXES]| {
        let pose = pose_at(&robot.model, &robot.home_m(), q).ok()?;
        let rotation = UnitQuaternion::from_matrix(&pose.rotation);
        Some(Isometry3::from_parts(pose.position_m.into(), rotation))
    };
    let mistake = Mistake::find(&measured.poses, of_file)
        .or_else(|| Mistake::find_turned(&measured.poses, ARMS, target_m, pose_of_file));
    if let Some(mistake) = mistake {
        return Err(CalibrateError::Columns { table: measured.table, mistake });
    }
    let (frames, agreement) = best_start(&pairs(robot, &measured.poses), target_m, &model, &file)
        .map_err(|reason| CalibrateError::NoStart { table: table.clone(), reason })?;
    let in_frame = model
        .in_frame_of(&agreement, &file, &robot.home_m(), target_m)
        .map_err(|reason| CalibrateError::Prediction { table: table.clone(), reason: reason.to_string() })?;
    options.frame.check(base.as_ref(), &in_frame.frames.device)?;
    let placed = match (&options.frame, base) {
        (FrameOption::Measured, _) => in_frame.in_device_frame(&agreement, &file),
        (_, Some(device)) => in_frame.in_known_frame(&agreement, &file, device),
        (_, None) => in_frame.clone(),
    };
    let state = &agreement.fit.state;
    let used = agreement.used(measured.poses.len());
    let shape = Shape::of_poses(&measured.poses, &used);
    check_shape(table, &shape, agreement.fit.seen.kept() - (PARAMETERS - OBSERVABLE), OBSERVABLE)?;
    let (rotation, translation_m) = rows(&placed.frames.device);
    let (rotation_target, translation_target_m) = rows(&placed.frames.target);
    let target = Some(Target { rotation_target, translation_target_m });
    let diagnostics = model.diagnostics(&agreement);
    let device = moved::doubt(&measured.poses, &used, &agreement.fit.rows, |motion| {
        DMatrix::from_column_slice(6, 6, (model.whitening * motion).as_slice())
    });
    let found = Found {
        model: "f1",
        agreement: &agreement,
        names: names(),
        values: parameters(state, state),
        unseen: unseen(state),
        kept: KEPT,
        measured_frame: machine(state),
        robot_frame: InRobotFrame { machine: machine(&placed.geometry), rotation, translation_m, target },
        covariance: placed.covariance,
        before_rms_m: rms_m(&model, &seen_by(&file, &frames.device, &frames.target), used.iter().copied()),
        left_out_rms_m: left_out_rms_m(&model, &agreement),
        expected: Expected::over(robot, |stands| {
            let stands: Vec<_> = stands.iter().map(|(q, tool_m)| (*q, Pose::at(*tool_m))).collect();
            in_frame.predicted_rms_m(&agreement, &stands)
        }),
        residuals: model.residuals(state, &agreement.outliers),
        remarks: remarks(&diagnostics),
        diagnostics,
        doubts: device.into_iter().collect(),
    };
    found.calibration(&measured, options, |text| {
        write_geometry(text, &machine(&placed.geometry));
        if options.frame == FrameOption::Measured {
            turn_along(text, robot, &in_frame.frames.device);
        }
    })
}

/// Reads the measured poses, all of them with orientations.
fn read(options: &CalibrateOptions) -> Result<poses::Poses<AXES>, CalibrateError> {
    let measured = poses::read::<AXES>(&options.poses, "f1")?;
    if measured.poses.len() < LEAST_POSES {
        let poses = measured.poses.len();
        return Err(CalibrateError::TooFew { table: measured.table, poses, least: LEAST_POSES });
    }
    if measured.poses.iter().any(|pose| pose.rotation.is_none()) {
        return Err(CalibrateError::NoOrientations { table: measured.table });
    }
    Ok(measured)
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
    let found = diagnostics.iter().filter(|diagnostic| diagnostic.is_found(diagnostics.len()));
    let named = |found: &Diagnostic| {
        let (departure, magnitude, p) = (found.departure, found.magnitude(), found.p);
        format!("{departure}: {magnitude} (p = {p:.1e}); the model has no such number, and nothing of it is written")
    };
    let named: Vec<String> = found.map(named).collect();
    if !named.is_empty() || diagnostics.is_empty() {
        return named;
    }
    let least = diagnostics.iter().map(|diagnostic| diagnostic.p).fold(1.0, f64::min);
    vec![format!(
        "axes and screws of the plates are as the model has them (the smallest p of {} is {least:.2})",
        diagnostics.len()
    )]
}

/// Whitening matrix of place and rotation vector, `W^T W = covariance^-1`. It is lower triangular: its first three rows whiten a place alone.
pub(crate) fn whitening(noise: &Noise) -> Matrix6<f64> {
    let covariance = noise.covariance(&(noise.position_m2 / (LEVER_M * LEVER_M)));
    let factor = covariance.cholesky().and_then(|factor| factor.l().try_inverse());
    factor.unwrap_or_else(Matrix6::identity)
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
        let (turn, cross) = (1e-8, 4.5e-9);
        let row = |at: usize| -> String {
            let entry = |column: usize| match (at.min(column), at.max(column)) {
                (one, other) if one == other => {
                    if one < 3 {
                        place
                    } else {
                        turn
                    }
                }
                (one, other) if other == one + 3 => cross,
                _ => 0.0,
            };
            let entries: Vec<String> = (0..6).map(|column| format!("{:?}", entry(column))).collect();
            format!("[{}]", entries.join(", "))
        };
        let covariance = (0..6).map(row).collect::<Vec<_>>().join(", ");
        let setup = format!(
            "format = \"gantry-tau poses 1\"\nmodel = \"f1\"\nmeasurements = \"p.csv\"\n[noise]\ncovariance = [{covariance}]\n"
        );
        let table = "pose,q_1,q_2,q_3,q_4,q_5,q_6,x_m,y_m,z_m,rot_w,rot_x,rot_y,rot_z\na,0,0,0,0,0,0,0,0,0,1,0,0,0\n";
        let measured = poses::parse::<AXES>(Path::new("p.toml"), &setup, "f1", table.as_bytes()).unwrap();
        let whitening = whitening(&measured.noise);
        let whole = measured.noise.covariance(&nalgebra::Matrix3::zeros());
        assert!((whole[(1, 4)] - cross).abs() < 1e-24 && whole[(1, 3)].abs() < 1e-24, "{whole}");
        assert!((whitening * whole * whitening.transpose() - Matrix6::identity()).amax() < 1e-12);
        // Of a place alone: its own standard deviation.
        assert!((whitening[(0, 0)] - 1.0 / place.sqrt()).abs() < 1e-6 && whitening.view((0, 3), (3, 3)).amax() < 1e-9);
        // Residuals on the line of the correlation are likely, those across it are not.
        let length = |turned: f64| (whitening * Vector6::new(50e-6, 0.0, 0.0, turned, 0.0, 0.0)).norm();
        assert!(length(90e-6) < 1.1 && length(-90e-6) > 4.0);
    }
}
