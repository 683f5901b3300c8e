//! Files that a measurement writes: a robot file, and what belongs to it.

use std::path::Path;

use gantry_tau::files::write;
use gantry_tau::robot_file::AnyRobotFile;

/// A file that is asked for, or not, and its text.
pub(super) type Asked<'a> = (Option<&'a Path>, &'a str);

/// Writes a robot file that can be read, after the answer for programs and the page: if one of them cannot be written there is no robot
/// file.
pub(super) fn write_learned(
    robot_file: &Path,
    text: &str,
    besides: &[Asked<'_>],
) -> Result<(), Box<dyn std::error::Error>> {
    AnyRobotFile::parse(&robot_file.display().to_string(), text)?;
    for (path, text) in besides {
        if let Some(path) = path {
            write(path, text)?;
        }
    }
    Ok(write(robot_file, text)?)
}
