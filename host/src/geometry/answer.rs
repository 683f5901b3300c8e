//! Answers of a calibration for programs: `"gantry-tau calibrated 1"`. SI units.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use crate::fit::least_squares::Direction;
use crate::fit::statistics::NORMAL_95;

/// First field of an answer.
pub const FORMAT: &str = "gantry-tau calibrated 1";
/// Smallest component of a direction that is named.
const NAMED: f64 = 0.01;

/// One parameter with its interval.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Parameter {
    /// Its name, as in the robot file, with its place: `A_s[0].x`.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Unit of value, deviation and interval.
    pub unit: &'static str,
    /// Standard deviation.
    pub sd: f64,
    /// Lower end of the central 95 % interval.
    pub low95: f64,
    /// Upper end.
    pub high95: f64,
    /// What the measurements say of it.
    pub status: Status,
}

/// What measurements say of a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// Known.
    Identified,
    /// Known to one digit at most.
    Weak,
    /// Not seen: the value of the robot file.
    Kept,
}

/// A combination of parameters that the measurements do not see, or hardly.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Unobservable {
    /// Its standard deviation, in changes that would matter.
    pub relative_sd: f64,
    /// Components of the unit vector, by the names of the parameters; those above 0.01.
    pub direction: BTreeMap<String, f64>,
}

impl Parameter {
    /// Parameters of a fit, in its order.
    #[must_use]
    pub fn list(
        names: &[(String, &'static str)],
        values: &DVector<f64>,
        covariance: &DMatrix<f64>,
        status: impl Fn(usize) -> Status,
    ) -> Vec<Self> {
        let parameter = |(index, (name, unit)): (usize, &(String, &'static str))| {
            let (value, sd) = (values[index], covariance[(index, index)].max(0.0).sqrt());
            let reach = NORMAL_95 * sd;
            let (low95, high95) = (value - reach, value + reach);
            Self { name: name.clone(), value, unit, sd, low95, high95, status: status(index) }
        };
        names.iter().enumerate().map(parameter).collect()
    }
}

impl Unobservable {
    /// Names the components of directions.
    #[must_use]
    pub fn list(names: &[(String, &'static str)], directions: &[Direction]) -> Vec<Self> {
        let named = |direction: &Direction| Self {
            relative_sd: direction.relative_sd,
            direction: (names.iter().zip(&direction.components))
                .filter(|(_, component)| component.abs() > NAMED)
                .map(|((name, _), component)| (name.clone(), *component))
                .collect(),
        };
        directions.iter().map(named).collect()
    }
}

/// A pose that does not agree with the others.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Outlier {
    /// Its name.
    pub pose: String,
}

/// Answer of a calibration; `M` is the machine in one frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Answer<M> {
    /// [`FORMAT`].
    pub format: &'static str,
    /// `l2` or `f1`.
    pub model: &'static str,
    /// The machine in the frame of the device.
    pub measured_frame: M,
    /// The machine in the frame of the robot, and how the two lie.
    pub robot_frame: InRobotFrame<M>,
    /// Parameters in the frame of the device.
    pub parameters: Vec<Parameter>,
    /// Number of combinations of parameters that are seen.
    pub observable: usize,
    /// The others, and those that are seen badly.
    pub unobservable: Vec<Unobservable>,
    /// Expected error of a place over the workspace, root mean square, m.
    pub predicted_rms_m: f64,
    /// Sum of the squares of the residuals, in standard deviations.
    pub chi2: f64,
    /// Degrees of freedom.
    pub dof: usize,
    /// Probability of such a sum, or a larger one, if the model and the noise are right.
    pub p: f64,
    /// Poses that do not agree, and were left out.
    pub outliers: Vec<Outlier>,
}

/// A machine in the frame of the robot. A place `x` of the robot's frame is `rotation x + translation_m` in the device's.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct InRobotFrame<M> {
    /// The machine.
    #[serde(flatten)]
    pub machine: M,
    /// By rows.
    pub rotation: [[f64; 3]; 3],
    /// m.
    pub translation_m: [f64; 3],
    /// The target on the platform, where its orientation was measured.
    #[serde(flatten)]
    pub target: Option<Target>,
}

/// Target on the platform: its centre and axes in those of the platform.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Target {
    /// By rows.
    pub rotation_target: [[f64; 3]; 3],
    /// m.
    pub translation_target_m: [f64; 3],
}

/// An F1 in some frame, with the keys of a robot file.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct F1Machine {
    /// `C`, m.
    #[serde(rename = "C")]
    pub carts_m: [[f64; 3]; 3],
    /// `V`, m per unit of `q`.
    #[serde(rename = "V")]
    pub guideways: [[f64; 3]; 3],
    /// `P`, m.
    #[serde(rename = "P")]
    pub plate_joints_m: [[f64; 3]; 6],
    /// `b`, m.
    #[serde(rename = "b")]
    pub platform_joints_m: [[f64; 3]; 6],
    /// `L`, m.
    #[serde(rename = "L")]
    pub lengths_m: [f64; 6],
    /// `ax`.
    #[serde(rename = "ax")]
    pub turn_axis: [f64; 3],
    /// `ax6`.
    #[serde(rename = "ax6")]
    pub tilt_axis: [f64; 3],
}

/// An L2 in some frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct L2Machine {
    /// Per arm, m.
    #[serde(rename = "A_s")]
    pub origins_m: [[f64; 3]; 3],
    /// Per arm, m per unit of `q`.
    #[serde(rename = "V")]
    pub guideways: [[f64; 3]; 3],
    /// Per arm, m.
    #[serde(rename = "L")]
    pub lengths_m: [f64; 3],
}
