//! Measured poses: what a camera, an arm or a tracker says of a target on the platform.

use std::path::Path;

use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_system::output::Name;
use nalgebra::{DMatrix, Matrix3, Matrix6, Quaternion, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use super::repeated::{self, Column};
use super::table::{self, CsvTable, TableRow};
use super::{FileError, setup};

mod plan;

pub use plan::{PlannedPose, PosesPlan};

/// A pose that a device outside of the robot has measured, in the axes of the device.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredPose<const N: usize> {
    /// Its name in the file.
    pub name: Name,
    /// Positions of the axes, q-units.
    pub q: [f64; N],
    /// Place of the target, m.
    pub position_m: Vector3<f64>,
    /// Orientation of the target, where the device sees it.
    pub rotation: Option<UnitQuaternion<f64>>,
}

impl<const N: usize> MeasuredPose<N> {
    /// The pose, where the orientation was measured.
    #[must_use]
    pub fn pose(&self) -> Option<Pose> {
        let rotation = self.rotation?.to_rotation_matrix().into_inner();
        Some(Pose {
            position_m: self.position_m,
            rotation,
        })
    }
}

/// First line of a set-up.
pub const FORMAT: &str = "gantry-tau poses 1";
/// Largest position of an axis, q-units, and of a target, m.
const MAX_VALUE: f64 = 1e3;
/// Largest deviation of a quaternion from unit length: four digits of each part are usual.
const UNIT: f64 = 2e-4;
/// Range of a standard deviation, µm or µrad.
const NOISE: (f64, f64) = (1e-6, 1e6);

/// `format = "gantry-tau poses 1"`.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct PosesFile {
    format: String,
    model: String,
    measurements: String,
    noise: NoiseSection,
    /// Of a plan.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pose: Vec<PlannedPose>,
}

/// `[noise]`: of one measured pose, in the axes of the device.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct NoiseSection {
    position_um: Option<[f64; 3]>,
    rotation_urad: Option<[f64; 3]>,
    covariance: Option<Vec<Vec<f64>>>,
}

/// Covariance of a measured pose, in the axes of the device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseNoise {
    /// Of the place, m^2.
    pub position_m2: Matrix3<f64>,
    /// Of the rotation vector, rad^2, where orientations are measured.
    pub rotation_rad2: Option<Matrix3<f64>>,
    /// Between place (rows) and rotation vector (columns), m rad; zero where neither is said to
    /// depend on the other.
    pub cross_m_rad: Matrix3<f64>,
}

impl PoseNoise {
    /// Noise of places and rotations that do not depend on each other.
    #[must_use]
    pub fn independent(position_m2: Matrix3<f64>, rotation_rad2: Option<Matrix3<f64>>) -> Self {
        Self {
            position_m2,
            rotation_rad2,
            cross_m_rad: Matrix3::zeros(),
        }
    }

    /// Covariance of place and rotation vector; `rotation_rad2` stands for that of a rotation
    /// vector which is not stated.
    #[must_use]
    pub fn covariance(&self, rotation_rad2: &Matrix3<f64>) -> Matrix6<f64> {
        let mut covariance = Matrix6::zeros();
        covariance
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&self.position_m2);
        covariance
            .fixed_view_mut::<3, 3>(3, 3)
            .copy_from(self.rotation_rad2.as_ref().unwrap_or(rotation_rad2));
        covariance
            .fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&self.cross_m_rad);
        covariance
            .fixed_view_mut::<3, 3>(3, 0)
            .copy_from(&self.cross_m_rad.transpose());
        covariance
    }
}

/// Poses and their noise.
#[derive(Clone, Debug, PartialEq)]
pub struct Poses<const N: usize> {
    /// `model` of the set-up.
    pub model: String,
    /// Path of the table, as messages name it.
    pub table: String,
    /// CRC-32 of the table.
    pub crc: u32,
    /// Noise of one pose.
    pub noise: PoseNoise,
    /// The poses.
    pub poses: Vec<MeasuredPose<N>>,
}

/// Parses a set-up without its table.
fn parse_setup(path: &Path, text: &str, model: &str) -> Result<(PosesFile, PoseNoise), FileError> {
    let file: PosesFile = setup::parse(path, text)?;
    if file.format != FORMAT {
        let reason = format!("is {:?}; expected {FORMAT:?}", file.format);
        return Err(FileError::key(path, "format", reason));
    }
    if file.model != model {
        let reason = format!("is {:?}, and the robot file's is {model:?}", file.model);
        return Err(FileError::key(path, "model", reason));
    }
    let noise = noise(&file.noise).map_err(|(key, reason)| FileError::key(path, key, reason))?;
    Ok((file, noise))
}

/// Reads a set-up and its table, for a machine of `model` with `N` axes.
///
/// # Errors
/// [`FileError`].
pub fn read<const N: usize>(path: &Path, model: &str) -> Result<Poses<N>, FileError> {
    let setup = parse_setup(path, &setup::text(path)?, model)?;
    let bytes = table::bytes(&setup::beside(path, &setup.0.measurements))?;
    measured(path, setup, &bytes)
}

/// As [`read`], of the text of a set-up, which `path` names, and the bytes of its table.
///
/// # Errors
/// [`FileError`].
pub fn parse<const N: usize>(
    path: &Path,
    text: &str,
    model: &str,
    table: &[u8],
) -> Result<Poses<N>, FileError> {
    measured(path, parse_setup(path, text, model)?, table)
}

fn measured<const N: usize>(
    path: &Path,
    (file, noise): (PosesFile, PoseNoise),
    bytes: &[u8],
) -> Result<Poses<N>, FileError> {
    let table = setup::beside(path, &file.measurements);
    let (lines, poses): (Vec<u64>, Vec<MeasuredPose<N>>) = rows(&table, bytes)?.into_iter().unzip();
    let table = table.display().to_string();
    let columns = columns(&noise, &poses);
    repeated::check(&table, &lines, "pose", &columns)?;
    repeated::check_still(&table, &lines, repeated::OTHERS, columns.iter())?;
    Ok(Poses {
        model: file.model,
        table,
        crc: crc32fast::hash(bytes),
        noise,
        poses,
    })
}

type RefusedKey = (&'static str, String);

fn noise(section: &NoiseSection) -> Result<PoseNoise, RefusedKey> {
    if let Some(given) = &section.covariance {
        return noise_of_covariance(given);
    }
    let position_um = section
        .position_um
        .ok_or(("noise.position_um", "is missing".to_owned()))?;
    let rotation = section
        .rotation_urad
        .map(|urad| squares("noise.rotation_urad", &urad))
        .transpose()?;
    Ok(PoseNoise::independent(
        squares("noise.position_um", &position_um)?,
        rotation,
    ))
}

/// Squares of standard deviations, µm or µrad, on a diagonal.
fn squares(key: &'static str, deviations: &[f64; 3]) -> Result<Matrix3<f64>, RefusedKey> {
    let (least, most) = NOISE;
    match deviations
        .iter()
        .find(|value| !(least..=most).contains(*value))
    {
        Some(wrong) => Err((key, format!("{wrong} is not from {least:e} to {most:e}"))),
        None => Ok(Matrix3::from_diagonal(&Vector3::from(
            deviations.map(|value| (value * 1e-6).powi(2)),
        ))),
    }
}

fn noise_of_covariance(given: &[Vec<f64>]) -> Result<PoseNoise, RefusedKey> {
    let key = "noise.covariance";
    let size = given.len();
    if (size != 3 && size != 6) || given.iter().any(|row| row.len() != size) {
        return Err((
            key,
            "must be 3 x 3 (places, m^2) or 6 x 6 (and rotations, rad^2)".to_owned(),
        ));
    }
    let whole = DMatrix::from_row_iterator(size, size, given.iter().flatten().copied());
    let mut blocks = (0..size)
        .step_by(3)
        .map(|first| whole.view((first, first), (3, 3)).into_owned());
    if !is_covariance(&whole) || !blocks.all(|block| is_covariance(&block)) {
        return Err((key, "is not symmetric and positive definite".to_owned()));
    }
    let (least, most) = NOISE;
    if let Some(wrong) = whole
        .diagonal()
        .iter()
        .map(|variance| variance.sqrt() * 1e6)
        .find(|sd| !(least..=most).contains(sd))
    {
        let reason = format!(
            "has a standard deviation of {wrong} um or urad; {least:e} to {most:e} are possible"
        );
        return Err((key, reason));
    }
    let places = whole.fixed_view::<3, 3>(0, 0).into_owned();
    if size == 3 {
        return Ok(PoseNoise::independent(places, None));
    }
    let rotations = whole.fixed_view::<3, 3>(3, 3).into_owned();
    Ok(PoseNoise {
        cross_m_rad: whole.fixed_view::<3, 3>(0, 3).into_owned(),
        ..PoseNoise::independent(places, Some(rotations))
    })
}

/// True for a symmetric, positive definite matrix of finite numbers.
fn is_covariance(matrix: &DMatrix<f64>) -> bool {
    // `amax` passes over NaN.
    matrix.iter().all(|entry| entry.is_finite())
        && (matrix - matrix.transpose()).amax() <= 1e-9 * matrix.amax()
        && matrix.clone().cholesky().is_some()
}

/// Columns of places.
fn columns<const N: usize>(noise: &PoseNoise, poses: &[MeasuredPose<N>]) -> Vec<Column> {
    let variances = noise.position_m2.diagonal();
    PLACE
        .into_iter()
        .zip(&variances)
        .enumerate()
        .map(|(axis, (name, variance))| Column {
            name: name.to_owned(),
            sd: Some(variance.sqrt()),
            values: poses
                .iter()
                .map(|pose| pose.position_m.get(axis).copied())
                .collect(),
        })
        .collect()
}

/// Poses, with their lines.
fn rows<const N: usize>(
    path: &Path,
    bytes: &[u8],
) -> Result<Vec<(u64, MeasuredPose<N>)>, FileError> {
    let axes: [String; N] = std::array::from_fn(|axis| format!("q_{}", axis + 1));
    let mut required = vec!["pose".to_owned()];
    required.extend(
        PLACE
            .map(str::to_owned)
            .into_iter()
            .chain(axes.iter().cloned()),
    );
    let table = CsvTable::begin(path, bytes, &required, |column| {
        QUATERNION.contains(&column)
    })?;
    let turned = QUATERNION.map(|column| table.has(column));
    if turned != [turned[0]; 4] {
        return Err(FileError::at(
            &path.display().to_string(),
            1,
            "rot_w",
            "a quaternion has four columns: rot_w, rot_x, rot_y, rot_z",
        ));
    }
    let mut names = std::collections::HashSet::new();
    table.rows(|row| {
        let name = row.name("pose")?;
        if !names.insert(name.clone()) {
            return Err(row.error("pose", format_args!("duplicate name {name:?}")));
        }
        let mut q = [0.0; N];
        for (q, column) in q.iter_mut().zip(&axes) {
            *q = row.number(column, MAX_VALUE)?;
        }
        let mut position_m = Vector3::zeros();
        for (coordinate, column) in position_m.iter_mut().zip(PLACE) {
            *coordinate = row.number(column, MAX_VALUE)?;
        }
        let rotation = if turned[0] {
            Some(rotation(row)?)
        } else {
            None
        };
        Ok((
            row.line(),
            MeasuredPose {
                name,
                q,
                position_m,
                rotation,
            },
        ))
    })
}

const PLACE: [&str; 3] = ["x_m", "y_m", "z_m"];
const QUATERNION: [&str; 4] = ["rot_w", "rot_x", "rot_y", "rot_z"];

fn rotation(row: &TableRow<'_>) -> Result<UnitQuaternion<f64>, FileError> {
    let mut parts = [0.0; 4];
    for (part, column) in parts.iter_mut().zip(QUATERNION) {
        *part = row.number(column, 1.0 + UNIT)?;
    }
    let [w, x, y, z] = parts;
    let quaternion = Quaternion::new(w, x, y, z);
    if (quaternion.norm() - 1.0).abs() > UNIT {
        return Err(row.error(
            "rot_w",
            format_args!("the quaternion has length {}, not 1", quaternion.norm()),
        ));
    }
    Ok(UnitQuaternion::new_normalize(quaternion))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The noise of a covariance with this diagonal, and this entry beside it in both halves.
    fn of_covariance(diagonal: &[f64], beside: f64) -> Result<PoseNoise, String> {
        let size = diagonal.len();
        let covariance = DMatrix::from_fn(size, size, |row, column| match row.abs_diff(column) {
            0 => diagonal[row],
            1 => beside,
            _ => 0.0,
        });
        let covariance = covariance
            .row_iter()
            .map(|row| row.iter().copied().collect())
            .collect();
        let section = NoiseSection {
            position_um: None,
            rotation_urad: None,
            covariance: Some(covariance),
        };
        noise(&section).map_err(|(key, reason)| format!("{key}: {reason}"))
    }

    #[test]
    fn a_covariance_is_one_of_places_or_of_places_and_rotations() {
        let places = of_covariance(&[1e-10, 2e-10, 3e-10], 0.5e-10).unwrap();
        assert_eq!(
            (
                places.position_m2[(2, 2)],
                places.position_m2[(0, 1)],
                places.rotation_rad2
            ),
            (3e-10, 0.5e-10, None)
        );
        let both = of_covariance(&[1e-10, 2e-10, 3e-10, 4e-10, 5e-10, 6e-10], 0.5e-10).unwrap();
        let rotation = both.rotation_rad2.unwrap();
        assert_eq!(
            (both.position_m2[(2, 2)], rotation[(0, 0)], rotation[(2, 2)]),
            (3e-10, 4e-10, 6e-10)
        );
        assert_eq!(
            (both.cross_m_rad[(2, 0)], both.cross_m_rad[(0, 0)]),
            (0.5e-10, 0.0)
        );
        for size in [1, 2, 4, 5, 7] {
            let refused = of_covariance(&vec![1e-10; size], 0.0).unwrap_err();
            assert!(
                refused.starts_with("noise.covariance: must be 3 x 3 (places, m^2) or 6 x 6"),
                "{refused}"
            );
        }
        let indefinite = of_covariance(&[1e-10, 1e-10, 1e-10], 2e-10).unwrap_err();
        assert_eq!(
            indefinite,
            "noise.covariance: is not symmetric and positive definite"
        );
        let [lopsided, endless] = [2e-10, f64::NAN].map(|entry| {
            let covariance = vec![
                vec![1e-10, entry, 0.0],
                vec![0.0, 1e-10, 0.0],
                vec![0.0, 0.0, 1e-10],
            ];
            noise(&NoiseSection {
                position_um: None,
                rotation_urad: None,
                covariance: Some(covariance),
            })
            .is_err()
        });
        assert!(lopsided && endless);
        // Places and rotations follow each other more than either scatters.
        let [mut bound, mut turned] = [[1e-10, 1e-18]; 2].map(|[place, rotation]| {
            let mut covariance = vec![vec![0.0; 6]; 6];
            for (index, row) in covariance.iter_mut().enumerate() {
                row[index] = if index < 3 { place } else { rotation };
            }
            covariance
        });
        bound[0][3] = 2e-14;
        bound[3][0] = 2e-14;
        // Nothing beside the largest entry.
        turned[3][4] = 1e-20;
        for covariance in [bound, turned] {
            let section = NoiseSection {
                position_um: None,
                rotation_urad: None,
                covariance: Some(covariance),
            };
            assert!(noise(&section).is_err(), "{section:?}");
        }
        let wide = of_covariance(&[1e-10, 1e-10, 1.1], 0.0).unwrap_err();
        assert!(
            wide.contains("has a standard deviation of 1048808"),
            "{wide}"
        );
    }
}
