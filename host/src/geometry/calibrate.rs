//! `calibrate`: from measured poses and a robot file to the file of this machine.

use std::path::PathBuf;

use gantry_tau_core::model::l2;
use gantry_tau_core::model::robot::{ARM_OF_LINK, LINKS};
use nalgebra::{DMatrix, Isometry3, Matrix3};

use super::agreement::fit_agreeing;
use super::answer::{Answer, FORMAT, InRobotFrame, L2Machine, Outlier, Parameter, Status, Unobservable};
use super::frames::rigid_trimmed;
use super::l2::{Calibrated as Fitted, LEAST_PLACES, Nominal, Places, PredictionError, closed_form, predicted_rms_m};
use crate::fit::least_squares::FitError;
use crate::fit::statistics::{chi_squared_above, float};
use crate::measurements::FileError;
use crate::measurements::poses::{self, Poses};
use crate::model::L2;
use crate::robot_file::edit::RobotText;
use crate::robot_file::{Calibrated, RobotFile};
use crate::workspace::{Grid, survey};

/// Steps along the longest side of the grid that the expected error is a mean over.
const GRID_CELLS: u32 = 16;
/// Smallest probability of the residuals at which a model is believed.
pub const LEAST_P: f64 = 1e-3;
/// Largest share of poses that may be left out.
pub const MOST_OUTLIERS: f64 = 0.1;

/// Options of a calibration.
#[derive(Clone, Debug)]
pub struct CalibrateOptions {
    /// Set-up of the measurements.
    pub poses: PathBuf,
    /// Largest expected error of a place over the workspace, m.
    pub tolerance_m: f64,
}

/// Reason why there is no calibration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrateError {
    /// A file is wrong.
    #[error(transparent)]
    File(#[from] FileError),
    /// Too few poses.
    #[error("{table}: {poses} poses are too few; {LEAST_PLACES} are needed, and 20 are a start")]
    TooFew {
        /// The table.
        table: String,
        /// Number of poses.
        poses: usize,
    },
    /// No start fits.
    #[error("{table}: neither the robot file nor the measurements alone lead to a machine: {reason}")]
    NoStart {
        /// The table.
        table: String,
        /// What the better of them ended in.
        reason: String,
    },
    /// The robot file's machine cannot stand where it was measured.
    #[error("{table}: {reason}")]
    Prediction {
        /// The table.
        table: String,
        /// What is wrong.
        reason: PredictionError,
    },
}

/// Result of a calibration of an L2.
#[derive(Clone, Debug, PartialEq)]
pub struct L2Calibration {
    /// What programs get.
    pub answer: Answer<L2Machine>,
    /// The machine in the frame of the robot.
    pub nominal: Nominal,
    /// Where it comes from.
    pub provenance: Calibrated,
    /// Reasons not to trust it as it is; empty where there are none.
    pub doubts: Vec<String>,
}

/// Calibrates an L2.
///
/// # Errors
/// [`CalibrateError`].
pub fn calibrate_l2(
    robot: &RobotFile<L2, { l2::AXES }>,
    options: &CalibrateOptions,
) -> Result<L2Calibration, CalibrateError> {
    let measured: Poses<{ l2::AXES }> = poses::read(&options.poses, "l2")?;
    if measured.poses.len() < LEAST_PLACES {
        return Err(CalibrateError::TooFew { table: measured.table, poses: measured.poses.len() });
    }
    let geometry = robot.model.robot().geometry();
    let file = Nominal::of(geometry);
    let whitening = measured.noise.position_m2.try_inverse().and_then(Matrix3::cholesky);
    let places = Places {
        poses: &measured.poses,
        // `covariance^-1 = L L^T`, so `W = L^T`.
        whitening: whitening.map_or_else(Matrix3::identity, |factor| factor.l().transpose()),
        configuration: geometry.configuration,
    };
    let calibrated = best_start(&file, &places)
        .map_err(|error| CalibrateError::NoStart { table: measured.table.clone(), reason: error.to_string() })?;
    let in_robot_frame = (calibrated.in_frame_of(&file, &places))
        .map_err(|reason| CalibrateError::Prediction { table: measured.table.clone(), reason })?;
    let at_q: Vec<_> = survey(robot, Grid::of(robot, GRID_CELLS), |_| ())
        .places
        .into_iter()
        .filter_map(|place| place.reached.ok().map(|reached| reached.q))
        .collect();
    let predicted_rms_m =
        predicted_rms_m(&calibrated.fit.state, geometry.configuration, &calibrated.fit.seen.covariance(), &at_q);
    let answer = answer(&calibrated, &in_robot_frame.nominal, &in_robot_frame.motion, predicted_rms_m, &measured);
    let doubts = doubts(&answer, measured.poses.len(), options.tolerance_m);
    let provenance = provenance(&answer, &in_robot_frame.covariance, &measured);
    Ok(L2Calibration { answer, nominal: in_robot_frame.nominal, provenance, doubts })
}

impl L2Calibration {
    /// Returns the text of the robot file of this machine: that of the file that the calibration began with, its geometry replaced.
    ///
    /// # Errors
    /// `text` is not TOML, or not this machine's.
    pub fn robot_file(&self, text: &str, file: &RobotFile<L2, { l2::AXES }>) -> Result<String, String> {
        let said = |error: toml_edit::TomlError| error.to_string();
        let Calibrated { measurements, crc, .. } = &self.provenance;
        let mut robot =
            RobotText::new(text, &format!("CALIBRATED with {measurements} (CRC-32 {crc:08x})")).map_err(said)?;
        let joints = file.model.robot().geometry().platform_joints_m;
        // The Tau property, exactly.
        let carts: [[f64; 3]; LINKS] =
            std::array::from_fn(|link| (self.nominal.origins_m[ARM_OF_LINK[link]] + joints[link]).into());
        robot.set_rows("A0", &carts);
        robot.set_rows("V", &self.nominal.guideways.map(Into::into));
        robot.set_numbers("L", &self.nominal.lengths_m);
        let section = toml::to_string(&self.provenance).map_err(|error| error.to_string())?;
        robot.set_section("calibrated", section.parse::<toml_edit::DocumentMut>().map_err(said)?.as_table().clone());
        Ok(robot.text())
    }
}

fn provenance<M>(answer: &Answer<M>, covariance: &DMatrix<f64>, measured: &Poses<{ l2::AXES }>) -> Calibrated {
    Calibrated {
        measurements: measured.table.clone(),
        crc: measured.crc,
        poses: measured.poses.len(),
        chi2: answer.chi2,
        dof: answer.dof,
        predicted_rms_um: answer.predicted_rms_m * 1e6,
        frame: "nominal".to_owned(),
        rotation: answer.robot_frame.rotation,
        translation_m: answer.robot_frame.translation_m,
        sd: covariance.diagonal().iter().map(|variance| variance.max(0.0).sqrt()).collect(),
        covariance: covariance.row_iter().map(|row| row.iter().copied().collect()).collect(),
    }
}

/// Fits from the robot file, moved to where the device sees it, and from the measurements alone; the better of both.
fn best_start(file: &Nominal, places: &Places<'_>) -> Result<Fitted, FitError<PredictionError>> {
    let kinematics = file.kinematics(places.configuration).map_err(FitError::Start)?;
    // A pose beyond the reach of the file's machine takes no part in the start.
    let pairs: Vec<_> =
        (places.poses.iter()).filter_map(|pose| Some((kinematics.forward(&pose.q).ok()?, pose.position_m))).collect();
    let start = rigid_trimmed(&pairs).map_or(*file, |motion| file.moved(&motion));
    let from_file = fit_agreeing(places, start);
    let Some(alone) = closed_form(places.poses).and_then(|start| fit_agreeing(places, start).ok()) else {
        return from_file;
    };
    let cost = |found: &Fitted| (found.outliers.len(), found.fit.reduced_chi_squared());
    match from_file {
        Ok(found) if cost(&found) <= cost(&alone) => Ok(found),
        _ => Ok(alone),
    }
}

fn names() -> Vec<(String, &'static str)> {
    let arm = |arm: usize| {
        let vector = |name: &str, unit| ["x", "y", "z"].map(|axis| (format!("{name}[{arm}].{axis}"), unit));
        vector("A_s", "m").into_iter().chain(vector("V", "m")).chain([(format!("L[{arm}]"), "m")])
    };
    (0..3).flat_map(arm).collect()
}

fn machine(nominal: &Nominal) -> L2Machine {
    L2Machine {
        origins_m: nominal.origins_m.map(Into::into),
        guideways: nominal.guideways.map(Into::into),
        lengths_m: nominal.lengths_m,
    }
}

fn answer(
    calibrated: &Fitted,
    in_robot_frame: &Nominal,
    motion: &Isometry3<f64>,
    predicted_rms_m: f64,
    measured: &Poses<{ l2::AXES }>,
) -> Answer<L2Machine> {
    let (fit, names) = (&calibrated.fit, names());
    let seen = &fit.seen;
    let status = |parameter: usize| if seen.lost_share(parameter) > 0.5 { Status::Kept } else { Status::Identified };
    let mut unobservable = seen.lost();
    unobservable.extend(seen.weak());
    let rotation = motion.rotation.to_rotation_matrix().into_inner().transpose();
    Answer {
        format: FORMAT,
        model: "l2",
        measured_frame: machine(&fit.state),
        robot_frame: InRobotFrame {
            machine: machine(in_robot_frame),
            rotation: rotation.into(),
            translation_m: motion.translation.vector.into(),
        },
        parameters: Parameter::list(&names, &fit.state.parameters(), &seen.covariance(), status),
        observable: seen.kept(),
        unobservable: Unobservable::list(&names, &unobservable),
        predicted_rms_m,
        chi2: fit.chi_squared(),
        dof: fit.degrees(),
        p: chi_squared_above(fit.chi_squared(), fit.degrees()),
        outliers: calibrated
            .outliers
            .iter()
            .map(|index| Outlier { pose: measured.poses[*index].name.clone() })
            .collect(),
    }
}

fn doubts<M>(answer: &Answer<M>, poses: usize, tolerance_m: f64) -> Vec<String> {
    let mut doubts = Vec::new();
    if answer.p < LEAST_P {
        doubts.push(format!(
            "the model or the stated noise is wrong: chi2/dof is {:.2} (p = {:.1e})",
            answer.chi2 / float(answer.dof),
            answer.p
        ));
    }
    let lost = answer.unobservable.iter().filter(|direction| direction.relative_sd > 1.0).count();
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
        doubts.push(format!(
            "over the workspace a place is expected to be {:.3} mm off; {:.3} mm are tolerated",
            answer.predicted_rms_m * 1e3,
            tolerance_m * 1e3
        ));
    }
    doubts
}
