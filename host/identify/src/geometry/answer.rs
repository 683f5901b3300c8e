//! Answers of a calibration for programs: `"gantry-tau calibrated 1"`. SI units.

use gantry_tau_system::output::Name;
use serde::Serialize;

use crate::fit::answer::{FitSummary, Parameter, Unobservable};

/// First field of an answer.
pub const FORMAT: &str = "gantry-tau calibrated 1";

/// A pose that does not agree with the others.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Outlier {
    /// Its name.
    pub pose: Name,
}

/// Answer of a calibration; `M` is the machine in one frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CalibrationAnswer<M> {
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
    /// Its residuals beside the stated noise.
    #[serde(flatten)]
    pub fit: FitSummary,
    /// Poses that do not agree, and were left out.
    pub outliers: Vec<Outlier>,
}

/// A machine in the frame of the robot. A place `x` of the robot's frame is
/// `rotation x + translation_m` in the device's.
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
    pub target: Option<TargetOnPlatform>,
}

/// Target on the platform: its centre and axes in those of the platform.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TargetOnPlatform {
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
