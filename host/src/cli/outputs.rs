//! Files that a measurement writes: a robot file, and what belongs to it.

use std::fs;
use std::path::{Path, PathBuf};

use gantry_tau::files::write;
use gantry_tau::robot_file::AnyRobotFile;

/// A file that is asked for, or not, and its text.
pub(super) type Asked<'a> = (Option<&'a Path>, &'a str);

/// A text beside its target, until all texts are there.
struct Prepared {
    target: PathBuf,
    /// `None`: the target is a device or a pipe, which takes its text directly.
    beside: Option<PathBuf>,
}

/// Writes a robot file that can be read, the answer for programs and the page: all of them, or, if one of them cannot be written, none.
pub(super) fn write_learned(
    robot_file: &Path,
    text: &str,
    besides: &[Asked<'_>],
) -> Result<(), Box<dyn std::error::Error>> {
    AnyRobotFile::parse(&robot_file.display().to_string(), text)?;
    let asked = besides.iter().filter_map(|(path, text)| path.map(|path| (path, *text)));
    let files: Vec<(&Path, &str)> = asked.chain([(robot_file, text)]).collect();
    let mut prepared = Vec::new();
    let written = files.iter().try_for_each(|(path, text)| prepare(path, text, &mut prepared));
    let written = written.and_then(|()| {
        prepared.iter().zip(&files).try_for_each(|(Prepared { target, beside }, (_, text))| match beside {
            Some(beside) => fs::rename(beside, target).map_err(|error| cannot(target, &error)),
            None => write(target, text).map_err(|error| error.to_string()),
        })
    });
    // What has been renamed is not there any more.
    prepared.iter().filter_map(|file| file.beside.as_ref()).for_each(|beside| _ = fs::remove_file(beside));
    Ok(written?)
}

/// Writes a text beside its target, with the permissions of the file that it replaces.
fn prepare(path: &Path, text: &str, prepared: &mut Vec<Prepared>) -> Result<(), String> {
    let old = fs::metadata(path).ok();
    if old.as_ref().is_some_and(fs::Metadata::is_dir) {
        return Err(format!("cannot write {}: it is a directory; name a file", path.display()));
    }
    // A link stays: the file that it names is replaced.
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    if old.as_ref().is_some_and(|old| !old.is_file()) {
        prepared.push(Prepared { target, beside: None });
        return Ok(());
    }
    if old.as_ref().is_some_and(|old| old.permissions().readonly()) {
        return Err(format!("cannot write {}: it is read-only", path.display()));
    }
    let name = target.file_name().ok_or_else(|| format!("cannot write {}: name a file", path.display()))?;
    let mut beside = name.to_owned();
    beside.push(format!(".{}-{}.new", std::process::id(), prepared.len()));
    let beside = target.with_file_name(beside);
    prepared.push(Prepared { target, beside: Some(beside.clone()) });
    fs::write(&beside, text).map_err(|error| cannot(path, &error))?;
    match old {
        Some(old) => fs::set_permissions(&beside, old.permissions()).map_err(|error| cannot(path, &error)),
        None => Ok(()),
    }
}

fn cannot(path: &Path, error: &std::io::Error) -> String {
    format!("cannot write {}: {error}; check its directory", path.display())
}

#[cfg(test)]
mod tests {
    use super::*;
    const L2_TEXT: &str = include_str!("../../../robots/l2.toml");

    /// One target that cannot be written: nothing is, and an old file stays as it was.
    #[test]
    fn all_files_are_written_or_none() {
        let directory = std::env::temp_dir().join(format!("gantry-tau-outputs-{}", std::process::id()));
        fs::create_dir_all(&directory).unwrap();
        let (robot, json) = (directory.join("robot.toml"), directory.join("answer.json"));
        fs::write(&json, "old").unwrap();
        let missing = directory.join("no").join("page.html");
        let asked: [Asked<'_>; 2] = [(Some(&json), "new"), (Some(&missing), "page")];
        let error = write_learned(&robot, L2_TEXT, &asked).unwrap_err().to_string();
        assert!(error.contains("page.html"), "{error}");
        assert_eq!(fs::read_to_string(&json).unwrap(), "old");
        let names = || fs::read_dir(&directory).unwrap().map(|entry| entry.unwrap().file_name()).collect::<Vec<_>>();
        assert_eq!(names(), ["answer.json"]);
        write_learned(&robot, L2_TEXT, &asked[..1]).unwrap();
        assert_eq!(fs::read_to_string(&json).unwrap(), "new");
        assert_eq!(fs::read_to_string(&robot).unwrap(), L2_TEXT);
        assert_eq!(names().len(), 2);
        fs::remove_dir_all(&directory).unwrap();
    }
}
