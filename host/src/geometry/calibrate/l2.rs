//! Calibration of an L2.

use gantry_tau_core::model::l2::AXES;
use gantry_tau_core::model::robot::{ARM_OF_LINK, LINKS};
use nalgebra::Matrix3;

use super::{CalibrateError, CalibrateOptions, Calibration, Found, GRID_CELLS, rows};
use crate::fit::least_squares::FitError;
use crate::geometry::agreement::fit_agreeing;
use crate::geometry::answer::{InRobotFrame, L2Machine};
use crate::geometry::frames::rigid_trimmed;
use crate::geometry::l2::{
    Calibrated, LEAST_PLACES, Nominal, PARAMETERS, Places, PredictionError, closed_form, predicted_rms_m,
};
use crate::measurements::poses::{self, Poses};
use crate::model::L2;
use crate::robot_file::RobotFile;
use crate::workspace::{Grid, survey};

/// Calibrates an L2, the machine of `options.robot`.
///
/// # Errors
/// [`CalibrateError`].
pub fn calibrate_l2(robot: &RobotFile<L2, AXES>, options: &CalibrateOptions) -> Result<Calibration, CalibrateError> {
    let measured: Poses<AXES> = poses::read(&options.poses, "l2")?;
    if measured.poses.len() < LEAST_PLACES {
        let poses = measured.poses.len();
        return Err(CalibrateError::TooFew { table: measured.table, poses, least: LEAST_PLACES });
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
    let agreement = best_start(&file, &places)
        .map_err(|error| CalibrateError::NoStart { table: measured.table.clone(), reason: error.to_string() })?;
    let moved = agreement
        .in_frame_of(&file, &places)
        .map_err(|reason| CalibrateError::Prediction { table: measured.table.clone(), reason: reason.to_string() })?;
    let reached = survey(robot, Grid::of(robot, GRID_CELLS), |_| ()).places.into_iter();
    let at_q: Vec<_> = reached.filter_map(|place| Some(place.reached.ok()?.q)).collect();
    let state = &agreement.fit.state;
    let predicted_rms_m = predicted_rms_m(state, geometry.configuration, &agreement.fit.seen.covariance(), &at_q);
    let (rotation, translation_m) = rows(&moved.motion);
    let robot_frame = InRobotFrame { machine: machine(&moved.nominal), rotation, translation_m, target: None };
    let found = Found {
        model: "l2",
        agreement: &agreement,
        names: names(),
        values: state.parameters(),
        observable: PARAMETERS,
        measured_frame: machine(state),
        robot_frame,
        covariance: moved.covariance,
        predicted_rms_m,
    };
    found.calibration(&measured, options, |text| {
        // The Tau property, exactly.
        let joints = geometry.platform_joints_m;
        let carts: [[f64; 3]; LINKS] =
            std::array::from_fn(|link| (moved.nominal.origins_m[ARM_OF_LINK[link]] + joints[link]).into());
        text.set_rows("A0", &carts);
        text.set_rows("V", &moved.nominal.guideways.map(Into::into));
        text.set_numbers("L", &moved.nominal.lengths_m);
    })
}

/// Fits from the robot file, moved to where the device sees it, and from the measurements alone; the better of both.
fn best_start(file: &Nominal, places: &Places<'_>) -> Result<Calibrated, FitError<PredictionError>> {
    let kinematics = file.kinematics(places.configuration).map_err(FitError::Start)?;
    // A pose beyond the reach of the file's machine takes no part in the start.
    let pairs: Vec<_> =
        (places.poses.iter()).filter_map(|pose| Some((kinematics.forward(&pose.q).ok()?, pose.position_m))).collect();
    let start = rigid_trimmed(&pairs).map_or(*file, |motion| file.moved(&motion));
    let from_file = fit_agreeing(places, start);
    let Some(alone) = closed_form(places.poses).and_then(|start| fit_agreeing(places, start).ok()) else {
        return from_file;
    };
    let cost = |found: &Calibrated| (found.outliers.len(), found.fit.reduced_chi_squared());
    match from_file {
        Ok(found) if cost(&found) <= cost(&alone) => Ok(found),
        _ => Ok(alone),
    }
}

/// Names of the parameters, and their units.
pub(crate) fn names() -> Vec<(String, &'static str)> {
    let arm = |arm: usize| {
        let vector = |name: &str| ["x", "y", "z"].map(|axis| (format!("{name}[{arm}].{axis}"), "m"));
        vector("A_s").into_iter().chain(vector("V")).chain([(format!("L[{arm}]"), "m")])
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
