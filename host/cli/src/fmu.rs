//! Functional mock-up units as files: description, library and robot file in a zip archive.

mod archive;
mod description;
pub mod library;

use gantry_tau_fmi::instance::{CallRefused, Instance};
use gantry_tau_fmi::kind::Kind;
use gantry_tau_machine::robot_file::{AnyRobotFile, RobotFileError};

use archive::archive;
use description::description;
use library::{Library, LibraryError};

/// Reason why no unit is made.
#[derive(Debug, thiserror::Error)]
pub enum FmuError {
    /// The robot file cannot be used.
    #[error(transparent)]
    Robot(#[from] RobotFileError),
    /// The robot file gives no unit of this kind.
    #[error(transparent)]
    Unit(#[from] CallRefused),
    /// A library cannot be used.
    #[error(transparent)]
    Library(#[from] LibraryError),
    /// The archive cannot be made.
    #[error("the archive: {0}")]
    Archive(#[from] zip::result::ZipError),
}

/// Returns the unit of a kind for a machine, whose robot file has this text and name, as the bytes of
/// its file.
///
/// # Errors
/// [`FmuError`].
pub fn fmu(
    kind: Kind,
    name: &str,
    robot_text: &str,
    libraries: &[Library],
) -> Result<Vec<u8>, FmuError> {
    let robot = AnyRobotFile::parse(name, robot_text)?;
    let model = match &robot {
        AnyRobotFile::L2(_) => "l2",
        AnyRobotFile::F1(_) => "f1",
    };
    let unit = Instance::new(kind, robot)?;
    let description = description(kind, model, &unit);
    Ok(archive(kind, &description, robot_text, libraries)?)
}
