//! `draw`: a picture of a machine at home: guideways, carts, links, platform and tool, as a wireframe in SVG.

pub(crate) mod figure;
pub(crate) mod scene;
mod svg;

use crate::model::MachineKind;
use crate::output::{Output, WriteError};
use crate::robot_file::{RobotFile, RobotFileError};
use scene::Scene;

/// Options of the picture.
#[derive(Clone, Debug)]
pub struct DrawOptions<K, const N: usize> {
    /// The machine.
    pub robot: RobotFile<K, N>,
    /// Output file.
    pub svg: Output,
    /// Direction from the machine to the viewer about the world's z axis, from +x towards +y, degrees.
    pub azimuth_deg: f64,
    /// The viewer's height above the world's xy plane, degrees.
    pub elevation_deg: f64,
}

/// Failures of [`run`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DrawError {
    /// An option is out of range.
    #[error("{0}")]
    Option(String),
    /// The machine cannot be drawn at its home.
    #[error(transparent)]
    Robot(#[from] RobotFileError),
    /// The picture cannot be written.
    #[error(transparent)]
    File(#[from] WriteError),
}

/// Draws the machine and writes the picture.
///
/// # Errors
/// [`DrawError`].
pub fn run<K: MachineKind<N>, const N: usize>(options: &DrawOptions<K, N>) -> Result<(), DrawError> {
    let (azimuth, elevation) = (options.azimuth_deg, options.elevation_deg);
    if !(-360.0..=360.0).contains(&azimuth) {
        let text = format!("--azimuth is {azimuth}; expected from -360 to 360 degrees");
        return Err(DrawError::Option(text));
    }
    if !(-90.0..=90.0).contains(&elevation) {
        let text = format!("--elevation is {elevation}; expected from -90 to 90 degrees");
        return Err(DrawError::Option(text));
    }
    let picture = picture(&options.robot, azimuth.to_radians(), elevation.to_radians())?;
    options.svg.write(&picture)?;
    Ok(())
}

/// Returns the picture of a machine at home, as an `<svg>` element; angles in rad.
///
/// # Errors
/// [`RobotFileError`] if home cannot be reached.
pub(crate) fn picture<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    azimuth: f64,
    elevation: f64,
) -> Result<String, RobotFileError> {
    Ok(svg::picture(&Scene::at_home(robot)?, azimuth, elevation))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot_file::AnyRobotFile;
    use crate::robot_file::AnyRobotFile::{F1, L2};

    /// The link vectors of the scene have the lengths of the robot file, and every label is apart from every other.
    #[test]
    fn links_have_their_lengths_and_labels_stand_apart() {
        for name in ["l2", "f1"] {
            let (scene, geometry) = match AnyRobotFile::named(name).unwrap() {
                L2(robot) => (Scene::at_home(&robot), robot.model.geometry()),
                F1(robot) => (Scene::at_home(&robot), robot.model.geometry()),
            };
            let (scene, lengths) = (scene.unwrap(), geometry.lengths_m);
            assert_eq!(scene.links.len(), 6);
            for (link, length) in scene.links.iter().zip(lengths) {
                let [cart, platform] = link.ends_m;
                let error = (cart - platform).norm() - length;
                assert!(error.abs() < 1e-9, "{name} {}", link.name);
            }
            for azimuth in [20.0_f64, 60.0, 110.0] {
                let labels = svg::labels(&scene, azimuth.to_radians(), 0.4);
                // 3 guideways, 3 carts, 6 links, platform, tool.
                assert_eq!(labels.len(), 14);
                for (index, label) in labels.iter().enumerate() {
                    for other in labels.iter().skip(index + 1) {
                        assert!(!label.overlaps(other), "{name}: {label:?} {other:?}");
                    }
                }
            }
        }
    }
}
