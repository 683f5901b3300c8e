//! Calibration of an L2.

mod guideways;
mod placed;

use gantry_tau_core::model::l2::{AXES, Geometry};
use gantry_tau_core::model::robot::{ARM_OF_LINK, LINKS};
use gantry_tau_machine::model::L2;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_machine::robot_file::edit::RobotText;
use nalgebra::{DMatrix, DVector, Matrix3, UnitQuaternion, Vector3};

use super::columns::ColumnMistake;
use super::expected::Expected;
use super::robot_file_frame::move_frame;
use super::shape::Shape;
use super::{
    CalibrateError, CalibrateOptions, Calibration, FittedMachine, FrameOption, GuidewaysOption,
    check_shape, mirror, moved, rows,
};
use crate::fit::frames::rigid_trimmed;
use crate::fit::goodness::MIN_P;
use crate::fit::least_squares::FitError;
use crate::fit::statistics::{chi_squared_above, float};
use crate::geometry::answer::{InRobotFrame, L2Machine};
use crate::geometry::l2::{
    Calibrated, MIN_PLACES, Nominal, PARAMETERS, Places, PredictionError, closed_form,
    predicted_rms_m,
};
use crate::geometry::parallel::{Parallel, expansion};
use crate::geometry::robust_fit::{
    agreeing, cost, fit_agreeing, fit_agreeing_first, left_out_rms_m, rms_m,
};
use crate::measurements::poses::{self, Poses};
use guideways::Guideways;
use placed::Placed;

/// Calibrates an L2, the machine of `options.robot`, with the poses of `options.poses`.
///
/// # Errors
/// [`CalibrateError`].
pub fn calibrate_l2(
    robot: &RobotFile<L2, AXES>,
    options: &CalibrateOptions,
) -> Result<Calibration, CalibrateError> {
    calibrate_l2_with(robot, &poses::read(&options.poses, "l2")?, options)
}

/// As [`calibrate_l2`], with poses in memory; `options.poses` is not read.
///
/// # Errors
/// [`CalibrateError`].
pub fn calibrate_l2_with(
    robot: &RobotFile<L2, AXES>,
    measured: &Poses<AXES>,
    options: &CalibrateOptions,
) -> Result<Calibration, CalibrateError> {
    let base = options.frame.points()?;
    let target_m = Vector3::from(options.target_m.unwrap_or_default());
    let geometry = robot.model.robot().geometry();
    // The point on the platform is the target.
    let file = Nominal::of(geometry).shifted(&target_m);
    let places = places(measured, geometry)?;
    check_columns(measured, &file, geometry)?;
    let free = fit_free(&file, &places, &measured.table)?;
    let used = free.used(measured.poses.len());
    let guideways = Guideways::of(&free, &places);
    let device = moved::doubt(&measured.poses, &used, &free.fit.rows, |motion| {
        let place = places.whitening * motion.fixed_rows::<3>(0);
        DMatrix::from_column_slice(3, 6, place.as_slice())
    });
    let doubts = turned_platform(measured)
        .into_iter()
        .chain(guideways.doubt(options.guideways))
        .chain(device)
        .collect();
    let remarks = guideways.remark(options.guideways).into_iter().collect();
    let Fitted {
        robust_fit,
        covariance,
        names,
        values,
        left_out_rms_m,
    } = match options.guideways {
        GuidewaysOption::Free => Fitted::free(free, &places),
        GuidewaysOption::Parallel => {
            let parallel = guideways
                .parallel
                .map_err(|error| CalibrateError::NotParallel {
                    table: measured.table.clone(),
                    reason: error.to_string(),
                })?;
            Fitted::parallel(parallel, &places)
        }
    };
    let moved = robust_fit
        .in_frame_of(&file, &places, &covariance)
        .map_err(|reason| CalibrateError::Prediction {
            table: measured.table.clone(),
            reason: reason.to_string(),
        })?;
    options.frame.check(base.as_ref(), &moved.motion)?;
    let state = &robust_fit.fit.state;
    let expected = Expected::over(robot, |stands| {
        let all: Vec<_> = stands.iter().map(|(q, _)| *q).collect();
        predicted_rms_m(state, geometry.configuration, &covariance, &all)
    });
    let before_rms_m = rms_m(&places, &file.moved(&moved.motion), used.iter().copied());
    let placed = Placed::new(options, state, moved, base, &covariance);
    let (rotation, translation_m) = rows(&placed.motion);
    // From here on the point is the tool centre point again.
    let tool = placed.nominal.shifted(&-(placed.along.rotation * target_m));
    let found = FittedMachine {
        model: "l2",
        robust_fit: &robust_fit,
        names,
        values,
        unseen: Vec::new(),
        kept: 0..0,
        measured_frame: machine(state),
        robot_frame: InRobotFrame {
            machine: machine(&tool),
            rotation,
            translation_m,
            target: None,
        },
        covariance: placed.covariance,
        before_rms_m,
        left_out_rms_m,
        expected,
        residuals: residuals(state, &places, &robust_fit.outliers),
        diagnostics: Vec::new(),
        remarks,
        doubts,
    };
    found.calibration(measured, options, |text| {
        let joints = geometry
            .platform_joints_m
            .map(|joint| placed.along.rotation * joint);
        write_geometry(text, &tool, &joints);
        if options.frame == FrameOption::Measured {
            // The axes of an L2's platform are those of the world, and the world is the device's
            // now.
            text.set_rows("b", &joints.map(Into::into));
            move_frame(text, robot, &placed.along);
        }
    })
}

/// Puts a machine into its robot file; `platform_joints_m` are in the axes of the world. It has the
/// Tau property exactly.
fn write_geometry(text: &mut RobotText, tool: &Nominal, platform_joints_m: &[Vector3<f64>; LINKS]) {
    let carts: [[f64; 3]; LINKS] = std::array::from_fn(|link| {
        (tool.origins_m[ARM_OF_LINK[link]] + platform_joints_m[link]).into()
    });
    text.set_rows("A0", &carts);
    text.set_rows("V", &tool.guideways.map(Into::into));
    text.set_numbers("L", &tool.lengths_m);
}

/// The measured places of a machine of this geometry.
fn places<'a>(
    measured: &'a Poses<AXES>,
    geometry: &Geometry,
) -> Result<Places<'a>, CalibrateError> {
    let poses = measured.poses.len();
    if poses < MIN_PLACES {
        return Err(CalibrateError::TooFew {
            table: measured.table.clone(),
            poses,
            least: MIN_PLACES,
        });
    }
    let whitening = measured
        .noise
        .position_m2
        .try_inverse()
        .and_then(Matrix3::cholesky);
    Ok(Places {
        poses: &measured.poses,
        // `covariance^-1 = L L^T`, so `W = L^T`.
        whitening: whitening.map_or_else(Matrix3::identity, |factor| factor.l().transpose()),
        configuration: geometry.configuration,
    })
}

fn check_columns(
    measured: &Poses<AXES>,
    file: &Nominal,
    geometry: &Geometry,
) -> Result<(), CalibrateError> {
    let Ok(kinematics) = file.kinematics(geometry.configuration) else {
        return Ok(());
    };
    let mistake = ColumnMistake::find(&measured.poses, |q| kinematics.forward(q).ok());
    mistake.map_or(Ok(()), |mistake| {
        Err(CalibrateError::Columns {
            table: measured.table.clone(),
            mistake,
        })
    })
}

fn no_start(table: &str) -> impl Fn(FitError<PredictionError>) -> CalibrateError {
    |error| CalibrateError::NoStart {
        table: table.to_owned(),
        reason: error.to_string(),
    }
}

/// Fits 21 parameters. Refuses places whose region is why that does not lead to one machine.
fn fit_free(
    file: &Nominal,
    places: &Places<'_>,
    table: &str,
) -> Result<Calibrated, CalibrateError> {
    let free = best_start(file, places).map_err(no_start(table))?;
    let shape = Shape::of_poses(places.poses, &free.used(places.poses.len()));
    if mirror::fits_as_well(&free, places, &shape) {
        return Err(CalibrateError::Mirror {
            table: table.to_owned(),
            shape: shape.to_string(),
        });
    }
    check_shape(table, &shape, free.fit.seen.kept(), PARAMETERS)?;
    Ok(free)
}

/// A fit, and its parameters.
struct Fitted {
    robust_fit: Calibrated,
    /// Of all 21 parameters.
    covariance: DMatrix<f64>,
    names: Vec<(String, &'static str)>,
    values: DVector<f64>,
    left_out_rms_m: f64,
}

impl Fitted {
    fn free(robust_fit: Calibrated, places: &Places<'_>) -> Self {
        Self {
            covariance: robust_fit.fit.seen.covariance(),
            names: names(),
            values: robust_fit.fit.state.parameters(),
            left_out_rms_m: left_out_rms_m(places, &robust_fit),
            robust_fit,
        }
    }

    fn parallel(robust_fit: Calibrated, places: &Places<'_>) -> Self {
        let expansion = expansion();
        Self {
            covariance: &expansion * robust_fit.fit.seen.covariance() * expansion.transpose(),
            names: guideways::names(),
            values: guideways::values(&robust_fit.fit.state),
            left_out_rms_m: left_out_rms_m(&Parallel(*places), &robust_fit),
            robust_fit,
        }
    }
}

/// Says if the platform turns from pose to pose, where the device sees it: then the links of a
/// cluster differ.
fn turned_platform(measured: &Poses<AXES>) -> Option<String> {
    let variance = measured.noise.rotation_rad2?;
    let rotations: Vec<UnitQuaternion<f64>> = measured
        .poses
        .iter()
        .filter_map(|pose| pose.rotation)
        .collect();
    let first = rotations.first()?;
    let vectors: Vec<Vector3<f64>> = rotations
        .iter()
        .map(|rotation| (rotation * first.inverse()).scaled_axis())
        .collect();
    let mean = vectors.iter().sum::<Vector3<f64>>() / float(vectors.len());
    let inverse = variance.try_inverse()?;
    let chi: f64 = vectors
        .iter()
        .map(|vector| (vector - mean).dot(&(inverse * (vector - mean))))
        .sum();
    let rms = (vectors
        .iter()
        .map(|vector| (vector - mean).norm_squared())
        .sum::<f64>()
        / float(vectors.len()))
    .sqrt();
    let p = chi_squared_above(chi, 3 * (vectors.len() - 1));
    (p < MIN_P).then(|| {
        format!(
            "the platform turns by {:.0} urad (rms) from pose to pose, which the links of a cluster do if they differ: the model of 21 parameters is wrong by as much times the lever",
            rms * 1e6
        )
    })
}

/// Residuals of the places that were used: place and rest, m, in the frame of the device.
fn residuals(state: &Nominal, places: &Places<'_>, outliers: &[usize]) -> Vec<[Vector3<f64>; 2]> {
    let Ok(kinematics) = state.kinematics(places.configuration) else {
        return Vec::new();
    };
    let used = places
        .poses
        .iter()
        .enumerate()
        .filter(|(index, _)| !outliers.contains(index));
    used.filter_map(|(_, pose)| {
        Some([
            pose.position_m,
            pose.position_m - kinematics.forward(&pose.q).ok()?,
        ])
    })
    .collect()
}

/// Fits from the robot file, moved to where the device sees it, and from the measurements alone: of
/// all poses, and of those that the moved file does not leave far off, for a few that are grossly
/// wrong spoil either. Returns the best.
fn best_start(
    file: &Nominal,
    places: &Places<'_>,
) -> Result<Calibrated, FitError<PredictionError>> {
    let kinematics = file
        .kinematics(places.configuration)
        .map_err(FitError::Start)?;
    // A pose beyond the reach of the file's machine takes no part in the start.
    let pairs: Vec<_> = (places.poses.iter())
        .filter_map(|pose| Some((kinematics.forward(&pose.q).ok()?, pose.position_m)))
        .collect();
    let start = rigid_trimmed(&pairs).map_or(*file, |motion| file.moved(&motion));
    let near: Vec<_> = agreeing(places, &start)
        .into_iter()
        .map(|index| places.poses[index].clone())
        .collect();
    let mut best = fit_agreeing(places, start);
    let others = [
        (near.len() < places.poses.len()).then(|| fit_agreeing_first(places, start)),
        closed_form(places.poses).map(|start| fit_agreeing(places, start)),
        closed_form(&near).map(|start| fit_agreeing_first(places, start)),
    ];
    for found in others.into_iter().flatten().flatten() {
        if best
            .as_ref()
            .is_ok_and(|best| cost::<Places<'_>>(best) <= cost::<Places<'_>>(&found))
        {
            continue;
        }
        best = Ok(found);
    }
    best
}

/// Names of the parameters, and their units.
pub(crate) fn names() -> Vec<(String, &'static str)> {
    (0..3)
        .flat_map(|arm| {
            let vectors = ["A_s", "V"].into_iter().flat_map(move |name| {
                ["x", "y", "z"].map(|axis| (format!("{name}[{arm}].{axis}"), "m"))
            });
            vectors.chain([(format!("L[{arm}]"), "m")])
        })
        .collect()
}

fn machine(nominal: &Nominal) -> L2Machine {
    L2Machine {
        origins_m: nominal.origins_m.map(Into::into),
        guideways: nominal.guideways.map(Into::into),
        lengths_m: nominal.lengths_m,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measurements::poses::MeasuredPose;
    use crate::measurements::poses::PoseNoise;
    use gantry_tau_system::output::Name;

    /// Poses of a platform that turns by this angle about x, to and fro, and noise of 10 urad.
    fn swinging(angle_rad: f64) -> Poses<AXES> {
        let rest = UnitQuaternion::from_scaled_axis(Vector3::new(0.4, -1.2, 2.0));
        let poses = (0..20_usize).map(|index| {
            let angle_rad = if index % 2 == 0 {
                angle_rad
            } else {
                -angle_rad
            };
            let rotation = UnitQuaternion::from_scaled_axis(Vector3::x() * angle_rad) * rest;
            MeasuredPose {
                name: Name::made(index),
                q: [0.0; AXES],
                position_m: Vector3::zeros(),
                rotation: Some(rotation),
            }
        });
        let noise = PoseNoise::independent(
            Matrix3::identity() * 1e-10,
            Some(Matrix3::identity() * 1e-10),
        );

        Poses {
            model: "l2".to_owned(),
            table: "p.csv".to_owned(),
            crc: 0,
            noise,
            poses: poses.collect(),
        }
    }

    #[test]
    fn a_platform_that_turns_by_more_than_its_noise_is_reported() {
        assert_eq!(turned_platform(&swinging(10e-6)), None);
        let said = turned_platform(&swinging(100e-6)).unwrap();
        assert!(
            said.starts_with("the platform turns by 100 urad (rms)"),
            "{said}"
        );
        let mut unseen = swinging(100e-6);
        unseen.noise.rotation_rad2 = None;
        assert_eq!(turned_platform(&unseen), None);
    }
}
