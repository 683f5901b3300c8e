//! Any text as a robot file: it is read, or refused in one line that names the file and says why.

use gantry_tau_machine::robot_file::{AnyRobotFile, RobotFileError};

const NAME: &str = "robots/fuzzed.toml";

/// The bytes are the text.
pub fn config(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else {
        return;
    };
    match AnyRobotFile::parse(NAME, text) {
        Ok(robot) => is_finite(&format!("{robot:?}")),
        Err(error) => is_told(&error),
    }
}

fn is_told(error: &RobotFileError) {
    let line = error.to_string();
    assert_eq!(error.file, NAME, "an error names its file");
    assert!(!error.reason.is_empty(), "an error says why: {line}");
    assert!(!line.contains(['\n', '\r']), "one line: {line}");
}

/// No number of a machine that was accepted is infinite or none, whichever machine it is: their
/// `Debug` would say so.
fn is_finite(machine: &str) {
    let words = machine.split(|c: char| !c.is_ascii_alphanumeric());
    for word in words {
        assert!(!["NaN", "inf"].contains(&word), "finite: {machine}");
    }
}
