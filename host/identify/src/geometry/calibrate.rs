//! `calibrate`: from measured poses and a robot file to the file of this machine.

mod columns;
mod error;
pub(crate) mod expected;
pub(crate) mod f1;
pub(crate) mod l2;
mod mirror;
mod moved;
mod report;
mod robot_file_frame;
mod shape;

use std::ops::Range;
use std::path::PathBuf;

use gantry_tau_machine::robot_file::Calibrated;
use gantry_tau_machine::robot_file::edit::RobotText;
use nalgebra::{DMatrix, Isometry3, Vector3};
use serde::Serialize;

use super::answer::{CalibrationAnswer, FORMAT, InRobotFrame, Outlier};
use super::f1::Diagnostic;
use super::robust_fit::RobustFit;
use crate::fit::answer::{FitSummary, Parameter, Status, Uncertainty, Unobservable};
use crate::fit::goodness;
use crate::fit::least_squares::{Direction, Observability};
use crate::fit::statistics::float;
use crate::measurements::poses::Poses;
use crate::measurements::{FileError, frame};
pub use columns::ColumnMistake;
pub use error::CalibrateError;
use expected::Expected;
pub use f1::{calibrate_f1, calibrate_f1_with};
pub use l2::{calibrate_l2, calibrate_l2_with};
use shape::Shape;

/// Largest distance and turn between the robot's frame by points of its base, and by where the
/// robot file's machine is seen, m, rad.
const MAX_OFFSET_M: f64 = 0.3;
const MAX_TURN_RAD: f64 = 0.3;
/// Poses that do not agree, of which the summary has the names.
const NAMED: usize = 8;
/// Largest share of poses that may be left out.
const MAX_OUTLIER_SHARE: f64 = 0.1;

/// Options of a calibration.
#[derive(Clone, Debug)]
pub struct CalibrateOptions {
    /// Set-up of the measurements.
    pub poses: PathBuf,
    /// Name of the robot file to begin with, as of
    /// [`gantry_tau_machine::robot_file::AnyRobotFile::named`].
    pub robot: String,
    /// Frame that the machine is written in.
    pub frame: FrameOption,
    /// Guideways of an L2.
    pub guideways: GuidewaysOption,
    /// Centre of the target from the tool centre point, platform axes, m. Absent: at the tool
    /// centre point of an L2, whose places cannot show it; found along with the frame of an F1.
    pub target_m: Option<[f64; 3]>,
    /// Largest expected error of a place over the workspace, m.
    pub tolerance_m: f64,
}

/// Frame that a calibrated machine is written in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FrameOption {
    /// The robot file's frame, as well as the places determine it `[T 3.11]`.
    Nominal,
    /// That of the device.
    Measured,
    /// That of points of the robot's base which the device has measured: a file of
    /// [`crate::measurements::frame`].
    Points(PathBuf),
}

impl FrameOption {
    /// Motion from the frame of the base's points to the device's, if that frame was asked for.
    fn points(&self) -> Result<Option<Isometry3<f64>>, FileError> {
        match self {
            Self::Points(path) => frame::read(path).map(Some),
            Self::Nominal | Self::Measured => Ok(None),
        }
    }

    /// Checks that the points of the base put the robot's frame near where the device sees the
    /// robot file's machine.
    ///
    /// # Errors
    /// [`CalibrateError::Frame`].
    fn check(
        &self,
        base: Option<&Isometry3<f64>>,
        of_file: &Isometry3<f64>,
    ) -> Result<(), CalibrateError> {
        let (Self::Points(path), Some(base)) = (self, base) else {
            return Ok(());
        };
        let off = of_file.inverse() * base;
        let away_m = off.translation.vector.norm();
        let turned_rad = off.rotation.angle();
        if away_m <= MAX_OFFSET_M && turned_rad <= MAX_TURN_RAD {
            return Ok(());
        }
        let file = path.display().to_string();
        Err(CalibrateError::Frame {
            file,
            away_m,
            turned_deg: turned_rad.to_degrees(),
        })
    }

    /// Its name in a robot file.
    fn name(&self) -> String {
        match self {
            Self::Nominal => "nominal".to_owned(),
            Self::Measured => "measured".to_owned(),
            Self::Points(path) => path.display().to_string(),
        }
    }
}

/// Guideways of an L2.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GuidewaysOption {
    /// Each has its own direction: 21 parameters.
    Free,
    /// All have one direction: 15 parameters.
    Parallel,
}

/// Result of a calibration.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Calibration {
    /// The answer for programs, JSON.
    pub json: String,
    /// Text of the robot file of this machine: that of the file that the calibration began with,
    /// its geometry replaced.
    pub robot_file: String,
    /// Page with plots.
    pub report: String,
    /// Result in one line.
    pub summary: String,
    /// Further findings; empty if there are none.
    pub remarks: Vec<String>,
    /// Reasons not to trust it as it is; empty where there are none.
    pub doubts: Vec<String>,
}

/// Names and values of the parameters of a kind of machine, in the frame of the device.
struct FittedMachine<'a, S, M> {
    model: &'static str,
    robust_fit: &'a RobustFit<S>,
    names: Vec<(String, &'static str)>,
    values: nalgebra::DVector<f64>,
    /// Directions that no poses show, and the parameters that are therefore kept.
    unseen: Vec<Direction>,
    kept: Range<usize>,
    measured_frame: M,
    robot_frame: InRobotFrame<M>,
    covariance: DMatrix<f64>,
    /// Residual of the robot file's machine in the frame that fits best, root mean square, m.
    before_rms_m: f64,
    /// Residual of places that took no part in the fit, root mean square, m.
    left_out_rms_m: f64,
    expected: Expected,
    /// Residuals of the places that were used: place and rest, m.
    residuals: Vec<[Vector3<f64>; 2]>,
    /// Departures from the model that were looked for.
    diagnostics: Vec<Diagnostic>,
    remarks: Vec<String>,
    doubts: Vec<String>,
}

impl<S, M: Serialize + Clone> FittedMachine<'_, S, M> {
    /// Writes the results; `edit` replaces the geometry in the robot file.
    fn calibration<const N: usize>(
        self,
        measured: &Poses<N>,
        options: &CalibrateOptions,
        edit: impl FnOnce(&mut RobotText),
    ) -> Result<Calibration, CalibrateError> {
        let poses = measured.poses.len();
        let answer = self.answer(measured);
        let calibrated = self.entry(measured, options, &answer);
        let summary = self.summary(&answer, poses);
        let mut doubts = doubts(&answer, poses, self.observable(), options.tolerance_m);
        doubts.extend(self.doubts);
        let page = report::CalibrationPage {
            robot: &options.robot,
            measurements: &calibrated,
            summary: &summary,
            doubts: &doubts,
            remarks: &self.remarks,
            parameters: &answer.parameters,
            directions: &Unobservable::list(&self.names, &self.robust_fit.fit.seen.all()),
            diagnostics: &self.diagnostics,
            residuals: &self.residuals,
            expected: &self.expected,
        };
        Ok(Calibration {
            json: serde_json::to_string_pretty(&answer).map_err(edit_error)?,
            robot_file: robot_file(&options.robot, &calibrated, edit)?,
            report: page.html(),
            summary,
            remarks: self.remarks,
            doubts,
        })
    }

    fn answer<const N: usize>(&self, measured: &Poses<N>) -> CalibrationAnswer<M> {
        let fit = &self.robust_fit.fit;
        let uncertainty = Uncertainty::new(&fit.rows, &fit.seen, &fit.held);

        let seen = Observability::new(&fit.rows, fit.seen.scales());
        let unobservable = [self.unseen.clone(), seen.lost(), seen.weak()].concat();
        let outliers = self.robust_fit.outliers.iter();
        CalibrationAnswer {
            format: FORMAT,
            model: self.model,
            measured_frame: self.measured_frame.clone(),
            robot_frame: self.robot_frame.clone(),
            parameters: Parameter::list(
                &self.names,
                &self.values,
                &uncertainty.covariance(),
                |parameter| match self.kept.contains(&parameter) {
                    true => Status::Kept,
                    false => uncertainty.status(parameter),
                },
            ),
            observable: fit.seen.kept().saturating_sub(self.unseen.len()),
            unobservable: Unobservable::list(&self.names, &unobservable),
            predicted_rms_m: self.expected.rms_m,
            fit: FitSummary::new(fit.chi_squared(), fit.degrees()),
            outliers: outliers
                .filter_map(|index| {
                    Some(Outlier {
                        pose: measured.poses.get(*index)?.name.clone(),
                    })
                })
                .collect(),
        }
    }

    /// Number of parameters that can be seen in any poses.
    fn observable(&self) -> usize {
        self.values.len().saturating_sub(self.unseen.len())
    }

    /// Entry of the robot file that says how it was calibrated.
    fn entry<const N: usize>(
        &self,
        measured: &Poses<N>,
        options: &CalibrateOptions,
        answer: &CalibrationAnswer<M>,
    ) -> Calibrated {
        let covariance = &self.covariance;
        Calibrated {
            measurements: measured.table.clone(),
            crc: measured.crc,
            poses: measured.poses.len(),
            chi2: answer.fit.chi2,
            dof: answer.fit.dof,
            predicted_rms_um: answer.predicted_rms_m * 1e6,
            frame: options.frame.name(),
            rotation: answer.robot_frame.rotation,
            translation_m: answer.robot_frame.translation_m,
            sd: covariance
                .diagonal()
                .iter()
                .map(|variance| variance.max(0.0).sqrt())
                .collect(),
            covariance: covariance
                .row_iter()
                .map(|row| row.iter().copied().collect())
                .collect(),
        }
    }

    fn summary(&self, answer: &CalibrationAnswer<M>, poses: usize) -> String {
        let lost = self.observable().saturating_sub(answer.observable);
        // With few poses a part of them does not lead to a machine.
        let left_out = match self.left_out_rms_m {
            rms_m if rms_m.is_finite() => {
                format!(
                    ", and are {:.1} um off where they took no part in the fit",
                    rms_m * 1e6
                )
            }
            _ => String::new(),
        };
        let named = match answer.outliers.as_slice() {
            [] => String::new(),
            outliers => {
                let names = outliers
                    .iter()
                    .take(NAMED)
                    .map(|outlier| outlier.pose.to_string())
                    .collect::<Vec<_>>();
                let more = if outliers.len() > NAMED { ", ..." } else { "" };
                format!(" and are left out ({}{more})", names.join(", "))
            }
        };
        format!(
            "{} of {} parameters seen; chi2/dof {:.2}, p {:.2}; {} of {poses} poses do not agree{named}; places were {:.2} mm off (rms){left_out}; one over the workspace is expected to be {:.1} um off{}",
            answer.observable,
            self.values.len(),
            self.robust_fit.fit.reduced_chi_squared(),
            answer.fit.p,
            answer.outliers.len(),
            self.before_rms_m * 1e3,
            answer.predicted_rms_m * 1e6,
            if lost > 0 {
                ", not counting what cannot be seen"
            } else {
                ""
            },
        )
    }
}

/// Returns the text of the changed robot file.
fn robot_file(
    name: &str,
    calibrated: &Calibrated,
    edit: impl FnOnce(&mut RobotText),
) -> Result<String, CalibrateError> {
    let Calibrated {
        measurements, crc, ..
    } = calibrated;
    let text = gantry_tau_machine::robot_file::text_of(name)?;
    let provenance = format!("CALIBRATED with {measurements} (CRC-32 {crc:08x})");
    let mut robot = RobotText::new(&text, &provenance).map_err(edit_error)?;
    edit(&mut robot);
    robot
        .set_serialized("calibrated", calibrated)
        .map_err(edit_error)?;
    Ok(robot.text())
}

fn edit_error(error: impl std::fmt::Display) -> CalibrateError {
    CalibrateError::Edit(error.to_string())
}

/// Refuses measurements in a region whose shape is why fewer than `all` combinations of parameters
/// can be seen.
fn check_shape(table: &str, shape: &Shape, seen: usize, all: usize) -> Result<(), CalibrateError> {
    let lost = all.saturating_sub(seen);
    if lost == 0 || !shape.is_poor() {
        return Ok(());
    }
    Err(CalibrateError::Shape {
        table: table.to_owned(),
        shape: shape.to_string(),
        lost,
        all,
    })
}

/// Rows of a rotation, and the translation.
fn rows(motion: &Isometry3<f64>) -> ([[f64; 3]; 3], [f64; 3]) {
    (
        motion
            .rotation
            .to_rotation_matrix()
            .into_inner()
            .transpose()
            .into(),
        motion.translation.vector.into(),
    )
}

fn doubts<M>(
    answer: &CalibrationAnswer<M>,
    poses: usize,
    observable: usize,
    tolerance_m: f64,
) -> Vec<String> {
    let mut doubts = Vec::new();
    doubts.extend(goodness::too_large(answer.fit.chi2, answer.fit.dof));
    doubts.extend(goodness::too_small(answer.fit.chi2, answer.fit.dof));
    let lost = observable.saturating_sub(answer.observable);
    if lost > 0 {
        doubts.push(format!(
            "{lost} combinations of parameters cannot be seen in these poses, and keep the file's values"
        ));
    }
    if float(answer.outliers.len()) > MAX_OUTLIER_SHARE * float(poses) {
        doubts.push(format!(
            "{} of {poses} poses do not agree with the others",
            answer.outliers.len()
        ));
    }
    // NaN is not below.
    let is_tolerated = answer.predicted_rms_m <= tolerance_m;
    if !is_tolerated {
        doubts.push(format!(
            "over the workspace a place is expected to be {:.3} mm off; {:.3} mm are tolerated",
            answer.predicted_rms_m * 1e3,
            tolerance_m * 1e3
        ));
    }
    doubts
}
