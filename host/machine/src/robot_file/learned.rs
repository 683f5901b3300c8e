//! Sections that measurements have written: what is known of the machine, and how well. The cycle
//! does not read them.

use gantry_tau_core::model::linalg::rotation_deviation;
use serde::{Deserialize, Serialize};

use super::matrix;
use super::problems::Problems;
use crate::model::WristJoint;

/// `[calibrated]`: where the geometry comes from, and how well it is known. The cycle does not read
/// it.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Calibrated {
    /// Name of the table of poses.
    pub measurements: String,
    /// Its CRC-32.
    pub crc: u32,
    /// Number of poses, those left out included.
    pub poses: usize,
    /// Sum of the squares of the residuals, in standard deviations.
    pub chi2: f64,
    /// Degrees of freedom.
    pub dof: usize,
    /// Expected error of a place over the workspace, root mean square, µm.
    pub predicted_rms_um: f64,
    /// Frame that the geometry is in: `nominal`, `measured`, or a file.
    pub frame: String,
    /// Rotation from the robot's frame to the device's, by rows.
    pub rotation: [[f64; 3]; 3],
    /// Origin of the robot's frame in the device's, m.
    pub translation_m: [f64; 3],
    /// Standard deviations of the parameters; SI. L2: arm by arm `A_s` (3), `V` (3), `L`. F1: `C`,
    /// `V`, `P`, `b`, `L`, two turns of `ax`, two of `ax6`.
    pub sd: Vec<f64>,
    /// Their covariance, by rows.
    pub covariance: Vec<Vec<f64>>,
}

/// `[identified]`: where the compliances come from, and how well they are known.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Identified {
    /// Name of the table of forces and gauges.
    pub measurements: String,
    /// Its CRC-32.
    pub crc: u32,
    /// Number of windows.
    pub windows: usize,
    /// Sum of the squares of the residuals, in standard deviations.
    pub chi2: f64,
    /// Degrees of freedom.
    pub dof: usize,
    /// Standard deviations of the compliances: links, axes, joints of the wrist; in the units of
    /// their keys. What the measurements do not see has the one that it had before; without one,
    /// all of its value.
    pub sd: Vec<f64>,
    /// Their covariance, by rows.
    pub covariance: Vec<Vec<f64>>,
    /// Compliances that say what is seen: those of the first robot file. Absent in files of earlier
    /// versions.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub relative_to: Vec<f64>,
}

/// `[play]`: the play of the joint of cluster 3. Compensation does not use it.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Play {
    /// Play of the joint, m.
    pub gap_m: f64,
    /// Its standard deviation, m.
    pub sd_m: f64,
    /// Sum of the tensions of cluster 3 that its weight causes, as rising forces show it: between
    /// these, N.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub preload_rising_n: Option<[f64; 2]>,
    /// As falling forces show it, N. A stroke that has not crossed the jump has no interval.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub preload_falling_n: Option<[f64; 2]>,
}

impl Play {
    /// Ends of the intervals of the preload that were measured, N.
    #[must_use]
    pub fn preload_ends_n(&self) -> Vec<f64> {
        self.preload_rising_n
            .into_iter()
            .chain(self.preload_falling_n)
            .flatten()
            .collect()
    }
}

/// Checks what a file says of its own uncertainty; `springs` are its compliances.
pub(super) fn identified(identified: &Identified, springs: usize, problems: &mut Problems) {
    problems.range("identified.chi2", identified.chi2, 0.0, f64::MAX);
    let relative_to = &identified.relative_to;
    let are_positive = relative_to
        .iter()
        .all(|value| value.is_finite() && *value > 0.0);
    if !relative_to.is_empty() && (relative_to.len() != springs || !are_positive) {
        let reason = format!("must have {springs} entries, all positive");
        problems.add("identified.relative_to", reason);
    }
    let Identified { sd, covariance, .. } = identified;
    spread("identified", sd, covariance, springs, problems);
}

/// Checks where a geometry of so many parameters comes from.
pub(super) fn calibrated(calibrated: &Calibrated, parameters: usize, problems: &mut Problems) {
    let c = calibrated;
    let rms_um = c.predicted_rms_um;
    problems.range("calibrated.chi2", c.chi2, 0.0, f64::MAX);
    problems.range("calibrated.predicted_rms_um", rms_um, 0.0, f64::MAX);
    problems.range(
        "calibrated.rotation (its deviation)",
        rotation_deviation(&matrix(c.rotation)),
        0.0,
        1e-6,
    );
    for (index, value) in c.translation_m.iter().enumerate() {
        let key = format!("calibrated.translation_m[{index}]");
        problems.range(&key, *value, -1e6, 1e6);
    }
    spread("calibrated", &c.sd, &c.covariance, parameters, problems);
}

/// Checks standard deviations and covariance of so many parameters.
fn spread(
    section: &str,
    sd: &[f64],
    covariance: &[Vec<f64>],
    parameters: usize,
    problems: &mut Problems,
) {
    if sd.len() != parameters || !sd.iter().all(|sd| sd.is_finite() && *sd >= 0.0) {
        let reason = format!("must have {parameters} entries, none negative");
        problems.add(format!("{section}.sd"), reason);
    }
    let is_row =
        |row: &Vec<f64>| row.len() == parameters && row.iter().all(|entry| entry.is_finite());
    if covariance.len() != parameters || !covariance.iter().all(is_row) {
        let reason = format!("must have {parameters} rows of {parameters} numbers");
        problems.add(format!("{section}.covariance"), reason);
    }
}

/// Checks a play.
pub(super) fn play(play: &Play, problems: &mut Problems) {
    problems.range("play.gap_m", play.gap_m, 0.0, 1.0);
    problems.range("play.sd_m", play.sd_m, 0.0, f64::MAX);
    for (key, ends) in [
        ("preload_rising_n", play.preload_rising_n),
        ("preload_falling_n", play.preload_falling_n),
    ] {
        for (index, value) in ends.iter().flatten().enumerate() {
            problems.range(&format!("play.{key}[{index}]"), *value, -1e9, 1e9);
        }
    }
    if play.preload_ends_n().is_empty() {
        let reason = "is missing, and preload_falling_n too; give one of them";
        problems.add("play.preload_rising_n", reason);
    }
}

/// Checks the joints of a wrist.
pub(super) fn wrist(joints: &[WristJoint], problems: &mut Problems) {
    if joints.len() > MAX_WRIST_JOINTS {
        problems.add("wrist", format!("has more than {MAX_WRIST_JOINTS} joints"));
    }
    for (index, joint) in joints.iter().enumerate() {
        let length = joint
            .axis
            .iter()
            .map(|component| component * component)
            .sum::<f64>()
            .sqrt();
        let key = format!("wrist[{index}].axis (its length)");
        problems.range(&key, length, 1.0 - 1e-6, 1.0 + 1e-6);
        for (component, value) in joint.point_m.iter().enumerate() {
            let key = format!("wrist[{index}].point_m[{component}]");
            problems.range(&key, *value, -10.0, 10.0);
        }
        let key = format!("wrist[{index}].c_rad_per_nm");
        problems.range(&key, joint.c_rad_per_nm, 0.0, 1.0);
    }
}

/// Largest number of joints of a wrist.
const MAX_WRIST_JOINTS: usize = 3;
