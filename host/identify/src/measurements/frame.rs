//! Known points of a robot's base, in the robot's frame and as the device sees them: where the one
//! lies in the other.

use std::path::Path;

use gantry_tau_system::output::Name;
use nalgebra::{Isometry3, Vector3};
use serde::Deserialize;

use super::{FileError, setup};
use crate::fit::frames::{apply, rigid};

/// First line of a file of points.
pub const FORMAT: &str = "gantry-tau frame 1";
/// Largest coordinate, m.
const MAX_COORDINATE_M: f64 = 1e3;
/// Largest distance between a point and where the others predict it, m.
const MAX_OFF_M: f64 = 1e-3;
/// Smallest extent of the points across the line through the farthest two, m.
const MIN_WIDTH_M: f64 = 0.05;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FrameFile {
    format: String,
    point: Vec<PointEntry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PointEntry {
    name: Name,
    robot_m: [f64; 3],
    measured_m: [f64; 3],
}

/// Reads three or more points. Returns the motion that takes a place of the robot's frame to the
/// device's.
///
/// # Errors
/// [`FileError`]: too few points, points on a line, or one that is more than a millimetre from
/// where the others predict it.
pub fn read(path: &Path) -> Result<Isometry3<f64>, FileError> {
    parse(path, &setup::text(path)?)
}

/// As [`read`], of a text; `path` names it.
///
/// # Errors
/// As [`read`].
pub fn parse(path: &Path, text: &str) -> Result<Isometry3<f64>, FileError> {
    let file: FrameFile = setup::parse(path, text)?;
    if file.format != FORMAT {
        let reason = format!("is {:?}; expected {FORMAT:?}", file.format);
        return Err(FileError::key(path, "format", reason));
    }
    for point in &file.point {
        // NaN is not within.
        if !point
            .robot_m
            .iter()
            .chain(&point.measured_m)
            .all(|coordinate| coordinate.abs() <= MAX_COORDINATE_M)
        {
            let key = format!("point.{}", point.name);
            let reason = "is not within a kilometre; it is in metres";
            return Err(FileError::key(path, key, reason));
        }
    }
    let pairs: Vec<(Vector3<f64>, Vector3<f64>)> = file
        .point
        .iter()
        .map(|point| (point.robot_m.into(), point.measured_m.into()))
        .collect();
    let Some(motion) = rigid(&pairs).filter(|_| width_m(&pairs) > MIN_WIDTH_M) else {
        let reason = format!(
            "has {} entries; three that are not on a line are needed",
            pairs.len()
        );
        return Err(FileError::key(path, "point", reason));
    };
    for (point, (from, to)) in file.point.iter().zip(&pairs) {
        let off_m = (to - apply(&motion, from)).norm();
        // NaN is not below.
        let is_near = off_m <= MAX_OFF_M;
        if !is_near {
            let key = format!("point.{}", point.name);
            let reason = format!("is {:.2} mm from where the others predict it", off_m * 1e3);
            return Err(FileError::key(path, key, reason));
        }
    }
    Ok(motion)
}

/// Extent of the points across the line through two of them that are far apart, m.
fn width_m(pairs: &[(Vector3<f64>, Vector3<f64>)]) -> f64 {
    let Some((first, _)) = pairs.first() else {
        return 0.0;
    };
    let levers = pairs.iter().map(|(point, _)| point - first);
    let Some(along) = levers
        .clone()
        .max_by(|one, other| one.norm().total_cmp(&other.norm()))
        .and_then(|farthest| farthest.try_normalize(1e-9))
    else {
        return 0.0;
    };
    levers
        .map(|lever| lever.cross(&along).norm())
        .fold(0.0, f64::max)
}
