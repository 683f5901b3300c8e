//! Plans of poses as files: the text of a set-up, the header of its table.

use std::path::Path;

use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::linalg::rotation_deviation;
use gantry_tau_machine::robot_file::matrix;
use gantry_tau_system::output::Name;
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

use super::{
    FORMAT, FileError, MAX_VALUE, NoiseSection, PoseNoise, PosesFile, QUATERNION, UNIT,
    parse_setup, setup, table,
};

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
        Self {
            name,
            position_m: pose.position_m.into(),
            rotation,
            q: q.to_vec(),
        }
    }

    /// The pose.
    #[must_use]
    pub fn pose(&self) -> Pose {
        Pose {
            position_m: self.position_m.into(),
            rotation: matrix(self.rotation),
        }
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
        toml::to_string(&PosesFile {
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
    pub fn read(path: &Path, model: &str) -> Result<(Self, PoseNoise), FileError> {
        Self::parse(path, &setup::text(path)?, model)
    }

    /// As [`read`](Self::read), of a text; `path` names it.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn parse(path: &Path, text: &str, model: &str) -> Result<(Self, PoseNoise), FileError> {
        let (file, noise) = parse_setup(path, text, model)?;
        if file.pose.is_empty() {
            let reason = "is missing: a plan says in [[pose]] where to measure";
            return Err(FileError::key(path, "pose", reason));
        }
        for (index, pose) in file.pose.iter().enumerate() {
            let before = file.pose.iter().take(index);
            check(pose, before).map_err(|(key, reason)| {
                FileError::key(path, format!("pose.{}.{key}", pose.name), reason)
            })?;
        }
        Ok((
            Self {
                measurements: file.measurements,
                position_um: micro(&noise.position_m2),
                rotation_urad: noise.rotation_rad2.as_ref().map(micro),
                poses: file.pose,
            },
            noise,
        ))
    }
}

/// Checks a pose that comes after others. Error: a key, and what is wrong with it.
fn check<'a>(
    pose: &PlannedPose,
    mut before: impl Iterator<Item = &'a PlannedPose>,
) -> Result<(), (&'static str, &'static str)> {
    if before.any(|other| other.name == pose.name) {
        return Err(("name", "is a duplicate name"));
    }
    if rotation_deviation(&matrix(pose.rotation)) > UNIT {
        return Err(("R", "is not a rotation matrix"));
    }
    if !pose
        .position_m
        .iter()
        .chain(&pose.q)
        .all(|number| number.abs() <= MAX_VALUE)
    {
        return Err((
            "T",
            "is not within a kilometre, or q is not; both are in metres",
        ));
    }
    Ok(())
}

/// Standard deviation of an axis, µm or µrad: root mean square of the three.
fn micro(covariance: &Matrix3<f64>) -> f64 {
    (covariance.trace() / 3.0).sqrt() * 1e6
}
