//! Calibration of an L2.

use gantry_tau_core::model::l2::AXES;
use gantry_tau_core::model::robot::{ARM_OF_LINK, LINKS};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, UnitQuaternion, Vector3};

use super::along::turn_along;
use super::shape::Shape;
use super::{
    CalibrateError, CalibrateOptions, Calibration, Found, FrameOption, GRID_CELLS, GuidewaysOption, LEAST_P,
    check_shape, mirror, rows,
};
use crate::fit::least_squares::{FitError, fit};
use crate::fit::statistics::{chi_squared_above, f_above, float};
use crate::geometry::agreement::{Model, cost, fit_agreeing, left_out_rms_m, rms_m};
use crate::geometry::answer::{InRobotFrame, L2Machine};
use crate::geometry::frames::rigid_trimmed;
use crate::geometry::l2::{
    self, Calibrated, LEAST_PLACES, Nominal, PARAMETERS, Places, PredictionError, closed_form, predicted_rms_m,
    turned_covariance,
};
use crate::geometry::parallel::{PARALLEL_PARAMETERS, Parallel, expansion, with_parallel_guideways};
use crate::measurements::frame;
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
    let target_m = Vector3::from(options.target_m.unwrap_or_default());
    // The point on the platform is the target.
    let file = Nominal::of(geometry).shifted(&target_m);
    let whitening = measured.noise.position_m2.try_inverse().and_then(Matrix3::cholesky);
    let places = Places {
        poses: &measured.poses,
        // `covariance^-1 = L L^T`, so `W = L^T`.
        whitening: whitening.map_or_else(Matrix3::identity, |factor| factor.l().transpose()),
        configuration: geometry.configuration,
    };
    let no_start = |error: FitError<PredictionError>| CalibrateError::NoStart {
        table: measured.table.clone(),
        reason: error.to_string(),
    };
    let free = best_start(&file, &places).map_err(no_start)?;
    let used: Vec<usize> = (0..measured.poses.len()).filter(|index| !free.outliers.contains(index)).collect();
    let shape = Shape::of(&used.iter().map(|index| measured.poses[*index].position_m).collect::<Vec<_>>());
    if mirror::fits_as_well(&free, &places, &shape) {
        return Err(CalibrateError::Mirror { table: measured.table, shape: shape.to_string() });
    }
    check_shape(&measured.table, &shape, free.fit.seen.kept(), PARAMETERS)?;
    let guideways = Guideways::of(&free, &places).map_err(no_start)?;
    let (agreement, covariance) = match options.guideways {
        GuidewaysOption::Free => (free.clone(), free.fit.seen.covariance()),
        GuidewaysOption::Parallel => {
            let expansion = expansion();
            let covariance = &expansion * guideways.parallel.fit.seen.covariance() * expansion.transpose();
            (guideways.parallel.clone(), covariance)
        }
    };
    let frame = match &options.frame {
        FrameOption::Points(path) => Some(frame::read(path)?),
        FrameOption::Nominal | FrameOption::Measured => None,
    };
    let moved = agreement
        .in_frame_of(&file, &places, &covariance)
        .map_err(|reason| CalibrateError::Prediction { table: measured.table.clone(), reason: reason.to_string() })?;
    let state = &agreement.fit.state;
    let grid = Grid::of(robot, GRID_CELLS);
    let reached = survey(robot, grid, |_| ()).places.into_iter();
    let at_q: Vec<_> = reached.filter_map(|place| Some((place.tool_m, place.reached.ok()?.q))).collect();
    let expected = |(tool_m, q): &(Vector3<f64>, [f64; AXES])| {
        let error_m = predicted_rms_m(state, geometry.configuration, &covariance, &[*q]);
        error_m.is_finite().then_some((*tool_m, error_m * 1e6))
    };
    let expected_um: Vec<_> = at_q.iter().filter_map(expected).collect();
    let all: Vec<_> = at_q.iter().map(|(_, q)| *q).collect();
    let predicted_rms_m = predicted_rms_m(state, geometry.configuration, &covariance, &all);
    let moved_by = moved.motion;
    let placed = Placed::new(options, state, moved, frame, &covariance);
    let (rotation, translation_m) = rows(&placed.motion);
    // From here on the point is the tool centre point again.
    let tool = placed.nominal.shifted(&-(placed.along.rotation * target_m));
    let robot_frame = InRobotFrame { machine: machine(&tool), rotation, translation_m, target: None };
    let is_parallel = options.guideways == GuidewaysOption::Parallel;
    let found = Found {
        model: "l2",
        agreement: &agreement,
        names: if is_parallel { parallel_names() } else { names() },
        values: if is_parallel { parallel_values(state) } else { state.parameters() },
        observable: if is_parallel { PARALLEL_PARAMETERS } else { PARAMETERS },
        measured_frame: machine(state),
        robot_frame,
        covariance: placed.covariance,
        predicted_rms_m,
        before_rms_m: rms_m(&places, &file.moved(&moved_by), used.iter().copied()),
        left_out_rms_m: if is_parallel {
            left_out_rms_m(&Parallel(places), &agreement)
        } else {
            left_out_rms_m(&places, &agreement)
        },
        grid,
        expected_um,
        residuals: residuals(state, &places, &agreement.outliers),
        diagnostics: Vec::new(),
        remarks: guideways.remark(options.guideways).into_iter().collect(),
        doubts: turned_platform(&measured).into_iter().chain(guideways.doubt(options.guideways)).collect(),
    };
    found.calibration(&measured, options, |text| {
        let turned = |vector: &Vector3<f64>| -> [f64; 3] { (placed.along.rotation * vector).into() };
        // The Tau property, exactly.
        let joints = geometry.platform_joints_m.map(|joint| placed.along.rotation * joint);
        let carts: [[f64; 3]; LINKS] =
            std::array::from_fn(|link| (tool.origins_m[ARM_OF_LINK[link]] + joints[link]).into());
        text.set_rows("A0", &carts);
        text.set_rows("V", &tool.guideways.map(Into::into));
        text.set_numbers("L", &tool.lengths_m);
        if options.frame == FrameOption::Measured {
            // The axes of an L2's platform are those of the world, and the world is the device's now.
            text.set_rows("b", &geometry.platform_joints_m.each_ref().map(turned));
            turn_along(text, robot, &placed.along);
        }
    })
}

/// The machine in the frame that was asked for.
struct Placed {
    nominal: Nominal,
    covariance: DMatrix<f64>,
    /// Takes a place of that frame to the device's.
    motion: Isometry3<f64>,
    /// Motion from the robot file's frame, with which platform's axes and home move along; none unless the frame is the device's.
    along: Isometry3<f64>,
}

impl Placed {
    fn new(
        options: &CalibrateOptions,
        state: &Nominal,
        moved: l2::InRobotFrame,
        frame: Option<Isometry3<f64>>,
        covariance: &DMatrix<f64>,
    ) -> Self {
        let along = Isometry3::identity();
        match (&options.frame, frame) {
            (FrameOption::Measured, _) => Self {
                nominal: *state,
                covariance: covariance.clone(),
                motion: Isometry3::identity(),
                along: moved.motion,
            },
            (FrameOption::Points(_), Some(motion)) => Self {
                nominal: state.moved(&motion.inverse()),
                covariance: turned_covariance(covariance, &motion.inverse().rotation),
                motion,
                along,
            },
            _ => Self { nominal: moved.nominal, covariance: moved.covariance, motion: moved.motion, along },
        }
    }
}

/// Parallel guideways against free ones, on the places that agree with the latter.
struct Guideways {
    parallel: Calibrated,
    /// Probability of so much more left with parallel guideways, if they are parallel.
    p: f64,
}

impl Guideways {
    fn of(free: &Calibrated, places: &Places<'_>) -> Result<Self, FitError<PredictionError>> {
        let start = with_parallel_guideways(&free.fit.state);
        let used: Vec<usize> = (0..places.poses.len()).filter(|index| !free.outliers.contains(index)).collect();
        let model = Parallel(*places);
        let parallel = fit(start, &model.scales(&start), |state| model.rows(state, &used), Parallel::stepped)?;
        let freed = PARAMETERS - PARALLEL_PARAMETERS;
        let more = (parallel.chi_squared() - free.fit.chi_squared()).max(0.0) / float(freed);
        let p = f_above(more / free.fit.reduced_chi_squared(), freed, free.fit.degrees());
        Ok(Self { parallel: Calibrated { fit: parallel, outliers: free.outliers.clone() }, p })
    }

    /// Says what the measurements want, where it is not what was asked for and does no harm.
    fn remark(&self, asked: GuidewaysOption) -> Option<String> {
        (asked == GuidewaysOption::Free && self.p > LEAST_PARALLEL_P).then(|| {
            format!("parallel guideways would do as well (p = {:.2}): --guideways parallel knows them better", self.p)
        })
    }

    fn doubt(&self, asked: GuidewaysOption) -> Option<String> {
        (asked == GuidewaysOption::Parallel && self.p < LEAST_PARALLEL_P)
            .then(|| format!("the guideways are not parallel (p = {:.1e}): calibrate with --guideways free", self.p))
    }
}

/// Smallest probability at which guideways are taken as parallel.
const LEAST_PARALLEL_P: f64 = 0.01;

/// Says if the platform turns from pose to pose, where the device sees it: then the links of a cluster differ.
fn turned_platform(measured: &Poses<AXES>) -> Option<String> {
    let variance = measured.noise.rotation_rad2?;
    let rotations: Vec<UnitQuaternion<f64>> = measured.poses.iter().filter_map(|pose| pose.rotation).collect();
    let first = rotations.first()?;
    let vectors: Vec<Vector3<f64>> =
        rotations.iter().map(|rotation| (rotation * first.inverse()).scaled_axis()).collect();
    let mean = vectors.iter().sum::<Vector3<f64>>() / float(vectors.len());
    let inverse = variance.try_inverse()?;
    let chi: f64 = vectors.iter().map(|vector| (vector - mean).dot(&(inverse * (vector - mean)))).sum();
    let rms = (vectors.iter().map(|vector| (vector - mean).norm_squared()).sum::<f64>() / float(vectors.len())).sqrt();
    let p = chi_squared_above(chi, 3 * (vectors.len() - 1));
    (p < LEAST_P).then(|| {
        format!(
            "the platform turns by {:.0} urad (rms) from pose to pose, which the links of a cluster do if they differ: the model of 21 parameters is wrong by as much times the lever",
            rms * 1e6
        )
    })
}

/// Residuals of the places that were used: place and rest, m, in the frame of the device.
fn residuals(state: &Nominal, places: &Places<'_>, outliers: &[usize]) -> Vec<[Vector3<f64>; 2]> {
    let Ok(kinematics) = state.kinematics(places.configuration) else { return Vec::new() };
    let used = places.poses.iter().enumerate().filter(|(index, _)| !outliers.contains(index));
    used.filter_map(|(_, pose)| Some([pose.position_m, pose.position_m - kinematics.forward(&pose.q).ok()?])).collect()
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
    match from_file {
        Ok(found) if cost::<Places<'_>>(&found) <= cost::<Places<'_>>(&alone) => Ok(found),
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

fn parallel_names() -> Vec<(String, &'static str)> {
    let arm = |arm: usize| {
        let origin = ["x", "y", "z"].map(|axis| (format!("A_s[{arm}].{axis}"), "m"));
        origin.into_iter().chain([(format!("L[{arm}]"), "m")])
    };
    (0..3).flat_map(arm).chain(["x", "y", "z"].map(|axis| (format!("V.{axis}"), "m"))).collect()
}

fn parallel_values(state: &Nominal) -> DVector<f64> {
    let arms = state.origins_m.iter().zip(state.lengths_m);
    let own = arms.flat_map(|(origin, length)| [origin.x, origin.y, origin.z, length]);
    DVector::from_iterator(PARALLEL_PARAMETERS, own.chain(state.guideways[0].iter().copied()))
}

fn machine(nominal: &Nominal) -> L2Machine {
    L2Machine {
        origins_m: nominal.origins_m.map(Into::into),
        guideways: nominal.guideways.map(Into::into),
        lengths_m: nominal.lengths_m,
    }
}
