//! `calibrate`: from measured poses and a robot file to the file of this machine.

mod along;
mod columns;
mod error;
pub(crate) mod expected;
pub(crate) mod f1;
pub(crate) mod l2;
mod mirror;
mod moved;
mod report;
mod shape;

use std::ops::Range;
use std::path::PathBuf;

use nalgebra::{DMatrix, Isometry3, Vector3};
use serde::Serialize;

use super::agreement::Agreement;
use super::answer::{Answer, FORMAT, InRobotFrame, Outlier};
use super::f1::Diagnostic;
use crate::fit::answer::{Parameter, Status, Uncertainty, Unobservable};
use crate::fit::goodness;
use crate::fit::least_squares::{Direction, Seen};
use crate::fit::statistics::{chi_squared_above, float};
use crate::measurements::poses::Poses;
use crate::measurements::{FileError, frame};
use crate::robot_file::Calibrated;
use crate::robot_file::edit::RobotText;
use expected::Expected;
use shape::Shape;

pub use columns::Mistake;
pub use error::CalibrateError;
pub use f1::calibrate_f1;
pub use l2::calibrate_l2;

/// Largest distance and turn between the robot's frame by points of its base, and by where the robot file's machine is seen, m, rad.
const MOST_AWAY_M: f64 = 0.3;
const MOST_TURNED_RAD: f64 = 0.3;
/// Poses that do not agree, of which the summary has the names.
const NAMED: usize = 8;
/// Largest share of poses that may be left out.
const MOST_OUTLIERS: f64 = 0.1;

/// Options of a calibration.
#[derive(Clone, Debug)]
pub struct CalibrateOptions {
    /// Set-up of the measurements.
    pub poses: PathBuf,
    /// Name of the robot file to begin with, as of [`crate::robot_file::AnyRobotFile::named`].
    pub robot: String,
    /// Frame that the machine is written in.
    pub frame: FrameOption,
    /// Guideways of an L2.
    pub guideways: GuidewaysOption,
    /// Centre of the target from the tool centre point, platform axes, m. Absent: at the tool centre point of an L2, whose places cannot show
    /// it; found along with the frame of an F1.
    pub target_m: Option<[f64; 3]>,
    /// Largest expected error of a place over the workspace, m.
    pub tolerance_m: f64,
}

/// Frame that a calibrated machine is written in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FrameOption {
    /// The robot file's frame, as well as it can be told from the places `[T 3.11]`.
    Nominal,
    /// That of the device.
    Measured,
    /// That of points of the robot's base which the device has measured: a file of [`crate::measurements::frame`].
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

    /// Checks that the points of the base put the robot's frame near where the device sees the robot file's machine.
    ///
    /// # Errors
    /// [`CalibrateError::Frame`].
    fn check(&self, base: Option<&Isometry3<f64>>, of_file: &Isometry3<f64>) -> Result<(), CalibrateError> {
        let (Self::Points(path), Some(base)) = (self, base) else { return Ok(()) };
        let off = of_file.inverse() * base;
        let (away_m, turned_rad) = (off.translation.vector.norm(), off.rotation.angle());
        if away_m <= MOST_AWAY_M && turned_rad <= MOST_TURNED_RAD {
            return Ok(());
        }
        let file = path.display().to_string();
        Err(CalibrateError::Frame { file, away_m, turned_deg: turned_rad.to_degrees() })
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
    /// Text of the robot file of this machine: that of the file that the calibration began with, its geometry replaced.
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
struct Found<'a, S, M> {
    model: &'static str,
    agreement: &'a Agreement<S>,
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

impl<S, M: Serialize + Clone> Found<'_, S, M> {
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
        let page = report::Page {
            robot: &options.robot,
            measurements: &calibrated,
            summary: &summary,
            doubts: &doubts,
            remarks: &self.remarks,
            parameters: &answer.parameters,
            directions: &Unobservable::list(&self.names, &self.agreement.fit.seen.all()),
            diagnostics: &self.diagnostics,
            residuals: &self.residuals,
            expected: &self.expected,
        };
        Ok(Calibration {
            json: serde_json::to_string_pretty(&answer).map_err(|error| CalibrateError::Edit(error.to_string()))?,
            robot_file: robot_file(&options.robot, &calibrated, edit)?,
            report: page.html(),
            summary,
            remarks: self.remarks,
            doubts,
        })
    }

    fn answer<const N: usize>(&self, measured: &Poses<N>) -> Answer<M> {
        let fit = &self.agreement.fit;
        let uncertainty = Uncertainty::new(&fit.rows, &fit.seen, &fit.held);
        let status = |parameter: usize| match self.kept.contains(&parameter) {
            true => Status::Kept,
            false => uncertainty.status(parameter),
        };
        let seen = Seen::new(&fit.rows, fit.seen.scales());
        let unobservable = [self.unseen.clone(), seen.lost(), seen.weak()].concat();
        let outliers = self.agreement.outliers.iter();
        Answer {
            format: FORMAT,
            model: self.model,
            measured_frame: self.measured_frame.clone(),
            robot_frame: self.robot_frame.clone(),
            parameters: Parameter::list(&self.names, &self.values, &uncertainty.covariance(), status),
            observable: fit.seen.kept().saturating_sub(self.unseen.len()),
            unobservable: Unobservable::list(&self.names, &unobservable),
            predicted_rms_m: self.expected.rms_m,
            chi2: fit.chi_squared(),
            dof: fit.degrees(),
            p: chi_squared_above(fit.chi_squared(), fit.degrees()),
            outliers: outliers
                .filter_map(|index| Some(Outlier { pose: measured.poses.get(*index)?.name.clone() }))
                .collect(),
        }
    }

    /// Number of parameters that can be seen in any poses.
    fn observable(&self) -> usize {
        self.values.len().saturating_sub(self.unseen.len())
    }

    /// Entry of the robot file that says how it was calibrated.
    fn entry<const N: usize>(&self, measured: &Poses<N>, options: &CalibrateOptions, answer: &Answer<M>) -> Calibrated {
        let covariance = &self.covariance;
        Calibrated {
            measurements: measured.table.clone(),
            crc: measured.crc,
            poses: measured.poses.len(),
            chi2: answer.chi2,
            dof: answer.dof,
            predicted_rms_um: answer.predicted_rms_m * 1e6,
            frame: options.frame.name(),
            rotation: answer.robot_frame.rotation,
            translation_m: answer.robot_frame.translation_m,
            sd: covariance.diagonal().iter().map(|variance| variance.max(0.0).sqrt()).collect(),
            covariance: covariance.row_iter().map(|row| row.iter().copied().collect()).collect(),
        }
    }

    fn summary(&self, answer: &Answer<M>, poses: usize) -> String {
        let lost = self.observable().saturating_sub(answer.observable);
        // With few poses a part of them does not lead to a machine.
        let left_out = match self.left_out_rms_m {
            rms_m if rms_m.is_finite() => {
                format!(", and are {:.1} um off where they took no part in the fit", rms_m * 1e6)
            }
            _ => String::new(),
        };
        let named = match answer.outliers.as_slice() {
            [] => String::new(),
            outliers => {
                let names = outliers.iter().take(NAMED).map(|outlier| outlier.pose.to_string()).collect::<Vec<_>>();
                let more = if outliers.len() > NAMED { ", ..." } else { "" };
                format!(" and are left out ({}{more})", names.join(", "))
            }
        };
        format!(
            "{} of {} parameters seen; chi2/dof {:.2}, p {:.2}; {} of {poses} poses do not agree{named}; places were {:.2} mm off (rms){left_out}; one over the workspace is expected to be {:.1} um off{}",
            answer.observable,
            self.values.len(),
            self.agreement.fit.reduced_chi_squared(),
            answer.p,
            answer.outliers.len(),
            self.before_rms_m * 1e3,
            answer.predicted_rms_m * 1e6,
            if lost > 0 { ", not counting what cannot be seen" } else { "" },
        )
    }
}

/// Returns the text of the changed robot file.
fn robot_file(
    name: &str,
    calibrated: &Calibrated,
    edit: impl FnOnce(&mut RobotText),
) -> Result<String, CalibrateError> {
    let said = |error: &dyn std::fmt::Display| CalibrateError::Edit(error.to_string());
    let Calibrated { measurements, crc, .. } = calibrated;
    let text = crate::robot_file::text_of(name)?;
    let provenance = format!("CALIBRATED with {measurements} (CRC-32 {crc:08x})");
    let mut robot = RobotText::new(&text, &provenance).map_err(|error| said(&error))?;
    edit(&mut robot);
    robot.set_serialized("calibrated", calibrated).map_err(|error| said(&error))?;
    Ok(robot.text())
}

/// Refuses measurements in a region whose shape is why fewer than `all` combinations of parameters can be seen.
fn check_shape(table: &str, shape: &Shape, seen: usize, all: usize) -> Result<(), CalibrateError> {
    let lost = all.saturating_sub(seen);
    if lost == 0 || !shape.is_poor() {
        return Ok(());
    }
    Err(CalibrateError::Shape { table: table.to_owned(), shape: shape.to_string(), lost, all })
}

/// Rows of a rotation, and the translation.
fn rows(motion: &Isometry3<f64>) -> ([[f64; 3]; 3], [f64; 3]) {
    (motion.rotation.to_rotation_matrix().into_inner().transpose().into(), motion.translation.vector.into())
}

fn doubts<M>(answer: &Answer<M>, poses: usize, observable: usize, tolerance_m: f64) -> Vec<String> {
    let mut doubts = Vec::new();
    doubts.extend(goodness::too_large(answer.chi2, answer.dof));
    doubts.extend(goodness::too_small(answer.chi2, answer.dof));
    let lost = observable.saturating_sub(answer.observable);
    if lost > 0 {
        doubts.push(format!(
            "{lost} combinations of parameters cannot be seen in these poses, and keep the file's values"
        ));
    }
    if float(answer.outliers.len()) > MOST_OUTLIERS * float(poses) {
        doubts.push(format!("{} of {poses} poses do not agree with the others", answer.outliers.len()));
    }
    // NaN is not below.
    let is_tolerated = answer.predicted_rms_m <= tolerance_m;
    if !is_tolerated {
        let (expected, tolerated) = (answer.predicted_rms_m * 1e3, tolerance_m * 1e3);
        doubts.push(format!(
            "over the workspace a place is expected to be {expected:.3} mm off; {tolerated:.3} mm are tolerated"
        ));
    }
    doubts
}
