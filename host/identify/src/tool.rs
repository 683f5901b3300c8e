//! `identify` of the tool: weight, centre of gravity and the sensor's bias from readings in turned
//! poses `[T 4.2.5]`.
#![expect(
    clippy::indexing_slicing,
    reason = "three and six components are counted by the arrays themselves"
)]

pub mod fit;
mod mistakes;
#[cfg(test)]
mod tests;

use std::convert::Infallible;
use std::path::PathBuf;

use gantry_tau_core::model::kinematics::KinematicsError;
use gantry_tau_core::model::sensor::Tool;
use gantry_tau_machine::model::{MachineKind, pose_at};
use gantry_tau_machine::robot_file::edit::RobotText;
use gantry_tau_machine::robot_file::{AnyRobotFile, RobotFile, RobotFileError, text_of};
use gantry_tau_machine::sensor::Mounting;
use nalgebra::{Matrix3, Vector3};
use serde::Serialize;

use crate::fit::answer::{FitSummary, Parameter, Unobservable};
use crate::fit::goodness;
use crate::fit::least_squares::{FitError, Observability};
use crate::fit::statistics::chi_squared_above;
use crate::measurements::FileError;
use crate::measurements::springs::LOAD;
use crate::measurements::tool::{self, ToolReadings};
use fit::{FittedTool, TOOL, Turned, fit_tool};

/// First field of an answer.
pub const FORMAT: &str = "gantry-tau tool identified 1";
/// Standard deviations by which a weight points upwards for sure.
const SURE_SD: f64 = 3.0;

/// Largest angle between the weight and the robot file's that a good mounting of the sensor leaves,
/// rad.
const MAX_TILT_RAD: f64 = 0.07;

/// Options of an identification.
#[derive(Clone, Debug)]
pub struct ToolOptions {
    /// Set-up of the measurements.
    pub setup: PathBuf,
    /// Name of the robot file to begin with, as of [`AnyRobotFile::named`].
    pub robot: String,
}

/// Reason why an identification fails.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ToolError {
    /// A file of measurements is wrong.
    #[error(transparent)]
    File(#[from] FileError),
    /// The robot file is wrong.
    #[error(transparent)]
    Robot(#[from] RobotFileError),
    /// One reading cannot be compared with anything.
    #[error(
        "{table}: has one reading; two are needed, and an F1 needs three or more, turned about two axes"
    )]
    TooFew {
        /// The table.
        table: String,
    },
    /// The fit fails.
    #[error("{table}: {reason}")]
    Fit {
        /// The table.
        table: String,
        /// Reason.
        reason: FitError<Infallible>,
    },
    /// The robot file cannot be changed.
    #[error("the robot file cannot be changed: {0}")]
    Edit(String),
}

/// Result of an identification.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IdentifiedTool {
    /// The answer for programs, JSON: an [`ToolAnswer`].
    pub json: String,
    /// Text of the robot file with `[sensor.tool]` replaced; as it was where the readings see
    /// nothing of the tool.
    pub robot_file: String,
    /// Result in one line.
    pub summary: String,
    /// Reasons not to trust it as it is; empty where there are none.
    pub doubts: Vec<String>,
}

/// Answer of an identification. SI units.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ToolAnswer {
    /// [`FORMAT`].
    pub format: &'static str,
    /// `l2` or `f1`.
    pub model: &'static str,
    /// `weight_n`, world axes; `centre_m`, platform axes, from the tool centre point;
    /// `bias_force_n`, `bias_moment_nm`, sensor axes, about the sensor's origin.
    pub parameters: Vec<Parameter>,
    /// Covariance of the parameters, by rows, with the lost directions of the tool as the file has
    /// them.
    pub covariance: Vec<Vec<f64>>,
    /// Its residuals beside the stated noise.
    #[serde(flatten)]
    pub fit: FitSummary,
    /// Combinations of weight and centre that cannot be distinguished from a bias (`relative_sd`
    /// above 1, null where infinite), or hardly (above 0.1).
    pub unobservable: Vec<Unobservable>,
}

/// Identifies the tool of a machine.
///
/// # Errors
/// [`ToolError`].
pub fn identify(robot: &AnyRobotFile, options: &ToolOptions) -> Result<IdentifiedTool, ToolError> {
    match robot {
        AnyRobotFile::L2(robot) => identify_with(robot, options, |q| {
            let position_m = robot.model.forward(q)?;
            Ok(robot.model.pose(position_m).rotation)
        }),
        AnyRobotFile::F1(robot) => identify_with(robot, options, |q| {
            let pose = pose_at(&robot.model, &robot.home_m(), q)?;
            Ok(pose.rotation)
        }),
    }
}

/// As [`identify`], with the rotation of the platform for positions of the axes.
fn identify_with<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    options: &ToolOptions,
    rotation: impl Fn(&[f64; N]) -> Result<Matrix3<f64>, KinematicsError>,
) -> Result<IdentifiedTool, ToolError> {
    let measured: ToolReadings<N> = tool::read(&options.setup, K::MODEL)?;
    let readings = measured.readings.iter().map(|reading| {
        let rotation =
            rotation(&reading.q).map_err(|error| out_of_reach(&measured, reading, error))?;
        Ok::<_, FileError>(Turned {
            rotation,
            raw: reading.raw,
        })
    });
    let readings = readings.collect::<Result<Vec<_>, _>>()?;
    let mounting = Mounting::from(&robot.sensor);
    let start: Tool = robot.sensor.tool.into();
    let fitted = fit_tool(&mounting, &readings, measured.noise, start);
    let problem = mistakes::ToolProblem {
        measured: &measured,
        mounting: &mounting,
        readings: &readings,
        start,
    };
    let unlike = problem.check(fitted.as_ref().ok())?;
    let fitted = fitted.map_err(|reason| match reason {
        FitError::TooFew { .. } => ToolError::TooFew {
            table: measured.table.clone(),
        },
        reason => ToolError::Fit {
            table: measured.table.clone(),
            reason,
        },
    })?;
    check_gravity(&measured, &fitted, &start.weight_n)?;
    let answer = answer(&fitted, K::MODEL);
    Ok(IdentifiedTool {
        json: serde_json::to_string_pretty(&answer)
            .map_err(|error| ToolError::Edit(error.to_string()))?,
        robot_file: robot_file(&fitted, &measured, &options.robot)?,
        summary: summary(&fitted, &answer),
        doubts: [
            doubts(&fitted, &answer, &mounting, &start),
            unlike.into_iter().collect(),
        ]
        .concat(),
    })
}

/// Error about the axes of a reading: the column of the axis that is out of its travel, if it is
/// one.
fn out_of_reach<const N: usize>(
    measured: &ToolReadings<N>,
    reading: &tool::ToolReading<N>,
    error: KinematicsError,
) -> FileError {
    match error {
        KinematicsError::OutOfRange { axis, q, lower, upper } => measured.error(
            reading,
            &format!("q_{}", axis + 1),
            format_args!("is {q:.4}, outside of the axis' travel, {lower:.4} to {upper:.4}; q is in the robot file's q-units: metres, radians, or turns by metres_per_q"),
        ),
        error => measured.error(reading, "q_1", format_args!("the machine does not reach these axes: {error}")),
    }
}

/// True if a tool pulls against the robot file's, or upwards where the file has none, for sure.
fn pulls_upwards(fitted: &FittedTool, file_n: &Vector3<f64>) -> bool {
    let down = file_n.try_normalize(0.0).unwrap_or_else(|| -Vector3::z());
    let sd = down
        .dot(&(fitted.covariance.fixed_view::<3, 3>(0, 0) * down))
        .max(0.0)
        .sqrt();
    down.dot(&fitted.tool.weight_n) < -SURE_SD * sd
}

/// Refuses a tool that pulls upwards: readings of what the sensor exerts.
fn check_gravity<const N: usize>(
    measured: &ToolReadings<N>,
    fitted: &FittedTool,
    file_n: &Vector3<f64>,
) -> Result<(), FileError> {
    let weight_n = &fitted.tool.weight_n;
    match measured.readings.first().filter(|_| pulls_upwards(fitted, file_n)) {
        None => Ok(()),
        Some(first) => Err(measured.error(first, LOAD[0], format_args!(
            "the tool would pull upwards, ({:.1}, {:.1}, {:.1}) N: these are forces and moments that the sensor exerts, not those on it; negate all six columns (or turn weight_n of the robot file, if that points upwards)",
            weight_n.x, weight_n.y, weight_n.z
        ))),
    }
}

/// Names and units of the parameters.
fn names() -> Vec<(String, &'static str)> {
    let vectors = [
        ("weight_n", "N"),
        ("centre_m", "m"),
        ("bias_force_n", "N"),
        ("bias_moment_nm", "N m"),
    ];
    let components = vectors
        .into_iter()
        .flat_map(|(name, unit)| (0..3).map(move |axis| (name, axis, unit)));
    components
        .map(|(name, axis, unit)| (format!("{name}[{axis}]"), unit))
        .collect()
}

fn answer(fitted: &FittedTool, model: &'static str) -> ToolAnswer {
    let fit = &fitted.fit;
    let names = names();
    let seen = Observability::new(&fit.rows, fit.seen.scales());
    let unobservable = [seen.lost(), seen.weak()].concat();
    ToolAnswer {
        format: FORMAT,
        model,
        parameters: Parameter::list(&names, &fitted.values(), &fitted.covariance, |index| {
            fitted.status(index)
        }),
        covariance: fitted
            .covariance
            .row_iter()
            .map(|row| row.iter().copied().collect())
            .collect(),
        fit: FitSummary::new(fit.chi_squared(), fit.degrees()),
        unobservable: Unobservable::list(&names[..TOOL], &unobservable),
    }
}

fn summary(fitted: &FittedTool, answer: &ToolAnswer) -> String {
    format!(
        "{} of {TOOL} parameters of the tool seen; weight ({}) N, centre of gravity ({}) m; chi2 {:.1} with {} degrees of freedom, p {:.2}",
        fitted.fit.seen.kept(),
        list(&answer.parameters[..3], 2),
        list(&answer.parameters[3..TOOL], 4),
        answer.fit.chi2,
        answer.fit.dof,
        answer.fit.p,
    )
}

/// Values of parameters, with half the length of their intervals.
fn list(parameters: &[Parameter], digits: usize) -> String {
    let values = parameters.iter().map(|one| match one.high95 {
        None => format!("{:.digits$} kept", one.value),
        Some(high) => format!("{:.digits$} +- {:.digits$}", one.value, high - one.value),
    });
    values.collect::<Vec<_>>().join(", ")
}

fn doubts(
    fitted: &FittedTool,
    answer: &ToolAnswer,
    mounting: &Mounting,
    file: &Tool,
) -> Vec<String> {
    let mut doubts = Vec::new();
    doubts.extend(goodness::too_large(answer.fit.chi2, answer.fit.dof));
    doubts
        .extend(too_quiet(fitted).or_else(|| goodness::too_small(answer.fit.chi2, answer.fit.dof)));
    let seen = Observability::new(&fitted.fit.rows, fitted.fit.seen.scales());
    let lost = Unobservable::list(&names()[..TOOL], &seen.lost());
    if fitted.fit.held.count() > 0 {
        let lost = lost
            .iter()
            .map(Unobservable::to_string)
            .collect::<Vec<_>>()
            .join("; ");
        doubts.push(format!(
            "not told from the bias in these poses, kept at the file's values: {lost}"
        ));
    }
    // A tool that does not explain the readings needs no further look.
    if doubts.is_empty() {
        doubts.extend(unlikely(fitted, mounting, file));
    }
    doubts
}

/// Says what is unlikely of a tool that explains the readings: channels that show nothing explain
/// themselves, and so does a sensor that is mounted otherwise.
fn unlikely(fitted: &FittedTool, mounting: &Mounting, file: &Tool) -> Vec<String> {
    let Tool { weight_n, centre_m } = fitted.tool;
    let mut unlikely = Vec::new();
    if !is_shown(fitted, 0, &weight_n) {
        unlikely.push(
            "the forces show no weight, and a centre of gravity is one of a weight: look at the channels of the forces"
                .to_owned(),
        );
    } else if !is_shown(fitted, 3, &(centre_m - mounting.lever_m)) {
        unlikely.push(
            "the moments change by no more than their noise, as if the centre of gravity were at the sensor's origin: look at the channels of the moments"
                .to_owned(),
        );
    }
    // Zero where the file has no tool.
    let off_rad = weight_n.angle(&file.weight_n);
    if off_rad > MAX_TILT_RAD && is_shown(fitted, 0, &across(&weight_n, &file.weight_n)) {
        unlikely.push(format!(
            "the weight is {:.0} degrees off the direction that the robot file has: look at [sensor] rotation, and at how the sensor is mounted",
            off_rad.to_degrees()
        ));
    }
    unlikely
}

/// True if three parameters, from `first` on, differ from zero by this value for sure.
fn is_shown(fitted: &FittedTool, first: usize, value: &Vector3<f64>) -> bool {
    let covariance = fitted
        .covariance
        .fixed_view::<3, 3>(first, first)
        .into_owned();
    let solved = covariance.cholesky().map(|factor| factor.solve(value));
    solved.is_none_or(|solved| chi_squared_above(value.dot(&solved), 3) < goodness::MIN_P)
}

/// Part of a vector across another one.
fn across(vector: &Vector3<f64>, other: &Vector3<f64>) -> Vector3<f64> {
    vector - other * (vector.dot(other) / other.norm_squared())
}

/// Says which half of the columns has less noise than is stated: it is in a larger unit.
fn too_quiet(fitted: &FittedTool) -> Option<String> {
    match fitted
        .parts()
        .into_iter()
        .zip(["forces", "moments"])
        .filter_map(|((chi2, dof), columns)| {
            Some(format!("{columns}: {}", goodness::too_small(chi2, dof)?))
        })
        .collect::<Vec<_>>()
        .as_slice()
    {
        [said] => Some(said.clone()),
        _ => None,
    }
}

/// Returns the text of the robot file with the tool that was found.
fn robot_file<const N: usize>(
    fitted: &FittedTool,
    measured: &ToolReadings<N>,
    robot: &str,
) -> Result<String, ToolError> {
    let text = text_of(robot)?;
    let part = match fitted.fit.seen.kept() {
        0 => return Ok(text),
        TOOL => "",
        _ => " in part",
    };
    let provenance = format!(
        "IDENTIFIED{part} with {} (CRC-32 {:08x})",
        measured.table, measured.crc
    );
    let mut text =
        RobotText::new(&text, &provenance).map_err(|error| ToolError::Edit(error.to_string()))?;
    let [weight_n, centre_m]: [[f64; 3]; 2] =
        [fitted.tool.weight_n.into(), fitted.tool.centre_m.into()];
    text.set_table_in(
        "sensor",
        "tool",
        &[("weight_n", &weight_n), ("centre_m", &centre_m)],
    );
    Ok(text.text())
}
