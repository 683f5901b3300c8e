//! Plans of poses as files: the text of a set-up, the header of its table.

use std::path::Path;

use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::linalg::rotation_deviation;
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

use super::{FORMAT, FileError, MOST, Noise, NoiseSection, QUATERNION, SetupFile, UNIT, parse_setup, setup, table};
use crate::output::Name;
use crate::robot_file::matrix;

/// `[[pose]]` of a plan: where the machine is to stand.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PlannedPose {
    /// Its name.
    pub name: Name,
    /// Place of the tool centre point, world axes, m.
    #[serde(rename = "T")]
    pub position_m: [f64; 3],
    /// Orientation of the platform, by rows.
    #[serde(rename = "R")]
    pub rotation: [[f64; 3]; 3],
    /// Positions of the axes, q-units.
    pub q: Vec<f64>,
}

impl PlannedPose {
    /// A pose of the machine with the axes at `q`.
    #[must_use]
    pub fn new(name: Name, pose: &Pose, q: &[f64]) -> Self {
        let rotation = pose.rotation.transpose().into();
        Self { name, position_m: pose.position_m.into(), rotation, q: q.to_vec() }
    }

    /// The pose.
    #[must_use]
    pub fn pose(&self) -> Pose {
        Pose { position_m: self.position_m.into(), rotation: matrix(self.rotation) }
    }
}

/// A plan of poses.
#[derive(Clone, Debug, PartialEq)]
pub struct PosesPlan {
    /// Table of the measurements, as the set-up names it.
    pub measurements: String,
    /// Noise of one pose: of the place, each axis, µm.
    pub position_um: f64,
    /// Of the rotation vector, each axis, µrad, where orientations are measured.
    pub rotation_urad: Option<f64>,
    /// The poses.
    pub poses: Vec<PlannedPose>,
}

impl PosesPlan {
    /// Returns the text of the set-up of a machine of `model`.
    ///
    /// # Errors
    /// Of TOML, for numbers that it cannot write.
    pub fn text(&self, model: &str) -> Result<String, toml::ser::Error> {
        let noise = NoiseSection {
            position_um: Some([self.position_um; 3]),
            rotation_urad: self.rotation_urad.map(|urad| [urad; 3]),
            covariance: None,
        };
        toml::to_string(&SetupFile {
            format: FORMAT.to_owned(),
            model: model.to_owned(),
            measurements: self.measurements.clone(),
            noise,
            pose: self.poses.clone(),
        })
    }

    /// Returns the header of the table of a machine with `N` axes.
    #[must_use]
    pub fn header<const N: usize>(&self) -> String {
        let mut columns = vec!["pose".to_owned()];
        columns.extend((1..=N).map(|axis| format!("q_{axis}")));
        columns.extend(["x_m", "y_m", "z_m"].map(str::to_owned));
        if self.rotation_urad.is_some() {
            columns.extend(QUATERNION.map(str::to_owned));
        }
        table::row(&columns)
    }

    /// Reads a plan for a machine of `model`, and its noise, without its table.
    ///
    /// # Errors
    /// [`FileError`] that names pose and key.
    pub fn read(path: &Path, model: &str) -> Result<(Self, Noise), FileError> {
        Self::parse(path, &setup::text(path)?, model)
    }

    /// As [`read`](Self::read), of a text; `path` names it.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn parse(path: &Path, text: &str, model: &str) -> Result<(Self, Noise), FileError> {
        let (file, noise) = parse_setup(path, text, model)?;
        let refused = |key: String, reason: &str| FileError::key(path, key, reason);
        if file.pose.is_empty() {
            return Err(refused("pose".to_owned(), "is missing: a plan says in [[pose]] where to measure"));
        }
        for (index, pose) in file.pose.iter().enumerate() {
            let key = |name: &str| format!("pose.{}.{name}", pose.name);
            if file.pose.iter().take(index).any(|other| other.name == pose.name) {
                return Err(refused(key("name"), "stands twice"));
            }
            if rotation_deviation(&matrix(pose.rotation)) > UNIT {
                return Err(refused(key("R"), "is not a rotation matrix"));
            }
            if !pose.position_m.iter().chain(&pose.q).all(|number| number.abs() <= MOST) {
                return Err(refused(key("T"), "is not within a kilometre, or q is not; both are in metres"));
            }
        }
        let micro = |covariance: &Matrix3<f64>| (covariance.trace() / 3.0).sqrt() * 1e6;
        let (position_um, rotation_urad) = (micro(&noise.position_m2), noise.rotation_rad2.as_ref().map(micro));
        Ok((Self { measurements: file.measurements, position_um, rotation_urad, poses: file.pose }, noise))
    }
}
